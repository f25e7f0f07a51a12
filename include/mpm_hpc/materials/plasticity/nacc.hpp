// Non-associated Cam-Clay, which tears and crushes without spurious volume change (Wolper et al. 2019, section 4; Li et al.
// 2022 for the form of p0), returned without change of J by default.
#pragma once

#include "mpm_hpc/materials/plasticity/critical_state.hpp"

namespace mpm {

// With p = -kappa/2 (J^2 - 1) of the trial (physics.md section 4):
// 1, p > p0: J = sqrt(1 - 2 p0/kappa), no shear. 2, p < -beta p0: J = sqrt(1 + 2 beta p0/kappa), no shear.
// 3, else outside of the ellipse: p stays, dev tau is scaled to the ellipse. In 1 and 2 alpha += ln(J_tr / J), in 3
// alpha += ln(J_tr / J_x) with J_x of the point where the line from the ellipse's centre to (p, q) meets it.
// The published case 3 keeps tr b in place of J, so its result is off the ellipse; it is there for reproduction.
template <int Dim>
struct Nacc {
  static constexpr const char* name = "nacc";
  static constexpr const char* doc = "non-associated Cam-Clay (bread, fruit, brittle foam)";
  template <class Law>
  static constexpr bool suits = SplitsShapeAndVolume<Law, Dim>;
  static constexpr int own_count = 1;  // alpha

  CriticalState<Dim> state;
  bool published = false;

  void declare(Parameters& parameters) {
    state.declare(parameters);
    std::string form = "volume_preserving";
    parameters.choice(
        "return", form, {"volume_preserving", "published"},
        "what a return in shear keeps: J, so that it ends on the yield surface, or tr b as published");
    published = form == "published";
  }

  std::vector<OwnColumn> own_columns() const { return state.own_columns(); }
  std::vector<const char*> guards() const {
    return {"nacc_pressure_beyond_half_bulk_modulus", "nacc_hardening_capped"};
  }

  template <class Law, class S>
  S yield(const Law& law, const Tensor<S, Dim>& F, const S* own) const {
    const S J = determinant(F), inverse = broadcast<S>(1.0) / J;
    S factor = inverse;  // J^(-2/d)
    if constexpr (Dim == 3) {
      factor = inverse_cube_root<S>(J);
      factor *= factor;
    }
    const S s = broadcast<S>(law.mu) * factor * norm(deviator(left_cauchy_green(F)));
    S capped;
    const S p0 = broadcast<S>(law.kappa) * state.hardening_pressure(state.alpha(own), capped);
    return state.yield_of(law.pressure(J), p0, S(broadcast<S>(state.deviator_factor) * s * s)) -
           broadcast<S>(state.tolerance);
  }

  template <class Law, class S>
  S return_stretches(const Law& law, S (&s)[Dim], S* own, S* guards) const {
    const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0), two = broadcast<S>(2.0);
    const Real beta = state.cohesion, kappa = law.kappa;
    S J = s[0], deviator[Dim], squares = zero, mean = zero;
    for (int a = 1; a < Dim; ++a) J *= s[a];
    law.principal_deviator(s, deviator);
    for (int a = 0; a < Dim; ++a) {
      squares += deviator[a] * deviator[a];
      mean += broadcast<S>(1.0 / Dim) * s[a] * s[a];
    }
    const S q2 = broadcast<S>(state.deviator_factor) * squares;
    S capped;
    const S alpha = state.alpha(own),
            p0 = state.hardening_pressure(alpha, capped);  // over kappa, as all pressures here
    const S p = broadcast<S>(1 / kappa) * law.pressure(J), q2_over = broadcast<S>(1 / (kappa * kappa)) * q2;
    const S tensile = broadcast<S>(-beta) * p0;

    // Cases 1 and 2. p < kappa/2 for any J, so p0 < kappa/2 where p > p0.
    const S tip = select_less<S>(p0, p, p0, tensile), J_tip = sqrt_of<S>(one - two * tip);
    S s_tip;
    if constexpr (Dim == 2) {
      s_tip = sqrt_of<S>(J_tip);
    } else {
      s_tip = one / inverse_cube_root<S>(J_tip);
    }

    // Case 3. The line from the centre leaves the ellipse at a share l of its way to (p, q).
    const S q2_new = broadcast<S>(-state.slope * state.slope / (1 + 2 * beta)) * (p - tensile) * (p - p0);
    const S kept = sqrt_of<S>(maximum<S>(q2_new, zero) / select_less<S>(zero, q2_over, q2_over, one));
    S scaled[Dim], sheared[Dim];
    for (int a = 0; a < Dim; ++a) scaled[a] = kept * deviator[a];
    if (published) {
      for (int a = 0; a < Dim; ++a) sheared[a] = sqrt_of<S>(mean + kept * (s[a] * s[a] - mean));
    } else {
      law.stretches_with_deviator(s, scaled, sheared);
    }
    const S centre = broadcast<S>((1 - beta) / 2) * p0, radius = broadcast<S>((1 + beta) / 2) * p0,
            way = p - centre;
    const S slope2 = broadcast<S>(state.slope * state.slope);
    const S l = radius * broadcast<S>(state.slope) /
                sqrt_of<S>(broadcast<S>(1 + 2 * beta) * q2_over + slope2 * way * way);
    // No J has a pressure beyond kappa/2, where the centre of a strongly hardened ellipse may lie.
    const S left = one - two * (centre + l * way), least = broadcast<S>(1e-6);
    const S J_crossing = sqrt_of<S>(maximum<S>(left, least));

    const auto by_case = [&](const S& at_tip, const S& in_shear) {
      return select_less<S>(p0, p, at_tip, select_less<S>(p, tensile, at_tip, in_shear));
    };
    for (int a = 0; a < Dim; ++a) s[a] = by_case(s_tip, sheared[a]);
    if (state.hardens) own[0] = alpha + log_of<S>(J / by_case(J_tip, J_crossing));
    guards[0] = by_case(zero, select_less<S>(left, least, one, zero));
    guards[1] = capped;
    return state.yield_of(p, p0, q2_over) - broadcast<S>(state.tolerance);
  }
};

}  // namespace mpm
