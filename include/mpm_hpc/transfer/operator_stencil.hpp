// The diffusion-reaction operator of scalar_transfer.hpp as numbers on the nodes: filled by one sweep over the particles,
// then applied without them.
#pragma once

#include <vector>

#include "mpm_hpc/transfer/scalar_transfer.hpp"

namespace mpm {

// A_ij is a sum over particles of products over directions, each symmetric in its two node numbers. So it is the same for
// all pairs of nodes that span the same box: 2^Dim ordered pairs share one entry, kept at the box's lower corner. A node has
// support^Dim entries (27 in 3D for the quadratic kernel) where a row of the matrix has 125.
//
// Blocks lie one behind the other, each as [offset][node], in the order in which a product reads them. Entries are this
// rank's part of the sum over particles.
template <class Kernel, int Dim>
struct OperatorStencil {
  static constexpr int offsets = Kernel::support;  // 0..support - 1 in each direction
  static constexpr int planes = Dim == 2 ? offsets : offsets * offsets;
  static constexpr int size = planes * offsets;  // entries per node
  static constexpr int nodes = nodes_per_block<Dim>;
  static constexpr int block_values = size * nodes;

  // Entry of the pairs that span the box from node n of the block to this node + offset, offset >= 0.
  static std::size_t index(Slot slot, int n, const IntVec<Dim>& offset) {
    return static_cast<std::size_t>(slot) * block_values + static_cast<std::size_t>(number(offset) * nodes + n);
  }
  // Number of an offset in lexicographic order, and back.
  static int number(const IntVec<Dim>& offset) {
    int n = 0;
    for (int a = 0; a < Dim; ++a) n = n * offsets + offset[a];
    return n;
  }
  static IntVec<Dim> offset(int number) {
    IntVec<Dim> o;
    for (int a = Dim - 1; a >= 0; --a, number /= offsets) o[a] = number % offsets;
    return o;
  }
};

// What scatter_values does, with 1, 2 or 4 values per node, and the
// operator's stencil in the same sweep: stencil[OperatorStencil::index(...)] += A_ij.
// touched[slot] = 1 for the blocks that have entries; those of the others are undefined, and become 0 when they are first
// touched, which is just before they are wanted in the cache.
// Entries (of type E) may be in single precision where the values are in double: this saves half of a product's
// bytes, and changes the operator by about 1e-7 of its entries.
template <class Kernel, int Values, int Dim, class T, class E>
void scatter_values_and_stencil(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                                ValueSource<T>& source, T* nodes, T* diagonal, E* stencil, std::vector<char>& touched);

// y += A x with the entries of the given blocks. x and y have one value per node.
template <class Kernel, int Dim, class T, class E>
void apply_stencil(const BlockTopology<Dim>& topology, const std::vector<Slot>& blocks, const E* stencil, const T* x, T* y);

// INSTANTIATE(Kernel, Dim, T, E) for all that a scene can choose.
#define MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, Kernel, Dim) \
  INSTANTIATE(Kernel, Dim, float, float)                       \
  INSTANTIATE(Kernel, Dim, double, float)                      \
  INSTANTIATE(Kernel, Dim, double, double)
#define MPM_FOR_OPERATOR_STENCILS(INSTANTIATE)                  \
  MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, LinearKernel, 2)    \
  MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, LinearKernel, 3)    \
  MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, QuadraticKernel, 2) \
  MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, QuadraticKernel, 3) \
  MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, CubicKernel, 2)     \
  MPM_FOR_OPERATOR_STENCILS_OF(INSTANTIATE, CubicKernel, 3)

}  // namespace mpm
