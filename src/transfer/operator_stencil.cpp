#include "mpm_hpc/transfer/operator_stencil.hpp"

#include <algorithm>

#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

namespace {

// The entries of one particle are products over directions of w_n w_m or (w_n d_n)(w_m d_m), symmetric in n and m: the
// particles of one cell share their nodes, so their 6^Dim products are summed first and spread to the nodes once.
template <class Kernel, int Dim, class T>
class CellSums {
 public:
  static constexpr int pairs = Kernel::support * (Kernel::support + 1) / 2;
  static constexpr int padded = 8;  // the last direction, for whole registers
  static constexpr int lines = Dim == 2 ? pairs : pairs * pairs;
  static_assert(pairs <= padded);

  // W[a][n m] = w_n w_m and K[a][n m] = (w_n d_n)(w_m d_m).
  void add(const T (*W)[padded], const T (*K)[padded], T k, T reaction) {
    for (int line = 0; line < lines; ++line) {
      T squares, moments;
      if constexpr (Dim == 2) {
        squares = k * W[0][line];
        moments = k * K[0][line] + reaction * W[0][line];
      } else {
        const int x = line / pairs, y = line % pairs;
        squares = k * W[0][x] * W[1][y];
        moments = k * (K[0][x] * W[1][y] + W[0][x] * K[1][y]) + reaction * W[0][x] * W[1][y];
      }
      for (int z = 0; z < padded; ++z) sums_[line][z] += moments * W[Dim - 1][z] + squares * K[Dim - 1][z];
    }
  }

  // Adds the sums to the nodes of the cell whose first node is `first` in the tile of `slot`, and forgets them.
  void flush(const BlockTopology<Dim>& topology, Slot slot, const IntVec<Dim>& first, T* stencil) {
    using Stencil = HalfStencil<Kernel, Dim>;
    const Slot* around = topology.neighbours(slot);
    for (int i = 0; i < nodes; ++i) {
      const IntVec<Dim> node_i = local(i);
      int neighbour = 0, in_block = 0;
      for (int a = 0; a < Dim; ++a) {
        const int t = first[a] + node_i[a] - 1;
        neighbour = 3 * neighbour + (t < 0 ? 0 : t < block_side ? 1 : 2);
        in_block = block_side * in_block + (t & (block_side - 1));
      }
      T* entries = stencil + (static_cast<std::size_t>(around[neighbour]) * nodes_per_block<Dim> + in_block) * Stencil::size;
      for (int j = i; j < nodes; ++j) {
        const IntVec<Dim> node_j = local(j);
        int line = 0;
        for (int a = 0; a < Dim - 1; ++a) line = line * pairs + pair(node_i[a], node_j[a]);
        entries[Stencil::number(node_j - node_i) - Stencil::centre] += sums_[line][pair(node_i[Dim - 1], node_j[Dim - 1])];
      }
    }
    std::fill(&sums_[0][0], &sums_[0][0] + lines * padded, T(0));
  }

  static int pair(int n, int m) {
    if (n > m) std::swap(n, m);
    return n * Kernel::support - n * (n - 1) / 2 + (m - n);
  }

 private:
  static constexpr int nodes = Dim == 2 ? Kernel::support * Kernel::support
                                        : Kernel::support * Kernel::support * Kernel::support;
  static IntVec<Dim> local(int n) {
    IntVec<Dim> node;
    for (int a = Dim - 1; a >= 0; --a, n /= Kernel::support) node[a] = n % Kernel::support;
    return node;
  }
  alignas(64) T sums_[lines][padded] = {};
};

}  // namespace

template <class Kernel, int Dim, class T>
void scatter_operator_stencil(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                              const OperatorColumns<T>& columns, T* stencil) {
  using Sums = CellSums<Kernel, Dim, T>;
  constexpr int W = pack_width<T>;
  Sums sums;
  const Real* x[Dim];
  for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a);
  const Real scale = Kernel::inverse_inertia / grid.geometry.spacing();
  const T scale2 = static_cast<T>(scale * scale);
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    IntVec<Dim> cell = IntVec<Dim>::Constant(-1);
    for (Index p = range.begin; p < range.end; p += W) {
      const LanePlace<Kernel, Dim, T> lanes(grid.geometry, grid.topology.first_node(range.slot), x, p);
      if (!lanes.inside()) throw_drifted_out();
      for (int l = 0; l < W; ++l) {
        IntVec<Dim> first;
        T pair_w[Dim][Sums::padded] = {}, pair_k[Dim][Sums::padded] = {};
        for (int a = 0; a < Dim; ++a) {
          first[a] = static_cast<int>(lanes.first[a][l]);
          for (int n = 0; n < Kernel::support; ++n)
            for (int m = n; m < Kernel::support; ++m) {
              const T ww = lanes.w[a][n][l] * lanes.w[a][m][l];
              const T dn = lanes.centre[a][l] + static_cast<T>(n - 1), dm = lanes.centre[a][l] + static_cast<T>(m - 1);
              pair_w[a][Sums::pair(n, m)] = ww;
              pair_k[a][Sums::pair(n, m)] = ww * dn * dm;
            }
        }
        if (first != cell) {
          if (cell[0] >= 0) sums.flush(grid.topology, range.slot, cell, stencil);
          cell = first;
        }
        sums.add(pair_w, pair_k, scale2 * columns.conductivity[p + l], columns.reaction ? columns.reaction[p + l] : T(0));
      }
    }
    if (cell[0] >= 0) sums.flush(grid.topology, range.slot, cell, stencil);
  }
}

#define MPM_INSTANTIATE(Dim, T)                                                                            \
  template void scatter_operator_stencil<QuadraticKernel, Dim, T>(const ScalarGrid<Dim>&, const Body<Dim>&,  \
                                                                  const std::vector<int>&,                   \
                                                                  const OperatorColumns<T>&, T*);
MPM_INSTANTIATE(2, float)
MPM_INSTANTIATE(2, double)
MPM_INSTANTIATE(3, float)
MPM_INSTANTIATE(3, double)
#undef MPM_INSTANTIATE

}  // namespace mpm
