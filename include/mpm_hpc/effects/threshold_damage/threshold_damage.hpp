// Damage of each particle by itself where its tension exceeds a threshold: the simple alternative to the phase field.
#pragma once

#include <algorithm>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/effects/effect.hpp"

namespace mpm {

// c <- min(c, max(0, 1 - H_s (1 - sigma_f / sigma_m))) where sigma_m > sigma_f (physics.md section 5; the slides print the
// ratio upside down, which would heal under tension; it is the linear softening of Cervera and Chiumenti 2006, d = (1 + H)
// (1 - r0 / r)). sigma_m is the largest principal Cauchy stress of the particle if it were intact, sigma_f the strength. c
// weakens the stress as the phase field's does, g(c) = (1 - r) c^2 + r on the part that drives cracks. The energy that the stress
// loses is the history's fracture_energy. The law has no length, so that the energy of a crack depends on the spacing.
template <int Dim>
class ThresholdDamage final : public Effect<Dim> {
 public:
  explicit ThresholdDamage(Parameters& p);

  std::string explain() const override;
  void declare_fields(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;
  void history(State<Dim>& state, std::vector<HistoryValue>& row) override;

 private:
  void update(State<Dim>& state);
  template <class T>
  void update_body(State<Dim>& state, std::size_t body);
  // c that a stress allows, for sigma_m > sigma_f.
  Real phase_at(Real stress) const { return std::max(0.0, 1 - softening_ * (1 - strength_ / stress)); }

  Real strength_ = 0;     // sigma_f [Pa]
  Real softening_ = 2;    // H_s
  Real residual_ = 1e-3;  // r
  std::string where_, where_bodies_;
  std::vector<std::string> body_names_;  // empty: all
  std::vector<char> damaged_;            // by body
};

}  // namespace mpm
