// What an implicit step asks of a solid: energy, stress and tangent of particles as a trial velocity would deform them.
#pragma once

#include <algorithm>
#include <limits>

#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

// With L = dt grad v, F = (I + L) F^n and the energy V0 Psi(F) of a particle, each entry [p - begin] of:
template <int Dim>
struct TrialColumns {
  static constexpr int tangent_size = SymTensor<double, Dim * Dim>::size;
  // d (V0 Psi) / d L_ab = V0 (P F^nT)_ab [J] at [a * Dim + b]
  double* stress[Dim * Dim] = {};
  // d^2 (V0 Psi) / d L_ab d L_cd [J] at the entry (a * Dim + b, c * Dim + d) of a symmetric tensor; null: not wanted
  double* tangent[tangent_size] = {};
  double* modulus = nullptr;  // V0 times the modulus of waves, degraded like the stress [J]; null: not wanted
  bool project = true;        // whether the tangent is made semi-definite
};

// Sums and extremes over a run of particles.
struct TrialSums {
  Real energy = 0;     // sum of V0 Psi [J]; no finite number if a particle is turned inside out
  Real magnitude = 0;  // sum of V0 times the moduli [J], to which its rounding errors are relative
  Real min_jacobian = std::numeric_limits<Real>::infinity();

  void include(const TrialSums& other) {
    energy += other.energy;
    magnitude += other.magnitude;
    min_jacobian = std::min(min_jacobian, other.min_jacobian);
  }
};

}  // namespace mpm
