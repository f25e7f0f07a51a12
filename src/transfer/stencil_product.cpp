#include <cstring>
#include <utility>


#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/math/row.hpp"
#include "mpm_hpc/transfer/operator_stencil.hpp"

namespace mpm {

namespace {

// The nodes of a block and those that its boxes reach, two rows of four nodes at a time. Products that belong to node
// z + s are summed at z in the part s, so that each sum is a register of its own; the offsets come in the outer loop, so
// that a sum is not needed again before it has reached memory.
template <class Kernel, int Dim, class T>
class ProductTile {
 public:
  using Stencil = OperatorStencil<Kernel, Dim>;
  static constexpr int offsets = Stencil::offsets;
  static constexpr int side = block_side + offsets - 1;
  static constexpr int sheets = Dim == 2 ? 1 : side;

  void apply(const BlockTopology<Dim>& topology, Slot slot, const T* stencil, const T* x, T* y) {
    for (int h = 0; h < sheets; ++h)
      for (int r = 0; r < side; ++r) {
        const Place place(topology, slot, h, r);
        gather(h, r, load_quad(x + place.own), load_quad(x + place.next), std::make_integer_sequence<int, offsets>());
        for (int s = 0; s < offsets; ++s) std::memset(y_[h][s][r], 0, sizeof(y_[h][s][r]));
      }
    stencil += static_cast<std::size_t>(slot) * Stencil::block_values;
    for (int plane = 0; plane < Stencil::planes; ++plane) {
      const int o = Dim == 2 ? 0 : plane / offsets, p = plane % offsets;
      for (int h = 0; h < (Dim == 2 ? 1 : block_side); ++h)
        for (int r = 0; r < block_side; r += 2) {
          const T* entries = stencil + plane * offsets * Stencil::nodes + (h * block_side + r) * block_side;
          // The entries come from memory once per product, too scattered for the machine to foresee.
          for (int s = 0; s < offsets; ++s)
            __builtin_prefetch(entries + (2 * offsets + s) * Stencil::nodes);
          if (plane == 0) {
            within(entries, h, r);
          } else {
            between(entries, h, r, h + o, r + p);
            if (o != 0 && p != 0) between(entries, h + o, r, h, r + p);
          }
        }
    }
    for (int h = 0; h < sheets; ++h)
      for (int r = 0; r < side; ++r) {
        const Place place(topology, slot, h, r);
        scatter(h, r, y + place.own, y + place.next, std::make_integer_sequence<int, offsets>());
      }
  }

 private:
  // First nodes of a row's part in the block and of the part behind it. Where there is no such block there are no entries
  // either: any node will do, since it is multiplied by 0 and gets 0.
  struct Place {
    std::size_t own, next;
    Place(const BlockTopology<Dim>& topology, Slot slot, int sheet, int row) {
      int neighbour = 1 + row / block_side, local = row % block_side;
      if constexpr (Dim == 3) {
        neighbour += 3 * (1 + sheet / block_side);
        local += block_side * (sheet % block_side);
      }
      const Slot* around = topology.neighbours(slot) + 3 * neighbour;
      auto node = [local, slot](Slot s) {
        return static_cast<std::size_t>(s == no_slot ? slot : s) * nodes_per_block<Dim> +
               static_cast<std::size_t>(local * block_side);
      };
      own = node(around[1]);
      next = node(around[2]);
    }
  };

  template <int... S>
  void gather(int h, int r, const Quad<T>& own, const Quad<T>& next, std::integer_sequence<int, S...>) {
    (put(x_[h][S][r], __builtin_shufflevector(own, next, S, S + 1, S + 2, S + 3)), ...);
  }
  // Part s goes to the nodes s further on.
  template <int... S>
  void scatter(int h, int r, T* own, T* next, std::integer_sequence<int, S...>) {
    const Quad<T> none{};
    Quad<T> a = load_quad(own), b = load_quad(next);
    ((a += __builtin_shufflevector(none, load_quad(y_[h][S][r]), 4 - S, 5 - S, 6 - S, 7 - S)), ...);
    ((b += __builtin_shufflevector(load_quad(y_[h][S][r]), none, 4 - S, 5 - S, 6 - S, 7 - S)), ...);
    // Should both be the same nodes, for want of a block behind, then b has nothing to add.
    put(next, b);
    put(own, a);
  }
  static void put(T* to, const Quad<T>& q) { std::memcpy(to, &q, sizeof(q)); }

  using V __attribute__((vector_size(8 * sizeof(T)))) = T;  // two rows
  static V load(const T* p) {
    V v;
    std::memcpy(&v, p, sizeof(v));
    return v;
  }
  static void add(T* to, const V& what) {
    const V sum = load(to) + what;
    std::memcpy(to, &sum, sizeof(sum));
  }
  // Boxes within rows: nodes z and z + s.
  void within(const T* entries, int h, int r) {
    V sum = load(entries) * load(x_[h][0][r]);
    for (int s = 1; s < offsets; ++s) {
      const V a = load(entries + s * Stencil::nodes);
      sum += a * load(x_[h][s][r]);
      add(y_[h][s][r], a * load(x_[h][0][r]));
    }
    add(y_[h][0][r], sum);
  }
  // Boxes between two pairs of rows: each node of one with node z + s of the other, both ways.
  void between(const T* entries, int h, int r, int other_h, int other_r) {
    const V a0 = load(entries), x0 = load(x_[h][0][r]), other_x0 = load(x_[other_h][0][other_r]);
    V sum = a0 * other_x0, other_sum = a0 * x0;
    for (int s = 1; s < offsets; ++s) {
      const V a = load(entries + s * Stencil::nodes);
      sum += a * load(x_[other_h][s][other_r]);
      other_sum += a * load(x_[h][s][r]);
      add(y_[h][s][r], a * other_x0);
      add(y_[other_h][s][other_r], a * x0);
    }
    add(y_[h][0][r], sum);
    add(y_[other_h][0][other_r], other_sum);
  }

  // By sheet, shift and row.
  alignas(64) T x_[sheets][offsets][side][block_side], y_[sheets][offsets][side][block_side];
};

}  // namespace

template <class Kernel, int Dim, class T>
void apply_stencil(const BlockTopology<Dim>& topology, const std::vector<Slot>& blocks, const T* stencil, const T* x,
                   T* y) {
  ProductTile<Kernel, Dim, T> tile;
  for (const Slot slot : blocks) tile.apply(topology, slot, stencil, x, y);
}

#define MPM_INSTANTIATE(Dim, T)                                                                               \
  template void apply_stencil<QuadraticKernel, Dim, T>(const BlockTopology<Dim>&, const std::vector<Slot>&,   \
                                                       const T*, const T*, T*);
MPM_INSTANTIATE(2, float)
MPM_INSTANTIATE(2, double)
MPM_INSTANTIATE(3, float)
MPM_INSTANTIATE(3, double)
#undef MPM_INSTANTIATE

}  // namespace mpm
