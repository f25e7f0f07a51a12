// The cracks' turn between two solves for the velocities of an implicit step.
#include "mpm_hpc/effects/phase_field/phase_field.hpp"

namespace mpm {

template <int Dim>
StaggeredField<Dim> PhaseField<Dim>::staggered() {
  StaggeredField<Dim> field;
  for (const BodyPart& part : parts_) {
    field.columns.push_back({part.body, part.phase, true});
    if (running_maximum_) field.columns.push_back({part.body, part.history});
  }
  field.pass = [this](State<Dim>& state) { pass(state); };
  field.most_passes = passes_;
  field.tolerance = pass_tolerance_;
  return field;
}

template <int Dim>
void PhaseField<Dim>::pass(State<Dim>& state) {
  auto s = state.timers.scope("phase field");
  const std::vector<FieldId> sums = system_->sums();
  begin(state);
  for (const FieldId f : sums) state.fields.zero(f);
  for (const bool boundary : {true, false}) {
    for (std::size_t b = 0; b < state.bodies.size(); ++b)
      scatter(state, b, boundary ? state.bodies[b].boundary : state.bodies[b].interior);
    if (boundary) state.halo().start_sum(state.fields, sums);
  }
  state.halo().finish_sum();
  solve(state);
  state.halo().start_fill(state.fields, {system_->result()});
  for (const bool boundary : {false, true}) {
    if (boundary) state.halo().finish_fill();
    for (std::size_t b = 0; b < state.bodies.size(); ++b)
      update(state, b, boundary ? state.bodies[b].boundary : state.bodies[b].interior);
  }
}

template StaggeredField<2> PhaseField<2>::staggered();
template StaggeredField<3> PhaseField<3>::staggered();
template void PhaseField<2>::pass(State<2>&);
template void PhaseField<3>::pass(State<3>&);

}  // namespace mpm
