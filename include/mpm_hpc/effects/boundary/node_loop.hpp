// The loop over the nodes that a shape covers.
#pragma once

#include <cmath>

#include "mpm_hpc/effects/boundary/rigid_motion.hpp"
#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// A node this near to a surface (in spacings) lies on it: planes along grid lines must not depend on
// rounding.
inline constexpr Real surface_tolerance = 1e-8;

// Calls f(X, x, values) for each owned node with mass inside or on the shape in its pose: X is the node's
// place in the shape's own frame, x its place in space, values its velocity and mass.
template <class T, int Dim, class F>
void for_nodes_inside(const State<Dim>& state, const Shape<Dim>& shape, const Pose<Dim>& pose, F&& f) {
  const GridGeometry<Dim>& grid = state.geometry();
  const Real h = grid.spacing(), tolerance = surface_tolerance * h;
  const Real half_side = 0.5 * (block_side - 1) * h;
  const Real radius = half_side * std::sqrt(static_cast<Real>(Dim)) + 2 * tolerance;  // of a block's sphere
  for (Slot s = 0; s < state.topology().owned(); ++s) {
    const Vec<Dim> center =
        grid.node_position(state.topology().first_node(s)) + Vec<Dim>::Constant(half_side);
    if (shape.distance(pose.to_shape(center)) > radius) continue;
    for_massive_nodes<T>(state, s, [&](const IntVec<Dim>& node, T* values) {
      const Vec<Dim> x = grid.node_position(node), X = pose.to_shape(x);
      if (shape.distance(X) <= tolerance) f(X, x, values);
    });
  }
}

}  // namespace mpm
