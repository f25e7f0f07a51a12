// The lane stage shared by P2G and G2P: where W particles sit in their tile, and their weights.
#pragma once

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/transfer/tile.hpp"
#include "mpm_hpc/transfer/transfer_form.hpp"

namespace mpm {

// Input of P2G's row stage and output of G2P's for one particle, side by side for quick loads.
// Row input: node values are q + sum_b (n_b - 1) a[b] at stencil node n, times the weights.
template <class T>
struct alignas(64) RowParticle {
  T q[4];        // values at the stencil's second node: momentum (or velocity), mass
  T a[3][4];     // their slope per node in each direction
  T w[3][4];     // weights by direction; 0 behind the kernel's support
  int tile_node; // first node of the stencil in the tile
};

// What forms of the transfer add to it.
template <class T>
struct RowGradients {
  T g[3][4];  // derivatives of the weights by direction
  T f[4][4];  // P2G: what they are multiplied by, by direction; G2P: the sums, and last the values
};
template <class T>
struct RowProducts {
  T products[4][4];  // of the slopes: (n_x - 1) (n_y - 1) and so on, in the order of product_modes
};
template <class T>
struct RowIncrements {
  T carried[4];  // P2G: momentum and mass, apart from the forces; G2P: change of velocity
};
template <int>
struct Without {};

template <class Form, class T>
struct alignas(64) FormParticle : RowParticle<T>,
                                  std::conditional_t<Form::classical, RowGradients<T>, Without<0>>,
                                  std::conditional_t<Form::modes, RowProducts<T>, Without<1>>,
                                  std::conditional_t<Form::increments, RowIncrements<T>, Without<2>> {};

// Numbers from one particle's row to the next.
template <class RowOfParticle, class T>
inline constexpr int row_stride = sizeof(RowOfParticle) / sizeof(T);

// Position of W particles in the tile, by direction: first stencil node and weights.
template <class Kernel, int Dim, class T>
struct LanePlace {
  using S = Pack<T>;
  S first[Dim];     // tile coordinate of the stencil's first node (whole numbers)
  S centre[Dim];    // (x_1 - x_p) / h, where x_1 is the stencil's second node
  S w[Dim][Kernel::support];

  // Inlined, so that a loop that has no use for the weights doesn't find them.
  [[gnu::always_inline]] LanePlace(const GridGeometry<Dim>& grid, const IntVec<Dim>& block_first_node, const Real* const* x, Index p) {
    using Wide = Eigen::Array<Real, PackTraits<S>::width, 1>;
    for (int a = 0; a < Dim; ++a) {
      // In double up to here, so that single precision keeps its digits for the place inside the tile.
      const Wide tile = (load<Wide>(x[a] + p) - grid.origin()[a]) * grid.inverse_spacing() -
                        static_cast<Real>(block_first_node[a] - 1);
      const S place = tile.template cast<T>();
      const S shifted = place - static_cast<T>(Kernel::shift);
      first[a] = shifted.floor();
      const S fx = place - first[a];
      Kernel::weights(fx, w[a]);
      centre[a] = static_cast<T>(1) - fx;
    }
  }

  // Node number in the tile of each lane's first stencil node, and the number of its cell.
  S tile_node() const { return number(Tile<Kernel, Dim, T>::side); }
  S cell() const { return number(Tile<Kernel, Dim, T>::cell_side); }

  // Hands each lane's node and weights to its row; RowOfParticle has w[direction][4] and tile_node.
  template <class RowOfParticle>
  void write(RowOfParticle* rows) const {
    constexpr int W = PackTraits<S>::width;
    alignas(64) T node[W], weight[4][W] = {};
    for (int a = 0; a < Dim; ++a) {
      for (int n = 0; n < Kernel::support; ++n) store(weight[n], w[a][n]);
      packs_to_quads<T, W>(weight[0], weight[1], weight[2], weight[3], rows[0].w[a], row_stride<RowOfParticle, T>);
    }
    store(node, tile_node());
    for (int l = 0; l < W; ++l) rows[l].tile_node = static_cast<int>(node[l]);
  }

  // The weights' derivatives per node; RowOfParticle has g[direction][4].
  template <class RowOfParticle>
  void write_gradients(RowOfParticle* rows) const {
    constexpr int W = PackTraits<S>::width;
    for (int a = 0; a < Dim; ++a) {
      alignas(64) T derivative[4][W] = {};
      S g[Kernel::support];
      Kernel::gradients(S(static_cast<T>(1) - centre[a]), g);
      for (int n = 0; n < Kernel::support; ++n) store(derivative[n], g[n]);
      packs_to_quads<T, W>(derivative[0], derivative[1], derivative[2], derivative[3], rows[0].g[a],
                           row_stride<RowOfParticle, T>);
    }
  }

  // More than 0 in the lanes whose stencil ends outside the tile, or that are nowhere; 0 in the others. To be summed over a
  // chunk: to ask all lanes of each pack would take as long as to place them.
  S outside() const {
    constexpr T last = Tile<Kernel, Dim, T>::side - Kernel::support;
    const S zero = S::Zero(), one = S::Ones(), below = S::Constant(T(-0.5)), above = S::Constant(last + T(0.5));
    S sum = zero;
    for (int a = 0; a < Dim; ++a)
      sum += select_less<S>(below, first[a], select_less<S>(first[a], above, zero, one), one);
    return sum;
  }

 private:
  S number(int side) const {
    S n = first[0];
    for (int a = 1; a < Dim; ++a) n = n * static_cast<T>(side) + first[a];
    return n;
  }
};

// Asks for the column's numbers of the next chunk, while this one is worked on: the transfers read more columns at a time
// than the machine follows by itself. Past the end it asks in vain.
template <class T>
inline void prefetch_next_chunk(const T* column, Index p) {
  __builtin_prefetch(column + p + chunk_particles);
}

// The same of the positions, for the pack at p. Inlined, because GCC drops calls of a function that does nothing but prefetch.
template <class T, std::size_t Dim>
[[gnu::always_inline]] inline void prefetch_positions(const Real* const (&x)[Dim], Index p) {
  for (const Real* component : x)
    for (int i = 0; i < pack_width<T>; i += pack_width<Real>) prefetch_next_chunk(component + i, p);
}

// The columns that a transfer reads, to be asked for a chunk ahead. A core waits for some ten or twenty cache lines at a time
// and stops at the next one: asked for by the lane stage, pack by pack, the lines of a chunk come faster than memory delivers,
// and the row stage asks for none. So in 3D the row stage asks, each particle for its share. In 2D a row stage is so short
// that sharing out costs more than it saves.
template <int Dim, class T>
class ColumnsAhead {
 public:
  void add(const T* column) { columns_[count_++] = column; }

  // By the lane stage at each pack, p its first particle.
  [[gnu::always_inline]] void at_pack(Index p) const {
    if constexpr (Dim == 2)
      for (int c = 0; c < count_; ++c) prefetch_next_chunk(columns_[c], p);
  }

  // By the row stage at its k-th particle; p is the chunk's first.
  [[gnu::always_inline]] void at_row(Index p, int k) const {
    constexpr int W = pack_width<T>;
    if constexpr (Dim == 3)
      for (int c = k % W; c < count_; c += W) prefetch_next_chunk(columns_[c], p + k);
  }

 private:
  const T* columns_[Dim + 2 * Dim * Dim + 2 + product_modes<Dim> * Dim];
  int count_ = 0;
};

// Throws LogicError: sorting came too late, which must never pass unnoticed because the tile would lose momentum.
[[noreturn]] void throw_drifted_out();
template <class S>
inline void require_inside(const S& outside) {
  if (!(outside.maxCoeff() <= 0)) throw_drifted_out();
}

}  // namespace mpm
