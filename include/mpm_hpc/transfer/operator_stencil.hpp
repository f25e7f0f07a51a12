// The diffusion-reaction operator as one stencil per node, a grid field like any other: ghost rows travel to their owners with the
// halo sum, so that the assembled matrix is filled row by row.
#pragma once

#include <array>

#include "mpm_hpc/transfer/scalar_transfer.hpp"

namespace mpm {

// A is symmetric, so a node keeps the entries to itself and to the nodes after it in lexicographic order. Entry
// `half_stencil_entry(offset)` of node i is A_i,i+offset.
template <class Kernel, int Dim>
struct HalfStencil {
  static constexpr int reach = Kernel::support - 1;
  static constexpr int width = 2 * reach + 1;
  static constexpr int full = Dim == 2 ? width * width : width * width * width;
  static constexpr int centre = full / 2;
  static constexpr int size = full - centre;  // 13 (2D) and 63 (3D) for the quadratic kernel

  // Number of an offset in -reach..reach per direction; centre for zero; below centre: the mirrored entry's row holds it.
  static constexpr int number(const IntVec<Dim>& offset) {
    int n = 0;
    for (int a = 0; a < Dim; ++a) n = n * width + offset[a] + reach;
    return n;
  }
  static IntVec<Dim> offset(int number) {
    IntVec<Dim> o;
    for (int a = Dim - 1; a >= 0; --a, number /= width) o[a] = number % width - reach;
    return o;
  }
};

// stencil[n * HalfStencil::size + e] += the entries of A (see scalar_transfer.hpp).
template <class Kernel, int Dim, class T>
void scatter_operator_stencil(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                              const OperatorColumns<T>& columns, T* stencil);

}  // namespace mpm
