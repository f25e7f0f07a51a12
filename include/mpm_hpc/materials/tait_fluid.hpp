// Weakly compressible fluid with Tait's equation of state, p = K/g (J^-g - 1), which resists compression ever more:
// Psi = K/g (J - 1 + (J^(1-g) - 1) / (g - 1)).
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/fluid_constants.hpp"
#include "mpm_hpc/math/simd.hpp"

namespace mpm {

struct TaitFluid : FluidConstants {
  static constexpr const char* name = "tait_fluid";
  static constexpr const char* doc = "weakly compressible fluid with Tait's equation of state and viscosity";

  Real exponent = 7;  // g

  void declare(Parameters& parameters) {
    FluidConstants::declare(parameters);
    parameters.real(
        "exponent", exponent,
        {.min = 1, .min_exclusive = true, .max = 100, .doc = "exponent g of Tait's equation; 7 for water"});
  }

  // tau = -p J = -K/g (J^-g - 1) J
  template <class S>
  S spherical_stress(const S& volume_change) const {
    const S pressure = broadcast<S>(bulk_modulus / exponent) * power_less_one(volume_change, -exponent);
    return -(pressure * (broadcast<S>(1.0) + volume_change));
  }
  template <class S>
  S energy_density(const S& volume_change) const {
    return broadcast<S>(bulk_modulus / exponent) *
           (volume_change + broadcast<S>(1 / (exponent - 1)) * power_less_one(volume_change, 1 - exponent));
  }
  // d tau / d ln J = K/g ((g - 1) J^(1-g) + J); where J < 1 sound is faster, c^2 = K J^(1-g) / rho0.
  template <class S>
  S wave_modulus(const S& volume_change) const {
    const S one = broadcast<S>(1.0), power = one + power_less_one(volume_change, 1 - exponent);
    return broadcast<S>(bulk_modulus) *
           maximum<S>(power, broadcast<S>(1 / exponent) *
                                 (broadcast<S>(exponent - 1) * power + one + volume_change));
  }

 private:
  // J^a - 1 with the digits of J - 1.
  template <class S>
  static S power_less_one(const S& volume_change, Real a) {
    return expm1_of<S>(broadcast<S>(a) * log1p_of<S>(volume_change));
  }
};

}  // namespace mpm
