// The L1 tile of a block: its nodes and the surrounding ones that its particles can reach, gathered from and scattered
// to the sparse grid as a whole.
#pragma once

#include <array>
#include <cstring>

#include "mpm_hpc/fields/grid_fields.hpp"
#include "mpm_hpc/math/row.hpp"

namespace mpm {

// Node t of the tile is node t - 1 of the block in each direction: one node of drift below, and the stencil's reach plus
// one node of drift above. Values: data[(((t_x * side) + t_y) * side + t_z) * Values + c].
template <class Kernel, int Dim, class T, int Values = node_values>
struct Tile {
  static constexpr int side = block_side + Kernel::support + 1;
  static constexpr int rows = Dim == 2 ? side : side * side;
  static constexpr int nodes = rows * side;
  static_assert(side <= 2 * block_side + 1, "a row spans three blocks");

  // Rows are read four nodes at a time, so the last one needs room behind it.
  alignas(64) T data[(nodes + row_nodes) * Values];

  // Cells are numbered by their stencil's first node, which leaves room for the others.
  static constexpr int cell_side = side - Kernel::support + 1;
  static constexpr int cells = Dim == 2 ? cell_side * cell_side : cell_side * cell_side * cell_side;
  static std::array<int, Dim> first_node_of_cell(int cell) {
    std::array<int, Dim> first;
    for (int a = Dim - 1; a >= 0; --a, cell /= cell_side) first[a] = cell % cell_side;
    return first;
  }
  static int node(const std::array<int, Dim>& t) {
    int n = 0;
    for (int a = 0; a < Dim; ++a) n = n * side + t[a];
    return n;
  }

  void zero() { std::memset(data, 0, sizeof(data)); }

  void gather(const BlockTopology<Dim>& topology, Slot slot, const T* grid) {
    for_each_segment(topology, slot, [this, grid](int tile_node, std::size_t grid_node, auto count) {
      std::memcpy(data + tile_node * Values, grid + grid_node * Values,
                  decltype(count)::value * Values * sizeof(T));
    });
    std::memset(data + nodes * Values, 0, row_nodes * Values * sizeof(T));
  }

  void scatter_add(const BlockTopology<Dim>& topology, Slot slot, T* grid) const {
    for_each_segment(topology, slot, [this, grid](int tile_node, std::size_t grid_node, auto count) {
      T* out = grid + grid_node * Values;
      const T* in = data + tile_node * Values;
      constexpr int numbers = decltype(count)::value * Values;
      if constexpr (numbers % 4 == 0) {
        // By hand: the compiler, which can't know that tile and grid are apart, would add one number at a time.
        for (int i = 0; i < numbers; i += 4) {
          const Quad<T> sum = load_quad(out + i) + load_quad(in + i);
          std::memcpy(out + i, &sum, sizeof(sum));
        }
      } else {
        for (int i = 0; i < numbers; ++i) out[i] += in[i];
      }
    });
  }

 private:
  template <int N>
  struct Count {
    static constexpr int value = N;
  };

  // Calls f(first tile node, first grid node, Count) for each run of nodes that is contiguous in both.
  template <class F>
  static void for_each_segment(const BlockTopology<Dim>& topology, Slot slot, F&& f) {
    constexpr int upper = side - 1 - block_side;
    const Slot* around = topology.neighbours(slot);
    for (int row = 0; row < rows; ++row) {
      int neighbour = 0, local = 0;  // of the row's first node, without the last direction
      for (int a = 0, rest = row, scale = rows / side; a < Dim - 1; ++a) {
        const int t = (Dim == 2 ? rest : rest / scale) - 1;
        if (Dim == 3) rest %= scale, scale = 1;
        neighbour = 3 * neighbour + (t < 0 ? 0 : t < block_side ? 1 : 2);
        local = block_side * local + (t & (block_side - 1));
      }
      auto node = [&](int direction, int first) {
        return static_cast<std::size_t>(around[3 * neighbour + direction]) * nodes_per_block<Dim> +
               static_cast<std::size_t>(block_side * local + first);
      };
      f(row * side, node(0, block_side - 1), Count<1>{});
      f(row * side + 1, node(1, 0), Count<block_side>{});
      f(row * side + 1 + block_side, node(2, 0), Count<upper>{});
    }
  }
};

}  // namespace mpm
