// Particles as a file gives them, before they become a body.
#pragma once

#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// A share of the file's rows, in their order; quantities that the file lacks are empty.
template <int Dim>
struct PointCloud {
  std::vector<Vec<Dim>> positions;   // [m]
  std::vector<Vec<Dim>> velocities;  // [m/s]
  std::vector<Real> volumes;         // undeformed [m^Dim]
  std::vector<Mat<Dim>> deformation_gradients;
  GlobalIndex first = 0, total = 0;  // number of the first row here; rows of the whole file
};

}  // namespace mpm
