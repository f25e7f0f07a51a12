// A periodic set of points of even density that nowhere come close.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// The square (cube) of side() cells, which is repeated in every direction; on average exactly so many points fall into a
// cell. Weighted sample elimination (Yuksel 2015, "Sample elimination for generating Poisson disk sample sets"): five times
// as many random points, of which the most crowded one goes until enough are left; here on a torus. The same seed gives the
// same tile on every rank.
template <int Dim>
class PoissonTile {
 public:
  PoissonTile(int points_per_cell, std::uint64_t seed);

  int side() const { return side_; }
  // In cell widths from the cell's lower corner, for a cell of the grid that the tile covers by repetition.
  std::span<const Vec<Dim>> cell(const Eigen::Matrix<std::int64_t, Dim, 1>& place) const;

 private:
  int side_;
  std::vector<Vec<Dim>> points_;  // by cell, the first direction fastest
  std::vector<std::size_t> first_;
};

// Largest possible distance [cells] of the nearest two of so many points per cell: that of the hexagonal lattice in 2D and of
// the closest packing in 3D. A tile reaches about 0.7 of it.
template <int Dim>
Real densest_distance(int points_per_cell);

}  // namespace mpm
