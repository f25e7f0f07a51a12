// Isotropic linear elasticity at F = I, read as Young's modulus and Poisson's ratio by every elastic law.
#pragma once

#include "mpm_hpc/base/types.hpp"

namespace mpm {

class Parameters;

struct ElasticConstants {
  Real mu = 0;      // shear modulus [Pa]
  Real lambda = 0;  // first Lame parameter of a 3D or plane-strain body [Pa]

  static ElasticConstants from_youngs_modulus(Real youngs_modulus, Real poisson_ratio);
  void declare(Parameters& parameters);

  template <int Dim>
  Real bulk_modulus() const {
    return lambda + 2 * mu / Dim;
  }
};

}  // namespace mpm
