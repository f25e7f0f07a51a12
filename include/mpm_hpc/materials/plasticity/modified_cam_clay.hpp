// Modified Cam-Clay with associated flow (Roscoe and Burland 1968; with cohesion beta: Gaume et al. 2018), in logarithmic
// strain.
#pragma once

#include "mpm_hpc/materials/plasticity/critical_state.hpp"

namespace mpm {

// The plastic strain points along dy/dtau. With p = -kappa tr e and p0 held during the return, both parts shrink towards the
// ellipse's centre, q = q_tr / (1 + a g) and p - p_c = (p_tr - p_c) / (1 + b g), a = 2 mu (6 - d) (1 + 2 beta),
// b = 2 kappa M^2, where the multiplier g makes y = 0. Then alpha += tr e_tr - tr e.
template <int Dim>
struct ModifiedCamClay {
  static constexpr const char* name = "modified_cam_clay";
  static constexpr const char* doc = "Cam-Clay ellipse with associated flow (clay, snow)";
  template <class Law>
  static constexpr bool suits = LinearInLogarithmicStrain<Law, Dim>;
  static constexpr int own_count = 1;  // alpha

  CriticalState<Dim> state;

  void declare(Parameters& parameters) { state.declare(parameters); }
  std::vector<OwnColumn> own_columns() const { return state.own_columns(); }
  std::vector<const char*> guards() const { return {"cam_clay_hardening_capped"}; }

  template <class Law, class S>
  S return_stretches(const Law& law, S (&s)[Dim], S* own, S* guards) const {
    const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0), two = broadcast<S>(2.0);
    const Real beta = state.cohesion, kappa = law.bulk_modulus();
    S e[Dim], trace = zero, squares = zero;
    for (int a = 0; a < Dim; ++a) {
      e[a] = log_of<S>(s[a]);
      trace += e[a];
    }
    const S mean = broadcast<S>(1.0 / Dim) * trace;
    for (int a = 0; a < Dim; ++a) {
      e[a] -= mean;
      squares += e[a] * e[a];
    }
    S capped;
    const S alpha = state.alpha(own),
            p0 = state.hardening_pressure(alpha, capped);  // over kappa, as all pressures here
    const S p = -trace,
            q2 = broadcast<S>(state.deviator_factor * 4 * law.mu * law.mu / (kappa * kappa)) * squares;
    const S centre = broadcast<S>((1 - beta) / 2) * p0, way = p - centre;

    // (1 + 2 beta) q^2 / (1 + a g)^2 + M^2 (p - p_c)^2 / (1 + b g)^2 = (M (1 + beta) p0 / 2)^2, divided by the right side.
    // 1 / sqrt of the left is nearly linear in g: Newton's iteration on it takes few steps and comes from below.
    const Real ratio = 2 * law.mu / kappa * (6 - Dim) * (1 + 2 * beta), b = 2 * state.slope * state.slope;
    const S radius = broadcast<S>(state.slope * (1 + beta) / 2) * p0, scale = one / (radius * radius);
    const S shear = broadcast<S>(1 + 2 * beta) * q2 * scale,
            volume = broadcast<S>(state.slope * state.slope) * way * way * scale;
    const S yields = shear + volume - one - broadcast<S>(4 / ((1 + beta) * (1 + beta)) * state.tolerance);
    S g = zero;
    constexpr int most = 60;
    for (int i = 0; i < most; ++i) {
      const S x = one / (one + broadcast<S>(ratio) * g), y = one / (one + broadcast<S>(b) * g);
      const S left = maximum<S>(shear * x * x + volume * y * y, one);
      const S fall = two * (broadcast<S>(ratio) * shear * x * x * x + broadcast<S>(b) * volume * y * y * y);
      const S step = two * left * (sqrt_of<S>(left) - one) / fall;
      const S taken = select_less<S>(one, left, step, zero);
      g += taken;
      if (none_above<S>(taken, broadcast<S>(1e-14) * g)) break;
    }
    const S kept = one / (one + broadcast<S>(ratio) * g);
    const S p_new = centre + way / (one + broadcast<S>(b) * g);
    for (int a = 0; a < Dim; ++a) s[a] = exp_of<S>(kept * e[a] - broadcast<S>(1.0 / Dim) * p_new);
    if (state.hardens) own[0] = alpha + trace + p_new;
    guards[0] = capped;
    return yields;
  }
};

}  // namespace mpm
