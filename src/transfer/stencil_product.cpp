#include <algorithm>
#include <cstring>
#include <utility>

#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/math/row.hpp"
#include "mpm_hpc/math/simd.hpp"
#include "mpm_hpc/transfer/operator_stencil.hpp"

namespace mpm {

namespace {

// The nodes of a block and those that its boxes reach. For each shift by (p, s) in the last two directions there is a copy of
// the block's sheets of 4 x 4 nodes, so that all that one register of entries is multiplied by and added to is a register too,
// and the sums of a sheet stay in registers until its entries have passed.
template <class Kernel, int Dim, class T, class E>
class ProductTile {
 public:
  using Stencil = OperatorStencil<Kernel, Dim>;
  static constexpr int offsets = Stencil::offsets;
  static constexpr int side = block_side + offsets - 1;
  static constexpr int sheets = Dim == 2 ? 1 : side, block_sheets = Dim == 2 ? 1 : block_side;
  static constexpr int sheet_nodes = block_side * block_side;

  // `next` is the block that comes after this one, whose entries are asked for meanwhile.
  void apply(const BlockTopology<Dim>& topology, Slot slot, Slot next, const E* stencil, const T* x, T* y) {
    const Places places(topology, slot);
    for (int h = 0; h < sheets; ++h)
      for (int r = 0; r < side; ++r)
        gather(h, r, load_quad(x + places.node(h, r, 0)), load_quad(x + places.node(h, r, 1)),
               std::make_integer_sequence<int, offsets>());
    std::memset(y_, 0, sizeof(y_));
    const E* entries = stencil + static_cast<std::size_t>(slot) * Stencil::block_values;
    const E* later = stencil + static_cast<std::size_t>(next) * Stencil::block_values;
    for (int h = 0; h < block_sheets; ++h)
      for (int n = 0; n < sheet_nodes; n += lanes) {
        const int first = h * sheet_nodes + n, ahead = first + Stencil::nodes / 2;
        multiply(entries + first, ahead < Stencil::nodes ? entries + ahead : later + ahead - Stencil::nodes,
                 h, n);
      }
    for (int h = 0; h < sheets; ++h)
      for (int r = 0; r < side; ++r)
        scatter(h, r, y + places.node(h, r, 0), y + places.node(h, r, 1),
                std::make_integer_sequence<int, offsets>());
  }

 private:
  static constexpr int lanes = register_bytes / sizeof(T);
  static_assert(sheet_nodes % lanes == 0);
  using V __attribute__((vector_size(lanes * sizeof(T)))) = T;

  // First nodes of the tile's rows. Where there is no block behind there are no entries either: any node will do, since it is
  // multiplied by 0 and gets 0.
  struct Places {
    std::size_t first[2][2][2];  // of this block and those behind it
    Places(const BlockTopology<Dim>& topology, Slot slot) {
      const Slot* around = topology.neighbours(slot);
      for (int n = 0; n < (Dim == 2 ? 4 : 8); ++n) {
        const int a = n / 4, b = n / 2 % 2, c = n % 2;
        const Slot s = around[Dim == 2 ? 3 * (1 + b) + 1 + c : 9 * (1 + a) + 3 * (1 + b) + 1 + c];
        first[a][b][c] = static_cast<std::size_t>(s == no_slot ? slot : s) * nodes_per_block<Dim>;
      }
    }
    std::size_t node(int sheet, int row, int part) const {
      return first[sheet / block_side][row / block_side][part] +
             static_cast<std::size_t>((sheet % block_side * block_side + row % block_side) * block_side);
    }
  };

  template <int... S>
  void gather(int h, int r, const Quad<T>& own, const Quad<T>& next, std::integer_sequence<int, S...>) {
    const Quad<T> shifted[] = {__builtin_shufflevector(own, next, S, S + 1, S + 2, S + 3)...};
    for (int p = 0; p < offsets; ++p)
      if (r >= p && r - p < block_side)
        for (int s = 0; s < offsets; ++s)
          std::memcpy(&x_[h][p * offsets + s][(r - p) * block_side], &shifted[s], sizeof(Quad<T>));
  }
  // What was summed for node z + s at z goes to the nodes s further on.
  template <int... S>
  void scatter(int h, int r, T* own, T* next, std::integer_sequence<int, S...>) {
    const Quad<T> none{};
    Quad<T> sum[] = {Quad<T>{S * T(0)}...};
    for (int p = 0; p < offsets; ++p)
      if (r >= p && r - p < block_side)
        for (int s = 0; s < offsets; ++s) sum[s] += load_quad(&y_[h][p * offsets + s][(r - p) * block_side]);
    Quad<T> a = load_quad(own), b = load_quad(next);
    ((a += __builtin_shufflevector(none, sum[S], 4 - S, 5 - S, 6 - S, 7 - S)), ...);
    ((b += __builtin_shufflevector(sum[S], none, 4 - S, 5 - S, 6 - S, 7 - S)), ...);
    // Should both be the same nodes, for want of a block behind, then b has nothing to add.
    std::memcpy(next, &b, sizeof(b));
    std::memcpy(own, &a, sizeof(a));
  }

  static V load(const T* p) {
    V v;
    std::memcpy(&v, p, sizeof(v));
    return v;
  }

  static V load_entries(const E* p) { return detail::load_converted<lanes, T>(p); }

  // All boxes from some nodes of sheet h. A box joins each of its corners with the opposite one.
  void multiply(const E* entries, const E* later, int h, int n) {
    V own[offsets * offsets];  // sums of sheet h, by shift
    load_sums(own, h, n);
    unrolled<offsets * offsets>([&](auto shift) {
      const V a = load_entries(entries + shift * Stencil::nodes);
      __builtin_prefetch(later + shift * Stencil::nodes);
      for_each_corner<shift>([&](auto corner, auto opposite) { own[corner] += a * load_x(h, opposite, n); });
    });
    if constexpr (Dim == 3) {
      for (int o = 1; o < offsets; ++o) {
        const int plane = o * offsets * offsets * Stencil::nodes;
        V other[offsets * offsets];  // of sheet h + o
        load_sums(other, h + o, n);
        unrolled<offsets * offsets>([&](auto shift) {
          const V a = load_entries(entries + plane + shift * Stencil::nodes);
          __builtin_prefetch(later + plane + shift * Stencil::nodes);
          for_each_corner<shift>([&](auto corner, auto opposite) {
            own[corner] += a * load_x(h + o, opposite, n);
            other[corner] += a * load_x(h, opposite, n);
          });
        });
        store_sums(other, h + o, n);
      }
    }
    store_sums(own, h, n);
  }
  // f(corner, opposite one) for the corners of the rectangle from 0 to the shift (p, s).
  template <int Shift, class F>
  static void for_each_corner(F&& f) {
    constexpr int p = Shift / offsets, s = Shift % offsets;
    f(std::integral_constant<int, 0>(), std::integral_constant<int, Shift>());
    if constexpr (s > 0) f(std::integral_constant<int, s>(), std::integral_constant<int, p * offsets>());
    if constexpr (p > 0) f(std::integral_constant<int, p * offsets>(), std::integral_constant<int, s>());
    if constexpr (p > 0 && s > 0) f(std::integral_constant<int, Shift>(), std::integral_constant<int, 0>());
  }
  V load_x(int h, int shift, int n) const { return load(&x_[h][shift][n]); }
  void load_sums(V* sums, int h, int n) const {
    unrolled<offsets * offsets>([&](auto shift) { sums[shift] = load(&y_[h][shift][n]); });
  }
  void store_sums(const V* sums, int h, int n) {
    unrolled<offsets * offsets>([&](auto shift) { std::memcpy(&y_[h][shift][n], &sums[shift], sizeof(V)); });
  }

  // By sheet, shift and node of the sheet.
  alignas(64) T x_[sheets][offsets * offsets][sheet_nodes], y_[sheets][offsets * offsets][sheet_nodes];
};

}  // namespace

template <class Kernel, int Dim, class T, class E>
void apply_stencil(const BlockTopology<Dim>& topology, const std::vector<Slot>& blocks, const E* stencil,
                   const T* x, T* y) {
  ProductTile<Kernel, Dim, T, E> tile;
  for (std::size_t b = 0; b < blocks.size(); ++b)
    tile.apply(topology, blocks[b], blocks[std::min(b + 1, blocks.size() - 1)], stencil, x, y);
}

#define MPM_INSTANTIATE(Kernel, Dim, T, E)                                                                            \
  template void apply_stencil<Kernel, Dim, T, E>(const BlockTopology<Dim>&, const std::vector<Slot>&, const E*, const T*, T*);
MPM_FOR_OPERATOR_STENCILS(MPM_INSTANTIATE)
#undef MPM_INSTANTIATE

}  // namespace mpm
