// Tresca's rule: the largest shear stress is bounded.
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/plasticity.hpp"

namespace mpm {

// tau_max - tau_min <= sigma_y on the principal Kirchhoff stresses. The return goes to the closest point of the hexagon in
// the plane of deviators, on a side or in a corner, and keeps J (de Souza Neto, Peric and Owen 2008, section 8.1; closest in
// stress, for laws linear in logarithmic strain also in energy).
template <int Dim>
struct Tresca {
  static constexpr const char* name = "tresca";
  static constexpr const char* doc = "bounded largest shear stress, ideally plastic";
  template <class Law>
  static constexpr bool suits = HasDeviator<Law, Dim>;
  static constexpr int own_count = 0;

  Real yield_stress = 0;  // sigma_y [Pa]

  void declare(Parameters& parameters) {
    parameters.real("yield_stress", yield_stress,
                    {.unit = "Pa",
                     .min = 0,
                     .min_exclusive = true,
                     .required = true,
                     .doc = "largest difference of two principal Kirchhoff stresses"});
  }

  std::vector<OwnColumn> own_columns() const { return {}; }
  std::vector<const char*> guards() const { return {}; }

  template <class Law, class S>
  S return_stretches(const Law& law, S (&s)[Dim], S*, S*) const {
    const S sigma = broadcast<S>(yield_stress), half = broadcast<S>(0.5);
    S deviator[Dim], returned[Dim];
    law.principal_deviator(s, deviator);
    S high = deviator[0], low = deviator[0];
    for (int a = 1; a < Dim; ++a) {
      high = maximum<S>(high, deviator[a]);
      low = minimum<S>(low, deviator[a]);
    }
    const S excess = high - low - sigma, shift = half * excess;
    S new_high = high - shift, new_middle = broadcast<S>(0.0), new_low = low + shift;
    if constexpr (Dim == 3) {
      // Beyond the ends of the side the middle stress joins one of the others, at thirds of sigma_y.
      const S third = broadcast<S>(1.0 / 3) * sigma, middle = -(high + low);
      const S upper = select_less<S>(new_high, middle, third, new_high);
      const S lower = select_less<S>(middle, new_low, S(-third), new_low);
      const S left = select_less<S>(new_high, middle, S(-(third + third)), lower);
      const S right = select_less<S>(middle, new_low, S(third + third), upper);
      new_high = right;
      new_low = left;
      new_middle = -(right + left);
    }
    for (int a = 0; a < Dim; ++a)
      deviator[a] =
          select_less<S>(deviator[a], high, select_less<S>(low, deviator[a], new_middle, new_low), new_high);
    law.stretches_with_deviator(s, deviator, returned);
    for (int a = 0; a < Dim; ++a) s[a] = returned[a];
    return excess - broadcast<S>(1e-13) * sigma;  // what a return leaves is no yield
  }
};

}  // namespace mpm
