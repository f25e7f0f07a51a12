#include "mpm_hpc/effects/walls/walls.hpp"

#include <fmt/ranges.h>

#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/boundary/node_loop.hpp"

namespace mpm {

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
    if (sides_[side]) parts.push_back(fmt::format("{} {}", domain_side_name(side), sides_[side]->describe()));
  return fmt::format("walls: {}", fmt::join(parts, ", "));
}

template <int Dim>
void Walls<Dim>::declare_fields(State<Dim>& state) {
  reaction_.declare(state);
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
void Walls<Dim>::join(StepHooks<Dim>& hooks) {
  if (hooks.implicit) {
    hooks.constraints.push_back([this](State<Dim>& state, NodeConstraints<Dim>& c) { constrain(state, c); });
    return;
  }
  hooks.on_grid.push_back([this](State<Dim>& state) { act(state); });
}

// The nodes on and beyond each plane.
template <int Dim>
void Walls<Dim>::constrain(State<Dim>& state, NodeConstraints<Dim>& constraints) {
  constraints.begin(reaction_);
  const GridGeometry<Dim>& grid = state.geometry();
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (Slot s = 0; s < state.topology().owned(); ++s)
      for_massive_nodes<T>(state, s, [&](const IntVec<Dim>& node, T* values) {
        const Vec<Dim> x = grid.node_position(node);
        for (int side = 0; side < 2 * Dim; ++side) {
          if (!sides_[side]) continue;
          const int a = side / 2;
          const Vec<Dim> inward = (side % 2 ? -1.0 : 1.0) * Vec<Dim>::Unit(a);
          const Real depth = inward[a] * (x[a] - (side % 2 ? grid.upper()[a] : grid.lower()[a]));
          if (depth > surface_tolerance * grid.spacing()) continue;
          constraints.touch(state.number_of_node(values), *sides_[side], inward, Vec<Dim>::Zero());
        }
      });
  });
}

template <int Dim>
void Walls<Dim>::act(State<Dim>& state) {
  // The first node on or beyond each plane, counted outwards.
  const GridGeometry<Dim>& grid = state.geometry();
  std::array<std::int32_t, 2 * Dim> limit{};
  for (int a = 0; a < Dim; ++a) {
    const Real low = (grid.lower()[a] - grid.origin()[a]) * grid.inverse_spacing();
    const Real high = (grid.upper()[a] - grid.origin()[a]) * grid.inverse_spacing();
    limit[2 * a] = static_cast<std::int32_t>(std::floor(low + surface_tolerance));
    limit[2 * a + 1] = static_cast<std::int32_t>(std::ceil(high - surface_tolerance));
  }
  auto reached = [&](int side, int node) { return side % 2 ? node >= limit[side] : node <= limit[side]; };

  Exchange<Dim> exchange;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (Slot s = 0; s < state.topology().owned(); ++s) {
      const IntVec<Dim> first = state.topology().first_node(s);
      bool touched = false;
      for (int side = 0; side < 2 * Dim; ++side)
        touched =
            touched || (sides_[side] && reached(side, first[side / 2] + (side % 2 ? block_side - 1 : 0)));
      if (!touched) continue;
      for_massive_nodes<T>(state, s, [&](const IntVec<Dim>& node, T* values) {
        Vec<Dim> velocity;
        for (int a = 0; a < Dim; ++a) velocity[a] = values[a];
        for (int side = 0; side < 2 * Dim; ++side)
          if (sides_[side] && reached(side, node[side / 2])) {
            const Vec<Dim> inward = (side % 2 ? -1.0 : 1.0) * Vec<Dim>::Unit(side / 2);
            velocity = sides_[side]->apply(inward, velocity);
          }
        exchange.set_velocity(values, velocity);
      });
    }
  });
  reaction_.add(state, exchange);
}

template class Walls<2>;
template class Walls<3>;

}  // namespace mpm
