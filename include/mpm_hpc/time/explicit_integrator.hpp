// Explicit symplectic Euler: the step of the material point method, in the order of its stages.
#pragma once

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
  Real busy_seconds(const State<Dim>& state) const;
  void reduce_limits(State<Dim>& state);
  template <class T>
  const TransferKernels<Dim, T>& kernels() const;
  template <class T>
  void step_in(State<Dim>& state);
  template <class T>
  void transfer_to_grid(State<Dim>& state, bool boundary);
  template <class T>
  void transfer_to_particles(State<Dim>& state, bool boundary);

  StepHooks<Dim> hooks_;
  StepSizeOptions options_;
  TransferKernels<Dim, float> single_;
  TransferKernels<Dim, double> double_;
  std::vector<FieldId> summed_, filled_;  // grid fields in the one message of each halo exchange
  const char* bound_by_ = "nothing";
  int stage_p2g_, stage_halo_sum_, stage_grid_, stage_halo_fill_, stage_g2p_, stage_effects_, stage_limits_,
      stage_sort_;
};

}  // namespace mpm
