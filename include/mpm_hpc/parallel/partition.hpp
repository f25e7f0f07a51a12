// Divides weighted coarse blocks among parts; what Decomposition does on rank 0.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

using BlockWeights = std::vector<std::pair<GlobalIndex, Real>>;  // (coarse block, weight), sorted by block

// Number of a coarse block and its place, of `counts` in each direction; the last direction runs fastest.
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

// A part for each weighted block, of about equal weight and with few common faces: METIS on the graph of face neighbours.
template <int Dim>
std::vector<int> graph_partition(const IntVec<Dim>& counts, const BlockWeights& weights, int parts);

// The same by recursive coordinate bisection (Berger and Bokhari 1987): across the longest side of the blocks' box, by
// weight; within the plane of the cut in the order of the blocks' places. Cuts follow a body that moves.
template <int Dim>
std::vector<int> bisection_partition(const IntVec<Dim>& counts, const BlockWeights& weights, int parts);

// automatic: see Decomposition; curve: pieces of Hilbert's curve, which the ranks cut together.
enum class Partitioner { automatic, bisection, metis, curve };

// What rank 0 does. automatic: by bisection; where that leaves a large imbalance, because few and unequal blocks come on a
// part, METIS tries too, and the better balance wins.
template <int Dim>
std::vector<int> partition_blocks(Partitioner partitioner, const IntVec<Dim>& counts,
                                  const BlockWeights& weights, int parts);

// The parts under names such that little weight leaves its present owner; `owners` are those of all coarse blocks.
std::vector<int> renamed_parts(const BlockWeights& weights, const std::vector<int>& parts,
                               const std::vector<std::int32_t>& owners, int ranks);

// Owners of all coarse blocks from those of the weighted ones: an empty block goes to the owner of a nearest one (breadth
// first, ties by the order of the blocks).
template <int Dim>
std::vector<std::int32_t> owners_of_all(const IntVec<Dim>& counts, const BlockWeights& weights,
                                        const std::vector<int>& owners);

// Largest weight of a part over the mean; 1 if there is no weight.
Real max_over_mean(const BlockWeights& weights, const std::vector<int>& parts, int count);

}  // namespace mpm
