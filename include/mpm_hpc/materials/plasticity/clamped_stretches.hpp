// Clamped singular values with hardening (snow, Stomakhin et al. 2013).
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/plasticity.hpp"

namespace mpm {

// s_a in [1 - theta_c, 1 + theta_s]; what is cut off goes into J_P, and the moduli are those of the law times
// exp(xi (1 - J_P)): packed snow is hard, torn snow soft.
template <int Dim>
struct ClampedStretches {
  static constexpr const char* name = "clamped_stretches";
  static constexpr const char* doc =
      "principal stretches between two limits, hardening with the volume lost (snow)";
  template <class Law>
  static constexpr bool suits = HasPrincipalStress<Law, Dim>;
  static constexpr int own_count = 1;  // J_P

  Real critical_compression = 2.5e-2;  // theta_c
  Real critical_stretch = 7.5e-3;      // theta_s
  Real hardening = 10;                 // xi

  void declare(Parameters& parameters) {
    parameters.real(
        "critical_compression", critical_compression,
        {.min = 0, .max = 1, .max_exclusive = true, .doc = "largest elastic compression, 1 - stretch"});
    parameters.real("critical_stretch", critical_stretch,
                    {.min = 0, .doc = "largest elastic extension, stretch - 1"});
    parameters.real("hardening", hardening,
                    {.min = 0, .max = 100, .doc = "xi of the moduli's factor exp(xi (1 - J_P)); 0: none"});
  }

  std::vector<OwnColumn> own_columns() const {
    if (hardening > 0) return {{"plastic_volume", "1", 1}};
    return {};
  }
  std::vector<const char*> guards() const { return {}; }

  template <class S>
  S modulus_factor(const S* own) const {
    if (hardening > 0) return exp_of<S>(broadcast<S>(hardening) * (broadcast<S>(1.0) - own[0]));
    return broadcast<S>(1.0);
  }

  template <class Law, class S>
  S return_stretches(const Law&, S (&s)[Dim], S* own, S*) const {
    const S low = broadcast<S>(1 - critical_compression), high = broadcast<S>(1 + critical_stretch);
    S cut = broadcast<S>(1.0), change = broadcast<S>(0.0);
    for (int a = 0; a < Dim; ++a) {
      const S clamped = minimum<S>(maximum<S>(s[a], low), high);
      cut *= s[a] / clamped;
      change += abs_of<S>(s[a] - clamped);
      s[a] = clamped;
    }
    if (hardening > 0) own[0] *= cut;
    return change;
  }
};

}  // namespace mpm
