#include "mpm_hpc/effects/walls/mirrors.hpp"

#include <cmath>

#include "mpm_hpc/effects/boundary/node_loop.hpp"

namespace mpm {

template <int Dim>
bool Mirrors<Dim>::add(const GridGeometry<Dim>& grid, int side, ContactCondition condition) {
  const int a = side / 2;
  // Nearer to each other than this, two mirrors would have images in common.
  constexpr std::int32_t least_cells = 4;
  const Real plane = side % 2 ? grid.upper()[a] : grid.lower()[a];
  const Real twice = 2 * (plane - grid.origin()[a]) * grid.inverse_spacing();
  if (condition == ContactCondition::separate || grid.cells()[a] < least_cells ||
      std::abs(twice - std::round(twice)) > 2 * surface_tolerance)
    return false;
  sides_[side] = {true, static_cast<std::int32_t>(std::lround(twice)), condition};
  return true;
}

template <int Dim>
bool Mirrors<Dim>::any() const {
  for (const Side& side : sides_)
    if (side.mirror) return true;
  return false;
}

template class Mirrors<2>;
template class Mirrors<3>;

}  // namespace mpm
