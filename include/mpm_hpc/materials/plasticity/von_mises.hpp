// Von Mises plasticity with linear isotropic hardening; radial return (Simo and Hughes 1998, section 9.2).
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/plasticity.hpp"

namespace mpm {

// q = sqrt(3/2) |dev tau|_F <= sigma_0 + H alpha in 2D (plane strain) as in 3D, with the equivalent plastic strain alpha.
// The return keeps J and the direction of dev tau: q_new = q - 3 mu dalpha.
template <int Dim>
struct VonMises {
  static constexpr const char* name = "von_mises";
  static constexpr const char* doc = "von Mises yield stress with linear isotropic hardening (metals)";
  template <class Law>
  static constexpr bool suits = HasDeviator<Law, Dim>;
  static constexpr int own_count = 1;  // alpha

  Real yield_stress = 0;       // sigma_0 [Pa]
  Real hardening_modulus = 0;  // H [Pa]

  void declare(Parameters& parameters) {
    parameters.real("yield_stress", yield_stress,
                    {.unit = "Pa",
                     .min = 0,
                     .min_exclusive = true,
                     .required = true,
                     .doc = "Kirchhoff stress at first yield"});
    parameters.real("hardening_modulus", hardening_modulus,
                    {.unit = "Pa", .min = 0, .doc = "yield stress gained per equivalent plastic strain"});
  }

  std::vector<OwnColumn> own_columns() const { return {{"plastic_strain", "1"}}; }
  std::vector<const char*> guards() const { return {}; }

  // Most of a metal is elastic most of the time.
  template <class Law, class S>
  S yield(const Law& law, const Tensor<S, Dim>& F, const S* own) const {
    const S q = broadcast<S>(std::sqrt(1.5)) * norm(deviator(law.kirchhoff_stress(F)));
    return q -
           broadcast<S>(1 + 1e-13) * (broadcast<S>(yield_stress) + broadcast<S>(hardening_modulus) * own[0]);
  }

  template <class Law, class S>
  S return_stretches(const Law& law, S (&s)[Dim], S* own, S*) const {
    S deviator[Dim], squares = broadcast<S>(0.0);
    law.principal_deviator(s, deviator);
    for (int a = 0; a < Dim; ++a) squares += deviator[a] * deviator[a];
    const S q = sqrt_of<S>(broadcast<S>(1.5) * squares);
    const S limit = broadcast<S>(yield_stress) + broadcast<S>(hardening_modulus) * own[0];
    const S excess = q - limit;
    const S flow = excess / (broadcast<S>(3.0) * law.shear_modulus(s) + broadcast<S>(hardening_modulus));
    const S kept = (limit + broadcast<S>(hardening_modulus) * flow) / maximum<S>(q, limit);
    for (int a = 0; a < Dim; ++a) deviator[a] *= kept;
    S returned[Dim];
    law.stretches_with_deviator(s, deviator, returned);
    for (int a = 0; a < Dim; ++a) s[a] = returned[a];
    own[0] += flow;
    return excess - broadcast<S>(1e-13) * limit;  // what a return leaves is no yield
  }
};

}  // namespace mpm
