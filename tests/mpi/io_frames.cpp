// Frames: what another program finds in them, read back with plain HDF5 calls on rank 0.
#include <gtest/gtest.h>
#include <hdf5.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "io_test_bodies.hpp"
#include "mpm_hpc/io/frames.hpp"
#include "support/mpi_test.hpp"

namespace mpm::test {
namespace {

// Everything as double, which holds all test values exactly (the largest identity is about 2^40).
struct Array {
  std::vector<hsize_t> shape;
  std::vector<double> values;
  H5T_class_t kind = H5T_NO_CLASS;
  std::size_t bytes = 0;
  bool chunked = false;

  double at(std::size_t row, std::size_t component) const { return values[row * shape[1] + component]; }
};

class FrameFile {
 public:
  explicit FrameFile(const std::filesystem::path& file)
      : file_(H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT)) {
    EXPECT_GE(file_, 0) << file;
  }
  ~FrameFile() { H5Fclose(file_); }

  bool has(const std::string& name) const {
    return H5Lexists(file_, ("VTKHDF/" + name).c_str(), H5P_DEFAULT) > 0;
  }
  Array read(const std::string& name) const {
    Array array;
    const hid_t dataset = H5Dopen2(file_, ("VTKHDF/" + name).c_str(), H5P_DEFAULT);
    EXPECT_GE(dataset, 0) << name;
    const hid_t space = H5Dget_space(dataset), type = H5Dget_type(dataset),
                list = H5Dget_create_plist(dataset);
    array.shape.resize(H5Sget_simple_extent_ndims(space));
    H5Sget_simple_extent_dims(space, array.shape.data(), nullptr);
    array.values.resize(H5Sget_simple_extent_npoints(space));
    array.kind = H5Tget_class(type);
    array.bytes = H5Tget_size(type);
    array.chunked = H5Pget_layout(list) == H5D_CHUNKED;
    if (!array.values.empty()) {
      EXPECT_GE(H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, array.values.data()), 0)
          << name;
    }
    H5Pclose(list);
    H5Tclose(type);
    H5Sclose(space);
    H5Dclose(dataset);
    return array;
  }
  std::string type_attribute() const {
    const hid_t attribute = H5Aopen_by_name(file_, "VTKHDF", "Type", H5P_DEFAULT, H5P_DEFAULT);
    const hid_t type = H5Aget_type(attribute);
    EXPECT_EQ(H5Tget_cset(type), H5T_CSET_ASCII);
    EXPECT_EQ(H5Tis_variable_str(type), 0);
    std::string text(H5Tget_size(type), ' ');
    H5Aread(attribute, type, text.data());
    H5Tclose(type);
    H5Aclose(attribute);
    return text;
  }

 private:
  hid_t file_;
};

// Rows that the ranks' particles must be in: rank by rank, body by body, in each rank's order.
struct ExpectedRow {
  int body;
  GlobalIndex id;
};

std::vector<ExpectedRow> expected_rows(int rank, int ranks) {
  std::vector<ExpectedRow> rows;
  const std::vector<GlobalIndex> plate = plate_ids(), ball = ball_ids();
  for (auto id = plate.rbegin(); id != plate.rend(); ++id)
    if (owner_of(*id, ranks) == rank) rows.push_back({0, *id});
  for (auto id = ball.rbegin(); id != ball.rend(); ++id)
    if (owner_of(*id, ranks) == rank) rows.push_back({1, *id});
  return rows;
}

// J = 2 id everywhere; a stress on the ball alone.
std::vector<DerivedField> derived_fields(const std::vector<Body<2>>& bodies) {
  const auto fill_J = [&bodies](std::size_t body, Index begin, Index end, Real* values) {
    for (Index p = begin; p < end; ++p)
      values[p - begin] = 2 * static_cast<Real>(bodies[body].particles.data<GlobalIndex>(core::id)[p]);
  };
  const auto fill_stress = [](std::size_t body, Index begin, Index end, Real* values) {
    if (body != 1) return;
    for (int c = 0; c < 4; ++c)
      for (Index p = begin; p < end; ++p) values[c * (end - begin) + p - begin] = 10 + c;
  };
  return {{"J", 1, fill_J}, {"stress", 4, fill_stress}};
}

void check_frame(const std::filesystem::path& file, int ranks, int deflate) {
  const FrameFile frame(file);
  EXPECT_EQ(frame.type_attribute(), "UnstructuredGrid");
  std::vector<ExpectedRow> rows;
  std::vector<double> counts, offsets, connectivity;
  for (int rank = 0; rank < ranks; ++rank) {
    const auto part = expected_rows(rank, ranks);
    rows.insert(rows.end(), part.begin(), part.end());
    counts.push_back(static_cast<double>(part.size()));
    for (std::size_t i = 0; i <= part.size(); ++i) offsets.push_back(static_cast<double>(i));
    for (std::size_t i = 0; i < part.size(); ++i) connectivity.push_back(static_cast<double>(i));
  }
  for (const char* name : {"NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds"})
    EXPECT_EQ(frame.read(name).values, counts) << name;
  EXPECT_EQ(frame.read("Offsets").values, offsets);
  EXPECT_EQ(frame.read("Connectivity").values, connectivity);
  EXPECT_EQ(frame.read("Types").values, std::vector<double>(rows.size(), 1));
  EXPECT_EQ(frame.read("FieldData/TimeValue").values, std::vector<double>{0.25});
  EXPECT_EQ(frame.read("FieldData/step").values, std::vector<double>{50});

  const Array points = frame.read("Points"), id = frame.read("PointData/id"),
              body = frame.read("PointData/body"), velocity = frame.read("PointData/velocity"),
              phase = frame.read("PointData/phase"), age = frame.read("PointData/age"),
              J = frame.read("PointData/J"), stress = frame.read("PointData/stress");
  EXPECT_EQ(points.bytes, 8u);
  EXPECT_EQ(id.bytes, 8u);
  EXPECT_EQ(id.kind, H5T_INTEGER);
  EXPECT_EQ(velocity.bytes, 4u);
  EXPECT_EQ(velocity.kind, H5T_FLOAT);
  EXPECT_EQ(points.chunked, deflate > 0);
  EXPECT_FALSE(frame.has("PointData/mass"));
  const hsize_t n = rows.size();
  EXPECT_EQ(points.shape, (std::vector<hsize_t>{n, 3}));
  EXPECT_EQ(velocity.shape, (std::vector<hsize_t>{n, 3}));
  EXPECT_EQ(stress.shape, (std::vector<hsize_t>{n, 9}));
  EXPECT_EQ(age.shape, (std::vector<hsize_t>{n, 3}));
  EXPECT_EQ(phase.shape, std::vector<hsize_t>{n});
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const GlobalIndex i = rows[r].id;
    const bool ball = rows[r].body == 1;
    ASSERT_EQ(id.values[r], static_cast<double>(i));
    ASSERT_EQ(body.values[r], rows[r].body);
    for (int c = 0; c < 3; ++c) {
      ASSERT_EQ(points.at(r, c), c < 2 ? value_of(i, "position", c) : 0);
      ASSERT_EQ(velocity.at(r, c), c < 2 ? value_of(i, "velocity", c) : 0);
      ASSERT_EQ(age.at(r, c), !ball ? -1 : c < 2 ? std::floor(value_of(i, "age", c)) : 0);
    }
    ASSERT_EQ(J.values[r], static_cast<float>(2 * i));
    if (!ball) {
      ASSERT_TRUE(std::isnan(phase.values[r]) && std::isnan(stress.at(r, 0)) && std::isnan(stress.at(r, 4)));
      continue;
    }
    ASSERT_EQ(phase.values[r], value_of(i, "phase", 0));
    const double tensor[9] = {10, 11, 0, 12, 13, 0, 0, 0, 0};
    for (int c = 0; c < 9; ++c) ASSERT_EQ(stress.at(r, c), tensor[c]) << c;
  }
}

void write_and_check(int deflate) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<2>(world, Precision::double_precision);
  FrameWriter<2> writer(world, folder.path(), {.deflate = deflate});
  writer.write(50, 0.25, bodies, derived_fields(bodies));
  if (world.root()) check_frame(folder / "frame_000000.hdf", world.size(), deflate);
  world.barrier();
  EXPECT_FALSE(std::filesystem::exists(folder / "frame_000000.hdf.tmp"));
}

TEST(IoFrames, Contents) { write_and_check(0); }
TEST(IoFrames, CompressedContents) { write_and_check(1); }

TEST(IoFrames, ChosenFieldsInDoublePrecision) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<2>(world, Precision::single_precision);
  FrameWriter<2> writer(world, folder.path(),
                        {.fields = {"deformation_gradient", "J"}, .precision = Precision::double_precision});
  writer.write(1, 0, bodies, derived_fields(bodies));
  if (world.root()) {
    const FrameFile frame(folder / "frame_000000.hdf");
    EXPECT_FALSE(frame.has("PointData/id"));
    EXPECT_FALSE(frame.has("PointData/velocity"));
    EXPECT_FALSE(frame.has("PointData/stress"));
    const Array F = frame.read("PointData/deformation_gradient"), J = frame.read("PointData/J");
    EXPECT_EQ(F.bytes, 8u);
    const auto rows = expected_rows(0, world.size());
    for (std::size_t r = 0; r < rows.size(); ++r) {
      EXPECT_EQ(J.values[r], static_cast<double>(2 * rows[r].id));
      // Row-major 2 x 2 inside 3 x 3, and no stretch out of the plane.
      const auto f = [&](int c) { return value_of(rows[r].id, "deformation_gradient", c); };
      const double tensor[9] = {f(0), f(1), 0, f(2), f(3), 0, 0, 0, 1};
      for (int c = 0; c < 9; ++c) ASSERT_EQ(F.at(r, c), tensor[c]) << c;
    }
  }
}

TEST(IoFrames, UnknownField) {
  const Communicator world = Communicator::world();
  const auto bodies = bodies_without_particles<3>(Precision::single_precision);
  const FrameOptions options{.fields = {"veloctiy"}, .where = "scene.toml:7:1"};
  const std::string text =
      text_on_all_ranks<UserError>(world, [&] { FrameWriter<3>::check_fields(options, bodies, {}); });
  EXPECT_TRUE(text.starts_with(
      "scene.toml:7:1: there is no field \"veloctiy\" to write (did you mean \"velocity\"?)"))
      << text;
}

TEST(IoFrames, NoParticlesAnywhere) {
  const Communicator world = Communicator::world();
  for (const int deflate : {0, 4}) {
    SharedTemporaryFolder folder;
    FrameWriter<3> writer(world, folder.path(), {.deflate = deflate});
    writer.write(0, 0, bodies_without_particles<3>(Precision::single_precision));
    if (world.root()) {
      const FrameFile frame(folder / "frame_000000.hdf");
      EXPECT_EQ(frame.read("Points").shape, (std::vector<hsize_t>{0, 3}));
      EXPECT_EQ(frame.read("Offsets").values, std::vector<double>(world.size(), 0));
    }
  }
}

// Several pieces per rank and several chunks (of 2^15 rows). The second chunk ends with rank 0, rank 1 has a
// small part of the third, and the other borders fall anywhere. `noise` can't be compressed.
TEST(IoFrames, CompressedEqualsContiguous) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  std::vector<Body<3>> bodies;
  bodies.emplace_back("block", 0, Precision::double_precision);
  FieldSet& set = bodies[0].particles;
  const FieldId noise_column =
      set.add({.name = "noise", .units = "1", .type = ScalarType::int64, .in_output = true});
  set.resize(world.rank() == 0 ? 1 << 16 : world.rank() == 1 ? 100 : 70001);
  std::mt19937_64 random(world.rank());
  for (FieldId f = 1; f < set.count(); ++f)
    for (int c = 0; c < set.traits(f).components; ++c)
      for (Index p = 0; p < set.size(); ++p) {
        const std::uint64_t noise = random();
        set_value(set, f, c, p, f == core::velocity && c == 0 ? 0 : static_cast<Real>(noise >> 11) * 1e-16);
        if (f == noise_column) set.data<GlobalIndex>(f)[p] = static_cast<GlobalIndex>(noise);
      }
  for (Index p = 0; p < set.size(); ++p)
    set.data<GlobalIndex>(core::id)[p] = world.rank() > 0 && p % 11 == 5 ? -1 : p;
  for (const int deflate : {0, 6}) {
    const auto part = folder / std::to_string(deflate);
    if (world.root()) std::filesystem::create_directory(part);
    world.barrier();
    FrameWriter<3> writer(world, part, {.deflate = deflate});
    writer.write(0, 0, bodies);
  }
  if (world.root()) {
    const FrameFile contiguous(folder / "0/frame_000000.hdf"), compressed(folder / "6/frame_000000.hdf");
    for (const char* name : {"Points", "Connectivity", "Offsets", "Types", "PointData/id", "PointData/body",
                             "PointData/velocity", "PointData/noise"}) {
      const Array expected = contiguous.read(name), found = compressed.read(name);
      EXPECT_FALSE(expected.chunked);
      EXPECT_TRUE(found.chunked);
      EXPECT_EQ(found.shape, expected.shape) << name;
      EXPECT_TRUE(found.values == expected.values) << name;
    }
  }
}

nlohmann::json series_in(const std::filesystem::path& folder) {
  return nlohmann::json::parse(std::ifstream(folder / "frames.hdf.series"));
}

TEST(IoFrames, Series) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<2>(world, Precision::single_precision);
  const auto times_and_names = [&] {
    world.barrier();
    std::vector<std::pair<std::string, double>> entries;
    const nlohmann::json series = series_in(folder.path());
    for (const auto& entry : series.at("files")) entries.emplace_back(entry["name"], entry["time"]);
    world.barrier();
    return entries;
  };
  using Entries = std::vector<std::pair<std::string, double>>;
  const double third = 1.0 / 3;
  {
    FrameWriter<2> writer(world, folder.path(), {});
    for (int i = 0; i < 4; ++i) writer.write(10 * i, third * i, bodies);
    EXPECT_EQ(writer.count(), 4);
  }
  EXPECT_EQ(series_in(folder.path()).at("file-series-version"), "1.0");
  EXPECT_EQ(times_and_names(), (Entries{{"frame_000000.hdf", 0},
                                        {"frame_000001.hdf", third},
                                        {"frame_000002.hdf", third * 2},
                                        {"frame_000003.hdf", third * 3}}));
  // Restarted at exactly the time of frame 1, which is written once more.
  if (world.root()) trim_frame_series(folder.path(), third);
  world.barrier();
  EXPECT_FALSE(std::filesystem::exists(folder / "frame_000002.hdf"));
  EXPECT_FALSE(std::filesystem::exists(folder / "frame_000003.hdf"));
  world.barrier();
  FrameWriter<2> writer(world, folder.path(), {});
  EXPECT_EQ(writer.count(), 2);
  writer.write(10, third, bodies);
  writer.write(15, 0.5, bodies);
  EXPECT_EQ(times_and_names(),
            (Entries{{"frame_000000.hdf", 0}, {"frame_000001.hdf", third}, {"frame_000002.hdf", 0.5}}));
}

TEST(IoFrames, Faults) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<2>(world, Precision::single_precision);
  FrameWriter<2> writer(world, folder.path(), {});
  writer.write(0, 0, bodies);
  world.barrier();
  // The next frame's place is taken by a folder: rank 0 alone notices, all must hear of it.
  if (world.root()) std::filesystem::create_directory(folder / "frame_000001.hdf");
  world.barrier();
  const std::string text = text_on_all_ranks<FileError>(world, [&] { writer.write(1, 1, bodies); });
  EXPECT_NE(text.find("frame_000001.hdf"), std::string::npos) << text;
  EXPECT_FALSE(std::filesystem::exists(folder / "frame_000001.hdf.tmp"));
  EXPECT_EQ(series_in(folder.path()).at("files").size(), 1u);
  world.barrier();
  if (world.root()) {
    std::filesystem::remove(folder / "frame_000001.hdf");
    std::ofstream(folder / "frames.hdf.series") << "{\"files\": [";
  }
  world.barrier();
  text_on_all_ranks<FileError>(world, [&] { FrameWriter<2>(world, folder.path(), {}); });
}

// One rank's field fails; with compression the ranks meet before the end of each dataset.
TEST(IoFrames, DerivedFieldThatThrows) {
  const Communicator world = Communicator::world();
  const int failing = world.size() == 2 ? 0 : world.size() - 1;  // rank 1 has no particles
  for (const int deflate : {0, 1}) {
    SharedTemporaryFolder folder;
    const auto bodies = test_bodies<2>(world, Precision::single_precision);
    FrameWriter<2> writer(world, folder.path(), {.deflate = deflate});
    const auto fill = [&](std::size_t, Index, Index, Real*) {
      if (world.rank() == failing) throw NumericalFailure("no stress");
    };
    const std::string text = text_on_all_ranks<NumericalFailure>(world, [&] {
      writer.write(0, 0, bodies, {{"stress", 1, fill}});
    });
    EXPECT_EQ(text, "no stress");
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  }
}

// For tests/checks/check_frames.py, which reads these frames with h5py and VTK.
TEST(IoFrames, Sample) {
  const char* sample = std::getenv("MPM_FRAME_SAMPLE");
  if (!sample) GTEST_SKIP() << "MPM_FRAME_SAMPLE names no folder";
  const Communicator world = Communicator::world();
  const auto bodies = test_bodies<2>(world, Precision::double_precision);
  for (const int deflate : {0, 3}) {
    const auto folder = std::filesystem::path(sample) / (deflate == 0 ? "contiguous" : "compressed");
    if (world.root()) std::filesystem::create_directory(folder);
    world.barrier();
    FrameWriter<2> writer(world, folder, {.deflate = deflate});
    writer.write(0, 0, bodies, derived_fields(bodies));
    writer.write(50, 0.25, bodies, derived_fields(bodies));
  }
  const auto folder = std::filesystem::path(sample) / "empty";
  if (world.root()) std::filesystem::create_directory(folder);
  world.barrier();
  FrameWriter<3>(world, folder, {}).write(0, 0, bodies_without_particles<3>(Precision::double_precision));
}

}  // namespace
}  // namespace mpm::test
