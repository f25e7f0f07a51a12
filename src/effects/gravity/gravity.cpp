#include "mpm_hpc/effects/gravity/gravity.hpp"

#include <fmt/ranges.h>

#include "mpm_hpc/effects/boundary/reaction.hpp"

namespace mpm {

template <int Dim>
Gravity<Dim>::Gravity(Parameters& p) {
  p.vector<Dim>("acceleration", acceleration_,
                {.unit = "m/s^2", .required = true, .doc = "For example [0, -9.81] in 2D."});
}

template <int Dim>
std::string Gravity<Dim>::explain() const {
  return fmt::format("gravity: [{:.6g}] m/s^2 on all bodies",
                     fmt::join(acceleration_.data(), acceleration_.data() + Dim, ", "));
}

template <int Dim>
void Gravity<Dim>::declare_fields(State<Dim>& state) {
  state.ledger["external_work"];
}

template <int Dim>
void Gravity<Dim>::join(StepHooks<Dim>& hooks) {
  if (hooks.implicit) {
    hooks.accelerations.push_back([this](const State<Dim>&) { return acceleration_; });
  } else {
    hooks.on_grid.push_back([this](State<Dim>& state) { accelerate(state); });
    hooks.after_grid.push_back([this](State<Dim>& state) { account(state); });
  }
}

template <int Dim>
void Gravity<Dim>::accelerate(State<Dim>& state) const {
  const Vec<Dim> change = state.dt * acceleration_;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (Slot s = 0; s < state.topology().owned(); ++s)
      for_massive_nodes<T>(state, s, [&](const IntVec<Dim>&, T* values) {
        for (int a = 0; a < Dim; ++a) values[a] = static_cast<T>(values[a] + change[a]);
      });
  });
}

// Weight times the way that the material takes in the step, for the reason of NodeImpulses.
template <int Dim>
void Gravity<Dim>::account(State<Dim>& state) const {
  Vec<Dim> momentum = Vec<Dim>::Zero();
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (Slot s = 0; s < state.topology().owned(); ++s)
      for_massive_nodes<T>(state, s, [&](const IntVec<Dim>&, T* values) {
        for (int a = 0; a < Dim; ++a) momentum[a] += static_cast<Real>(values[Dim]) * values[a];
      });
  });
  state.ledger["external_work"] += state.dt * acceleration_.dot(momentum);
}

template class Gravity<2>;
template class Gravity<3>;

}  // namespace mpm
