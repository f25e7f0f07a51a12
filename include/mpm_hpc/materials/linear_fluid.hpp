// Weakly compressible fluid with p = K (1 - J): Psi = K/2 (J - 1)^2.
#pragma once

#include "mpm_hpc/materials/fluid_constants.hpp"
#include "mpm_hpc/math/simd.hpp"

namespace mpm {

struct LinearFluid : FluidConstants {
  static constexpr const char* name = "linear_fluid";
  static constexpr const char* doc = "weakly compressible fluid, p = K (1 - J), with viscosity";

  // tau = -p J = K (J - 1) J
  template <class S>
  S spherical_stress(const S& volume_change) const {
    return broadcast<S>(bulk_modulus) * volume_change * (broadcast<S>(1.0) + volume_change);
  }
  template <class S>
  S energy_density(const S& volume_change) const {
    return broadcast<S>(0.5 * bulk_modulus) * volume_change * volume_change;
  }
  // d tau / d ln J = K J (2J - 1); where J < 1 sound is faster, c^2 = K J^2 / rho0.
  template <class S>
  S wave_modulus(const S& volume_change) const {
    const S J = broadcast<S>(1.0) + volume_change;
    return broadcast<S>(bulk_modulus) * J * maximum<S>(J, J + volume_change);
  }
};

}  // namespace mpm
