#include "mpm_hpc/materials/elastic_constants.hpp"

#include "mpm_hpc/base/parameters.hpp"

namespace mpm {

ElasticConstants ElasticConstants::from_youngs_modulus(Real youngs_modulus, Real poisson_ratio) {
  return {.mu = youngs_modulus / (2 * (1 + poisson_ratio)),
          .lambda = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))};
}

void ElasticConstants::declare(Parameters& parameters) {
  Real youngs_modulus = 0, poisson_ratio = 0;
  parameters.real(
      "youngs_modulus", youngs_modulus,
      {.unit = "Pa", .min = 0, .min_exclusive = true, .required = true, .doc = "Young's modulus"});
  parameters.real("poisson_ratio", poisson_ratio,
                  {.min = -1,
                   .min_exclusive = true,
                   .max = 0.5,
                   .max_exclusive = true,
                   .required = true,
                   .doc = "Poisson's ratio; a 2D body is in plane strain"});
  *this = from_youngs_modulus(youngs_modulus, poisson_ratio);
}

}  // namespace mpm
