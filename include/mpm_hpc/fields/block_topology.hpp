// The active blocks of one rank: slots, their keys and neighbours.
#pragma once

#include <array>
#include <vector>

#include "mpm_hpc/fields/grid_geometry.hpp"

namespace mpm {

using Slot = std::int32_t;
inline constexpr Slot no_slot = -1;

// Open-addressing map from block key to slot.
class BlockMap {
 public:
  void reset(std::size_t expected);
  void insert(BlockKey key, Slot slot);
  Slot find(BlockKey key) const;
  std::size_t allocated_bytes() const { return keys_.capacity() * 8 + slots_.capacity() * 4; }

 private:
  static std::size_t hash(BlockKey key) { return (key * 0x9E3779B97F4A7C15ull) >> 20; }
  std::vector<BlockKey> keys_;
  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
};

// Neighbour number of offset (o_x, o_y[, o_z]), each in -1..1; the centre is number (3^Dim - 1) / 2.
template <int Dim>
constexpr int neighbour_number(const std::array<int, Dim>& offset) {
  int n = 0;
  for (int a = 0; a < Dim; ++a) n = 3 * n + offset[a] + 1;
  return n;
}

// Slots [0, owned) are this rank's blocks in the order of their keys; the rest are ghosts, grouped by owner.
template <int Dim>
class BlockTopology {
 public:
  // owned: sorted keys; ghosts: keys in halo order. The grid says which blocks meet across periodic sides.
  void rebuild(const std::vector<BlockKey>& owned, const std::vector<BlockKey>& ghosts,
               const GridGeometry<Dim>& grid = {});

  Slot owned() const { return owned_; }
  Slot size() const { return static_cast<Slot>(keys_.size()); }
  BlockKey key(Slot s) const { return keys_[s]; }
  // First node of the block in grid coordinates.
  IntVec<Dim> first_node(Slot s) const { return block_side * block_of_key<Dim>(keys_[s]); }
  Slot find(BlockKey key) const { return map_.find(key); }
  // 3^Dim slots around and including s; no_slot where the neighbour is not active.
  const Slot* neighbours(Slot s) const { return &neighbours_[static_cast<std::size_t>(s) * block_neighbours<Dim>]; }
  std::size_t allocated_bytes() const {
    return keys_.capacity() * 8 + neighbours_.capacity() * 4 + map_.allocated_bytes();
  }

 private:
  Slot owned_ = 0;
  std::vector<BlockKey> keys_;
  std::vector<Slot> neighbours_;
  BlockMap map_;
};

// Grid coordinates of node number n inside a block; the last direction runs fastest.
template <int Dim>
inline IntVec<Dim> node_in_block(int n) {
  IntVec<Dim> node;
  for (int a = Dim - 1; a >= 0; --a) {
    node[a] = n % block_side;
    n /= block_side;
  }
  return node;
}

inline constexpr std::size_t no_node = ~std::size_t{0};

// The number of the node at a place counted from a block's first node, at most one block away; no_node if its block isn't
// active. around: the block's neighbours.
template <int Dim>
inline std::size_t node_around(const Slot* around, const IntVec<Dim>& place) {
  int neighbour = 0, in_block = 0;
  for (int a = 0; a < Dim; ++a) {
    neighbour = 3 * neighbour + (place[a] < 0 ? 0 : place[a] < block_side ? 1 : 2);
    in_block = block_side * in_block + (place[a] & (block_side - 1));
  }
  if (around[neighbour] == no_slot) return no_node;
  return static_cast<std::size_t>(around[neighbour]) * nodes_per_block<Dim> + static_cast<std::size_t>(in_block);
}

}  // namespace mpm
