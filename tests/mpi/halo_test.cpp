// Halos of bodies that are spread over ranks, against what one process would compute from all ranks' data.
#include <chrono>
#include <map>
#include <thread>

#include "support/distributed_bodies.hpp"

using namespace mpm;
using test::gather_all;
using test::hash_of;
using test::node_key;

namespace {

Communicator world() { return Communicator::world(); }

template <class C>
using Halos = test::DistributedBodies<C>;
TYPED_TEST_SUITE(Halos, test::EveryCase);

TYPED_TEST(Halos, HaloSumAndFillEqualSerialOnes) {
  constexpr int Dim = TestFixture::Dim;
  using T = typename TestFixture::T;
  this->start(Dim == 2 ? 700 : 500, Vec<Dim>::Constant(0.1), Vec<Dim>::Constant(Dim == 2 ? 2.9 : 1.3));
  for (int round = 0; round < 2; ++round) {
    this->redistribute();
    const std::set<BlockKey> mine = this->reached_nodes();
    std::vector<int> ranks;
    const std::vector<BlockKey> all = gather_all(std::vector<BlockKey>(mine.begin(), mine.end()), &ranks);
    std::map<BlockKey, std::vector<int>> reached_by;
    for (std::size_t i = 0; i < all.size(); ++i) reached_by[all[i]].push_back(ranks[i]);
    std::set<BlockKey> here;
    this->for_nodes([&](Slot, BlockKey key, T*) { here.insert(key); });
    for (BlockKey key : mine) ASSERT_TRUE(here.contains(key)) << "no room for a node that particles reach";

    // Small integers: their sums are exact in either precision.
    auto term = [](int rank, BlockKey key, int c) { return static_cast<T>(hash_of(rank, key, c) % 1000); };
    this->for_nodes([&](Slot, BlockKey key, T* v) {
      for (int c = 0; c < 4; ++c) v[c] = mine.contains(key) ? term(test::rank(), key, c) : T(0);
    });
    this->fields.zero(this->other);
    Halo<Dim>& halo = this->distribution.halo();
    const GlobalIndex bytes = halo.bytes(), messages = halo.messages();
    halo.sum(this->fields, {this->values});
    EXPECT_EQ(halo.bytes() - bytes, halo.ghost_nodes() * 3 * static_cast<GlobalIndex>(sizeof(T)));
    EXPECT_LE(halo.messages() - messages, halo.neighbours());
    const Slot owned = this->distribution.topology().owned();
    std::vector<BlockKey> summed;
    GlobalIndex shared = 0;
    this->for_nodes([&](Slot s, BlockKey key, T* v) {
      if (s >= owned) return;
      summed.push_back(key);
      const auto by = reached_by.find(key);
      for (int c = 0; c < 4; ++c) {
        T expected = 0;
        if (by != reached_by.end())
          for (int rank : by->second)
            if (c < 3 || rank == test::rank()) expected += term(rank, key, c);
        ASSERT_EQ(v[c], expected) << "component " << c;
      }
      if (by != reached_by.end() && by->second.size() > 1) ++shared;
    });
    // Every node that anyone reaches has exactly one owner.
    std::vector<BlockKey> all_summed = gather_all(summed);
    const std::set<BlockKey> once(all_summed.begin(), all_summed.end());
    EXPECT_EQ(once.size(), all_summed.size());
    for (const auto& [key, by] : reached_by) ASSERT_TRUE(once.contains(key));
    if (test::size() > 1) {
      EXPECT_GT(world().sum(shared), 0);
      EXPECT_EQ(world().sum(halo.ghost_nodes()), world().sum(halo.shared_nodes()));
    }

    auto owners_value = [](BlockKey key, int c) { return static_cast<T>(hash_of(key, c) % 65536); };
    this->for_nodes([&](Slot s, BlockKey key, T* v) {
      for (int c = 0; c < 4; ++c) v[c] = s < owned ? owners_value(key, c) : T(-1);
    });
    halo.fill(this->fields, {this->values});
    this->for_nodes([&](Slot s, BlockKey key, T* v) {
      for (int c = 0; c < 4; ++c) {
        if (s < owned || (c < 3 && mine.contains(key))) {
          ASSERT_EQ(v[c], owners_value(key, c));
        }
        if (s >= owned && c == 3) {
          ASSERT_EQ(v[c], T(-1)) << "padding was sent";
        }
      }
    });
    // Anywhere else in the next round.
    this->for_particles([](Body<Dim>& body, Index p) {
      Real& x = body.particles.template data<Real>(core::position, 0)[p];
      x = (Dim == 2 ? 3.0 : 1.4) - x;
    });
  }
}

TYPED_TEST(Halos, RowHaloBringsEveryOwnersNodeInReach) {
  constexpr int Dim = TestFixture::Dim;
  using T = typename TestFixture::T;
  this->start(Dim == 2 ? 120 : 60, Vec<Dim>::Constant(0.1), Vec<Dim>::Constant(Dim == 2 ? 2.9 : 1.3));
  this->distribution.require_row_halo();
  this->redistribute();
  const BlockTopology<Dim>& topology = this->distribution.topology();
  std::vector<BlockKey> owned_nodes;
  this->for_nodes([&](Slot s, BlockKey key, T* v) {
    for (int c = 0; c < 4; ++c) v[c] = s < topology.owned() ? static_cast<T>(hash_of(key, c) % 65536) : T(-1);
    if (s < topology.owned()) owned_nodes.push_back(key);
  });
  const std::vector<BlockKey> all = gather_all(owned_nodes);
  const std::set<BlockKey> active(all.begin(), all.end());
  EXPECT_EQ(active.size(), all.size());
  this->distribution.row_halo().fill(this->fields, {this->values});
  std::map<BlockKey, const T*> here;
  this->for_nodes([&](Slot, BlockKey key, T* v) { here[key] = v; });
  GlobalIndex from_others = 0, beyond_stencils = 0;
  const std::set<BlockKey> reached = this->reached_nodes(), mine(owned_nodes.begin(), owned_nodes.end());
  constexpr int side = 5;
  for (BlockKey key : owned_nodes)
    for (int n = 0; n < (Dim == 2 ? side * side : side * side * side); ++n) {
      IntVec<Dim> node = block_of_key<Dim>(key);
      for (int a = 0, rest = n; a < Dim; ++a, rest /= side) node[a] += rest % side - 2;
      if ((node.array() < 0).any()) continue;
      const BlockKey other = node_key<Dim>(node);
      if (!active.contains(other)) continue;
      ASSERT_TRUE(here.contains(other)) << "a node in reach is missing";
      for (int c = 0; c < 3; ++c) ASSERT_EQ(here[other][c], static_cast<T>(hash_of(other, c) % 65536));
      from_others += !mine.contains(other);
      beyond_stencils += !mine.contains(other) && !reached.contains(other);
    }
  if (test::size() > 1) {
    EXPECT_GT(world().sum(from_others), 0);
    EXPECT_GT(world().sum(beyond_stencils), 0) << "the test must hold a node that no own particle reaches";
  }
}

// A rank goes on to the next exchange while slower ones still have to take what it sent in this one.
TYPED_TEST(Halos, MessagesOnTheirWayAreNotOverwritten) {
  constexpr int Dim = TestFixture::Dim;
  using T = typename TestFixture::T;
  this->start(Dim == 2 ? 700 : 500, Vec<Dim>::Constant(0.1), Vec<Dim>::Constant(Dim == 2 ? 2.9 : 1.3));
  this->redistribute();
  const std::set<BlockKey> mine = this->reached_nodes();
  Halo<Dim>& halo = this->distribution.halo();
  const Slot owned = this->distribution.topology().owned();
  const auto value = [](BlockKey key, int c, int round) { return static_cast<T>(hash_of(key, c, round) % 65536); };
  for (int round = 0; round < 12; ++round) {
    this->for_nodes([&](Slot s, BlockKey key, T* v) {
      for (int c = 0; c < 4; ++c) v[c] = s < owned ? value(key, c, round) : T(-1);
    });
    halo.start_fill(this->fields, {this->values});
    if (round % test::size() == test::rank()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    halo.finish_fill();
    this->for_nodes([&](Slot s, BlockKey key, T* v) {
      if (s < owned || !mine.contains(key)) return;
      for (int c = 0; c < 3; ++c) ASSERT_EQ(v[c], value(key, c, round)) << "round " << round;
    });
  }
}

}  // namespace
