// Sorts a body's particles by block and cell and pads each block to whole packs.
#pragma once

#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"

namespace mpm {

// First node of the stencil of a particle at x: floor(xi - shift) with xi = (x - origin) / h and the kernel's shift
// (0 linear, 1/2 quadratic, 1 cubic). A particle belongs to the block of this node.
template <int Dim>
inline IntVec<Dim> base_node(const GridGeometry<Dim>& grid, const Vec<Dim>& x, Real shift) {
  IntVec<Dim> base;
  for (int a = 0; a < Dim; ++a)
    base[a] = static_cast<std::int32_t>(std::floor((x[a] - grid.origin()[a]) * grid.inverse_spacing() - shift));
  return base;
}

// The place in a periodic grid with the same nodes around it, such that its base node is one of the domain.
template <int Dim>
Vec<Dim> wrapped_place(const GridGeometry<Dim>& grid, Vec<Dim> x, Real shift);

enum class OrderWithinCell {
  stable,    // keep the present order
  canonical  // by identity, so that the order doesn't depend on the history
};

// Drops padding, sorts the rest by (block key, cell) and pads each block with massless copies of its last particle.
// Fills body.ranges with slot = position in the returned list of occupied keys, which is sorted.
template <int Dim>
std::vector<BlockKey> order_particles(Body<Dim>& body, const GridGeometry<Dim>& grid, Real shift, int pad,
                                      OrderWithinCell within);

}  // namespace mpm
