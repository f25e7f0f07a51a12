#include "mpm_hpc/parallel/distribution.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <map>
#include <unordered_map>

#include "bytes.hpp"
#include "mpm_hpc/base/error.hpp"

namespace mpm {

namespace {

template <int Dim>
Vec<Dim> position_of(const Body<Dim>& body, Index p) {
  Vec<Dim> x;
  for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a)[p];
  return x;
}

template <int Dim>
std::string describe_place(const Vec<Dim>& x) {
  std::string text = fmt::format("({:.6g}, {:.6g}", x[0], x[1]);
  if constexpr (Dim == 3) text += fmt::format(", {:.6g}", x[2]);
  return text + ")";
}

// The first place from `first` on whose position is outside the domain or not finite; the number of places if there is none.
template <int Dim>
Index first_outside(const Body<Dim>& body, const GridGeometry<Dim>& grid, Index first) {
  constexpr Index at_once = 256;
  constexpr Real most = std::numeric_limits<Real>::max();
  const Index size = body.particles.size();
  const auto inside = [&](Index begin, Index end) {
    Index sides = 0;  // counted, because GCC doesn't take a product of truths into lanes
    for (int a = 0; a < Dim; ++a) {
      const Real lower = grid.periodic(a) ? -most : grid.lower()[a], upper = grid.periodic(a) ? most : grid.upper()[a];
      const Real* x = body.particles.template data<Real>(core::position, a);
      for (Index p = begin; p < end; ++p) sides += (x[p] >= lower) & (x[p] <= upper);
    }
    return sides == Dim * (end - begin);
  };
  while (first < size && inside(first, std::min(first + at_once, size))) first += at_once;
  while (first < size && inside(first, first + 1)) ++first;
  return std::min(first, size);
}

}  // namespace

template <int Dim>
typename Decomposition<Dim>::Weights Distribution<Dim>::weights(const std::vector<Body<Dim>>& bodies,
                                                                Real factor) const {
  std::unordered_map<GlobalIndex, Real> sums;
  RecentBlocks<Dim, Real*> recent;
  for (const Body<Dim>& body : bodies)
    for_each_run(body, grid_, options_.kernel_shift, [&](const BlockRun<Dim>& run) {
      if (run.padding) return;
      Real* sum = recent(run.block, [&] { return &sums[decomposition_.grain(run.block)]; });
      *sum += factor * static_cast<Real>(run.end - run.begin);
    });
  typename Decomposition<Dim>::Weights result(sums.begin(), sums.end());
  std::sort(result.begin(), result.end());
  return result;
}

template <int Dim>
void Distribution<Dim>::wrap(std::vector<Body<Dim>>& bodies) const {
  if (!grid_.any_periodic()) return;
  for (Body<Dim>& body : bodies)
    for (Index p = 0; p < body.particles.size(); ++p) {
      if (body.is_padding(p)) continue;
      const Vec<Dim> x = position_of(body, p);
      if (!x.allFinite()) continue;  // found by the leave policy
      const Vec<Dim> wrapped = wrapped_place(grid_, x, options_.kernel_shift);
      for (int a = 0; a < Dim; ++a) body.particles.template data<Real>(core::position, a)[p] = wrapped[a];
    }
}

template <int Dim>
bool Distribution<Dim>::left_through_open_side(const Vec<Dim>& x) const {
  for (int a = 0; a < Dim; ++a)
    if ((options_.open[2 * a] && x[a] < grid_.lower()[a]) ||
        (options_.open[2 * a + 1] && x[a] > grid_.upper()[a]))
      return true;
  return false;
}

template <int Dim>
void Distribution<Dim>::apply_leave_policy(std::vector<Body<Dim>>& bodies) {
  std::string failure;
  for (Body<Dim>& body : bodies) {
    for (Index p = first_outside(body, grid_, 0); p < body.particles.size(); p = first_outside(body, grid_, p + 1)) {
      if (body.is_padding(p)) continue;
      const Vec<Dim> x = position_of(body, p);
      if (left_through_open_side(x)) {
        body.particles.template data<GlobalIndex>(core::id)[p] = padding_id;
        ++left_;
      } else if (options_.leave_policy == LeavePolicy::stop || !x.allFinite()) {
        if (failure.empty())
          failure = fmt::format(
              "particle {} of body \"{}\" left the domain at {} m; enlarge the domain, put a wall there, "
              "name the "
              "side in domain.open, or choose domain.on_leave = \"delete\" or \"keep\"",
              body.particles.template data<GlobalIndex>(core::id)[p], body.name, describe_place<Dim>(x));
      } else if (options_.leave_policy == LeavePolicy::remove) {
        body.particles.template data<GlobalIndex>(core::id)[p] = padding_id;
        ++removed_;
      } else {
        ++kept_;
        with_precision(options_.precision, [&](auto zero) {
          using T = decltype(zero);
          for (int a = 0; a < Dim; ++a) {
            T& v = body.particles.template data<T>(core::velocity, a)[p];
            if (grid_.periodic(a)) continue;
            const bool below = x[a] < grid_.lower()[a], above = x[a] > grid_.upper()[a];
            if ((below && v < 0) || (above && v > 0)) v = 0;
            body.particles.template data<Real>(core::position, a)[p] =
                std::clamp(x[a], grid_.lower()[a], grid_.upper()[a]);
          }
        });
      }
    }
  }
  communicator_.fail_together(failure);
}

namespace {

// Numbers of particles per body that come from any rank, when each rank says how many go to whom. Collective.
template <class Leaving>
std::vector<GlobalIndex> count_arrivals(const Communicator& communicator, const std::vector<Leaving>& leaving) {
  std::map<int, std::vector<GlobalIndex>> counts;
  for (std::size_t b = 0; b < leaving.size(); ++b)
    for (const auto& [owner, particles] : leaving[b].particles) {
      counts[owner].resize(leaving.size());
      counts[owner][b] = static_cast<GlobalIndex>(particles.size());
    }
  std::map<int, Communicator::Bytes> outgoing;
  for (const auto& [owner, list] : counts) outgoing[owner] = to_bytes(list);
  std::vector<GlobalIndex> arrivals(leaving.size(), 0);
  for (const auto& [source, bytes] : communicator.exchange(outgoing)) {
    const std::vector<GlobalIndex> list = from_bytes<GlobalIndex>(bytes);
    for (std::size_t b = 0; b < arrivals.size(); ++b) arrivals[b] += list[b];
  }
  return arrivals;
}

// New free places behind the particles.
template <int Dim>
void add_places(Body<Dim>& body, std::vector<Index>& free, Index count) {
  const Index first = body.particles.size();
  body.particles.resize(first + count);
  GlobalIndex* ids = body.particles.template data<GlobalIndex>(core::id);
  for (Index p = first; p < first + count; ++p) {
    ids[p] = padding_id;
    free.push_back(p);
  }
}

// Removes padding, if it is much.
template <int Dim>
void close_gaps(Body<Dim>& body) {
  std::vector<Index> real;
  real.reserve(static_cast<std::size_t>(body.real_particles()));
  if (real.capacity() > static_cast<std::size_t>(body.particles.size()) / 16 * 15) return;
  for (Index p = 0; p < body.particles.size(); ++p)
    if (!body.is_padding(p)) real.push_back(p);
  body.particles.gather(real);
}

// The last `count` free places.
template <int Dim>
std::vector<Index> take_places(Body<Dim>& body, std::vector<Index>& free, Index count) {
  const Index present = static_cast<Index>(free.size());
  if (count > present) add_places(body, free, count - present);
  const std::vector<Index> places(free.end() - count, free.end());
  free.resize(free.size() - places.size());
  return places;
}

}  // namespace

template <int Dim>
std::vector<typename Distribution<Dim>::Leaving> Distribution<Dim>::find_leaving(
    const std::vector<Body<Dim>>& bodies) const {
  std::vector<Leaving> leaving(bodies.size());
  RecentBlocks<Dim, int> recent;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto append = [](const BlockRun<Dim>& run, std::vector<Index>& list) {
      for (Index p = run.begin; p < run.end; ++p) list.push_back(p);
    };
    for_each_run(bodies[b], grid_, options_.kernel_shift, [&](const BlockRun<Dim>& run) {
      if (run.padding) return append(run, leaving[b].free);
      const int owner = recent(run.block, [&] { return decomposition_.owner(run.block); });
      if (owner != communicator_.rank()) append(run, leaving[b].particles[owner]);
    });
  }
  return leaving;
}

template <int Dim>
void Distribution<Dim>::migrate(std::vector<Body<Dim>>& bodies) {
  if (communicator_.size() == 1) return;
  std::vector<Leaving> leaving = find_leaving(bodies);
  std::vector<GlobalIndex> arrivals = count_arrivals(communicator_, leaving);
  // When one body grows here while another one shrinks, columns are made longer and shorter in between.
  GlobalIndex grown = 0, held = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    grown += std::max<GlobalIndex>(arrivals[b] - leaving[b].count(), 0);
    held += bodies[b].particles.size();
  }
  const bool several = communicator_.any(bodies.size() > 1 && grown > held / 8);
  const int stages = several ? 8 : 1;
  for (int stage = 0; stage < stages; ++stage) {
    if (stage > 0) leaving = find_leaving(bodies);
    if (several) {
      for (Leaving& l : leaving)
        for (auto& [owner, particles] : l.particles)
          particles.resize(particles.size() / static_cast<std::size_t>(stages - stage));
      arrivals = count_arrivals(communicator_, leaving);
    }
    send_and_receive(bodies, leaving, arrivals);
    if (several)
      for (Body<Dim>& body : bodies) close_gaps(body);
  }
}

template <int Dim>
void Distribution<Dim>::send_and_receive(std::vector<Body<Dim>>& bodies, std::vector<Leaving>& leaving,
                                         const std::vector<GlobalIndex>& arrivals) {
  GlobalIndex held = 0, gone = 0, come = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const GlobalIndex going = leaving[b].count(), free = static_cast<GlobalIndex>(leaving[b].free.size());
    held += bodies[b].particles.size() - free;
    gone += going;
    come += arrivals[b];
    // Once, since growing moves every column.
    if (arrivals[b] > going + free) add_places(bodies[b], leaving[b].free, static_cast<Index>(arrivals[b] - going - free));
  }
  migrated_ += gone;

  // A round takes the same part of every list, so that no rank gets much at once: about a thirty-second of what it holds.
  const GlobalIndex at_once = std::max<GlobalIndex>(std::max(held, held - gone + come) / 32, 1 << 12);
  const GlobalIndex rounds = communicator_.max((std::max(gone, come) + at_once - 1) / at_once);
  for (GlobalIndex round = 0; round < rounds; ++round) {
    std::map<int, Communicator::Bytes> outgoing;
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      GlobalIndex* ids = bodies[b].particles.template data<GlobalIndex>(core::id);
      for (const auto& [owner, particles] : leaving[b].particles) {
        const std::size_t begin = particles.size() * round / rounds, end = particles.size() * (round + 1) / rounds;
        if (begin == end) continue;
        const std::span<const Index> part(particles.data() + begin, end - begin);
        Communicator::Bytes& bytes = outgoing[owner];
        const GlobalIndex header[2] = {static_cast<GlobalIndex>(b), static_cast<GlobalIndex>(part.size())};
        const char* raw = reinterpret_cast<const char*>(header);
        bytes.insert(bytes.end(), raw, raw + sizeof(header));
        bodies[b].particles.pack(part, bytes);
        for (Index p : part) ids[p] = padding_id;
        leaving[b].free.insert(leaving[b].free.end(), part.begin(), part.end());
      }
    }
    for (const auto& [source, bytes] : communicator_.exchange(outgoing)) {
      for (std::size_t at = 0; at < bytes.size();) {
        GlobalIndex header[2];
        std::memcpy(header, &bytes[at], sizeof(header));
        at += sizeof(header);
        Body<Dim>& body = bodies[header[0]];
        const std::vector<Index> places = take_places(body, leaving[header[0]].free, static_cast<Index>(header[1]));
        body.particles.unpack(&bytes[at], places);
        at += places.size() * static_cast<std::size_t>(body.particles.bytes_per_particle());
      }
    }
  }
}

namespace {

constexpr Real least_gain = 0.02;  // in max/mean weight

}  // namespace

template <int Dim>
bool Distribution<Dim>::wants_partition(OrderWithinCell within) {
  constexpr int patience = 10;
  if (within == OrderWithinCell::canonical) settled_ = 0;  // a checkpoint doesn't carry it, so a run that goes on forgets it too
  if (settled_ == 0) sorts_since_partition_ = 0;
  ++sorts_since_partition_;
  return imbalance_ > options_.rebalance_threshold &&
         (sorts_since_partition_ > patience || imbalance_ > settled_ + least_gain);
}

template <int Dim>
void Distribution<Dim>::redistribute(std::vector<Body<Dim>>& bodies, GridFields& fields, OrderWithinCell within,
                                     Real seconds) {
  wrap(bodies);
  apply_leave_policy(bodies);
  if (decomposition_.empty()) {
    auto first = weights(bodies, 1);
    if (decomposition_.choose(communicator_, static_cast<GlobalIndex>(first.size()))) first = weights(bodies, 1);
    decomposition_.partition(communicator_, first, 0);
  }
  migrate(bodies);

  const auto held = [&] {
    GlobalIndex count = 0;
    for (const auto& body : bodies) count += body.real_particles();
    return static_cast<Real>(count);
  };
  const Real particles = held();
  const Real factor = options_.weigh_by_time && seconds > 0 && particles > 0 ? seconds / particles : 1;
  imbalance_ = decomposition_.imbalance(communicator_, factor * particles);
  if (communicator_.size() > 1 && wants_partition(within)) {
    // A new partition must win 2 % at least, or particles would be sent back and forth for nothing.
    ++partitions_;
    if (decomposition_.partition(communicator_, weights(bodies, factor), least_gain)) {
      ++rebalances_;
      migrate(bodies);
      imbalance_ = decomposition_.imbalance(communicator_, factor * held());
    }
    settled_ = imbalance_;
    sorts_since_partition_ = 0;
  }

  std::vector<std::vector<BlockKey>> keys;
  std::vector<BlockKey> occupied;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    keys.push_back(order_particles(bodies[b], grid_, options_.kernel_shift, padding_width(options_.precision), within));
    occupied.insert(occupied.end(), keys.back().begin(), keys.back().end());
  }
  std::sort(occupied.begin(), occupied.end());
  occupied.erase(std::unique(occupied.begin(), occupied.end()), occupied.end());
  halo_.rebuild(communicator_, decomposition_, occupied, options_.kernel_support, topology_);
  if (needs_row_halo_)
    row_halo_.rebuild_for_rows(communicator_, decomposition_, options_.kernel_support - 1, topology_);

  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body<Dim>& body = bodies[b];
    body.boundary.clear();
    body.interior.clear();
    for (std::size_t r = 0; r < body.ranges.size(); ++r) {
      BlockRange& range = body.ranges[r];
      range.slot = topology_.find(keys[b][range.slot]);
      const Slot* around = topology_.neighbours(range.slot);
      const bool reaches_ghost =
          std::any_of(around, around + block_neighbours<Dim>, [&](Slot s) { return s >= topology_.owned(); });
      (reaches_ghost ? body.boundary : body.interior).push_back(static_cast<int>(r));
    }
  }
  fields.resize(static_cast<std::size_t>(topology_.size()) * nodes_per_block<Dim>);
  ++sorts_;
}

template class Distribution<2>;
template class Distribution<3>;

}  // namespace mpm
