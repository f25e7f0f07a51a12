// The tile of OperatorStencil's entries of a block and the nodes around, filled cell by cell.
#pragma once

#include <algorithm>
#include <cstring>
#include <vector>

#include "mpm_hpc/transfer/operator_stencil.hpp"
#include "mpm_hpc/transfer/tile.hpp"

namespace mpm {

// Lane n * support + o of a register belongs to the pair of nodes n and n + o of one direction. That is also their place
// in a line of the tile, whose nodes have `support` offsets each: a cell's sums are added to a line at once.
template <class Kernel, class T>
struct PairLanes {
  static constexpr int support = Kernel::support;
  static constexpr int pairs = support * (support + 1) / 2;
  static constexpr int width = support == 4 ? 16 : support == 3 ? 8 : 4;

  static constexpr bool is_pair(int lane) {
    return lane < support * support && lane / support + lane % support < support;
  }
  // Lane, node and offset of pair k.
  static constexpr int lane(int k) {
    int found = 0;
    for (int l = 0; l < width; ++l)
      if (is_pair(l) && found++ == k) return l;
    return -1;
  }
  static constexpr int node(int k) { return lane(k) / support; }
  static constexpr int offset(int k) { return lane(k) % support; }
};

// The stencil's tile, of entries of type T: by plane of offsets and row of nodes a line along the last direction.
template <class Kernel, int Dim, class T>
class StencilTile {
 public:
  using Stencil = OperatorStencil<Kernel, Dim>;
  static constexpr int side = Tile<Kernel, Dim, T>::side;
  static constexpr int rows = Tile<Kernel, Dim, T>::rows;
  static constexpr int line = (side * Kernel::support + 7) / 8 * 8;
  // Not a multiple of 4 KiB, or the entries of a row would compete for one L1 set.
  static constexpr int plane_stride = rows * line + 56;

  StencilTile() : data_(static_cast<std::size_t>(Stencil::planes) * plane_stride, T(0)) { forget(); }

  // Entries of the first node of `row` (or behind it) with the offsets of `plane`.
  T* at(int row, int plane, int node) { return data_.data() + place(row, plane, node); }
  // How far behind the tile's first entry they stand; it is a sum of what each number adds.
  static constexpr int place(int row, int plane, int node) {
    return plane * plane_stride + row * line + node * Kernel::support;
  }

  void include(const int* first_node) {
    for (int a = 0; a < Dim; ++a) {
      lower_[a] = std::min(lower_[a], first_node[a]);
      upper_[a] = std::max(upper_[a], first_node[a] + Kernel::support);
    }
  }

  // Moves the sums to the grid: block by block, so that a block's entries pass through the cache once and in their order.
  template <class U>
  void scatter_add(const BlockTopology<Dim>& topology, Slot slot, T* stencil, U* diagonal,
                   std::vector<char>& touched) {
    const Slot* around = topology.neighbours(slot);
    for (int neighbour = 0; neighbour < block_neighbours<Dim>; ++neighbour) {
      Part part;
      bool used = true;
      for (int a = Dim - 1, n = neighbour; a >= 0; --a, n /= 3) {
        part.begin[a] = std::max(lower_[a], first_of(n % 3));
        part.end[a] = std::min(upper_[a], first_of(n % 3 + 1));
        used = used && part.begin[a] < part.end[a];
      }
      if (!used) continue;
      const Slot block = around[neighbour];
      T* out = stencil + block * Stencil::block_values;
      if (!touched[static_cast<std::size_t>(block)]) {
        touched[static_cast<std::size_t>(block)] = 1;
        std::memset(out, 0, Stencil::block_values * sizeof(T));
      }
      U* of_diagonal = diagonal + block * Stencil::nodes;
      switch (neighbour % 3) {
        case 0: move<0>(part, out, of_diagonal); break;
        case 1: move<1>(part, out, of_diagonal); break;
        default: move<2>(part, out, of_diagonal);
      }
    }
    forget();
  }

 private:
  // The tile's nodes in one block that have entries.
  struct Part {
    int begin[Dim], end[Dim];
  };
  // First node of the tile's part in the blocks before, in the block itself, and in those behind it.
  static constexpr int first_of(int part) {
    return part == 0 ? 0 : part == 1 ? 1 : part == 2 ? 1 + block_side : side;
  }

  // Last is the part of the last direction.
  template <int Last, class U>
  void move(const Part& part, T* stencil, U* diagonal) {
    constexpr int y = Dim - 2, first = first_of(Last), nodes = first_of(Last + 1) - first;
    for (int plane = 0; plane < Stencil::planes; ++plane) {
      // Boxes end inside the nodes that have entries.
      const int x_begin = Dim == 2 ? 0 : part.begin[0];
      const int x_end = Dim == 2 ? 1 : std::min(part.end[0], upper_[0] - plane / Stencil::offsets);
      const int y_end = std::min(part.end[y], upper_[y] - plane % Stencil::offsets);
      T* out = stencil + plane * Stencil::offsets * Stencil::nodes;
      for (int i = x_begin; i < x_end; ++i)
        for (int j = part.begin[y]; j < y_end; ++j) {
          T* in = at(i * side + j, plane, first);
          const int node = node_of_row(i, j);
          add_line<Last>(in, out + node, std::make_integer_sequence<int, Stencil::offsets>());
          if (plane == 0)
            for (int n = 0; n < nodes; ++n)
              diagonal[node + ((first + n - 1) & (block_side - 1))] += in[n * Kernel::support];
          std::fill_n(in, nodes * Kernel::support, T(0));
        }
    }
  }
  // The first node of a row of the tile in its block.
  static constexpr int node_of_row(int i, int j) {
    const int sheet = Dim == 2 ? 0 : (i - 1) & (block_side - 1);
    return (sheet * block_side + ((j - 1) & (block_side - 1))) * block_side;
  }
  // For each offset o, the line's entries for the block's four nodes; those outside of the part are 0.
  template <int Last, int... O>
  static void add_line(const T* in, T* out, std::integer_sequence<int, O...>) {
    constexpr int N = Stencil::offsets, width = PairLanes<Kernel, T>::width;
    auto add = [](T* to, const Quad<T>& what) {
      const Quad<T> sum = load_quad(to) + what;
      std::memcpy(to, &sum, sizeof(sum));
    };
    // The first `width` numbers hold all entries of the nodes behind the block.
#ifdef __AVX512F__
    using V __attribute__((vector_size(width * sizeof(T)))) = T;
    constexpr int none = width;
    constexpr auto behind = [](int entry) { return entry < none ? entry : none; };
    V a, b;
    std::memcpy(&a, in, sizeof(a));
    if constexpr (Last == 1) {
      std::memcpy(&b, in + width, sizeof(b));
    } else {
      b = V{};
    }
    if constexpr (Last == 0) {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, none, none, none, O)), ...);
    } else if constexpr (Last == 1) {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, O, N + O, 2 * N + O, 3 * N + O)), ...);
    } else {
      (add(out + O * Stencil::nodes,
           __builtin_shufflevector(a, b, O, N + O, behind(2 * N + O), behind(3 * N + O))),
       ...);
    }
#else
    if constexpr (Last == 0) {
      (add(out + O * Stencil::nodes, Quad<T>{0, 0, 0, in[O]}), ...);
    } else {
      Quad<T> a[N];
      for (int q = 0; q < N; ++q) a[q] = Last == 1 || 4 * q < width ? load_quad(in + 4 * q) : Quad<T>{};
      (add(out + O * Stencil::nodes, each_of_node<O>(a)), ...);
    }
#endif
  }
#ifndef __AVX512F__
  // Entry O of four nodes, from the entries of one node after the other. Shuffles of no more than two registers, as the compiler
  // would take others apart.
  template <int O, int N>
  static Quad<T> each_of_node(const Quad<T> (&a)[N]) {
    if constexpr (N == 2) {
      return __builtin_shufflevector(a[0], a[1], O, O + 2, O + 4, O + 6);
    } else if constexpr (N == 3 && O == 0) {
      return __builtin_shufflevector(__builtin_shufflevector(a[0], a[1], 0, 3, 6, 6), a[2], 0, 1, 2, 5);
    } else if constexpr (N == 3 && O == 1) {
      return __builtin_shufflevector(__builtin_shufflevector(a[0], a[1], 1, 1, 4, 7),
                                     __builtin_shufflevector(a[1], a[2], 3, 3, 6, 6), 0, 2, 4, 6);
    } else if constexpr (N == 3) {
      return __builtin_shufflevector(__builtin_shufflevector(a[0], a[1], 2, 2, 5, 5), a[2], 0, 2, 4, 7);
    } else {
      return Quad<T>{a[0][O], a[1][O], a[2][O], a[3][O]};
    }
  }
#endif
  void forget() {
    std::fill(lower_, lower_ + Dim, side);
    std::fill(upper_, upper_ + Dim, 0);
  }
  std::vector<T> data_;
  int lower_[Dim], upper_[Dim];  // of the nodes that have entries
};

}  // namespace mpm
