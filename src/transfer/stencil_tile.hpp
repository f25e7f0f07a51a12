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

  // Moves the sums to the grid.
  template <class U>
  void scatter_add(const BlockTopology<Dim>& topology, Slot slot, T* stencil, U* diagonal,
                   std::vector<char>& touched) {
    find_rows(topology, slot, stencil, touched);
    for (int plane = 0; plane < Stencil::planes; ++plane) {
      const int o[2] = {Dim == 2 ? plane : plane / Stencil::offsets, plane % Stencil::offsets};
      T* out = stencil + plane * Stencil::offsets * Stencil::nodes;
      for (int n = 0; n < used_rows_; ++n) {
        const UsedRow& r = used_[n];
        bool used = true;  // boxes end inside the nodes that have entries
        for (int a = 0; a < Dim - 1; ++a) used = used && r.t[a] + o[a] < upper_[a];
        if (!used) continue;
        add_part<0>(r, plane, out, diagonal);
        add_part<1>(r, plane, out, diagonal);
        add_part<2>(r, plane, out, diagonal);
        std::fill(at(r.row, plane, 0), at(r.row, plane, 0) + line, T(0));
      }
    }
    forget();
  }

 private:
  // A row of nodes that has entries: its place, and for its parts before the block, in it and behind it the nodes' first
  // number in the grid, or none.
  struct UsedRow {
    int row, t[2];
    std::ptrdiff_t block[3], node;
  };
  void find_rows(const BlockTopology<Dim>& topology, Slot slot, T* stencil, std::vector<char>& touched) {
    const Slot* around = topology.neighbours(slot);
    used_rows_ = 0;
    for (int row = 0; row < rows; ++row) {
      UsedRow r{row, {Dim == 2 ? row : row / side, row % side}, {}, 0};
      int neighbour = 0;
      bool used = true;
      for (int a = 0; a < Dim - 1; ++a) {
        used = used && r.t[a] >= lower_[a] && r.t[a] < upper_[a];
        neighbour = 3 * neighbour + (r.t[a] < 1 ? 0 : r.t[a] < 1 + block_side ? 1 : 2);
        r.node = block_side * r.node + ((r.t[a] - 1) & (block_side - 1));
      }
      if (!used) continue;
      r.node *= block_side;
      for (int part = 0; part < 3; ++part) {
        const bool has = first_of(part) < upper_[Dim - 1] && first_of(part + 1) > lower_[Dim - 1];
        r.block[part] = has ? around[3 * neighbour + part] : no_slot;
        if (!has || touched[static_cast<std::size_t>(r.block[part])]) continue;
        touched[static_cast<std::size_t>(r.block[part])] = 1;
        std::memset(stencil + r.block[part] * Stencil::block_values, 0, Stencil::block_values * sizeof(T));
      }
      used_[used_rows_++] = r;
    }
  }
  // First node of a row's part in the block before, in the block, and behind it.
  static constexpr int first_of(int part) {
    return part == 0 ? 0 : part == 1 ? 1 : part == 2 ? 1 + block_side : side;
  }

  template <int Part, class U>
  void add_part(const UsedRow& r, int plane, T* stencil, U* diagonal) {
    if (r.block[Part] == no_slot) return;
    T* out = stencil + r.block[Part] * Stencil::block_values + r.node;
    add_line<Part>(at(r.row, plane, first_of(Part)), out,
                   std::make_integer_sequence<int, Stencil::offsets>());
    // The next plane's, which come from far.
    for (int o = 0; o < Stencil::offsets; ++o)
      __builtin_prefetch(out + (Stencil::offsets + o) * Stencil::nodes, 1);
    if (plane != 0) return;
    U* d = diagonal + r.block[Part] * Stencil::nodes + r.node;
    for (int n = first_of(Part); n < first_of(Part + 1); ++n)
      d[(n - 1) & (block_side - 1)] += *at(r.row, 0, n);
  }
  // For each offset o, the line's entries for the block's four nodes; those outside of the part are 0.
  template <int Part, int... O>
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
    if constexpr (Part == 1) {
      std::memcpy(&b, in + width, sizeof(b));
    } else {
      b = V{};
    }
    if constexpr (Part == 0) {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, none, none, none, O)), ...);
    } else if constexpr (Part == 1) {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, O, N + O, 2 * N + O, 3 * N + O)), ...);
    } else {
      (add(out + O * Stencil::nodes,
           __builtin_shufflevector(a, b, O, N + O, behind(2 * N + O), behind(3 * N + O))),
       ...);
    }
#else
    // Number by number, as the compiler takes other shuffles apart anyway, and less well.
    const auto behind = [in](int entry) { return Part == 1 || entry < width ? in[entry] : T(0); };
    if constexpr (Part == 0) {
      (add(out + O * Stencil::nodes, Quad<T>{0, 0, 0, in[O]}), ...);
    } else {
      (add(out + O * Stencil::nodes, Quad<T>{in[O], in[N + O], behind(2 * N + O), behind(3 * N + O)}), ...);
    }
#endif
  }
  void forget() {
    std::fill(lower_, lower_ + Dim, side);
    std::fill(upper_, upper_ + Dim, 0);
  }
  std::vector<T> data_;
  UsedRow used_[rows];
  int used_rows_ = 0;
  int lower_[Dim], upper_[Dim];  // of the nodes that have entries
};

}  // namespace mpm
