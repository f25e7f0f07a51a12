// What all integrators do in a step before and after the velocities on the grid are found.
#pragma once

#include "mpm_hpc/effects/effect.hpp"

namespace mpm {

// All members but the accessors are collective.
template <int Dim>
class GridStages {
 public:
  enum class Stress { of_materials, none };

  GridStages(State<Dim>& state, StepHooks<Dim> hooks);

  // Limits of the first step of a fresh run, from the particles as they are.
  void initialise(State<Dim>& state);
  // Sorts and migrates when the drift asks for it, or always.
  void sort(State<Dim>& state, bool always);
  // Effects before P2G, P2G, halo sum: the owned nodes then hold velocities and mass; forces are in them if stress is asked
  // for.
  void to_grid(State<Dim>& state, Stress stress);
  // Effects on the grid.
  void on_grid(State<Dim>& state);
  // Halo fill, G2P, effects after it; time and step go on, and the limits of the next step are found. Throws NumericalFailure
  // on all ranks if a particle has failed.
  void to_particles(State<Dim>& state);

  const StepHooks<Dim>& hooks() const { return hooks_; }

 private:
  Real busy_seconds(const State<Dim>& state) const;
  void reduce_limits(State<Dim>& state);
  template <class T>
  const TransferKernels<Dim, T>& kernels() const;
  template <class T>
  void transfer_to_grid(State<Dim>& state, bool boundary, Stress stress);
  template <class T>
  void transfer_to_particles(State<Dim>& state, bool boundary);
  template <class T>
  void to_grid_in(State<Dim>& state, Stress stress);
  template <class T>
  void to_particles_in(State<Dim>& state);
  void run(State<Dim>& state, const std::vector<typename StepHooks<Dim>::Hook>& hooks);
  void run(State<Dim>& state, const std::vector<typename StepHooks<Dim>::RangeHook>& hooks, bool boundary);

  StepHooks<Dim> hooks_;
  TransferKernels<Dim, float> single_;
  TransferKernels<Dim, double> double_;
  std::vector<FieldId> summed_, filled_;  // grid fields in the one message of each halo exchange
  int stage_p2g_, stage_halo_sum_, stage_grid_, stage_halo_fill_, stage_g2p_, stage_effects_, stage_limits_,
      stage_sort_;
};

}  // namespace mpm
