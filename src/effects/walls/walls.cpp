#include "mpm_hpc/effects/walls/walls.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/boundary/node_loop.hpp"

namespace mpm {

namespace {

template <int Dim>
Vec<Dim> inward(int side) {
  return (side % 2 ? -1.0 : 1.0) * Vec<Dim>::Unit(side / 2);
}

}  // namespace

template <int Dim>
Walls<Dim>::Walls(Parameters& p) : reaction_("walls", p.where()) {
  Real friction = 0;
  bool any = false, any_sliding = false;
  std::vector<std::string> names = contact_condition_names;
  names.push_back("none");
  for (int side = 0; side < 2 * Dim; ++side) {
    std::string condition = "none";
    p.choice(domain_side_name(side), condition, names, "Condition on this side of the domain.");
    if (p.describing() || condition == "none") continue;
    any = true;
    where_[side] = p.where(domain_side_name(side));
    sides_[side] = Contact{contact_condition(condition)};
    any_sliding = any_sliding || sides_[side]->condition != ContactCondition::sticky;
  }
  p.real("friction", friction,
         {.min = 0, .doc = "Coulomb's friction coefficient of all slip and separate sides."});
  for (auto& side : sides_)
    if (side && side->condition != ContactCondition::sticky) side->friction = friction;
  if (!any)
    p.error_at("", "the walls have no side; give one at least, such as y_min = \"slip\", or drop the table.");
  if (friction > 0 && !any_sliding)
    p.error_at("friction",
               "friction has no effect on sticky walls; make a side \"slip\" or \"separate\", or drop it.");
}

template <int Dim>
std::string Walls<Dim>::explain() const {
  std::vector<std::string> parts;
  for (int side = 0; side < 2 * Dim; ++side)
    if (sides_[side]) {
      const bool first_order = sides_[side]->condition != ContactCondition::separate && !mirrors_.has(side);
      parts.push_back(fmt::format(
          "{} {}{}", domain_side_name(side), sides_[side]->describe(),
          first_order ? " (no mirror, since the domain is no multiple of h/2 long, or shorter than 4 h: "
                        "of first order)"
                      : ""));
    }
  return fmt::format("walls: {}", fmt::join(parts, ", "));
}

template <int Dim>
void Walls<Dim>::declare_fields(State<Dim>& state) {
  reaction_.declare(state);
  find_mirrors(state.geometry());
  for (int side = 0; side < 2 * Dim; ++side) {
    if (!sides_[side]) continue;
    require(!state.geometry().periodic(side / 2),
            "{}: {} can't be a wall, since domain.periodic has {}; take one of the two out.", where_[side],
            domain_side_name(side), "xyz"[side / 2]);
    require(!state.distribution.options().open[side],
            "{}: {} can't be a wall, since domain.open has it; take one of the two out.", where_[side],
            domain_side_name(side));
  }
}

template <int Dim>
void Walls<Dim>::find_mirrors(const GridGeometry<Dim>& grid) {
  for (int side = 0; side < 2 * Dim; ++side) {
    const int a = side / 2;
    const Real plane =
        ((side % 2 ? grid.upper()[a] : grid.lower()[a]) - grid.origin()[a]) * grid.inverse_spacing();
    limit_[side] = static_cast<std::int32_t>(side % 2 ? std::ceil(plane - surface_tolerance)
                                                      : std::floor(plane + surface_tolerance));
    if (sides_[side]) mirrors_.add(grid, side, sides_[side]->condition);
  }
}

// Calls f(values, reached) for each owned node with mass on or beyond one of the sides that act; reached(side) tells which.
template <int Dim>
template <class T, class Acts, class F>
void Walls<Dim>::for_nodes_beyond(const State<Dim>& state, Acts&& acts, F&& f) const {
  auto reached = [&](int side, int node) {
    return sides_[side] && acts(side) && (side % 2 ? node >= limit_[side] : node <= limit_[side]);
  };
  for (Slot s = 0; s < state.topology().owned(); ++s) {
    const IntVec<Dim> first = state.topology().first_node(s);
    bool touched = false;
    for (int side = 0; side < 2 * Dim; ++side)
      touched = touched || reached(side, first[side / 2] + (side % 2 ? block_side - 1 : 0));
    if (!touched) continue;
    for_massive_nodes<T>(state, s, [&](const IntVec<Dim>& node, T* values) {
      f(values, [&](int side) { return reached(side, node[side / 2]); });
    });
  }
}

// All sides: the equations of an implicit step don't know of mirrors.
template <int Dim>
void Walls<Dim>::constrain(State<Dim>& state, NodeConstraints<Dim>& constraints) {
  constraints.begin(reaction_);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_nodes_beyond<T>(state, [](int) { return true; }, [&](const T* values, auto&& reached) {
      for (int side = 0; side < 2 * Dim; ++side)
        if (reached(side))
          constraints.touch(state.number_of_node(values), *sides_[side], inward<Dim>(side), Vec<Dim>::Zero());
    });
  });
}

template <int Dim>
void Walls<Dim>::join(StepHooks<Dim>& hooks) {
  if (hooks.implicit) {
    hooks.constraints.push_back([this](State<Dim>& state, NodeConstraints<Dim>& c) { constrain(state, c); });
    return;
  }
  if (mirrors_.any()) hooks.on_grid.push_back([this](State<Dim>& state) { reflect(state); });
  hooks.end_of_grid.push_back([this](State<Dim>& state) { finish(state); });
  reaction_.join(hooks);
}

// The common velocity of a group, sum m R v / sum m, which keeps its momentum.
template <int Dim>
template <class T>
Vec<Dim> Walls<Dim>::mean(const Group& group, const T* masses, const T* velocities) const {
  Vec<Dim> momentum = Vec<Dim>::Zero();
  Real mass = 0;
  const Member* members = mirrors_.members(group);
  for (int i = 0; i < group.count; ++i) {
    const std::size_t node = static_cast<std::size_t>(members[i].node) * node_values;
    const Real m = masses[node + Dim];
    for (int a = 0; a < Dim; ++a)
      momentum[a] += (Mirrors<Dim>::in(members[i].turned, a) ? -m : m) * velocities[node + a];
    mass += m;
  }
  for (int a = 0; a < Dim; ++a)
    if (Mirrors<Dim>::in(group.vanishing, a)) momentum[a] = 0;
  return momentum / mass;
}

// The velocity of a group after friction with the mirrors next to it.
template <int Dim>
template <class T>
Vec<Dim> Walls<Dim>::rubbed(const Group& group, const T* nodes, Vec<Dim> velocity) const {
  for (int a = 0; a < Dim; ++a) {
    if (group.side[a] < 0 || sides_[group.side[a]]->friction == 0) continue;
    Real impulse = 0, mass = 0;
    const Member* members = mirrors_.members(group);
    for (int i = 0; i < group.count; ++i) {
      const T* values = nodes + static_cast<std::size_t>(members[i].node) * node_values;
      const Real m = values[Dim];
      impulse += m * ((Mirrors<Dim>::in(members[i].turned, a) ? -velocity[a] : velocity[a]) - values[a]);
      mass += m;
    }
    const Real along = velocity[a];
    velocity[a] = 0;
    const Real momentum = mass * velocity.norm();
    if (momentum > 0)
      velocity *= std::max(0.0, 1 - sides_[group.side[a]]->friction * std::abs(impulse) / momentum);
    velocity[a] = along;
  }
  return velocity;
}

// Sets the velocities of a group's nodes with mass from that of the first; the factor is that of NodeImpulses.
template <int Dim>
template <class T>
void Walls<Dim>::give(const Group& group, const T* masses, T* velocities, const Vec<Dim>& velocity, Real factor) {
  const Member* members = mirrors_.members(group);
  for (int i = 0; i < group.count; ++i) {
    const std::size_t node = static_cast<std::size_t>(members[i].node) * node_values;
    const Real mass = masses[node + Dim];
    if (mass == 0) continue;
    Vec<Dim> turned = velocity;
    for (int a = 0; a < Dim; ++a)
      if (Mirrors<Dim>::in(members[i].turned, a)) turned[a] = -turned[a];
    reaction_.impulses().set_velocity(members[i].node, velocities + node, turned, mass, factor);
  }
}

template <int Dim>
void Walls<Dim>::reflect(State<Dim>& state) {
  mirrors_.find_groups(state);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    T* nodes = state.fields.template data<T>(state.nodes);
    T* changes = state.transfer.increments() ? state.fields.template data<T>(state.changes) : nullptr;
    for (const Group& group : mirrors_.groups()) {
      if (nodes[static_cast<std::size_t>(mirrors_.members(group)->node) * node_values + Dim] == 0) continue;
      // With increments, these are the velocities before the forces, from which the change is measured. What particles keep
      // of their own velocity the wall doesn't take from them.
      if (changes) give<T>(group, nodes, changes, mean<T>(group, nodes, changes), -state.transfer.flip_blend);
      give<T>(group, nodes, nodes, rubbed<T>(group, nodes, mean<T>(group, nodes, nodes)));
    }
  });
}

// The sides that are no mirrors.
template <int Dim>
template <class T>
void Walls<Dim>::touch(State<Dim>& state) {
  for_nodes_beyond<T>(state, [&](int side) { return !mirrors_.has(side); }, [&](T* values, auto&& reached) {
    Vec<Dim> velocity;
    for (int a = 0; a < Dim; ++a) velocity[a] = values[a];
    for (int side = 0; side < 2 * Dim; ++side)
      if (reached(side)) velocity = sides_[side]->apply(inward<Dim>(side), velocity);
    reaction_.impulses().set_velocity(state.number_of_node(values), values, velocity, values[Dim]);
  });
}

// The nodes beyond the mirrors once more, after what obstacles and grips did to those inside.
template <int Dim>
template <class T>
void Walls<Dim>::follow(State<Dim>& state) {
  mirrors_.find_groups(state);
  T* nodes = state.fields.template data<T>(state.nodes);
  const auto stop = [&](const Member& member) {
    T* values = nodes + static_cast<std::size_t>(member.node) * node_values;
    if (values[Dim] == 0) return;
    Vec<Dim> velocity;
    for (int a = 0; a < Dim; ++a) velocity[a] = Mirrors<Dim>::in(member.stopped, a) ? 0 : values[a];
    reaction_.impulses().set_velocity(member.node, values, velocity, values[Dim]);
  };
  for (const Group& group : mirrors_.groups()) {
    const Member* members = mirrors_.members(group);
    const T* first = nodes + static_cast<std::size_t>(members->node) * node_values;
    if (first[Dim] == 0) {
      std::for_each(members + 1, members + group.count, stop);
      continue;
    }
    Vec<Dim> velocity;
    for (int a = 0; a < Dim; ++a) velocity[a] = Mirrors<Dim>::in(group.vanishing, a) ? 0 : first[a];
    give<T>(group, nodes, nodes, velocity);
  }
  std::for_each(mirrors_.far_nodes().begin(), mirrors_.far_nodes().end(), stop);
}

template <int Dim>
void Walls<Dim>::finish(State<Dim>& state) {
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    touch<T>(state);
    follow<T>(state);
  });
}

template class Walls<2>;
template class Walls<3>;

}  // namespace mpm
