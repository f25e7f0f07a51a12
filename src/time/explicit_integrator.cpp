#include "mpm_hpc/time/explicit_integrator.hpp"

namespace mpm {

template <int Dim>
ExplicitIntegrator<Dim>::ExplicitIntegrator(State<Dim>& state, StepHooks<Dim> hooks, const StepSizeOptions& options)
    : stages_(state, std::move(hooks)), options_(options) {
  options_.isolated_stiffness = isolated_stiffness(state.transfer);
}

template <int Dim>
void ExplicitIntegrator<Dim>::initialise(State<Dim>& state) {
  stages_.initialise(state);
}

template <int Dim>
Real ExplicitIntegrator<Dim>::stable_step(const State<Dim>& state) {
  const StepSize size = stable_step_size(state.limits, state.geometry().spacing(), options_);
  bound_by_ = size.bound_by;
  return size.dt;
}

template <int Dim>
void ExplicitIntegrator<Dim>::step(State<Dim>& state) {
  stages_.sort(state, false);
  stages_.to_grid(state, GridStages<Dim>::Stress::of_materials);
  stages_.on_grid(state);
  stages_.to_particles(state);
}

template class ExplicitIntegrator<2>;
template class ExplicitIntegrator<3>;

}  // namespace mpm
