#include "mpm_hpc/parallel/partition.hpp"

#include <metis.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

template <int Dim>
std::vector<int> graph_partition(const IntVec<Dim>& counts, const BlockWeights& weights, int parts) {
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
  Real largest = 0, total = 0;
  for (const auto& w : weights) {
    largest = std::max(largest, w.second);
    total += w.second;
  }
  // METIS wants integers whose sum stays far from overflow.
  const Real steps = std::min(2000.0, std::numeric_limits<idx_t>::max() / 4 / (total / largest));
  for (idx_t i = 0; i < n; ++i) {
    vertex_weight.push_back(
        std::max<idx_t>(1, static_cast<idx_t>(std::lround(weights[i].second / largest * steps))));
    for_face_neighbours<Dim>(weights[i].first, counts, [&](GlobalIndex block) {
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
  const int status =
      method(&count, &constraints, start.data(), adjacent.data(), vertex_weight.data(), nullptr,
             edge_weight.data(), &wanted, nullptr, nullptr, options.data(), &cut, part.data());
  debug_check(status == METIS_OK, "METIS failed to partition the blocks");
  std::copy(part.begin(), part.end(), result.begin());
  return result;
}

namespace {

template <int Dim>
struct PlacedBlock {
  IntVec<Dim> place;
  Real weight;
  int number;
};

template <int Dim>
using Placed = typename std::vector<PlacedBlock<Dim>>::iterator;

// Calls assign(number, part) for the blocks of [begin, end), divided among `parts` from `first` on; there are at least as
// many blocks as parts.
template <int Dim, class F>
void bisect(Placed<Dim> begin, Placed<Dim> end, int first, int parts, F&& assign) {
  if (parts == 1) {
    for (auto block = begin; block != end; ++block) assign(block->number, first);
    return;
  }
  IntVec<Dim> lower = begin->place, upper = begin->place;
  Real total = 0;
  for (auto block = begin; block != end; ++block) {
    lower = lower.cwiseMin(block->place);
    upper = upper.cwiseMax(block->place);
    total += block->weight;
  }
  int along = 0;
  (upper - lower).maxCoeff(&along);
  auto before = [along](const PlacedBlock<Dim>& a, const PlacedBlock<Dim>& b) {
    if (a.place[along] != b.place[along]) return a.place[along] < b.place[along];
    return std::lexicographical_compare(a.place.begin(), a.place.end(), b.place.begin(), b.place.end());
  };
  // Halves the range that the cut lies in.
  const int below = parts / 2;
  const Real wanted = total * below / parts;
  Real sum = 0;
  auto low = begin, high = end;
  while (high - low > 1) {
    const auto middle = low + (high - low) / 2;
    std::nth_element(low, middle, high, before);
    Real half = 0;
    for (auto block = low; block != middle; ++block) half += block->weight;
    if (sum + half <= wanted) {
      sum += half;
      low = middle;
    } else {
      high = middle;
    }
  }
  if (low->weight / 2 < wanted - sum) ++low;
  const auto cut = std::clamp(low, begin + below, end - (parts - below));
  if (cut != low) std::nth_element(begin, cut, end, before);
  bisect<Dim>(begin, cut, first, below, assign);
  bisect<Dim>(cut, end, first + below, parts - below, assign);
}

}  // namespace

template <int Dim>
std::vector<int> bisection_partition(const IntVec<Dim>& counts, const BlockWeights& weights, int parts) {
  std::vector<int> result(weights.size(), 0);
  if (static_cast<int>(weights.size()) <= parts) {
    std::iota(result.begin(), result.end(), 0);
    return result;
  }
  std::vector<PlacedBlock<Dim>> blocks;
  blocks.reserve(weights.size());
  for (const auto& [block, weight] : weights)
    blocks.push_back({coarse_coordinates<Dim>(block, counts), weight, static_cast<int>(blocks.size())});
  bisect<Dim>(blocks.begin(), blocks.end(), 0, parts, [&](int number, int part) { result[number] = part; });
  return result;
}

template <int Dim>
std::vector<int> partition_blocks(Partitioner partitioner, const IntVec<Dim>& counts,
                                  const BlockWeights& weights, int parts) {
  if (partitioner == Partitioner::metis) return graph_partition<Dim>(counts, weights, parts);
  std::vector<int> bisected = bisection_partition<Dim>(counts, weights, parts);
  // Within these bounds METIS takes less than half a second.
  constexpr Real good = 1.02;
  constexpr std::size_t most_blocks = std::size_t{1} << 16;
  constexpr int most_parts = 256;
  if (partitioner == Partitioner::bisection || weights.size() > most_blocks || parts > most_parts)
    return bisected;
  const Real imbalance = max_over_mean(weights, bisected, parts);
  if (imbalance <= good) return bisected;
  std::vector<int> by_graph = graph_partition<Dim>(counts, weights, parts);
  return max_over_mean(weights, by_graph, parts) < imbalance ? by_graph : bisected;
}

std::vector<int> renamed_parts(const BlockWeights& weights, const std::vector<int>& parts,
                               const std::vector<std::int32_t>& owners, int ranks) {
  if (owners.empty()) return parts;
  std::map<std::pair<int, int>, Real> overlap;  // (part, present owner) -> weight
  for (std::size_t i = 0; i < weights.size(); ++i)
    overlap[{parts[i], owners[weights[i].first]}] += weights[i].second;
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

template <int Dim>
std::vector<std::int32_t> owners_of_all(const IntVec<Dim>& counts, const BlockWeights& weights,
                                        const std::vector<int>& owners) {
  const GlobalIndex entries = counts.template cast<GlobalIndex>().prod();
  if (weights.empty()) return std::vector<std::int32_t>(entries, 0);
  std::vector<std::int32_t> all(entries, -1);
  std::vector<GlobalIndex> front;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    all[weights[i].first] = owners[i];
    front.push_back(weights[i].first);
  }
  for (std::vector<GlobalIndex> next; !front.empty(); front.swap(next)) {
    next.clear();
    for (GlobalIndex block : front)
      for_face_neighbours<Dim>(block, counts, [&](GlobalIndex other) {
        if (all[other] >= 0) return;
        all[other] = all[block];
        next.push_back(other);
      });
  }
  return all;
}

Real max_over_mean(const BlockWeights& weights, const std::vector<int>& parts, int count) {
  std::vector<Real> load(count, 0);
  for (std::size_t i = 0; i < weights.size(); ++i) load[parts[i]] += weights[i].second;
  const Real total = std::accumulate(load.begin(), load.end(), 0.0);
  return total > 0 ? *std::max_element(load.begin(), load.end()) * count / total : 1.0;
}

#define MPM_INSTANTIATE(Dim)                                                                            \
  template std::vector<int> bisection_partition<Dim>(const IntVec<Dim>&, const BlockWeights&, int);     \
  template std::vector<int> graph_partition<Dim>(const IntVec<Dim>&, const BlockWeights&, int);         \
  template std::vector<int> partition_blocks<Dim>(Partitioner, const IntVec<Dim>&, const BlockWeights&, \
                                                  int);                                                 \
  template std::vector<std::int32_t> owners_of_all<Dim>(const IntVec<Dim>&, const BlockWeights&,        \
                                                        const std::vector<int>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
