// What a crack on the grid costs over its toughness, by kernel and by how the driving term acts.
#pragma once

#include "mpm_hpc/math/bspline.hpp"

namespace mpm {

// The crack that the toughness is corrected for.
enum class CrackShape {
  profile,  // c of one broken row of particles
  running  // what a crack breaks that runs: grids join its flanks until the particles within a cell of it are broken
};

// k of the energy (1 + k h / l0) G_c per area. profile: the discretised AT2 energy, least over c on the nodes, of one row where
// c = 0 (physics.md section 5 for lumped reactions; with the reaction at the particles the energies of the quadratic kernel are
// 1.276, 1.130, 1.064 G_c at l0/h = 0.5, 1, 2). running: least energy over c and the displacements across a clamped strip 80 cells
// high at the load at which it pays to break it (tests/support/cracked_column.hpp); the k whose largest error over l0/h = 0.5, 1,
// 2 is least.
inline double crack_cost(KernelKind kernel, bool lumped, CrackShape shape) {
  struct Costs {
    double profile, running;
  };
  // By kernel: reaction at the particles, lumped.
  static constexpr Costs table[3][2] = {
      {{0.10, 0.29}, {0.25, 0.29}},  // linear
      {{0.16, 0.32}, {0.40, 0.46}},  // quadratic
      {{0.15, 0.38}, {0.59, 0.56}},  // cubic
  };
  const Costs& costs = table[static_cast<int>(kernel)][lumped];
  return shape == CrackShape::profile ? costs.profile : costs.running;
}

}  // namespace mpm
