// Checkpoints that are not what they should be: the same sentence on all ranks, no hang, and never wrong
// particles.
#include <gtest/gtest.h>
#include <hdf5.h>

#include <cstring>
#include <fstream>

#include "io_test_bodies.hpp"
#include "mpm_hpc/io/checkpoint.hpp"
#include "support/mpi_test.hpp"

namespace mpm::test {
namespace {

constexpr Precision precision = Precision::single_precision;

std::vector<Body<2>> small_bodies(bool with_particles) {
  std::vector<Body<2>> bodies;
  bodies.emplace_back("plate", 0, precision);
  const Communicator world = Communicator::world();
  if (with_particles)
    fill(bodies[0].particles, {3, 4, 5, 8, 20, 21, 22, 23, 24, 25}, world.rank(), world.size());
  return bodies;
}

class IoCheckpointDamage : public testing::Test {
 protected:
  IoCheckpointDamage() {
    CheckpointState state;
    state.step = 7;
    state.scene_text = "scene";
    state.code_version = "0.1.0";
    state.numbers["integrator"] = {1, 2, 3};
    state.owners = {0, 0};
    good_ = write_checkpoint(world_, folder_.path(), state, small_bodies(true), precision);
    if (world_.root()) content_ = read_bytes(good_);
    world_.broadcast(content_);
  }

  static std::string read_bytes(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  // Rank 0 replaces the file under test.
  void put(const std::string& content) {
    world_.barrier();
    if (world_.root()) std::ofstream(file_, std::ios::binary | std::ios::trunc) << content;
    world_.barrier();
  }
  // Rank 0 changes a good file by means of HDF5.
  void edit(const std::function<void(hid_t)>& change) {
    put(content_);
    if (world_.root()) {
      const hid_t file = H5Fopen(file_.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
      change(file);
      H5Fclose(file);
    }
    world_.barrier();
  }
  std::string fault() {
    std::vector<Body<2>> bodies = small_bodies(false);
    return text_on_all_ranks<FileError>(world_, [&] { read_checkpoint(world_, file_, bodies, precision); });
  }
  void expect_fault(const std::string& part) {
    const std::string text = fault();
    EXPECT_NE(text.find(part), std::string::npos) << text;
    EXPECT_NE(text.find(file_.string()), std::string::npos) << text;
    EXPECT_EQ(text.back(), '.') << text;
  }

  Communicator world_ = Communicator::world();
  SharedTemporaryFolder folder_;
  std::filesystem::path good_, file_ = folder_ / "checkpoint_000000008.h5";
  std::string content_;
};

TEST_F(IoCheckpointDamage, Missing) { expect_fault("does not exist"); }

TEST_F(IoCheckpointDamage, Folder) {
  if (world_.root()) std::filesystem::create_directory(file_);
  world_.barrier();
  expect_fault("no regular file");
}

TEST_F(IoCheckpointDamage, Empty) {
  put("");
  expect_fault("is empty");
}

TEST_F(IoCheckpointDamage, NoHdf5) {
  put("step,time\n1,2\n");
  expect_fault("no HDF5 file");
  put(std::string(100000, '\0'));
  expect_fault("no HDF5 file");
}

TEST_F(IoCheckpointDamage, CutShort) {
  for (const std::size_t length :
       {std::size_t{1}, std::size_t{7}, std::size_t{8}, std::size_t{20}, std::size_t{48}, std::size_t{1000},
        content_.size() / 2, content_.size() - 1}) {
    put(content_.substr(0, length));
    expect_fault("is cut short");
  }
}

TEST_F(IoCheckpointDamage, ForeignHdf5) {
  if (world_.root()) {
    const hid_t file = H5Fcreate(file_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    H5Gclose(H5Gcreate2(file, "bodies", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    H5Fclose(file);
  }
  world_.barrier();
  expect_fault("no checkpoint of mpm_hpc");
}

void set_integer(hid_t object, const char* name, std::int64_t value) {
  const hid_t attribute = H5Aopen(object, name, H5P_DEFAULT);
  H5Awrite(attribute, H5T_NATIVE_INT64, &value);
  H5Aclose(attribute);
}

TEST_F(IoCheckpointDamage, NewerVersion) {
  edit([](hid_t file) { set_integer(file, "format_version", checkpoint_format + 1); });
  expect_fault("written by a newer version");
}

TEST_F(IoCheckpointDamage, Incomplete) {
  edit([](hid_t file) { H5Adelete(file, "complete"); });
  expect_fault("never completed");
  edit([](hid_t file) { set_integer(file, "complete", 0); });
  expect_fault("never completed");
}

TEST_F(IoCheckpointDamage, MissingParts) {
  edit([](hid_t file) { H5Ldelete(file, "scene", H5P_DEFAULT); });
  expect_fault("the scene can't be read");
  edit([](hid_t file) { H5Adelete(file, "time"); });
  expect_fault("the time can't be read");
  edit([](hid_t file) { H5Adelete_by_name(file, "bodies/0/mass", "checksum", H5P_DEFAULT); });
  expect_fault("the checksum of column \"mass\" of body \"plate\" can't be read");
  edit([](hid_t file) { H5Ldelete(file, "bodies/0/mass", H5P_DEFAULT); });
  expect_fault("lacks the column \"mass\" of body \"plate\"");
}

TEST_F(IoCheckpointDamage, ColumnMovedBeyondTheEnd) {
  edit([](hid_t file) {
    const hid_t body = H5Gopen2(file, "bodies/0", H5P_DEFAULT);
    set_integer(body, "particles", 1 << 20);
    H5Gclose(body);
  });
  expect_fault("wrong shape");
}

TEST_F(IoCheckpointDamage, WrongNumbers) {
  edit([](hid_t file) {
    const double values[3] = {1, 2, 4};
    const hid_t dataset = H5Dopen2(file, "numbers/integrator", H5P_DEFAULT);
    H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values);
    H5Dclose(dataset);
  });
  expect_fault("the checksum of numbers/integrator is wrong");
}

TEST_F(IoCheckpointDamage, OtherScene) {
  put(content_);
  const auto fault_with = [&](auto bodies, Precision chosen) {
    return text_on_all_ranks<FileError>(world_, [&] { read_checkpoint(world_, file_, bodies, chosen); });
  };
  const auto has = [](const std::string& text, const char* part) {
    return text.find(part) != std::string::npos;
  };

  const std::string dimension = fault_with(bodies_without_particles<3>(precision), precision);
  EXPECT_TRUE(has(dimension, "is of a 2D run, the scene is 3D")) << dimension;

  std::vector<Body<2>> doubles;
  doubles.emplace_back("plate", 0, Precision::double_precision);
  const std::string other_precision = fault_with(std::move(doubles), Precision::double_precision);
  EXPECT_TRUE(has(other_precision, "set precision = \"single\"")) << other_precision;

  std::vector<Body<2>> more_columns = small_bodies(false);
  more_columns[0].particles.add({.name = "phase", .units = "1", .type = ScalarType::float32});
  const std::string lacking = fault_with(std::move(more_columns), precision);
  EXPECT_TRUE(has(lacking, "lacks the column \"phase\" of body \"plate\"")) << lacking;

  std::vector<Body<2>> renamed;
  renamed.emplace_back("disc", 0, precision);
  const std::string body = fault_with(std::move(renamed), precision);
  EXPECT_TRUE(has(body, "has a body \"plate\", which the scene lacks")) << body;

  std::vector<Body<2>> two = small_bodies(false);
  two.emplace_back("disc", 0, precision);
  const std::string second = fault_with(std::move(two), precision);
  EXPECT_TRUE(has(second, "has no body \"disc\"")) << second;
}

TEST_F(IoCheckpointDamage, ColumnThatNoEffectAsksFor) {
  std::vector<Body<2>> bodies;
  bodies.emplace_back("plate", 0, precision);
  bodies[0].particles.add({.name = "phase", .units = "1", .type = ScalarType::float32});
  fill(bodies[0].particles, {1, 2, 3}, world_.rank(), world_.size());
  CheckpointState state;
  state.step = 8;
  write_checkpoint(world_, folder_.path(), state, bodies, precision);
  expect_fault("has a column \"phase\" of body \"plate\", which no effect of the scene asks for");
}

// Whatever byte changes: an error, or the particles of before (the byte held nothing).
TEST_F(IoCheckpointDamage, FlippedBytes) {
  std::vector<Body<2>> expected = small_bodies(false);
  read_checkpoint(world_, good_, expected, precision);
  const FieldSet& before = expected[0].particles;
  int found = 0, tried = 0;
  for (std::size_t at = 0; at < content_.size(); at += 97) {
    std::string damaged = content_;
    damaged[at] = static_cast<char>(damaged[at] ^ (1 << at % 8));
    put(damaged);
    ++tried;
    std::vector<Body<2>> bodies = small_bodies(false);
    std::string text;
    try {
      const CheckpointState state = read_checkpoint(world_, file_, bodies, precision);
      EXPECT_EQ(state.step, 7);
      EXPECT_EQ(state.scene_text, "scene");
      EXPECT_EQ(state.numbers.at("integrator"), (std::vector<Real>{1, 2, 3}));
      const FieldSet& set = bodies[0].particles;
      EXPECT_EQ(set.size(), before.size());
      for (FieldId f = 0; f < set.count() && set.size() == before.size(); ++f)
        for (int c = 0; c < set.traits(f).components; ++c)
          EXPECT_EQ(std::memcmp(set.raw(f, c), before.raw(f, c),
                                static_cast<std::size_t>(bytes_of(set.traits(f).type)) * set.size()),
                    0)
              << "byte " << at;
    } catch (const FileError& error) {
      text = error.what();
    }
    std::string of_root = text;
    world_.broadcast(of_root);
    EXPECT_EQ(text, of_root) << "byte " << at;
    found += !text.empty();
  }
  EXPECT_GT(found, tried / 3) << "of " << tried;
}

}  // namespace
}  // namespace mpm::test
