// One time step of the whole simulation; explicit, implicit and quasi-static are its kinds.
#pragma once

#include <string>

#include "mpm_hpc/effects/effect.hpp"

namespace mpm {

template <int Dim>
class Integrator {
 public:
  virtual ~Integrator() = default;
  // Limits of the first step of a fresh run, from the particles as they are. Collective.
  virtual void initialise(State<Dim>& state) = 0;
  // Largest stable step; the same on all ranks.
  virtual Real stable_step(const State<Dim>& state) = 0;
  // The rule that decided the last stable step, for messages.
  virtual const char* bound_by() const = 0;
  // How the last step was solved, for messages; empty if there was nothing to solve.
  virtual std::string solved() const { return {}; }
  // Sorts and migrates when the drift asks for it and advances by state.dt. Throws NumericalFailure on all ranks if a
  // particle has failed. Collective.
  virtual void step(State<Dim>& state) = 0;
};

}  // namespace mpm
