#include "mpm_hpc/effects/state.hpp"

namespace mpm {

void Ledger::consolidate(const Communicator& communicator) {
  std::vector<CompensatedSum> sums;
  for (const auto& entry : entries_) sums.push_back({entry.second, 0});
  communicator.sum(sums);
  std::size_t i = 0;
  for (auto& entry : entries_) entry.second = communicator.root() ? sums[i++].value() : 0.0;
}

template <int Dim>
void sort_particles(State<Dim>& state, OrderWithinCell within) {
  const int rebalances = state.distribution.rebalances();
  state.memory.begin();
  state.distribution.redistribute(state.bodies, state.fields, within, state.busy);
  state.memory.end(state.distribution.rebalances() == rebalances ? "sort and migrate" : "re-balance");
  state.busy = 0;
  state.drift = 0;
}

template <int Dim>
void sort_if_drifted(State<Dim>& state) {
  // A particle may drift by one cell before its block's tile no longer holds its stencil; the rest is for rounding.
  constexpr Real limit = 0.999;
  if (state.drift > limit * state.geometry().spacing()) sort_particles(state, OrderWithinCell::stable);
}

template void sort_particles<2>(State<2>&, OrderWithinCell);
template void sort_particles<3>(State<3>&, OrderWithinCell);
template void sort_if_drifted<2>(State<2>&);
template void sort_if_drifted<3>(State<3>&);

}  // namespace mpm
