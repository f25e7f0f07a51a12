// Random particles with columns of every type, spread over the ranks, and grid fields of which some values are padding.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <random>
#include <set>

#include "mpm_hpc/parallel/distribution.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"
#include "support/typed_cases.hpp"

namespace mpm::test {

template <int Dim>
BlockKey node_key(const IntVec<Dim>& node) {
  return block_key<Dim>(node);  // any injective number of integer coordinates
}

template <class C>
class DistributedBodies : public testing::Test {
 public:
  static constexpr int Dim = C::Dim;
  using T = typename C::T;
  using V = Vec<Dim>;
  static constexpr Precision precision =
      std::is_same_v<T, float> ? Precision::single_precision : Precision::double_precision;
  static constexpr Real h = 0.1;

  void start(int count, const V& lower = V::Zero(), const V& upper = V::Ones(), DistributionOptions options = {}) {
    options.precision = precision;
    distribution = Distribution<Dim>(Communicator::world(), {V::Zero(), V::Ones() * (Dim == 2 ? 3.2 : 1.6), h}, options);
    fields = GridFields(precision);
    values = fields.add({.name = "values", .units = "1", .components = 4, .halo_components = 3});
    other = fields.add({.name = "other", .units = "1"});
    bodies.clear();
    total = 0;
    std::mt19937 random(static_cast<unsigned>(count));
    std::uniform_real_distribution<Real> unit(0, 1);
    for (int b = 0; b < 2; ++b) {
      bodies.emplace_back(b ? "second" : "first", 0, precision);
      FieldSet& f = bodies[b].particles;
      number = f.add({.name = "number", .units = "1", .type = ScalarType::int64});
      if (b == 1)
        vector = f.add({.name = "vector", .units = "1", .type = ScalarType::float32, .components = 3});
      std::vector<std::pair<GlobalIndex, V>> mine;
      for (int i = 0; i < count; ++i, ++total) {
        V x;
        for (int a = 0; a < Dim; ++a) x[a] = lower[a] + unit(random) * (upper[a] - lower[a]);
        if (hash_of(total) % size() == rank()) mine.push_back({total, x});
      }
      f.resize(static_cast<Index>(mine.size()));
      for (std::size_t p = 0; p < mine.size(); ++p) {
        for (FieldId id = 0; id < f.count(); ++id)
          for (int c = 0; c < f.traits(id).components; ++c)
            write(f, id, c, static_cast<Index>(p), mine[p].first);
        f.data<GlobalIndex>(core::id)[p] = mine[p].first;
        for (int a = 0; a < Dim; ++a) f.data<Real>(core::position, a)[p] = mine[p].second[a];
      }
    }
  }

  // What column `id` of a particle holds; all its bits count.
  static void write(FieldSet& f, FieldId id, int c, Index p, GlobalIndex particle) {
    const Real value = static_cast<Real>(hash_of(particle, id, c)) / 3;
    switch (f.traits(id).type) {
      case ScalarType::float32:
        f.data<float>(id, c)[p] = static_cast<float>(value);
        break;
      case ScalarType::float64:
        f.data<double>(id, c)[p] = value;
        break;
      case ScalarType::int64:
        f.data<GlobalIndex>(id, c)[p] = hash_of(particle, id, c) * 1000003;
        break;
    }
  }

  void redistribute() { distribution.redistribute(bodies, fields, OrderWithinCell::canonical); }

  template <class F>
  void for_particles(F&& f) {
    for (auto& body : bodies)
      for (Index p = 0; p < body.particles.size(); ++p)
        if (!body.is_padding(p)) f(body, p);
  }
  static V position(const Body<Dim>& body, Index p) {
    V x;
    for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a)[p];
    return x;
  }

  // Every column of every particle is what it was at the start, bit by bit; positions are left to the caller.
  void expect_intact() {
    std::vector<GlobalIndex> ids;
    for (auto& body : bodies) {
      FieldSet& f = body.particles;
      FieldSet one;
      for (FieldId id = 0; id < f.count(); ++id) one.add(f.traits(id));
      one.resize(1);
      for (Index p = 0; p < f.size(); ++p) {
        if (body.is_padding(p)) continue;
        const GlobalIndex particle = f.data<GlobalIndex>(core::id)[p];
        ids.push_back(particle);
        for (FieldId id = 0; id < f.count(); ++id) {
          if (id == core::id || id == core::position) continue;
          const int bytes = bytes_of(f.traits(id).type);
          for (int c = 0; c < f.traits(id).components; ++c) {
            write(one, id, c, 0, particle);
            ASSERT_EQ(std::memcmp(static_cast<char*>(f.raw(id, c)) + static_cast<std::size_t>(p) * bytes,
                                  one.raw(id, c), bytes),
                      0)
                << "column " << f.traits(id).name << " of particle " << particle;
          }
        }
      }
    }
    std::vector<GlobalIndex> all = gather_all(ids);
    std::sort(all.begin(), all.end());
    ASSERT_EQ(static_cast<GlobalIndex>(all.size()), total);
    for (GlobalIndex i = 0; i < total; ++i) ASSERT_EQ(all[i], i) << "particle lost or there twice";
  }

  // Each particle lies in a block that its rank owns, in the range of that block.
  void expect_at_home() {
    for (auto& body : bodies)
      for (const BlockRange& range : body.ranges)
        for (Index p = range.begin; p < range.end; ++p) {
          IntVec<Dim> block = base_node(distribution.grid(), position(body, p), 0.5);
          for (int a = 0; a < Dim; ++a) block[a] /= block_side;
          ASSERT_EQ(distribution.decomposition().owner(block), rank());
          ASSERT_EQ(distribution.topology().find(block_key<Dim>(block)), range.slot);
          ASSERT_LT(range.slot, distribution.topology().owned());
        }
  }

  // Nodes within a drift of one cell of the stencils of this rank's blocks.
  std::set<BlockKey> reached_nodes() {
    std::set<BlockKey> blocks, nodes;
    for_particles([&](const Body<Dim>& body, Index p) {
      IntVec<Dim> block = base_node(distribution.grid(), position(body, p), 0.5);
      for (int a = 0; a < Dim; ++a) block[a] /= block_side;
      blocks.insert(block_key<Dim>(block));
    });
    constexpr int side = block_side + 4;  // one below, three above
    for (BlockKey key : blocks) {
      const IntVec<Dim> first = block_side * block_of_key<Dim>(key);
      for (int n = 0; n < (Dim == 2 ? side * side : side * side * side); ++n) {
        IntVec<Dim> node = first;
        for (int a = 0, rest = n; a < Dim; ++a, rest /= side) node[a] += rest % side - 1;
        nodes.insert(node_key<Dim>(node));
      }
    }
    return nodes;
  }

  // f(slot, node's key, pointer to its four values)
  template <class F>
  void for_nodes(F&& f) {
    T* data = fields.template data<T>(values);
    for (Slot s = 0; s < distribution.topology().size(); ++s)
      for (int n = 0; n < nodes_per_block<Dim>; ++n, data += 4)
        f(s, node_key<Dim>(IntVec<Dim>(distribution.topology().first_node(s) + node_in_block<Dim>(n))), data);
  }

  Distribution<Dim> distribution;
  std::vector<Body<Dim>> bodies;
  GridFields fields;
  FieldId values = no_field, other = no_field, number = no_field, vector = no_field;
  GlobalIndex total = 0;
};

}  // namespace mpm::test
