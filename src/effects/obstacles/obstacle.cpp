#include "mpm_hpc/effects/obstacles/obstacle.hpp"

#include <fmt/format.h>

#include "mpm_hpc/effects/boundary/node_loop.hpp"

namespace mpm {

template <int Dim>
Obstacle<Dim>::Obstacle(Parameters& p) : reaction_(read_effect_name(p, "obstacle"), p.where("name")) {
  declare_shape<Dim>(p, "shape", shape_, true, "The obstacle at time 0.");
  if (shape_ && shape_.bounds().is_empty()) p.error_at("shape", "the shape is empty; give it a size.");
  contact_ = read_contact(p);
  motion_ = RigidMotion<Dim>::read(p, shape_);
}

template <int Dim>
std::string Obstacle<Dim>::explain() const {
  return fmt::format("obstacle {}: {}, {}", reaction_.name(), contact_.describe(), motion_.describe());
}

template <int Dim>
void Obstacle<Dim>::declare_fields(State<Dim>& state) {
  reaction_.declare(state);
}

template <int Dim>
void Obstacle<Dim>::join(StepHooks<Dim>& hooks) {
  if (hooks.implicit) {
    hooks.constraints.push_back([this](State<Dim>& state, NodeConstraints<Dim>& constraints) {
      constraints.begin(reaction_);
      for_touched(state, [&](auto* values, const Vec<Dim>& normal, const Vec<Dim>& surface) {
        constraints.touch(state.number_of_node(values), contact_, normal, surface);
      });
    });
  } else {
    hooks.on_grid.push_back([this](State<Dim>& state) { act(state); });
    reaction_.join(hooks);
  }
}

// Calls f(values, normal, velocity of the surface) for each node that the obstacle covers.
template <int Dim>
template <class F>
void Obstacle<Dim>::for_touched(State<Dim>& state, F&& f) const {
  const RigidStep<Dim> step = motion_.step(state.time, state.dt);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_nodes_inside<T>(state, shape_, step.pose, [&](const Vec<Dim>& X, const Vec<Dim>& x, T* values) {
      // A sticky obstacle needs no normal, which is dear for meshes.
      const Vec<Dim> normal = contact_.condition == ContactCondition::sticky
                                  ? Vec<Dim>(Vec<Dim>::Zero())
                                  : Vec<Dim>(step.pose.rotation * shape_.normal(X));
      f(values, normal, step.velocity_at(x));
    });
  });
}

template <int Dim>
void Obstacle<Dim>::act(State<Dim>& state) {
  for_touched(state, [&](auto* values, const Vec<Dim>& normal, const Vec<Dim>& surface) {
    Vec<Dim> relative;
    for (int a = 0; a < Dim; ++a) relative[a] = values[a] - surface[a];
    reaction_.impulses().set_velocity(state.number_of_node(values), values,
                                      surface + contact_.apply(normal, relative), values[Dim]);
  });
}

template class Obstacle<2>;
template class Obstacle<3>;

}  // namespace mpm
