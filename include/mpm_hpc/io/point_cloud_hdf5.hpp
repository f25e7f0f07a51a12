// Particles that another program made, read from an HDF5 file.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

#include "mpm_hpc/fields/point_cloud.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Datasets `position` (n x Dim) and, if there, `velocity` (n x Dim), `volume` (n) and `deformation_gradient`
// (n x Dim x Dim), of any number type. Each rank gets an equal share of the rows, which `take` gets in pieces, in
// their order; it must not communicate. `where` is the place in the scene that names the file, for messages.
// Throws FileError on all ranks. Collective.
template <int Dim>
void read_point_cloud_hdf5(const Communicator& communicator, const std::filesystem::path& file,
                           const std::string& where, const std::function<void(const PointCloud<Dim>&)>& take);

}  // namespace mpm
