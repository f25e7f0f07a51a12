// Decomposition and communicator against what one process would compute from all ranks' data.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <numeric>
#include <set>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/parallel/decomposition.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"

using namespace mpm;
using test::hash_of;

namespace {

Communicator world() { return Communicator::world(); }

std::int64_t same_everywhere(const std::vector<std::int32_t>& values) {
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < values.size(); ++i) sum += hash_of(i, values[i]);
  EXPECT_EQ(world().max(sum), -world().max(-sum)) << "ranks disagree";
  return sum;
}

using Weights = Decomposition<2>::Weights;

// This rank's share of a filled rectangle of blocks [x0, x1) x [0, ny), dealt out block by block.
Weights rectangle(const Decomposition<2>& d, int x0, int x1, int ny, unsigned seed) {
  std::map<GlobalIndex, Real> mine;
  for (int x = x0; x < x1; ++x)
    for (int y = 0; y < ny; ++y)
      if ((x + y) % test::size() == test::rank())
        mine[d.coarse_index({x, y})] += 1 + (seed ? hash_of(x, y, seed) % 5 : 0);
  return {mine.begin(), mine.end()};
}

std::vector<Real> loads(const Decomposition<2>& d, const Weights& mine) {
  std::vector<Real> sums(test::size(), 0.0);
  for (const auto& [block, weight] : mine) sums[d.owners()[block]] += weight;
  world().sum(sums);
  return sums;
}

TEST(Parallel, DecompositionCoversTheDomain) {
  const GridGeometry<2> grid({0, 0}, {50, 30}, 0.5);
  for (const Partitioner partitioner : {Partitioner::automatic, Partitioner::bisection, Partitioner::metis}) {
    Decomposition<2> d(grid, partitioner);
    EXPECT_TRUE(d.empty());
    const Weights mine = rectangle(d, 3, 23, 12, 7);
    EXPECT_TRUE(d.partition(world(), mine, 0));
    ASSERT_EQ(static_cast<GlobalIndex>(d.owners().size()), d.entries());
    EXPECT_EQ(d.entries(), GlobalIndex{grid.blocks()[0]} * grid.blocks()[1]);
    std::set<GlobalIndex> numbers;
    for (int x = 0; x < grid.blocks()[0]; ++x)
      for (int y = 0; y < grid.blocks()[1]; ++y) {
        numbers.insert(d.coarse_index({x, y}));
        ASSERT_GE(d.owner({x, y}), 0);
        ASSERT_LT(d.owner({x, y}), test::size());
      }
    EXPECT_EQ(static_cast<GlobalIndex>(numbers.size()), d.entries());
    same_everywhere(d.owners());
    const std::vector<Real> load = loads(d, mine);
    const Real total = std::accumulate(load.begin(), load.end(), 0.0);
    const Real imbalance = *std::max_element(load.begin(), load.end()) * test::size() / total;
    if (test::rank() == 0) std::printf("imbalance of a fresh partition %.3f, expected below 1.05\n", imbalance);
    EXPECT_LT(imbalance, 1.05);
  }
}

TEST(Parallel, HugeDomainsAreCutIntoCoarserBlocks) {
  const GridGeometry<3> grid({0, 0, 0}, {3000, 2000, 10}, 1);
  Decomposition<3> d(grid);
  EXPECT_LE(d.entries(), Decomposition<3>::max_entries);
  EXPECT_GT(8 * d.entries(), GlobalIndex{grid.blocks()[0]} * grid.blocks()[1] * grid.blocks()[2] / 2);
  const IntVec<3> last = grid.blocks() - IntVec<3>::Ones();
  EXPECT_EQ(d.coarse_index(last), d.entries() - 1);
  typename Decomposition<3>::Weights mine;
  if (test::rank() == test::size() - 1) mine = {{0, 1.0}, {d.coarse_index(last), 1.0}};
  d.partition(world(), mine, 0);
  same_everywhere(d.owners());
  EXPECT_EQ(d.owner({0, 0, 0}) == d.owner(last), test::size() == 1);
}

// The parts of a shifted body are the shifted parts: under their old names only the blocks at the cuts change hands. The
// old names are turned by one, so that those which the partitioner gives anew don't fit.
TEST(Parallel, PartsAreNamedSoThatLittleMoves) {
  Decomposition<2> d(GridGeometry<2>({0, 0}, {200, 60}, 1));
  d.partition(world(), rectangle(d, 4, 28, 8, 0), 0);
  for (int shift = 1; shift <= 6; ++shift) {
    std::vector<std::int32_t> turned = d.owners();
    for (std::int32_t& owner : turned) owner = (owner + 1) % test::size();
    d.set_owners(turned);
    const Decomposition<2> before = d;
    const Weights mine = rectangle(d, 4 + shift, 28 + shift, 8, 0);
    ASSERT_TRUE(d.partition(world(), mine, -1e9));
    Real moved = 0, total = 0;
    for (const auto& [block, weight] : mine) {
      total += weight;
      if (before.owners()[block] != d.owners()[block]) moved += weight;
    }
    moved = world().sum(moved);
    total = world().sum(total);
    if (test::rank() == 0)
      std::printf("shift %d moves %.3f of the weight, expected below 0.2\n", shift, moved / total);
    EXPECT_LT(moved, 0.2 * total);
  }
}

TEST(Parallel, PartitionsAreKeptUnlessTheNewOneIsBetter) {
  Decomposition<2> d(GridGeometry<2>({0, 0}, {200, 60}, 1));
  const Weights mine = rectangle(d, 4, 28, 8, 3);
  EXPECT_TRUE(d.partition(world(), mine, 0));
  const std::vector<std::int32_t> owners = d.owners();
  EXPECT_FALSE(d.partition(world(), mine, 0.02));
  EXPECT_EQ(d.owners(), owners);
  // All on one rank is as bad as can be.
  d.set_owners(std::vector<std::int32_t>(d.owners().size(), test::size() - 1));
  EXPECT_NEAR(d.imbalance(world(), test::rank() == test::size() - 1 ? 1 : 0), test::size(), 1e-12);
  EXPECT_EQ(d.partition(world(), mine, 0.02), test::size() > 1);
}

TEST(Parallel, ExchangeDeliversEverythingOnce) {
  const int size = test::size(), me = test::rank();
  auto message = [](int from, int to, int round) {
    // Most pairs stay silent; some messages are empty, others large.
    const std::int64_t kind = hash_of(from, to, round) % 4;
    const std::size_t length = kind == 1 ? 0 : kind == 2 ? 17 : 300000;
    std::vector<char> bytes(length);
    for (std::size_t i = 0; i < length; ++i) bytes[i] = static_cast<char>(hash_of(from, to, round, i % 1000));
    return std::make_pair(kind != 0, bytes);
  };
  const Communicator communicator = world();
  for (int round = 0; round < 20; ++round) {
    std::map<int, Communicator::Bytes> outgoing;
    for (int to = 0; to < size; ++to)
      if (auto [sent, bytes] = message(me, to, round); sent) outgoing[to] = bytes;
    const auto incoming = communicator.exchange(outgoing);
    std::size_t next = 0;
    for (int from = 0; from < size; ++from) {
      const auto [sent, bytes] = message(from, me, round);
      if (!sent) continue;
      ASSERT_LT(next, incoming.size());
      EXPECT_EQ(incoming[next].first, from);
      EXPECT_TRUE(incoming[next].second == bytes) << "round " << round << " from " << from;
      ++next;
    }
    EXPECT_EQ(next, incoming.size());
  }
}

TEST(Parallel, CollectivesAreCounted) {
  const Communicator c = world();
  const GlobalIndex before = c.collectives();
  c.max(Real{1});
  std::vector<Real> values(3, 1.0);
  c.sum(values);
  c.exchange({});
  c.barrier();
  EXPECT_EQ(c.collectives() - before, 4);
  EXPECT_EQ(world().max(c.collectives()), c.collectives()) << "the same on all ranks";
}

// 10^17 and its negative stand on different ranks, with numbers between them that a plain sum loses.
TEST(Parallel, CompensatedSumsAreExact) {
  const int size = test::size(), me = test::rank();
  constexpr int sums = 20000;  // more than MPI reduces in one piece
  std::vector<CompensatedSum> values(sums);
  for (int s = 0; s < sums; ++s) {
    if (s % size == me) values[s].add(1e17);
    for (int k = 0; k < 3; ++k) values[s].add(1.0 + s % 7);
    if ((s + 1) % size == me) values[s].add(-1e17);
  }
  world().sum(values);
  int wrong = 0;
  for (int s = 0; s < sums; ++s) wrong += values[s].value() != 3.0 * size * (1 + s % 7);
  if (test::rank() == 0) std::printf("%d of %d compensated sums are wrong, expected 0\n", wrong, sums);
  EXPECT_EQ(wrong, 0);
}

TEST(Parallel, CollectivesAgreeWithTheirSerialMeaning) {
  const Communicator c = world();
  const int size = test::size(), me = test::rank();
  EXPECT_EQ(c.rank(), me);
  EXPECT_EQ(c.size(), size);
  EXPECT_EQ(c.sum(GlobalIndex{1} << 40), (GlobalIndex{1} << 40) * size);
  EXPECT_EQ(c.max(GlobalIndex{me}), size - 1);
  EXPECT_EQ(c.min(static_cast<Real>(me)), 0);
  EXPECT_EQ(c.max(static_cast<Real>(-me)), 0);
  EXPECT_EQ(c.exclusive_sum(me + 1), me * (me + 1) / 2);
  EXPECT_EQ(c.exclusive_max(7 - me), me == 0 ? -1 : 7);
  EXPECT_TRUE(c.any(me == size - 1));
  EXPECT_FALSE(c.any(false));
  std::vector<Real> list = {1.0 * me, -1.0 * me};
  c.max(list);
  EXPECT_EQ(list, (std::vector<Real>{size - 1.0, 0.0}));
  std::string text = me == size - 1 ? "from the last rank" : "";
  c.broadcast(text, size - 1);
  EXPECT_EQ(text, "from the last rank");
  const auto parts = c.gather(std::vector<char>(me, static_cast<char>('a' + me)));
  ASSERT_EQ(static_cast<int>(parts.size()), me == 0 ? size : 0);
  for (int r = 0; r < static_cast<int>(parts.size()); ++r)
    EXPECT_EQ(std::string(parts[r].begin(), parts[r].end()), std::string(r, static_cast<char>('a' + r)));

  EXPECT_NO_THROW(c.fail_together(""));
  const int first = size > 1 ? 1 : 0;
  std::string told;
  try {
    c.fail_together(me >= first ? fmt::format("rank {} failed", me) : "");
  } catch (const NumericalFailure& failure) {
    told = failure.what();
  }
  EXPECT_EQ(told, fmt::format("rank {} failed", first));
}

}  // namespace
