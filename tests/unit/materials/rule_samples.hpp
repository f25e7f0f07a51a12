// Plasticity rules whose limits are reached at strains of about a per cent, for the tests.
#pragma once

#include "mpm_hpc/materials/plasticity_list.hpp"

namespace mpm::test {

template <class Rule>
Rule rule_sample(Real mu);
template <class Rule>
struct RuleSample;
template <int D>
struct RuleSample<ClampedStretches<D>> {
  static ClampedStretches<D> rule(Real) {
    return {.critical_compression = 0.02, .critical_stretch = 0.01, .hardening = 10};
  }
};
template <int D>
struct RuleSample<Tresca<D>> {
  static Tresca<D> rule(Real mu) { return {.yield_stress = 0.03 * mu}; }
};
template <int D>
struct RuleSample<VonMises<D>> {
  static VonMises<D> rule(Real mu) { return {.yield_stress = 0.03 * mu, .hardening_modulus = 0.2 * mu}; }
};
template <int D>
struct RuleSample<DruckerPrager<D>> {
  static DruckerPrager<D> rule(Real mu) { return {.friction_angle = 0.6, .cohesion = 0.002 * mu}; }
};
template <int D>
CriticalState<D> critical_state_sample() {
  CriticalState<D> state;
  state.slope = CriticalState<D>::critical_slope(0.7);
  state.cohesion = 0.5;
  state.hardening = 2;
  state.initial_alpha = -0.015;
  return state;
}
template <int D>
struct RuleSample<ModifiedCamClay<D>> {
  static ModifiedCamClay<D> rule(Real) { return {.state = critical_state_sample<D>()}; }
};
template <int D>
struct RuleSample<Nacc<D>> {
  static Nacc<D> rule(Real) { return {.state = critical_state_sample<D>()}; }
};
template <class Rule>
Rule rule_sample(Real mu) {
  return RuleSample<Rule>::rule(mu);
}

template <class Rule>
Rule without_hardening(Rule rule) {
  if constexpr (requires { rule.state; }) rule.state.hardens = false;
  return rule;
}

template <class Rule>
double factor_of(const Rule& rule, const double* own) {
  if constexpr (ScalesModuli<Rule, double>) return rule.modulus_factor(own);
  return 1;
}
// tau : (ln trial - ln returned) of F = diag(returned), by the law's stress of a tensor.
template <class Law, class Rule, int Dim>
double work_of_return(const Law& law, const Rule& rule, const double* own, const double (&trial)[Dim],
                      const double (&returned)[Dim]) {
  Tensor<double, Dim> F;
  for (int k = 0; k < Dim * Dim; ++k) F.m[k] = k % (Dim + 1) == 0 ? returned[k / Dim] : 0;
  const SymTensor<double, Dim> tau = law.kirchhoff_stress(F);
  double work = 0;
  for (int a = 0; a < Dim; ++a) work += tau(a, a) * std::log(trial[a] / returned[a]);
  return factor_of(rule, own) * work;
}

}  // namespace mpm::test
