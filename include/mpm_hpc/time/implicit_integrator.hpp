// Backward Euler on the grid's velocities, or static equilibrium after each load step (physics.md section 6).
#pragma once

#include "mpm_hpc/time/contact_states.hpp"
#include "mpm_hpc/time/grid_stages.hpp"
#include "mpm_hpc/time/implicit_system.hpp"
#include "mpm_hpc/time/integrator.hpp"
#include "mpm_hpc/time/particle_copies.hpp"

namespace mpm {

// Elastic trial stresses are in the solve; a plasticity rule returns the particles after it. What the deformation drives and
// what weakens the stress in turn, the phase field, is staggered: the velocities are solved for with the cracks as they are,
// the cracks with the particles deformed as these velocities will do it, and so on. A step whose Newton iteration fails is tried again with half its
// length, from the particles as they were; after a success the length grows again.
template <int Dim>
class ImplicitIntegrator final : public Integrator<Dim> {
 public:
  struct Options {
    ImplicitOptions system;
    Real cfl = 0.4;  // share of a cell that particles may travel in a step
    Real largest_step = std::numeric_limits<Real>::infinity();
  };
  // Steps below this share of the largest that succeeded (or was tried first) end the run.
  static constexpr Real least_step = 1e-6;

  ImplicitIntegrator(State<Dim>& state, StepHooks<Dim> hooks, const Options& options);

  void initialise(State<Dim>& state) override;
  Real stable_step(const State<Dim>& state) override;
  void step(State<Dim>& state) override;
  const char* bound_by() const override { return bound_by_; }
  std::string solved() const override;

  // The first part of a step: everything up to the equations, with the contacts as they are assumed to begin with. Exposed
  // for tests.
  void prepare(State<Dim>& state);
  ImplicitSystem<Dim>& system() { return system_; }
  const NewtonResult& last_result() const { return result_; }

 private:
  bool attempt(State<Dim>& state);
  bool solve_contacts(State<Dim>& state);
  Real staggered_pass(State<Dim>& state);
  void plan_copies(State<Dim>& state);
  Vec<Dim> acceleration(const State<Dim>& state) const;  // of all matter [m/s^2]
  void take_velocities(State<Dim>& state);
  Real fastest(const State<Dim>& state) const;

  GridStages<Dim> stages_;
  Options options_;
  ImplicitSystem<Dim> system_;
  NodeConstraints<Dim> constraints_;
  ContactStates<Dim> contacts_;
  // What a failed attempt spoils: loads act on the particles' velocities; what a pass of the staggered fields finds; what
  // deform() changes.
  ParticleCopies<Dim> loaded_, staggered_, compared_, deformed_;
  int most_passes_ = 1;
  Real pass_tolerance_ = 0;
  NewtonResult result_;
  // Of the last step: solves, more than one because of contacts and cracks, and the iterations of all of them.
  struct Work {
    int solves = 0, newton = 0, krylov = 0;
    Real first_residual = 0;
  } work_;
  std::string failure_;
  const char* bound_by_ = "nothing";
};

}  // namespace mpm
