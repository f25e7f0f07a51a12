// Transfers of scalar fields between particles and nodes, and the discrete diffusion-reaction operator on the particles'
// quadrature: what an effect such as the phase field needs of the grid.
#pragma once

#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_fields.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"

namespace mpm {

template <int Dim>
struct ScalarGrid {
  const GridGeometry<Dim>& geometry;
  const BlockTopology<Dim>& topology;
};

// The particles' coefficients of the operator
//   A_ij = sum_p k_p (D_p^-1 w_ip (x_i - x_p)) . (D_p^-1 w_jp (x_j - x_p)) + a_p w_ip w_jp
// (H of physics.md section 5 in MLS form, with grad w_ip for the linear kernel, and a reaction term that isn't lumped).
template <class T>
struct OperatorColumns {
  const T* conductivity;        // k_p
  const T* reaction = nullptr;  // a_p; none: 0
};

// What a chunk of particles puts onto the nodes.
template <class T>
class ValueSource {
 public:
  virtual ~ValueSource() = default;
  // q[c][p - begin], node_values values per particle, of which the first `Values` are wanted; the others' arrays are there to be
  // written as well. conductivity[p - begin] = k_p and reaction[p - begin] = a_p.
  virtual void values(Index begin, Index end, T* const* q, T* conductivity, T* reaction) = 0;
};

// Receives the interpolated field of a chunk, and its gradient if that was asked for, else nullptr.
template <class T>
class ValueSink {
 public:
  virtual ~ValueSink() = default;
  // value[p - begin] = sum_i w_ip x_i; gradient[a][p - begin] = D_p^-1 sum_i w_ip x_i (x_i - x_p), or sum_i x_i grad w_ip
  // for the linear kernel.
  virtual void values(Index begin, Index end, const T* value, const T* const* gradient) = 0;
};

// nodes[n * Values + c] += sum_p w_ip q_c with 2 or 4 values per node, and diagonal[n] += A_nn.
template <class Kernel, int Values = node_values, int Dim, class T>
void scatter_values(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                    ValueSource<T>& source, T* nodes, T* diagonal);

// y += A x in one sweep, without forming A. One value per node.
template <class Kernel, int Dim, class T>
void apply_operator(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                    const OperatorColumns<T>& columns, const T* x, T* y);

template <class Kernel, int Dim, class T>
void gather_scalar(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges, const T* x,
                   ValueSink<T>& sink);

// The same without the gradient.
template <class Kernel, int Dim, class T>
void gather_value(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges, const T* x,
                  ValueSink<T>& sink);

// INSTANTIATE(Kernel, Dim, T) for all that a scene can choose.
#define MPM_FOR_SCALAR_TRANSFERS_OF(INSTANTIATE, Kernel) \
  INSTANTIATE(Kernel, 2, float) INSTANTIATE(Kernel, 2, double) INSTANTIATE(Kernel, 3, float) INSTANTIATE(Kernel, 3, double)
#define MPM_FOR_SCALAR_TRANSFERS(INSTANTIATE)             \
  MPM_FOR_SCALAR_TRANSFERS_OF(INSTANTIATE, LinearKernel)    \
  MPM_FOR_SCALAR_TRANSFERS_OF(INSTANTIATE, QuadraticKernel) \
  MPM_FOR_SCALAR_TRANSFERS_OF(INSTANTIATE, CubicKernel)

}  // namespace mpm
