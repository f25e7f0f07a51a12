// Plasticity as a return mapping joined to an elastic law: what a rule must offer, as concepts.
#pragma once

#include <vector>

#include "mpm_hpc/materials/material.hpp"
#include "mpm_hpc/materials/material_columns.hpp"

namespace mpm {

// A law whose stress is known by the principal stretches, so that the work of a return can be told.
template <class Law, int Dim, class S = double>
concept HasPrincipalStress = SolidLaw<Law, Dim, S> &&
    requires(const Law law, const S (&stretches)[Dim], S (&tau)[Dim]) {
  law.principal_stress(stretches, tau);  // of tau [Pa]
};

// A law whose stress falls into a deviator and a pressure that depends on J alone, so that a rule can change the one and
// keep the other.
template <class Law, int Dim, class S = double>
concept HasDeviator = HasPrincipalStress<Law, Dim, S> &&
    requires(const Law law, const S (&stretches)[Dim], S (&deviator)[Dim], S (&returned)[Dim]) {
  law.principal_deviator(stretches, deviator);  // of tau [Pa]
  // The stretches of the same J whose stress has this deviator.
  law.stretches_with_deviator(stretches, deviator, returned);
};

// tau_a = 2 mu ln s_a + lambda sum_b ln s_b (Hencky).
template <class Law, int Dim>
concept LinearInLogarithmicStrain = HasDeviator<Law, Dim> && Law::linear_in_logarithmic_strain;

// tau = mu J^(-2/d) dev(b) + kappa/2 (J^2 - 1) I.
template <class Law, int Dim>
concept SplitsShapeAndVolume = HasDeviator<Law, Dim> && Law::splits_shape_and_volume;

// No plasticity.
struct Elastic {
  static constexpr int own_count = 0;
};

// A rule says which laws suit it (Rule::suits<Law>), what columns of its own it keeps, and how it returns the trial
// stretches of a pack of particles: return_stretches changes stretches, own numbers and the guards' marks (1 where one
// acted) and gives a number above 0 for each lane that it has changed.
template <class Rule, class Law, int Dim, class S = double>
concept ReturnMapping = std::copyable<Rule> && HasPrincipalStress<Law, Dim, S> &&
    Rule::template suits<Law>&& requires(const Rule rule, Rule fresh, Parameters& parameters, const Law law,
                                         S (&stretches)[Dim], S* own, S* guards) {
  { Rule::name } -> std::convertible_to<const char*>;  // value of the scene's key `plasticity.model`
  { Rule::doc } -> std::convertible_to<const char*>;
  { Rule::own_count } -> std::convertible_to<int>;
  { rule.own_columns() } -> std::same_as<std::vector<OwnColumn>>;  // at most own_count
  { rule.guards() } -> std::same_as<std::vector<const char*>>;
  fresh.declare(parameters);
  { rule.return_stretches(law, stretches, own, guards) } -> std::same_as<S>;
};

// A rule that tells before the stretches are known where it has nothing to do: above 0 where it may act.
template <class Rule, class Law, int Dim, class S>
concept TellsElastic = requires(const Rule rule, const Law law, const Tensor<S, Dim>& F, const S* own) {
  { rule.yield(law, F, own) } -> std::same_as<S>;
};

// A rule whose hardening scales the law's moduli.
template <class Rule, class S>
concept ScalesModuli = requires(const Rule rule, const S* own) {
  { rule.modulus_factor(own) } -> std::same_as<S>;
};

}  // namespace mpm
