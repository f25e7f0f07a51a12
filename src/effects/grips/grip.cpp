#include "mpm_hpc/effects/grips/grip.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "mpm_hpc/effects/boundary/node_loop.hpp"

namespace mpm {

template <int Dim>
Grip<Dim>::Grip(Parameters& p) : reaction_(read_effect_name(p, "grip"), p.where("name")) {
  declare_shape<Dim>(p, "shape", shape_, true, "The gripped region at time 0.");
  if (shape_ && shape_.bounds().is_empty()) p.error_at("shape", "the shape is empty; give it a size.");
  motion_ = RigidMotion<Dim>::read(p, shape_);

  prescribed_.fill(true);
  std::vector<std::string> directions;
  const TextOptions options{.doc = "Prescribed components, a subset of [\"x\", \"y\", \"z\"]. Default: all."};
  if (!p.text_list("directions", directions, options)) return;
  prescribed_.fill(false);
  for (const std::string& direction : directions) {
    const std::size_t a = std::string_view("xyz").substr(0, Dim).find(direction);
    if (direction.size() != 1 || a == std::string_view::npos) {
      p.error_at("directions", fmt::format("\"{}\" is no direction here; use {}.", direction,
                                           Dim == 2 ? "\"x\" and \"y\"" : "\"x\", \"y\" and \"z\""));
    } else {
      prescribed_[a] = true;
    }
  }
  if (directions.empty())
    p.error_at("directions", "the grip prescribes no direction; name one or drop the key.");
}

template <int Dim>
std::string Grip<Dim>::explain() const {
  std::string components;
  for (int a = 0; a < Dim; ++a)
    if (prescribed_[a]) components += "xyz"[a];
  return fmt::format("grip {}: prescribes the {} velocity, {}", reaction_.name(), fmt::join(components, ", "),
                     motion_.describe());
}

template <int Dim>
void Grip<Dim>::declare_fields(State<Dim>& state) {
  reaction_.declare(state);
}

template <int Dim>
void Grip<Dim>::join(StepHooks<Dim>& hooks) {
  if (hooks.implicit) {
    hooks.constraints.push_back([this](State<Dim>& state, NodeConstraints<Dim>& constraints) {
      const RigidStep<Dim> step = motion_.step(state.time, state.dt);
      constraints.begin(reaction_);
      with_precision(state.precision, [&](auto zero) {
        using T = decltype(zero);
        for_nodes_inside<T>(state, shape_, step.pose, [&](const Vec<Dim>&, const Vec<Dim>& x, T* values) {
          constraints.prescribe(state.number_of_node(values), prescribed_, step.velocity_at(x));
        });
      });
    });
  } else {
    hooks.on_grid.push_back([this](State<Dim>& state) { act(state); });
    reaction_.join(hooks);
  }
}

template <int Dim>
void Grip<Dim>::act(State<Dim>& state) {
  const RigidStep<Dim> step = motion_.step(state.time, state.dt);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_nodes_inside<T>(state, shape_, step.pose, [&](const Vec<Dim>&, const Vec<Dim>& x, T* values) {
      Vec<Dim> velocity = step.velocity_at(x);
      for (int a = 0; a < Dim; ++a)
        if (!prescribed_[a]) velocity[a] = values[a];
      reaction_.impulses().set_velocity(state.number_of_node(values), values, velocity, values[Dim]);
    });
  });
}

template class Grip<2>;
template class Grip<3>;

}  // namespace mpm
