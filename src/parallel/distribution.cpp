#include "mpm_hpc/parallel/distribution.hpp"

#include <algorithm>
#include <cstring>
#include <unordered_map>

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

}  // namespace

template <int Dim>
IntVec<Dim> Distribution<Dim>::block_of(const Body<Dim>& body, Index p) const {
  IntVec<Dim> block = base_node(grid_, position_of(body, p), options_.kernel_shift);
  for (int a = 0; a < Dim; ++a) block[a] /= block_side;
  return block;
}

template <int Dim>
typename Decomposition<Dim>::Weights Distribution<Dim>::weights(const std::vector<Body<Dim>>& bodies,
                                                                Real factor) const {
  std::unordered_map<GlobalIndex, Real> sums;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Body<Dim>& body = bodies[b];
    for (Index p = 0; p < body.particles.size(); ++p)
      if (!body.is_padding(p) && (keep_[b].empty() || keep_[b][p]))
        sums[decomposition_.coarse_index(block_of(body, p))] += factor;
  }
  typename Decomposition<Dim>::Weights result(sums.begin(), sums.end());
  std::sort(result.begin(), result.end());
  return result;
}

template <int Dim>
void Distribution<Dim>::apply_leave_policy(std::vector<Body<Dim>>& bodies) {
  std::string failure;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body<Dim>& body = bodies[b];
    keep_[b].clear();
    for (Index p = 0; p < body.particles.size(); ++p) {
      if (body.is_padding(p)) continue;
      const Vec<Dim> x = position_of(body, p);
      if (grid_.contains(x)) continue;
      if (options_.leave_policy == LeavePolicy::stop || !x.allFinite()) {
        if (failure.empty())
          failure = fmt::format(
              "particle {} of body \"{}\" left the domain at {} m; enlarge the domain, put a wall there, or choose "
              "domain.on_leave = \"delete\" or \"keep\"",
              body.particles.template data<GlobalIndex>(core::id)[p], body.name, describe_place<Dim>(x));
      } else if (options_.leave_policy == LeavePolicy::remove) {
        if (keep_[b].empty()) keep_[b].assign(body.particles.size(), 1);
        keep_[b][p] = 0;
        ++removed_;
      } else {
        ++kept_;
        with_precision(options_.precision, [&](auto zero) {
          using T = decltype(zero);
          for (int a = 0; a < Dim; ++a) {
            T& v = body.particles.template data<T>(core::velocity, a)[p];
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

template <int Dim>
void Distribution<Dim>::migrate(std::vector<Body<Dim>>& bodies) {
  if (communicator_.size() == 1) return;
  std::map<int, Communicator::Bytes> outgoing;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    Body<Dim>& body = bodies[b];
    std::map<int, std::vector<Index>> leaving;
    for (Index p = 0; p < body.particles.size(); ++p) {
      if (body.is_padding(p) || (!keep_[b].empty() && !keep_[b][p])) continue;
      const int owner = decomposition_.owner(block_of(body, p));
      if (owner != communicator_.rank()) leaving[owner].push_back(p);
    }
    for (const auto& [owner, particles] : leaving) {
      if (keep_[b].empty()) keep_[b].assign(body.particles.size(), 1);
      for (Index p : particles) keep_[b][p] = 0;
      migrated_ += static_cast<GlobalIndex>(particles.size());
      Communicator::Bytes& bytes = outgoing[owner];
      const GlobalIndex header[2] = {static_cast<GlobalIndex>(b), static_cast<GlobalIndex>(particles.size())};
      const char* raw = reinterpret_cast<const char*>(header);
      bytes.insert(bytes.end(), raw, raw + sizeof(header));
      body.particles.pack(particles, bytes);
    }
  }
  for (const auto& [source, bytes] : communicator_.exchange(outgoing)) {
    for (std::size_t at = 0; at < bytes.size();) {
      GlobalIndex header[2];
      std::memcpy(header, &bytes[at], sizeof(header));
      at += sizeof(header);
      FieldSet& particles = bodies[header[0]].particles;
      const Index first = particles.size(), count = static_cast<Index>(header[1]);
      particles.resize(first + count);
      particles.unpack(&bytes[at], first, count);
      if (!keep_[header[0]].empty()) keep_[header[0]].resize(first + count, 1);
      at += static_cast<std::size_t>(count) * particles.bytes_per_particle();
    }
  }
}

template <int Dim>
void Distribution<Dim>::redistribute(std::vector<Body<Dim>>& bodies, GridFields& fields, OrderWithinCell within,
                                     Real seconds) {
  keep_.resize(bodies.size());
  apply_leave_policy(bodies);
  if (decomposition_.empty()) decomposition_.partition(communicator_, weights(bodies, 1), 0);
  migrate(bodies);

  Real factor = 1;
  if (options_.weigh_by_time && seconds > 0) {
    GlobalIndex count = 0;
    for (const auto& body : bodies) count += body.real_particles();
    if (count > 0) factor = seconds / static_cast<Real>(count);
  }
  auto local = weights(bodies, factor);
  imbalance_ = decomposition_.imbalance(communicator_, local);
  // A new partition must win 2 % at least, or particles would be sent back and forth for nothing.
  if (communicator_.size() > 1 && imbalance_ > options_.rebalance_threshold &&
      decomposition_.partition(communicator_, local, 0.02)) {
    ++rebalances_;
    migrate(bodies);
    local = weights(bodies, factor);
    imbalance_ = decomposition_.imbalance(communicator_, local);
  }

  std::vector<std::vector<BlockKey>> keys;
  std::vector<BlockKey> occupied;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    keys.push_back(order_particles(bodies[b], grid_, options_.kernel_shift, padding_width(options_.precision), keep_[b],
                                   within));
    occupied.insert(occupied.end(), keys.back().begin(), keys.back().end());
    keep_[b].clear();
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
