// The equations of phase-field fracture at one particle (physics.md section 5), divided by the mobility so that the
// rate-independent limit is just another value.
#pragma once

#include <cmath>

#include "mpm_hpc/math/simd.hpp"

namespace mpm {

// c = 1 intact, c = 0 broken. With m = 1 / (M_c dt), m = 0 for M_c -> infinity, backward Euler on the grid reads
//   (M + H) c = r,  M_ii = sum_p V_p (4 l0 (1 - r) H_p / G_c + 1 + m) w_ip,  r_i = sum_p V_p (1 + m c_p) w_ip,
//   H_ij = sum_p V_p 4 l0^2 grad w_ip . grad w_jp.
struct PhaseLaw {
  double length = 0;            // l0 [m]
  double residual = 0;          // r
  double toughness = 1;         // G_c as it enters the equations, corrected for the grid if asked for [J/m^2]
  double inverse_mobility = 0;  // 1 / M_c [s]

  // 4 l0 (1 - r) H / G_c, the driving force over the resistance.
  template <class S>
  S drive(const S& history) const {
    return broadcast<S>(4 * length * (1 - residual) / toughness) * history;
  }
  // m, how much the equation knows of c^n.
  double memory(double dt) const { return inverse_mobility / dt; }
  double storage(double dt) const { return 1 + memory(dt); }
  // The energy at which a homogeneous c = 1 / (1 + 4 l0 (1 - r) H / G_c) has this value.
  double energy_for(double phase) const { return (1 / phase - 1) * toughness / (4 * length * (1 - residual)); }
  // L_s = 2 l0 sqrt(M_c dt / (1 + M_c dt)), over which a disturbance of c decays in one step [m].
  double decay_length(double dt) const { return 2 * length / std::sqrt(storage(dt)); }
  double conductivity() const { return 4 * length * length; }
  // G_c ((c - 1)^2 / (4 l0) + l0 |grad c|^2) [J/m^3].
  double energy_density(double phase, double gradient_squared) const {
    return toughness * ((phase - 1) * (phase - 1) / (4 * length) + length * gradient_squared);
  }
  // The energy of some particles [J], by their undeformed volume, c and grad c (one array per direction).
  template <int Dim, class T>
  double energy(int count, const T* volume, const T* phase, const T* const* gradient) const {
    double sum = 0;
    for (int p = 0; p < count; ++p) {
      double squared = 0;
      for (int a = 0; a < Dim; ++a) squared += static_cast<double>(gradient[a][p]) * gradient[a][p];
      sum += volume[p] * energy_density(phase[p], squared);
    }
    return sum;
  }
};

// A crack on the grid costs (1 + k h / l0) G_c per area (crack_cost.hpp): dividing by it gives the toughness that the user
// asked for.
inline double corrected_toughness(double toughness, double spacing, double length, double k) {
  return toughness / (1 + k * spacing / length);
}

}  // namespace mpm
