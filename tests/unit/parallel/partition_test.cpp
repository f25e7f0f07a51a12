// Partitions of weighted blocks against bounds that follow from the weights.
#include "mpm_hpc/parallel/partition.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <numeric>
#include <random>

using namespace mpm;

namespace {

std::vector<Real> loads(const BlockWeights& weights, const std::vector<int>& parts, int count) {
  std::vector<Real> load(count, 0);
  for (std::size_t i = 0; i < weights.size(); ++i) load.at(parts[i]) += weights[i].second;
  return load;
}

TEST(Partition, BisectionOfARowIsTheObviousOne) {
  const IntVec<2> counts(1, 12);
  BlockWeights weights;
  for (int i = 0; i < 12; ++i) weights.push_back({i, 1.0});
  EXPECT_EQ(bisection_partition<2>(counts, weights, 4),
            (std::vector<int>{0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3}));
  EXPECT_EQ(bisection_partition<2>(counts, weights, 3),
            (std::vector<int>{0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2}));
  weights[0].second = 11;
  EXPECT_EQ(bisection_partition<2>(counts, weights, 2),
            (std::vector<int>{0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}));
}

// A cut misses the wanted weight by half the heaviest block at most, and the next cuts share what it missed: no part exceeds
// the mean by more than the heaviest block.
TEST(Partition, BisectionIsAsEvenAsTheHeaviestBlockAllows) {
  std::mt19937 random(1);
  const IntVec<3> counts(17, 30, 12);
  Real worst = 0;
  for (const int parts : {2, 3, 4, 7, 16, 33, 64}) {
    BlockWeights weights;
    for (GlobalIndex block = 0; block < counts.cast<GlobalIndex>().prod(); ++block)
      if (random() % 3 == 0) weights.push_back({block, static_cast<Real>(random() % 100 + 1)});
    const std::vector<int> result = bisection_partition<3>(counts, weights, parts);
    const std::vector<Real> load = loads(weights, result, parts);
    const Real mean = std::accumulate(load.begin(), load.end(), 0.0) / parts;
    const Real excess = (*std::max_element(load.begin(), load.end()) - mean) / 100;
    worst = std::max(worst, excess);
    EXPECT_LE(excess, 1) << parts << " parts";
    EXPECT_GT(*std::min_element(load.begin(), load.end()), 0) << parts << " parts";
    EXPECT_EQ(bisection_partition<3>(counts, weights, parts), result);
  }
  std::printf("largest excess %.3f of the heaviest block, at most 1 expected\n", worst);
}

TEST(Partition, EveryPartGetsABlockWhileThereAreEnough) {
  const IntVec<2> counts(5, 5);
  BlockWeights weights;
  for (int i = 0; i < 25; ++i) weights.push_back({i, i == 12 ? 1e6 : 1.0});
  for (int parts = 1; parts <= 25; ++parts) {
    std::vector<int> result = bisection_partition<2>(counts, weights, parts);
    std::sort(result.begin(), result.end());
    result.erase(std::unique(result.begin(), result.end()), result.end());
    EXPECT_EQ(static_cast<int>(result.size()), parts);
  }
}

// Few unequal blocks: what METIS balances better, it gets.
TEST(Partition, AutomaticIsNeverLessEvenThanBisection) {
  std::mt19937 random(2);
  const IntVec<2> counts(6, 6);
  int graph_won = 0;
  for (int round = 0; round < 50; ++round) {
    BlockWeights weights;
    for (int i = 0; i < 36; ++i) weights.push_back({i, static_cast<Real>(random() % 100 + 1)});
    const int parts = 2 + round % 5;
    auto imbalance = [&](Partitioner p) {
      return max_over_mean(weights, partition_blocks<2>(p, counts, weights, parts), parts);
    };
    const Real bisected = imbalance(Partitioner::bisection), chosen = imbalance(Partitioner::automatic);
    EXPECT_LE(chosen, bisected);
    if (bisected > 1.02) {
      EXPECT_LE(chosen, imbalance(Partitioner::metis));
    }
    graph_won += chosen < bisected;
  }
  EXPECT_GT(graph_won, 0);
}

// METIS counts in 32 bits; the sum of all weights must fit.
TEST(Partition, MetisBalancesMoreThanAMillionEqualBlocks) {
  const IntVec<2> counts(1100, 1100);
  BlockWeights weights;
  for (GlobalIndex i = 0; i < counts.cast<GlobalIndex>().prod(); ++i) weights.push_back({i, 512.0});
  const Real imbalance = max_over_mean(weights, graph_partition<2>(counts, weights, 4), 4);
  std::printf("imbalance %.4f of %zu equal blocks, expected below 1.02\n", imbalance, weights.size());
  EXPECT_LT(imbalance, 1.02);
}

}  // namespace
