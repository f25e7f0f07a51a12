// Hilbert's curve and its pieces against what one process works out from all ranks' blocks.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <map>
#include <numeric>
#include <random>
#include <set>

#include "mpm_hpc/parallel/decomposition.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"

using namespace mpm;
using test::hash_of;

namespace {

Communicator world() { return Communicator::world(); }

template <int Dim>
void walk_the_curve(int levels) {
  const int side = 1 << levels;
  std::map<GlobalIndex, IntVec<Dim>> places;
  for (int n = 0; n < (Dim == 2 ? side * side : side * side * side); ++n) {
    IntVec<Dim> block;
    for (int a = 0, rest = n; a < Dim; ++a, rest /= side) block[a] = rest % side;
    places[curve_place<Dim>(block, levels)] = block;
  }
  ASSERT_EQ(places.rbegin()->first + 1, static_cast<GlobalIndex>(places.size()))
      << "two blocks have one place";
  for (auto it = std::next(places.begin()); it != places.end(); ++it)
    ASSERT_EQ((it->second - std::prev(it)->second).cwiseAbs().sum(), 1)
        << "the curve jumps at place " << it->first;
}

TEST(Curve, VisitsEveryBlockOnceAndGoesToANeighbourEachTime) {
  for (int levels = 0; levels <= 6; ++levels) walk_the_curve<2>(levels);
  for (int levels = 0; levels <= 4; ++levels) walk_the_curve<3>(levels);
  EXPECT_EQ(curve_levels<2>({1, 1}), 0);
  EXPECT_EQ(curve_levels<2>({5, 8}), 3);
  EXPECT_EQ(curve_levels<3>({5, 9, 2}), 4);
}

// The piece of each block, whose middle lies between the wanted sums; `all` holds the blocks' weights.
std::map<GlobalIndex, int> plain_pieces(const std::map<GlobalIndex, Real>& all, int pieces) {
  Real total = 0;
  for (const auto& [place, weight] : all) total += weight;
  std::map<GlobalIndex, int> result;
  Real before = 0;
  for (const auto& [place, weight] : all) {
    result[place] = static_cast<int>((before + weight / 2) / total * pieces);
    before += weight;
  }
  return result;
}

// Ways in which the ranks may hold the blocks' weights.
enum class Dealt { in_order, scattered, shared, to_the_last };

BlockWeights deal(const std::map<GlobalIndex, Real>& all, Dealt dealt) {
  const GlobalIndex ranks = test::size(), me = test::rank();
  BlockWeights mine;
  GlobalIndex number = 0;
  for (const auto& [place, weight] : all) {
    const GlobalIndex in_order = number++ * ranks / static_cast<GlobalIndex>(all.size());
    if (dealt == Dealt::in_order && in_order == me) mine.push_back({place, weight});
    if (dealt == Dealt::scattered && hash_of(place) % ranks == me) mine.push_back({place, weight});
    if (dealt == Dealt::shared)
      mine.push_back({place, weight * static_cast<Real>(2 * (me + 1)) / (ranks * (ranks + 1))});
    if (dealt == Dealt::to_the_last && me == ranks - 1) mine.push_back({place, weight});
  }
  return mine;
}

constexpr Dealt all_ways[] = {Dealt::in_order, Dealt::scattered, Dealt::shared, Dealt::to_the_last};

TEST(Curve, CutsAreThoseOfASortedList) {
  std::mt19937 random(3);
  std::uniform_real_distribution<Real> unit(0.5, 100);
  for (const int blocks : {1, 2, 5, 40, 1000}) {
    std::map<GlobalIndex, Real> all;
    while (static_cast<int>(all.size()) < blocks)
      all[static_cast<GlobalIndex>(random()) << (random() % 30)] = unit(random);
    const Real heaviest = std::max_element(all.begin(), all.end(), [](const auto& a, const auto& b) {
                            return a.second < b.second;
                          })->second;
    for (const int pieces : {1, 2, 3, 7, 16, 100, 3000}) {
      const std::map<GlobalIndex, int> expected = plain_pieces(all, pieces);
      std::vector<Real> load(pieces, 0);
      for (const auto& [place, piece] : expected) load[piece] += all[place];
      const Real mean = std::accumulate(load.begin(), load.end(), 0.0) / pieces;
      const Real largest = *std::max_element(load.begin(), load.end());
      EXPECT_LE(largest, mean + heaviest);
      for (const Dealt dealt : all_ways) {
        const BlockWeights mine = deal(all, dealt);
        const CurveCuts cuts = cut_curve(world(), mine, pieces);
        ASSERT_EQ(static_cast<int>(cuts.size()), pieces - 1);
        EXPECT_TRUE(std::is_sorted(cuts.begin(), cuts.end()));
        for (const auto& [place, piece] : expected)
          ASSERT_EQ(piece_of(cuts, place), piece)
              << "of " << pieces << " pieces of " << blocks << " blocks, dealt " << static_cast<int>(dealt);
        EXPECT_NEAR(max_over_mean(world(), mine, cuts), largest / mean, 1e-9 * largest / mean);
      }
    }
  }
}

TEST(Curve, EqualBlocksAreCountedOut) {
  for (const int blocks : {3, 16, 100})
    for (const int pieces : {2, 3, 5, 16, 31})
      for (const Dealt dealt : all_ways) {
        std::map<GlobalIndex, Real> all;
        for (int b = 0; b < blocks; ++b) all[5 * b + 2] = 64;
        const CurveCuts cuts = cut_curve(world(), deal(all, dealt), pieces);
        std::vector<int> count(pieces, 0);
        for (const auto& [place, weight] : all) ++count[piece_of(cuts, place)];
        EXPECT_GE(*std::min_element(count.begin(), count.end()), blocks / pieces);
        EXPECT_LE(*std::max_element(count.begin(), count.end()), (blocks + pieces - 1) / pieces);
      }
}

TEST(Curve, AHeavyBlockStandsAloneAmongItsLightNeighbours) {
  std::map<GlobalIndex, Real> all;
  for (int b = 0; b < 101; ++b) all[b] = b == 50 ? 1e6 : 1.0;
  for (const Dealt dealt : all_ways) {
    const BlockWeights mine = deal(all, dealt);
    const CurveCuts cuts = cut_curve(world(), mine, 8);
    // All seven wanted sums lie within the heavy block.
    EXPECT_NEAR(max_over_mean(world(), mine, cuts), 8e6 / (1e6 + 100), 1e-9);
    std::set<int> pieces;
    for (const auto& [place, weight] : all) pieces.insert(piece_of(cuts, place));
    EXPECT_EQ(pieces.size(), 3u);
  }
}

TEST(Curve, WithoutWeightTheFirstPieceHoldsAll) {
  const CurveCuts cuts = cut_curve(world(), {}, 5);
  EXPECT_EQ(cuts.size(), 4u);
  EXPECT_EQ(piece_of(cuts, 0), 0);
  EXPECT_EQ(piece_of(cuts, GlobalIndex{1} << 62), 0);
  EXPECT_EQ(max_over_mean(world(), {}, cuts), 1.0);
}

// This rank's share of the blocks of a box, dealt out one by one.
BlockWeights box(const Decomposition<3>& d, const IntVec<3>& lower, const IntVec<3>& upper) {
  std::map<GlobalIndex, Real> mine;
  for (int x = lower[0]; x < upper[0]; ++x)
    for (int y = lower[1]; y < upper[1]; ++y)
      for (int z = lower[2]; z < upper[2]; ++z)
        if ((x + y + z) % test::size() == test::rank()) mine[d.grain({x, y, z})] += 1;
  return {mine.begin(), mine.end()};
}

TEST(Curve, OwnersFollowAMovingBodyAndOnlyBlocksAtTheCutsChangeHands) {
  Decomposition<3> d(GridGeometry<3>(Vec<3>::Zero(), Vec<3>::Constant(200), 1), Partitioner::curve);
  EXPECT_TRUE(d.empty());
  const IntVec<3> lower(6, 7, 8), upper(22, 20, 21);
  EXPECT_TRUE(d.partition(world(), box(d, lower, upper), 0));
  EXPECT_FALSE(d.empty());
  EXPECT_TRUE(d.owners().empty());
  EXPECT_EQ(static_cast<int>(d.cuts().size()), test::size() - 1);
  EXPECT_FALSE(d.partition(world(), box(d, lower, upper), 0)) << "no better than itself";
  std::vector<std::int32_t> before;
  for (int shift = 1; shift <= 8; ++shift) {
    const IntVec<3> by(shift, 0, 0);
    const BlockWeights mine = box(d, lower + by, upper + by);
    const CurveCuts old = d.cuts();
    d.partition(world(), mine, -1e9);
    EXPECT_LT(max_over_mean(world(), mine, d.cuts()), 1.01);
    Real moved = 0, total = 0;
    for (const auto& [place, weight] : mine) {
      total += weight;
      if (piece_of(old, place) != piece_of(d.cuts(), place)) moved += weight;
    }
    moved = world().sum(moved) / world().sum(total);
    if (test::rank() == 0)
      std::printf("shift %d moves %.3f of the weight, expected below 0.3\n", shift, moved);
    EXPECT_LT(moved, 0.3);
  }
  Real checksum = 0;
  for (int n = 0; n < 1000; ++n) checksum += n * d.owner({n % 10 * 5, n / 10 % 10 * 5, n / 100 * 5});
  EXPECT_EQ(world().max(checksum), world().min(checksum)) << "ranks disagree";
}

TEST(Curve, AutomaticTakesItWhereACoarseTableLeavesFewEntries) {
  const auto chosen = [](Real cells, const IntVec<3>& blocks) {
    Decomposition<3> d(GridGeometry<3>(Vec<3>::Zero(), Vec<3>::Constant(cells), 1));
    EXPECT_FALSE(d.on_curve());
    const BlockWeights mine = box(d, IntVec<3>::Constant(4), IntVec<3>::Constant(4) + blocks);
    const bool changed = d.choose(world(), static_cast<GlobalIndex>(mine.size()));
    EXPECT_EQ(changed, d.on_curve());
    d.partition(world(), box(d, IntVec<3>::Constant(4), IntVec<3>::Constant(4) + blocks), 0);
    if (test::rank() == 0) std::printf("%s\n", d.describe().c_str());
    EXPECT_FALSE(d.choose(world(), 1)) << "owners there are stay";
    return d.on_curve();
  };
  EXPECT_FALSE(chosen(100, {4, 4, 4})) << "a table that isn't coarse";
  EXPECT_EQ(chosen(2000, {4, 4, 4}), test::size() > 1);
  EXPECT_FALSE(chosen(2000, {40, 40, 40})) << "enough entries";
}

TEST(Curve, RestoresWhatFits) {
  const GridGeometry<3> grid(Vec<3>::Zero(), Vec<3>::Constant(100), 1);
  Decomposition<3> curve(grid, Partitioner::curve), table(grid, Partitioner::bisection);
  const IntVec<3> lower = IntVec<3>::Constant(5), upper = IntVec<3>::Constant(15);
  curve.partition(world(), box(curve, lower, upper), 0);
  table.partition(world(), box(table, lower, upper), 0);
  const auto restored = [&](Partitioner partitioner, const Decomposition<3>& from, int ranks) {
    Decomposition<3> d(grid, partitioner);
    d.restore(from.owners(), from.cuts(), ranks);
    if (d.empty()) return false;
    EXPECT_EQ(d.on_curve(), from.on_curve());
    for (int n = 0; n < 27; ++n) {
      const IntVec<3> block(5 + n % 3 * 4, 5 + n / 3 % 3 * 4, 5 + n / 9 * 4);
      EXPECT_EQ(d.owner(block), from.owner(block));
    }
    return true;
  };
  EXPECT_TRUE(restored(Partitioner::curve, curve, test::size()));
  EXPECT_TRUE(restored(Partitioner::automatic, curve, test::size()));
  EXPECT_TRUE(restored(Partitioner::automatic, table, test::size()));
  EXPECT_TRUE(restored(Partitioner::metis, table, test::size()));
  EXPECT_FALSE(restored(Partitioner::curve, curve, test::size() + 1));
  EXPECT_FALSE(restored(Partitioner::curve, table, test::size()));
  EXPECT_FALSE(restored(Partitioner::metis, curve, test::size()));
}

}  // namespace
