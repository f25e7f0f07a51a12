// P2G: particles' mass and momentum, with the momentum of the stress, onto the nodes.
#pragma once

#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/math/tensor.hpp"
#include "mpm_hpc/transfer/transfer_form.hpp"

namespace mpm {

// Gives the Kirchhoff stress of a run of particles; one call per chunk.
template <int Dim, class T>
class StressSource {
 public:
  virtual ~StressSource() = default;
  // tau[c][p - begin] [Pa], components as in SymTensor.
  virtual void kirchhoff_stress(Index begin, Index end, T* const* tau) const = 0;
};

// What every transfer kernel works on. T is the scene's precision.
template <int Dim, class T>
struct TransferGrid {
  const GridGeometry<Dim>& geometry;
  const BlockTopology<Dim>& topology;
  T* nodes;  // (momentum or velocity, mass) of node n at nodes[n * node_values]; padded to four values in 2D
  // For a scheme with increments, node_values per node likewise: P2G adds the forces' impulse here instead, and G2P finds
  // the change of the velocity.
  T* changes = nullptr;
  Real flip_blend = 0;  // share of the particle's own velocity
};

// Adds for each particle of the given ranges (numbers into body.ranges)
//   m_i += w_ip m_p,   (m v)_i += w_ip m_p (v_p + C_p (x_i - x_p)) + dt f_ip
// with C_p and the force f_ip of the form (physics.md section 1); for APIC and MLS forces that is
//   (m v)_i += w_ip (m_p v_p + A_p (x_i - x_p)),   A_p = m_p C_p - dt V0_p D_p^-1 tau_p.
// Throws LogicError if a particle drifted further than the tile reaches.
template <class Kernel, class Form = ApicMls, int Dim, class T>
void particle_to_grid(const TransferGrid<Dim, T>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                      const StressSource<Dim, T>& stress, Real dt);

}  // namespace mpm
