// Particles from a table: positions, and what else the columns name.
#pragma once

#include <filesystem>

#include "mpm_hpc/fields/point_cloud.hpp"

namespace mpm {

// A CSV file with a header: x,y,z and optionally vx,vy,vz, volume, F_xx,F_xy,... in any order; in 2D without
// z. A column may name its unit, as in "x [mm]"; without one it is SI. Empty lines and lines from # on are
// skipped. Of `parts` equal shares of the rows only number `part` is read and checked. Throws UserError with
// file:line.
template <int Dim>
PointCloud<Dim> read_point_cloud_csv(const std::filesystem::path& file, int part = 0, int parts = 1);

}  // namespace mpm
