// Makes the state of a run from its scene.
#pragma once

#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/scene/scene.hpp"
#include "mpm_hpc/time/integrator.hpp"

namespace mpm {

// Bodies with all columns and no particles, grid fields, distribution. Takes the scene's materials. Throws UserError for
// effects that don't fit the bodies. Collective.
template <int Dim>
void declare_state(const Communicator& communicator, Scene<Dim>& scene, State<Dim>& state);

// The hooks of all effects for the scene's integrator.
template <int Dim>
StepHooks<Dim> join_effects(const Scene<Dim>& scene);

// The scene's integrator. Before the particles are there. Throws UserError for bodies that it can't move. Collective.
template <int Dim>
std::unique_ptr<Integrator<Dim>> make_integrator(const Scene<Dim>& scene, State<Dim>& state, StepHooks<Dim> hooks);

// Fills the bodies with their particles, each rank a share of them, and brings them to their owners. Throws UserError on
// all ranks for a body that is empty or reaches out of the domain. Collective.
template <int Dim>
void create_particles(Scene<Dim>& scene, State<Dim>& state);

}  // namespace mpm
