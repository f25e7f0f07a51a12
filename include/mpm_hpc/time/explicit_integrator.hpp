// Explicit symplectic Euler: the step of the material point method, in the order of its stages.
#pragma once

#include "mpm_hpc/time/grid_stages.hpp"
#include "mpm_hpc/time/integrator.hpp"
#include "mpm_hpc/time/time_step_size.hpp"

namespace mpm {

template <int Dim>
class ExplicitIntegrator final : public Integrator<Dim> {
 public:
  ExplicitIntegrator(State<Dim>& state, StepHooks<Dim> hooks, const StepSizeOptions& options);

  void initialise(State<Dim>& state) override;
  Real stable_step(const State<Dim>& state) override;
  void step(State<Dim>& state) override;

  const char* bound_by() const override { return bound_by_; }

 private:
  GridStages<Dim> stages_;
  StepSizeOptions options_;
  const char* bound_by_ = "nothing";
};

}  // namespace mpm
