// Names the particle that made a step fail.
#pragma once

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// Throws NumericalFailure with the worst particle of all ranks (inverted, or not a number), its place, the step and what
// may help. Collective.
template <int Dim>
[[noreturn]] void report_failed_particle(const State<Dim>& state);

}  // namespace mpm
