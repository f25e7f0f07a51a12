#include "mpm_hpc/parallel/decomposition.hpp"

#include <metis.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "bytes.hpp"
#include "mpm_hpc/base/error.hpp"

namespace mpm {

template <int Dim>
Decomposition<Dim>::Decomposition(const GridGeometry<Dim>& grid) : blocks_(grid.blocks()) {
  for (shift_ = 0;; ++shift_) {
    entries_ = 1;
    for (int a = 0; a < Dim; ++a) {
      counts_[a] = ((grid.blocks()[a] - 1) >> shift_) + 1;
      entries_ *= counts_[a];
    }
    if (entries_ <= max_entries) break;
  }
}

namespace {

template <int Dim>
IntVec<Dim> coarse_coordinates(GlobalIndex index, const IntVec<Dim>& counts) {
  IntVec<Dim> c;
  for (int a = Dim - 1; a >= 0; --a) {
    c[a] = static_cast<std::int32_t>(index % counts[a]);
    index /= counts[a];
  }
  return c;
}

// Calls f(index) for the face neighbours of a coarse block.
template <int Dim, class F>
void for_face_neighbours(GlobalIndex index, const IntVec<Dim>& counts, F&& f) {
  const IntVec<Dim> c = coarse_coordinates<Dim>(index, counts);
  GlobalIndex stride = 1;
  for (int a = Dim - 1; a >= 0; --a) {
    if (c[a] > 0) f(index - stride);
    if (c[a] + 1 < counts[a]) f(index + stride);
    stride *= counts[a];
  }
}

Real max_over_mean(const std::vector<Real>& load) {
  const Real total = std::accumulate(load.begin(), load.end(), 0.0);
  return total > 0 ? *std::max_element(load.begin(), load.end()) * static_cast<Real>(load.size()) / total : 1.0;
}

}  // namespace

template <int Dim>
std::vector<int> Decomposition<Dim>::partition_graph(const Weights& weights, int parts) const {
  const idx_t n = static_cast<idx_t>(weights.size());
  std::vector<int> result(n, 0);
  if (parts == 1 || n == 0) return result;
  if (n <= parts) {
    std::iota(result.begin(), result.end(), 0);
    return result;
  }
  auto number_of = [&weights](GlobalIndex block) {
    const auto it = std::lower_bound(weights.begin(), weights.end(), block,
                                     [](const auto& w, GlobalIndex b) { return w.first < b; });
    return it != weights.end() && it->first == block ? static_cast<idx_t>(it - weights.begin()) : idx_t{-1};
  };
  std::vector<idx_t> start{0}, adjacent, edge_weight, vertex_weight;
  Real largest = 0;
  for (const auto& w : weights) largest = std::max(largest, w.second);
  for (idx_t i = 0; i < n; ++i) {
    // METIS wants integers: 2000 steps of resolution keep the sum far from overflow.
    vertex_weight.push_back(std::max<idx_t>(1, static_cast<idx_t>(std::lround(weights[i].second / largest * 2000))));
    for_face_neighbours<Dim>(weights[i].first, counts_, [&](GlobalIndex block) {
      const idx_t j = number_of(block);
      if (j < 0) return;
      adjacent.push_back(j);
      edge_weight.push_back(1);
    });
    start.push_back(static_cast<idx_t>(adjacent.size()));
  }
  std::vector<idx_t> part(n), options(METIS_NOPTIONS);
  METIS_SetDefaultOptions(options.data());
  options[METIS_OPTION_SEED] = 1;
  options[METIS_OPTION_UFACTOR] = 10;  // 1 % imbalance asked for
  idx_t constraints = 1, count = n, wanted = parts, cut = 0;
  // Recursive bisection balances few parts better than k-way does.
  const auto method = parts <= 16 ? METIS_PartGraphRecursive : METIS_PartGraphKway;
  const int status = method(&count, &constraints, start.data(), adjacent.data(), vertex_weight.data(), nullptr,
                            edge_weight.data(), &wanted, nullptr, nullptr, options.data(), &cut, part.data());
  debug_check(status == METIS_OK, "METIS failed to partition the blocks");
  std::copy(part.begin(), part.end(), result.begin());
  return result;
}

template <int Dim>
std::vector<int> Decomposition<Dim>::renamed(const Weights& weights, const std::vector<int>& parts,
                                             int ranks) const {
  if (owners_.empty()) return parts;
  std::map<std::pair<int, int>, Real> overlap;  // (part, present owner) -> weight
  for (std::size_t i = 0; i < weights.size(); ++i)
    overlap[{parts[i], owners_[weights[i].first]}] += weights[i].second;
  std::vector<std::pair<Real, std::pair<int, int>>> pairs;
  for (const auto& [pair, weight] : overlap) pairs.push_back({weight, pair});
  std::sort(pairs.begin(), pairs.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second < b.second;
  });
  std::vector<int> name(ranks, -1);
  std::vector<char> taken(ranks, 0);
  for (const auto& [weight, pair] : pairs)
    if (name[pair.first] < 0 && !taken[pair.second]) {
      name[pair.first] = pair.second;
      taken[pair.second] = 1;
    }
  for (int part = 0, free = 0; part < ranks; ++part)
    if (name[part] < 0) {
      while (taken[free]) ++free;
      name[part] = free;
      taken[free] = 1;
    }
  std::vector<int> result(parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i) result[i] = name[parts[i]];
  return result;
}

// Empty coarse blocks go to the owner of a nearest occupied one (breadth first, ties by the order of the blocks).
template <int Dim>
void Decomposition<Dim>::assign(const Weights& weights, const std::vector<int>& owners) {
  owners_.assign(entries_, -1);
  std::vector<GlobalIndex> front;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    owners_[weights[i].first] = owners[i];
    front.push_back(weights[i].first);
  }
  if (front.empty()) owners_.assign(entries_, 0);
  for (std::vector<GlobalIndex> next; !front.empty(); front.swap(next)) {
    next.clear();
    for (GlobalIndex block : front)
      for_face_neighbours<Dim>(block, counts_, [&](GlobalIndex other) {
        if (owners_[other] >= 0) return;
        owners_[other] = owners_[block];
        next.push_back(other);
      });
  }
}

template <int Dim>
bool Decomposition<Dim>::partition(const Communicator& communicator, const Weights& local_weights, Real gain) {
  const int ranks = communicator.size();
  // Rank 0 learns the occupied blocks and their weights, and tells all of them the new owners.
  std::map<GlobalIndex, Real> merged;
  for (const auto& bytes : communicator.gather(to_bytes(local_weights)))
    for (const auto& [block, weight] : from_bytes<std::pair<GlobalIndex, Real>>(bytes)) merged[block] += weight;
  std::vector<GlobalIndex> answer;  // block, owner, block, owner, ..., whether they are new
  if (communicator.root()) {
    const Weights weights(merged.begin(), merged.end());
    const std::vector<int> owners = renamed(weights, partition_graph(weights, ranks), ranks);
    bool better = owners_.empty();
    if (!better) {
      std::vector<Real> before(ranks, 0), after(ranks, 0);
      for (std::size_t i = 0; i < weights.size(); ++i) {
        before[owners_[weights[i].first]] += weights[i].second;
        after[owners[i]] += weights[i].second;
      }
      better = max_over_mean(after) < max_over_mean(before) - gain;
    }
    if (better)
      for (std::size_t i = 0; i < weights.size(); ++i) {
        answer.push_back(weights[i].first);
        answer.push_back(owners[i]);
      }
    answer.push_back(better);
  }
  Communicator::Bytes bytes = to_bytes(answer);
  communicator.broadcast(bytes);
  answer = from_bytes<GlobalIndex>(bytes);
  if (!answer.back()) return false;
  Weights blocks;
  std::vector<int> owners;
  for (std::size_t i = 0; i + 2 < answer.size(); i += 2) {
    blocks.push_back({answer[i], 0.0});
    owners.push_back(static_cast<int>(answer[i + 1]));
  }
  assign(blocks, owners);
  return true;
}

template <int Dim>
Real Decomposition<Dim>::imbalance(const Communicator& communicator, const Weights& local_weights) const {
  // Between two sorts a rank's own particles may lie in a neighbour's block; the weights count where they lie.
  Real mine = 0;
  for (const auto& w : local_weights) mine += w.second;
  const Real mean = communicator.sum(mine) / communicator.size();
  return mean > 0 ? communicator.max(mine) / mean : 1.0;
}

template class Decomposition<2>;
template class Decomposition<3>;

}  // namespace mpm
