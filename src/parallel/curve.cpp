#include "mpm_hpc/parallel/curve.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

namespace mpm {

template <int Dim>
GlobalIndex curve_place(IntVec<Dim> block, int levels) {
  if (levels == 0) return 0;
  const std::int32_t top = std::int32_t{1} << (levels - 1);
  for (std::int32_t bit = top; bit > 1; bit >>= 1)
    for (int a = 0; a < Dim; ++a) {
      if (block[a] & bit) {
        block[0] ^= bit - 1;
      } else {
        const std::int32_t swapped = (block[0] ^ block[a]) & (bit - 1);
        block[0] ^= swapped;
        block[a] ^= swapped;
      }
    }
  for (int a = 1; a < Dim; ++a) block[a] ^= block[a - 1];
  std::int32_t turned = 0;
  for (std::int32_t bit = top; bit > 1; bit >>= 1)
    if (block[Dim - 1] & bit) turned ^= bit - 1;
  for (int a = 0; a < Dim; ++a) block[a] ^= turned;
  return static_cast<GlobalIndex>(block_key<Dim>(block));
}

template <int Dim>
int curve_levels(const IntVec<Dim>& blocks) {
  return std::bit_width(static_cast<std::uint32_t>(blocks.maxCoeff() - 1));
}

int piece_of(const CurveCuts& cuts, GlobalIndex place) {
  return static_cast<int>(std::upper_bound(cuts.begin(), cuts.end(), place) - cuts.begin());
}

namespace {

constexpr GlobalIndex beyond_all = std::numeric_limits<GlobalIndex>::max();

// Running sums of weights in whole units, few enough that a double holds every sum over all ranks exactly: cuts don't
// depend on who adds what first.
std::vector<Real> running_sums(const BlockWeights& weights, Real total) {
  constexpr Real units = 0x1p50;
  std::vector<Real> sums{0};
  sums.reserve(weights.size() + 1);
  for (const auto& [place, weight] : weights)
    sums.push_back(sums.back() + std::round(weight / total * units));
  return sums;
}

Real wanted_before(int cut, int pieces, Real total) { return total * cut / pieces; }

// The cut beside the block at `place` that holds the wanted sum: its middle lies before or behind that.
GlobalIndex cut_beside(GlobalIndex place, Real before, Real up_to, Real wanted) {
  return wanted - before <= up_to - wanted ? place : place + 1;
}

// Where the places of the ranks follow one another: every cut is in one rank's hands.
CurveCuts cut_in_order(const Communicator& communicator, const BlockWeights& weights,
                       const std::vector<Real>& sums, Real total, int pieces) {
  CurveCuts cuts(pieces - 1, -1);
  const Real before = static_cast<Real>(communicator.exclusive_sum(static_cast<GlobalIndex>(sums.back())));
  std::size_t block = 0;
  for (int cut = std::max(1, static_cast<int>(before / total * pieces) - 1); cut < pieces; ++cut) {
    const Real wanted = wanted_before(cut, pieces, total) - before;
    if (wanted < 0) continue;
    if (wanted >= sums.back()) break;
    while (sums[block + 1] <= wanted) ++block;
    cuts[cut - 1] = cut_beside(weights[block].first, sums[block], sums[block + 1], wanted);
  }
  communicator.max(cuts);
  return cuts;
}

// Whoever holds what: halves the range in which each cut lies until it is a single block.
CurveCuts cut_by_search(const Communicator& communicator, const BlockWeights& weights,
                        const std::vector<Real>& sums, Real total, int pieces) {
  const std::size_t count = pieces - 1;
  const GlobalIndex end = communicator.max(weights.empty() ? 0 : weights.back().first + 1);
  CurveCuts low(count, 0), high(count, end), middle(count);
  std::vector<Real> below_low(count, 0), below_high(count, total), below(count);
  const auto open = [&](std::size_t i) { return high[i] - low[i] > 1; };
  for (bool searching = count > 0; searching;) {
    searching = false;
    for (std::size_t i = 0; i < count; ++i) {
      middle[i] = low[i] + (high[i] - low[i]) / 2;
      const auto it = std::lower_bound(weights.begin(), weights.end(), middle[i],
                                       [](const auto& w, GlobalIndex place) { return w.first < place; });
      below[i] = sums[it - weights.begin()];
    }
    communicator.sum(below);
    for (std::size_t i = 0; i < count; ++i) {
      if (!open(i)) continue;
      const bool before = below[i] <= wanted_before(static_cast<int>(i) + 1, pieces, total);
      (before ? low : high)[i] = middle[i];
      (before ? below_low : below_high)[i] = below[i];
      searching = searching || open(i);
    }
  }
  for (std::size_t i = 0; i < count; ++i)
    low[i] = cut_beside(low[i], below_low[i], below_high[i],
                        wanted_before(static_cast<int>(i) + 1, pieces, total));
  return low;
}

}  // namespace

CurveCuts cut_curve(const Communicator& communicator, const BlockWeights& weights, int pieces) {
  const Real weight = communicator.sum(std::accumulate(
      weights.begin(), weights.end(), Real{0}, [](Real sum, const auto& w) { return sum + w.second; }));
  if (!(weight > 0)) return CurveCuts(pieces - 1, beyond_all);
  const std::vector<Real> sums = running_sums(weights, weight);
  const Real total = communicator.sum(sums.back());
  const GlobalIndex last = communicator.exclusive_max(weights.empty() ? -1 : weights.back().first);
  const bool behind = !weights.empty() && weights.front().first <= last;
  const auto cut = communicator.any(behind) ? cut_by_search : cut_in_order;
  return cut(communicator, weights, sums, total, pieces);
}

Real max_over_mean(const Communicator& communicator, const BlockWeights& weights, const CurveCuts& cuts) {
  std::vector<Real> load(cuts.size() + 1, 0);
  for (const auto& [place, weight] : weights) load[piece_of(cuts, place)] += weight;
  communicator.sum(load);
  const Real total = std::accumulate(load.begin(), load.end(), Real{0});
  return total > 0 ? *std::max_element(load.begin(), load.end()) * static_cast<Real>(load.size()) / total
                   : 1.0;
}

template GlobalIndex curve_place<2>(IntVec<2>, int);
template GlobalIndex curve_place<3>(IntVec<3>, int);
template int curve_levels<2>(const IntVec<2>&);
template int curve_levels<3>(const IntVec<3>&);

}  // namespace mpm
