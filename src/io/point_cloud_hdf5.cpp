#include "mpm_hpc/io/point_cloud_hdf5.hpp"

#include <mpi.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "hdf5_source.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

namespace {

using Extent = std::vector<std::uint64_t>;

class CloudFile {
 public:
  CloudFile(const std::filesystem::path& file, const std::string& where)
      : source_(file), file_(file), where_(where) {
    if (source_.valid()) return;
    std::error_code ignored;
    fail(std::filesystem::exists(file_, ignored) ? "can't be opened as HDF5 (another format or damaged)"
                                                 : "does not exist");
  }

  [[noreturn]] void fail(const std::string& fault) const {
    throw FileError(
        fmt::format("{}{}point cloud {} {}.", where_, where_.empty() ? "" : ": ", file_.string(), fault));
  }

  // The dataset, checked to have `rows` rows (0: any number) of the shape `row`; invalid when there is none.
  Hdf5Id dataset(const std::string& name, std::uint64_t rows, const Extent& row) const {
    Hdf5Id dataset = source_.dataset(name);
    if (!dataset.valid()) return dataset;
    const Hdf5Id type(H5Dget_type(dataset), H5Tclose);
    const H5T_class_t kind = H5Tget_class(type);
    Extent expected = row, found = Hdf5Source::extent(dataset);
    expected.insert(expected.begin(), rows > 0 || found.empty() ? rows : found[0]);
    if (found != expected)
      fail(fmt::format("has a dataset \"{}\" of shape ({}), but ({}{}{}) is wanted", name,
                       fmt::join(found, ", "), rows > 0 ? std::to_string(rows) : "n", row.empty() ? "" : ", ",
                       fmt::join(row, ", ")));
    if (kind != H5T_FLOAT && kind != H5T_INTEGER)
      fail(fmt::format("has a dataset \"{}\" that holds no numbers", name));
    return dataset;
  }

  // Rows [first, first + rows) of a dataset, row-major.
  std::vector<Real> read(const std::string& name, const Hdf5Id& dataset, std::uint64_t first,
                         std::uint64_t rows) const {
    Extent extent = Hdf5Source::extent(dataset);
    std::vector<hsize_t> start(extent.size()), count(extent.begin(), extent.end());
    start[0] = first;
    count[0] = rows;
    std::uint64_t size = 1;
    for (const hsize_t n : count) size *= n;
    std::vector<Real> values(size);
    if (size == 0) return values;
    const Hdf5Id in_file(H5Dget_space(dataset), H5Sclose);
    const Hdf5Id in_memory(H5Screate_simple(static_cast<int>(count.size()), count.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(in_file, H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) < 0 ||
        H5Dread(dataset, H5T_NATIVE_DOUBLE, in_memory, in_file, H5P_DEFAULT, values.data()) < 0)
      fail(fmt::format("is damaged: dataset \"{}\" can't be read", name));
    for (std::uint64_t i = 0; i < size; ++i)
      if (!std::isfinite(values[i]))
        fail(fmt::format("has a value in row {} of \"{}\" that is not finite", first + i / (size / rows),
                         name));
    return values;
  }

 private:
  Hdf5Source source_;
  std::filesystem::path file_;
  std::string where_;
};

// Entries of N rows x columns, row-major, into fixed-size Eigen objects.
template <class Matrix>
std::vector<Matrix> as_matrices(const std::vector<Real>& values) {
  constexpr int rows = Matrix::RowsAtCompileTime, columns = Matrix::ColsAtCompileTime;
  std::vector<Matrix> result(values.size() / (rows * columns));
  for (std::size_t p = 0; p < result.size(); ++p)
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) result[p](i, j) = values[(p * rows + i) * columns + j];
  return result;
}

constexpr std::uint64_t rows_at_once = 1 << 16;

template <int Dim>
PointCloud<Dim> read_piece(const CloudFile& file, std::uint64_t total, std::uint64_t first, std::uint64_t rows) {
  const auto part = [&](const char* name, const Extent& row) {
    const Hdf5Id dataset = file.dataset(name, total, row);
    return dataset.valid() ? file.read(name, dataset, first, rows) : std::vector<Real>();
  };
  PointCloud<Dim> cloud;
  cloud.first = static_cast<GlobalIndex>(first);
  cloud.total = static_cast<GlobalIndex>(total);
  cloud.positions = as_matrices<Vec<Dim>>(part("position", {Dim}));
  cloud.velocities = as_matrices<Vec<Dim>>(part("velocity", {Dim}));
  cloud.volumes = part("volume", {});
  cloud.deformation_gradients = as_matrices<Mat<Dim>>(part("deformation_gradient", {Dim, Dim}));
  for (std::size_t p = 0; p < cloud.volumes.size(); ++p)
    if (cloud.volumes[p] <= 0)
      file.fail(fmt::format("has the volume {} m^3 in row {}, but volumes are positive", cloud.volumes[p],
                            first + p));
  for (std::size_t p = 0; p < cloud.deformation_gradients.size(); ++p)
    if (cloud.deformation_gradients[p].determinant() <= 0)
      file.fail(
          fmt::format("has a deformation_gradient in row {} whose determinant is not positive", first + p));
  return cloud;
}

}  // namespace

template <int Dim>
void read_point_cloud_hdf5(const Communicator& communicator, const std::filesystem::path& file,
                           const std::string& where, const std::function<void(const PointCloud<Dim>&)>& take) {
  std::uint64_t total = 0;
  on_root(communicator, [&] {
    const CloudFile source(file, where);
    const Hdf5Id position = source.dataset("position", 0, {Dim});
    if (!position.valid()) source.fail("has no dataset \"position\"");
    total = Hdf5Source::extent(position)[0];
    if (total == 0) source.fail("has no points");
    if (total / communicator.size() >= std::numeric_limits<Index>::max())
      source.fail("has too many points for so few ranks; use more");
    source.dataset("velocity", total, {Dim});
    source.dataset("volume", total, {});
    source.dataset("deformation_gradient", total, {Dim, Dim});
  });
  MPI_Bcast(&total, 1, MPI_UINT64_T, 0, mpi_comm(communicator));

  const auto size = static_cast<std::uint64_t>(communicator.size());
  const auto start = [&](std::uint64_t rank) { return total / size * rank + std::min(rank, total % size); };
  const std::uint64_t end = start(communicator.rank() + 1);
  together(communicator, [&] {
    const CloudFile source(file, where);
    for (std::uint64_t row = start(communicator.rank()); row < end; row += rows_at_once)
      take(read_piece<Dim>(source, total, row, std::min(rows_at_once, end - row)));
  });
}

template void read_point_cloud_hdf5(const Communicator&, const std::filesystem::path&, const std::string&,
                                    const std::function<void(const PointCloud<2>&)>&);
template void read_point_cloud_hdf5(const Communicator&, const std::filesystem::path&, const std::string&,
                                    const std::function<void(const PointCloud<3>&)>&);

}  // namespace mpm
