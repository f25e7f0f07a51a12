// A solid as the loops see it: a law of the deformation gradient, perhaps joined to a plasticity rule.
#pragma once

#include "mpm_hpc/materials/material_update.hpp"
#include "mpm_hpc/materials/plasticity.hpp"
#include "mpm_hpc/math/symmetric_eigen.hpp"

namespace mpm {

template <class Law, class Rule, int Dim>
struct SolidModel {
  Law law;
  Rule rule;

  static constexpr bool has_deformation_gradient = true;
  static constexpr bool is_plastic = !std::is_same_v<Rule, Elastic>;
  // Returns are evaluated in double whatever the columns are: a yield surface may be as small as 1e-5 of the moduli, and
  // what a return rounds off would add up over the steps.
  template <class T>
  using AdvanceScalar = std::conditional_t<is_plastic, double, T>;

  template <class S>
  struct Point {
    Tensor<S, Dim> F;
    S own[Rule::own_count + 1];  // the last is unused: an array has a first element
  };

  std::vector<OwnColumn> own_columns() const {
    if constexpr (is_plastic) return rule.own_columns();
    return {};
  }
  std::vector<const char*> guards() const {
    if constexpr (is_plastic) return rule.guards();
    return {};
  }
  Real viscosity() const { return 0; }

  template <class S, class T>
  Point<S> load_point(const MaterialColumns<Dim, T>& columns, Index p) const {
    Point<S> point;
    point.F = load_tensor<S, Dim>(columns.F, p);
    for (int k = 0; k < Rule::own_count; ++k)
      if (columns.own[k]) point.own[k] = load<S>(columns.own[k] + p);
    return point;
  }

  template <class S>
  S jacobian(const Point<S>& point) const {
    return determinant(point.F);
  }
  template <class S>
  SymTensor<S, Dim> stress(const Point<S>& point) const {
    return scaled(point, law.kirchhoff_stress(point.F));
  }
  template <class S>
  SymTensor<S, Dim> stress_degraded(const Point<S>& point, const S& g) const {
    return scaled(point, law.kirchhoff_stress_degraded(point.F, g));
  }
  template <class S>
  S energy(const Point<S>& point) const {
    return scaled(point, law.energy_density(point.F));
  }
  template <class S>
  S energy_plus(const Point<S>& point) const {
    return scaled(point, law.energy_plus(point.F));
  }
  template <class S>
  S energy_degraded(const Point<S>& point, const S& g) const {
    return scaled(point, law.energy_degraded(point.F, g));
  }
  template <class S>
  S stiffness_bound(const Point<S>& point) const {
    return scaled(point, law.stiffness_bound(point.F));
  }
  template <class S>
  S wave_modulus(const Point<S>& point) const {
    return scaled(point, law.wave_modulus(point.F));
  }
  template <class S>
  S stiffness_bound_degraded(const Point<S>& point, const S& g) const {
    return scaled(point, law.stiffness_bound_degraded(point.F, g));
  }
  template <class S>
  S wave_modulus_degraded(const Point<S>& point, const S& g) const {
    return scaled(point, law.wave_modulus_degraded(point.F, g));
  }

  template <class S, class T, class Tally>
  Point<S> advance(const MaterialColumns<Dim, T>& columns, const T* const* gradient,
                   const DeformationStep& step, Index p, Index begin, Tally& tally) const {
    Point<S> point = load_point<S>(columns, p);
    const Tensor<S, Dim> A = broadcast<S>(step.dt) * load_tensor<S, Dim>(gradient, p - begin);
    point.F = deformed(step.update, A, point.F);
    if constexpr (Relaxes<Law, Dim>) point.F = law.relaxed(point.F);
    if constexpr (is_plastic) return_to_surface(columns, p, point, tally);
    store_tensor(columns.F, p, point.F);
    return point;
  }

  // V0 times the factor of the rule, to which all energies are proportional.
  template <class S>
  S energy_weight(const MaterialColumns<Dim, double>& columns, Index p) const {
    return scaled(load_point<S>(columns, p), load<S>(columns.volume + p));
  }

 private:
  template <class S, class V>
  V scaled(const Point<S>& point, const V& value) const {
    if constexpr (ScalesModuli<Rule, S>) return rule.modulus_factor(point.own) * value;
    return value;
  }

  // With the trial's b = F F^T = Q diag(s^2) Q^T: F <- Q diag(s_new / s) Q^T F.
  template <class S, class T, class Tally>
  void return_to_surface(const MaterialColumns<Dim, T>& columns, Index p, Point<S>& point,
                         Tally& tally) const {
    const S zero = broadcast<S>(0.0);
    if constexpr (TellsElastic<Rule, Law, Dim, S>)
      if (none_above(rule.yield(law, point.F, point.own), zero)) return;
    const SymmetricEigen<S, Dim> eigen = symmetric_eigen(left_cauchy_green(point.F));
    S trial[Dim], returned[Dim], guards[max_material_guards];
    for (int a = 0; a < Dim; ++a) trial[a] = returned[a] = sqrt_of<S>(eigen.values[a]);
    for (S& guard : guards) guard = zero;
    Point<S> after = point;
    const S yields = rule.return_stretches(law, returned, after.own, guards);
    if (none_above(yields, zero)) return;

    SymTensor<S, Dim> change;  // Q diag(s_new / s - 1) Q^T, of which a small return keeps the digits
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) change(i, j) = zero;
    for (int a = 0; a < Dim; ++a) {
      const S ratio = (returned[a] - trial[a]) / trial[a];
      for (int i = 0; i < Dim; ++i)
        for (int j = i; j < Dim; ++j) change(i, j) += ratio * eigen.vectors(i, a) * eigen.vectors(j, a);
    }
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) {
        S sum = point.F(i, j);
        for (int k = 0; k < Dim; ++k) sum += change(i, k) * point.F(k, j);
        after.F(i, j) = select_less<S>(zero, yields, sum, point.F(i, j));
      }
    for (int k = 0; k < Rule::own_count; ++k)
      if (columns.own[k]) {
        after.own[k] = select_less<S>(zero, yields, after.own[k], point.own[k]);
        store(columns.own[k] + p, after.own[k]);
      }

    const S volume = load<S>(columns.volume + p);
    tally.plastic_work +=
        select_less<S>(zero, yields, S(volume * work_of_return(columns, p, after, trial, returned)), zero);
    for (int k = 0; k < max_material_guards; ++k)
      tally.guards[k] += select_less<S>(zero, volume, select_less<S>(zero, yields, guards[k], zero), zero);
    point = after;
  }

  // tau : (ln s_trial - ln s) with the returned stress, degraded if there is a phase.
  template <class S, class T>
  S work_of_return(const MaterialColumns<Dim, T>& columns, Index p, const Point<S>& after,
                   const S (&trial)[Dim], const S (&returned)[Dim]) const {
    S tau[Dim], work = broadcast<S>(0.0);
    bool degraded = false;
    if constexpr (SplitsEnergy<Law, Dim>) {
      degraded = columns.phase != nullptr;
      if (degraded) law.principal_stress_degraded(returned, degradation<S>(columns, p), tau);
    }
    if (!degraded) law.principal_stress(returned, tau);
    for (int a = 0; a < Dim; ++a) work += tau[a] * log_of<S>(S(trial[a] / returned[a]));
    return scaled(after, work);
  }
};

}  // namespace mpm
