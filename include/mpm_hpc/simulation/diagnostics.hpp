// Global sums of the state: the rows of history.csv.
#pragma once

#include "mpm_hpc/effects/effect.hpp"
#include "mpm_hpc/io/frames.hpp"

namespace mpm {

// One row, the same on all ranks. Sums carry their rounding error along, so that they don't depend on the number of ranks
// beyond the last digit. Collective.
template <int Dim>
std::vector<HistoryValue> history_row(State<Dim>& state, const std::vector<std::unique_ptr<Effect<Dim>>>& effects);

// Particles of all ranks, without padding. Collective.
template <int Dim>
GlobalIndex count_particles(const State<Dim>& state);

// Fields of frames that are no columns: det F and the von Mises equivalent of the Cauchy stress [Pa]. They refer to the
// state.
template <int Dim>
std::vector<DerivedField> derived_fields(const State<Dim>& state);

}  // namespace mpm
