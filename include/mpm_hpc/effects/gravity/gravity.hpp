// The same acceleration for all material.
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/effects/effect.hpp"

namespace mpm {

template <int Dim>
class Gravity final : public Effect<Dim> {
 public:
  explicit Gravity(Parameters& p);

  std::string explain() const override;
  void declare_fields(State<Dim>& state) override;
  void join(StepHooks<Dim>& hooks) override;

 private:
  void accelerate(State<Dim>& state) const;
  void account(State<Dim>& state) const;

  Vec<Dim> acceleration_ = Vec<Dim>::Zero();  // [m/s^2]
};

}  // namespace mpm
