// Point clouds in HDF5: each rank gets its rows, and a wrong file gives one sentence with the place in the
// scene.
#include <gtest/gtest.h>
#include <hdf5.h>

#include <cmath>
#include <fstream>

#include "io_test_bodies.hpp"
#include "mpm_hpc/io/point_cloud_hdf5.hpp"
#include "support/mpi_test.hpp"

namespace mpm::test {
namespace {

class IoPointCloud : public testing::Test {
 protected:
  using Shape = std::vector<hsize_t>;

  // Rank 0 adds a dataset with values value(0), value(1), ... in row-major order.
  void add(const std::string& name, const Shape& shape, hid_t type,
           const std::function<double(std::size_t)>& value) {
    if (world_.root()) {
      const bool exists = std::filesystem::exists(file_);
      const hid_t file = exists ? H5Fopen(file_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT)
                                : H5Fcreate(file_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
      std::size_t size = 1;
      for (const hsize_t n : shape) size *= n;
      std::vector<double> values(size);
      for (std::size_t i = 0; i < size; ++i) values[i] = value(i);
      const hid_t space = H5Screate_simple(static_cast<int>(shape.size()), shape.data(), nullptr);
      const hid_t dataset =
          H5Dcreate2(file, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
      if (size > 0) H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
      H5Dclose(dataset);
      H5Sclose(space);
      H5Fclose(file);
    }
    world_.barrier();
  }
  void remove() {
    world_.barrier();
    if (world_.root()) std::filesystem::remove(file_);
    world_.barrier();
  }
  // This rank's rows, which are few enough for one piece.
  template <int Dim>
  PointCloud<Dim> read() {
    PointCloud<Dim> cloud;
    read_point_cloud_hdf5<Dim>(world_, file_, "", [&](const PointCloud<Dim>& piece) { cloud = piece; });
    return cloud;
  }
  void expect_fault(const std::string& part) {
    const std::string text = text_on_all_ranks<FileError>(
        world_, [&] { read_point_cloud_hdf5<2>(world_, file_, "scene.toml:3:1", [](const PointCloud<2>&) {}); });
    EXPECT_TRUE(text.starts_with("scene.toml:3:1: point cloud " + file_.string() + " ")) << text;
    EXPECT_NE(text.find(part), std::string::npos) << text;
  }

  Communicator world_ = Communicator::world();
  SharedTemporaryFolder folder_;
  std::filesystem::path file_ = folder_ / "cloud.h5";
};

const auto number = [](std::size_t i) { return static_cast<double>(i); };

TEST_F(IoPointCloud, EachRankItsRows) {
  constexpr hsize_t n = 11;
  add("position", {n, 3}, H5T_IEEE_F32LE, number);
  add("velocity", {n, 3}, H5T_STD_I16LE, [](std::size_t i) { return 100.0 + i; });
  add("volume", {n}, H5T_IEEE_F64BE, [](std::size_t i) { return 0.5 + i; });
  // Row-major: F = [[4 + p, 1, 0], [0, 1, 0], [0, 0, 1]].
  add("deformation_gradient", {n, 3, 3}, H5T_IEEE_F64LE, [](std::size_t i) {
    return i % 9 == 0 ? 4.0 + static_cast<double>(i / 9) : i % 9 == 1 || i % 9 == 4 || i % 9 == 8 ? 1 : 0;
  });
  const PointCloud<3> cloud = read<3>();
  EXPECT_FALSE(cloud.positions.empty());
  EXPECT_EQ(cloud.total, 11);
  EXPECT_EQ(world_.sum(static_cast<GlobalIndex>(cloud.positions.size())), 11);
  EXPECT_EQ(cloud.first, world_.exclusive_sum(static_cast<GlobalIndex>(cloud.positions.size())));
  ASSERT_EQ(cloud.velocities.size(), cloud.positions.size());
  ASSERT_EQ(cloud.volumes.size(), cloud.positions.size());
  ASSERT_EQ(cloud.deformation_gradients.size(), cloud.positions.size());
  for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
    const double row = static_cast<double>(cloud.first) + static_cast<double>(i);
    EXPECT_EQ(cloud.positions[i], Vec<3>(3 * row, 3 * row + 1, 3 * row + 2));
    EXPECT_EQ(cloud.velocities[i][1], 101 + 3 * row);
    EXPECT_EQ(cloud.volumes[i], 0.5 + row);
    EXPECT_EQ(cloud.deformation_gradients[i](0, 0), 4 + row);
    EXPECT_EQ(cloud.deformation_gradients[i](0, 1), 1);
    EXPECT_EQ(cloud.deformation_gradients[i](1, 0), 0);
  }
}

TEST_F(IoPointCloud, PositionsAlone) {
  add("position", {2, 2}, H5T_IEEE_F64LE, number);
  const PointCloud<2> cloud = read<2>();
  if (!cloud.positions.empty()) {
    EXPECT_EQ(cloud.total, 2);
  }
  EXPECT_TRUE(cloud.velocities.empty() && cloud.volumes.empty() && cloud.deformation_gradients.empty());
}

TEST_F(IoPointCloud, Faults) {
  expect_fault("does not exist");
  if (world_.root()) std::ofstream(file_) << "x,y\n1,2\n";
  world_.barrier();
  expect_fault("can't be opened as HDF5");
  remove();
  add("velocity", {3, 2}, H5T_IEEE_F64LE, number);
  expect_fault("has no dataset \"position\"");
  add("position", {3, 3}, H5T_IEEE_F64LE, number);
  expect_fault("has a dataset \"position\" of shape (3, 3), but (n, 2) is wanted");
  remove();
  add("position", {0, 2}, H5T_IEEE_F64LE, number);
  expect_fault("has no points");
  remove();
  add("position", {5, 2}, H5T_IEEE_F64LE, number);
  add("volume", {5, 1}, H5T_IEEE_F64LE, number);
  expect_fault("has a dataset \"volume\" of shape (5, 1), but (5) is wanted");
  remove();
  add("position", {5, 2}, H5T_IEEE_F64LE, number);
  add("volume", {5}, H5T_IEEE_F64LE, [](std::size_t i) { return i == 4 ? -1.0 : 1.0; });
  expect_fault("the volume -1 m^3 in row 4");
  remove();
  add("position", {5, 2}, H5T_IEEE_F64LE, [](std::size_t i) { return i == 7 ? NAN : 1.0; });
  expect_fault("a value in row 3 of \"position\" that is not finite");
  remove();
  add("position", {5, 2}, H5T_IEEE_F64LE, number);
  add("deformation_gradient", {5, 2, 2}, H5T_IEEE_F64LE,
      [](std::size_t i) { return i % 4 == 0 ? 1.0 : 0.0; });
  expect_fault("a deformation_gradient in row 0 whose determinant is not positive");
}

}  // namespace
}  // namespace mpm::test
