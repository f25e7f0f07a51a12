// Returns of single trials, and the worst errors that the unit tests and the verification table share.
#pragma once

#include <array>
#include <numeric>

#include "unit/materials/law_samples.hpp"
#include "unit/materials/rule_samples.hpp"

namespace mpm::test {

template <int Dim>
using Numbers = std::array<double, Dim>;

template <int Dim>
struct Outcome {
  Numbers<Dim> s;
  double own, yields;
  double guards[max_material_guards] = {};
};

template <class Law, class Rule, std::size_t Dim>
Outcome<Dim> returned(const Law& law, const Rule& rule, const std::array<double, Dim>& trial, double own) {
  double s[Dim];
  std::copy(trial.begin(), trial.end(), s);
  Outcome<Dim> out;
  out.own = own;
  out.yields = rule.return_stretches(law, s, &out.own, out.guards);
  if (!(out.yields > 0)) {
    out.own = own;
    std::copy(trial.begin(), trial.end(), s);
  }
  std::copy(s, s + Dim, out.s.begin());
  return out;
}

template <class Law, std::size_t Dim>
Vec<static_cast<int>(Dim)> principal_stress(const Law& law, const std::array<double, Dim>& s) {
  Tensor<double, static_cast<int>(Dim)> F;
  for (std::size_t k = 0; k < Dim * Dim; ++k) F.m[k] = k % (Dim + 1) == 0 ? s[k / (Dim + 1)] : 0;
  return to_matrix<static_cast<int>(Dim)>(law.kirchhoff_stress(F)).diagonal();
}
template <std::size_t Dim>
double volume(const std::array<double, Dim>& s) {
  return std::accumulate(s.begin(), s.end(), 1.0, std::multiplies<>());
}
template <int Dim>
Vec<Dim> deviator_of(const Vec<Dim>& tau) {
  return tau - Vec<Dim>::Constant(tau.mean());
}

// f(trial stretches) for many trials about I.
template <int Dim, class F>
void for_trials(double strain, F&& f) {
  std::mt19937 generator(41);
  std::uniform_real_distribution<double> e(-strain, strain);
  for (int n = 0; n < 400; ++n) {
    Numbers<Dim> trial;
    for (double& s : trial) s = std::exp(e(generator));
    if (n % 5 == 1) trial[1] = trial[0];
    f(trial);
  }
}

// Over many trials: |q - sigma_y| / mu after a return, the change of J, 1 - cos between dev tau before and after, and what
// elastic ones exceed the surface by, over mu.
struct VonMisesErrors {
  double surface = 0, volume = 0, direction = 0, elastic = 0;
  int yielded = 0;
};
template <class Law>
VonMisesErrors von_mises_errors() {
  constexpr int dim = Traits<Law>::dim;
  const Law law = Traits<Law>::law();
  const VonMises<dim> rule = rule_sample<VonMises<dim>>(test_mu);
  const double alpha = 0.003;
  VonMisesErrors worst;
  const auto raise = [](double& most, double value) { most = std::max(most, value); };
  for_trials<dim>(0.3, [&](const Numbers<dim>& trial) {
    const auto out = returned(law, rule, trial, alpha);
    const Vec<dim> before = deviator_of<dim>(principal_stress(law, trial)),
                   after = deviator_of<dim>(principal_stress(law, out.s));
    const double limit = rule.yield_stress + rule.hardening_modulus * out.own, factor = std::sqrt(1.5);
    raise(worst.volume, std::abs(volume(out.s) / volume(trial) - 1));
    if (out.yields > 0) {
      ++worst.yielded;
      raise(worst.surface, std::abs(factor * after.norm() - limit) / test_mu);
      raise(worst.direction, std::abs(1 - after.dot(before) / (after.norm() * before.norm())));
    } else {
      raise(worst.elastic, (factor * before.norm() - limit) / test_mu);
    }
  });
  return worst;
}

// Distances over mu from the tip and from the cone after a return, over many trials, and the change of what lies inside.
struct DruckerPragerErrors {
  double tip = 0, cone = 0, inside = 0;
  int at_tip = 0, on_cone = 0, within = 0;
};
template <int Dim>
DruckerPragerErrors drucker_prager_errors(bool plane_strain) {
  const Hencky<Dim> law = Traits<Hencky<Dim>>::law();
  const double phi = 0.5, cohesion = 0.002 * test_mu, sine = std::sin(phi);
  const DruckerPrager<Dim> rule{
      .friction_angle = phi, .cohesion = cohesion, .volume_correction = false, .plane_strain = plane_strain};
  const double a = plane_strain ? std::sqrt(2.0) * sine / Dim : std::sqrt(2.0 / 3) * 2 * sine / (3 - sine);
  // In stresses the cone is |dev tau| = a d (p + c cot phi): a d kappa of a strain over 2 mu is a d / 2 mu of a pressure.
  const double tip = cohesion / std::tan(phi);
  DruckerPragerErrors worst;
  const auto raise = [](double& most, double value) { most = std::max(most, std::abs(value) / test_mu); };
  for_trials<Dim>(0.03, [&](const Numbers<Dim>& trial) {
    const auto out = returned(law, rule, trial, 0);
    const Vec<Dim> tau = principal_stress(law, trial), after = principal_stress(law, out.s);
    const double p = -tau.mean(), p_after = -after.mean(), shear = deviator_of<Dim>(after).norm();
    if (p < -tip) {
      ++worst.at_tip;
      raise(worst.tip, p_after + tip);
      raise(worst.tip, shear);
    } else if (deviator_of<Dim>(tau).norm() <= a * Dim * (p + tip)) {
      ++worst.within;
      // Of the stretches: the stress of the same stretches may be rounded in two ways at two places.
      for (std::size_t k = 0; k < trial.size(); ++k)
        worst.inside = std::max(worst.inside, std::abs(out.s[k] - trial[k]));
    } else {
      ++worst.on_cone;
      raise(worst.cone, p_after - p);
      raise(worst.cone, shear - a * Dim * (p + tip));
    }
  });
  return worst;
}

inline Nacc<3> published_points() {
  Nacc<3> rule;
  rule.state.slope = CriticalState<3>::critical_slope(std::atan(1.0));
  rule.state.cohesion = 0.5;
  rule.state.hardening = 3;
  rule.state.initial_alpha = -0.01;
  return rule;
}
inline SplitNeoHookean<3> soft_law() {
  const ElasticConstants elastic = ElasticConstants::from_youngs_modulus(1e4, 0.3);
  return {elastic.mu, elastic.bulk_modulus<3>()};
}

// The numbers of an independent program: E = 1e4, nu = 0.3, 45 degrees, beta = 0.5, xi = 3, alpha = -0.01.
struct NaccPoint {
  Numbers<3> trial, stretches;
  double alpha, trial_pressure;
  bool published;
};
inline const std::vector<NaccPoint> nacc_points = {
    {{.9, .9, .9}, {.9897353357, .9897353357, .9897353357}, -.29512842, 1952.32916667, false},
    {{1.1, 1.1, 1.1}, {1.0049409799, 1.0049409799, 1.0049409799}, .26114410, -3214.8375, false},
    {{1.05, .98, .96}, {1.0174877034, .990907423, .9835249119}, -.01289116, 100.71722667, true}};

template <int Dim>
double nacc_yield(const SplitNeoHookean<Dim>& law, const Nacc<Dim>& rule, double p0, const Numbers<Dim>& s) {
  const Vec<Dim> tau = principal_stress(law, s);
  const double p = -tau.mean(), q2 = (6.0 - Dim) / 2 * deviator_of<Dim>(tau).squaredNorm(),
               M = rule.state.slope;
  return (q2 * (1 + 2 * rule.state.cohesion) + M * M * (p + rule.state.cohesion * p0) * (p - p0)) /
         (M * M * p0 * p0);
}

}  // namespace mpm::test
