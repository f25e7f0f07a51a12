// Checkpoints: every particle comes back bit by bit, whoever owned it, and old files go only when new ones
// are there.
#include <gtest/gtest.h>
#include <hdf5.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <fstream>
#include <set>

#include "io_test_bodies.hpp"
#include "mpm_hpc/io/checkpoint.hpp"
#include "support/mpi_test.hpp"

namespace mpm::test {
namespace {

CheckpointState state_of_step(GlobalIndex step) {
  CheckpointState state;
  state.step = step;
  state.time = 0.1 * static_cast<Real>(step);
  state.dt = std::nextafter(1e-7, 1);
  state.code_version = "0.1.0";
  state.scene_text = "# \xc3\xa9nergie\n[grid]\nspacing = 0.01\n" + std::string(100000, '#');
  state.numbers["integrator"] = {1.0 / 3, -0.0, 5e-324, 1e308};
  state.numbers["effect.phase_field"] = {};
  state.numbers["special"] = {INFINITY, -INFINITY, NAN};
  state.owners = {0, 1, 2, 1, 0, -1};
  return state;
}

// The rows of this rank among all: the r-th row is the r-th identity.
void expect_share(const FieldSet& set, const std::vector<GlobalIndex>& ids, int rank, int ranks) {
  const std::size_t share = ids.size() / ranks, rest = ids.size() % ranks;
  const std::size_t first = rank * share + std::min<std::size_t>(rank, rest);
  ASSERT_EQ(static_cast<std::size_t>(set.size()), share + (static_cast<std::size_t>(rank) < rest ? 1 : 0));
  for (Index p = 0; p < set.size(); ++p) {
    const GlobalIndex id = ids[first + p];
    ASSERT_EQ(set.data<GlobalIndex>(core::id)[p], id);
    for (FieldId f = 1; f < set.count(); ++f)
      for (int c = 0; c < set.traits(f).components; ++c)
        ASSERT_EQ(get_value(set, f, c, p), expected_value(set, f, c, id)) << set.traits(f).name << " " << c;
  }
}

template <int Dim>
void round_trip(Precision precision) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const CheckpointState written = state_of_step(42);
  const auto file =
      write_checkpoint(world, folder.path(), written, test_bodies<Dim>(world, precision), precision);
  EXPECT_EQ(file, folder / "checkpoint_000000042.h5");

  std::vector<Body<Dim>> bodies = bodies_without_particles<Dim>(precision);
  std::reverse(bodies.begin(), bodies.end());  // matched by name, not by place
  const CheckpointState read = read_checkpoint(world, file, bodies, precision);
  expect_share(bodies[2].particles, plate_ids(), world.rank(), world.size());
  expect_share(bodies[1].particles, ball_ids(), world.rank(), world.size());
  EXPECT_EQ(bodies[0].particles.size(), 0);

  EXPECT_EQ(read.step, 42);
  EXPECT_EQ(read.time, written.time);
  EXPECT_EQ(read.dt, written.dt);
  EXPECT_EQ(read.code_version, "0.1.0");
  EXPECT_EQ(read.scene_text, written.scene_text);
  EXPECT_EQ(read.owners, written.owners);
  EXPECT_EQ(read.ranks, world.size());
  ASSERT_EQ(read.numbers.size(), 3u);
  EXPECT_EQ(read.numbers.at("integrator"), written.numbers.at("integrator"));
  EXPECT_TRUE(std::signbit(read.numbers.at("integrator")[1]));
  EXPECT_TRUE(read.numbers.at("effect.phase_field").empty());
  EXPECT_EQ(read.numbers.at("special")[1], -INFINITY);
  EXPECT_TRUE(std::isnan(read.numbers.at("special")[2]));

  const CheckpointHeader header = read_checkpoint_header(world, file);
  EXPECT_EQ(header.dimension, Dim);
  EXPECT_EQ(header.precision, precision);
  ASSERT_EQ(header.bodies.size(), 3u);
  EXPECT_EQ(header.bodies[1].name, "ball / 2.");
  EXPECT_EQ(header.bodies[0].particles, static_cast<GlobalIndex>(plate_ids().size()));
}

TEST(IoCheckpoint, RoundTrip2dDouble) { round_trip<2>(Precision::double_precision); }
TEST(IoCheckpoint, RoundTrip2dSingle) { round_trip<2>(Precision::single_precision); }
TEST(IoCheckpoint, RoundTrip3dDouble) { round_trip<3>(Precision::double_precision); }
TEST(IoCheckpoint, RoundTrip3dSingle) { round_trip<3>(Precision::single_precision); }

// More particles than one round moves, spread such that a rank's particles all lie in one corner of the
// identities.
TEST(IoCheckpoint, ManyRounds) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const Index mine = 40000 + 1000 * world.rank();
  const GlobalIndex first = world.exclusive_sum(mine), total = world.sum(static_cast<GlobalIndex>(mine));
  std::vector<Body<2>> bodies;
  bodies.emplace_back("block", 0, Precision::single_precision);
  FieldSet& set = bodies[0].particles;
  const auto write_values = [&](GlobalIndex id, Index p) {
    for (FieldId f = 1; f < set.count(); ++f)
      for (int c = 0; c < set.traits(f).components; ++c)
        set_value(set, f, c, p, expected_value(set, f, c, id));
    set.data<GlobalIndex>(core::id)[p] = id;
  };
  set.resize(mine);
  for (Index p = 0; p < mine; ++p) write_values(3 * (total - 1 - first - p), p);
  const auto file =
      write_checkpoint(world, folder.path(), state_of_step(1), bodies, Precision::single_precision);

  std::vector<Body<2>> read;
  read.emplace_back("block", 0, Precision::single_precision);
  read_checkpoint(world, file, read, Precision::single_precision);
  std::vector<GlobalIndex> ids(total);
  for (GlobalIndex i = 0; i < total; ++i) ids[i] = 3 * i;
  expect_share(read[0].particles, ids, world.rank(), world.size());
}

std::set<std::string> names_in(const std::filesystem::path& folder) {
  std::set<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) names.insert(entry.path().filename());
  return names;
}

TEST(IoCheckpoint, KeepsTheLastTwo) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<2>(world, Precision::double_precision);
  const auto write = [&](GlobalIndex step) {
    write_checkpoint(world, folder.path(), state_of_step(step), bodies, Precision::double_precision);
    world.barrier();
    const auto names = names_in(folder.path());
    world.barrier();
    return names;
  };
  if (world.root()) std::ofstream(folder / "checkpoint_notes.h5") << "the user's own";
  using Names = std::set<std::string>;
  EXPECT_EQ(write(10), (Names{"checkpoint_000000010.h5", "checkpoint_notes.h5"}));
  EXPECT_EQ(write(20), (Names{"checkpoint_000000010.h5", "checkpoint_000000020.h5", "checkpoint_notes.h5"}));
  EXPECT_EQ(write(30), (Names{"checkpoint_000000020.h5", "checkpoint_000000030.h5", "checkpoint_notes.h5"}));
  EXPECT_EQ(write(30), (Names{"checkpoint_000000020.h5", "checkpoint_000000030.h5", "checkpoint_notes.h5"}));
  // Restarted from step 20: 30 belongs to the course that was given up.
  EXPECT_EQ(write(25), (Names{"checkpoint_000000020.h5", "checkpoint_000000025.h5", "checkpoint_notes.h5"}));
  EXPECT_EQ(write(1234567890),
            (Names{"checkpoint_000000025.h5", "checkpoint_1234567890.h5", "checkpoint_notes.h5"}));
}

TEST(IoCheckpoint, LatestSkipsWhatIsDamaged) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  EXPECT_FALSE(latest_checkpoint(world, folder.path()).file);
  EXPECT_FALSE(latest_checkpoint(world, folder / "missing").file);
  const auto bodies = test_bodies<3>(world, Precision::single_precision);
  const auto first =
      write_checkpoint(world, folder.path(), state_of_step(100), bodies, Precision::single_precision);
  const auto second =
      write_checkpoint(world, folder.path(), state_of_step(200), bodies, Precision::single_precision);
  EXPECT_EQ(latest_checkpoint(world, folder.path()).file, second);

  // As a kill in the middle of writing step 300 leaves it, and a step 200 that was never completed.
  if (world.root()) {
    std::ofstream(folder / "checkpoint_000000300.h5.tmp") << std::string(3000, '\0');
    const hid_t file = H5Fopen(second.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    H5Adelete(file, "complete");
    H5Fclose(file);
  }
  world.barrier();
  LatestCheckpoint latest = latest_checkpoint(world, folder.path());
  EXPECT_EQ(latest.file, first);
  ASSERT_EQ(latest.skipped.size(), 1u);
  EXPECT_NE(latest.skipped[0].find("never completed"), std::string::npos) << latest.skipped[0];

  // A flipped bit in the particles is found as well.
  if (world.root()) {
    std::fstream bytes(first, std::ios::in | std::ios::out | std::ios::binary);
    bytes.seekg(static_cast<std::streamoff>(std::filesystem::file_size(first) / 2));
    const char flipped = static_cast<char>(bytes.peek() ^ 4);
    bytes.put(flipped);
  }
  world.barrier();
  latest = latest_checkpoint(world, folder.path());
  EXPECT_FALSE(latest.file);
  ASSERT_EQ(latest.skipped.size(), 2u);
  EXPECT_NE(latest.skipped[1].find("damaged"), std::string::npos) << latest.skipped[1];

  // The next checkpoint sweeps up what the kill left.
  write_checkpoint(world, folder.path(), state_of_step(400), bodies, Precision::single_precision);
  world.barrier();
  EXPECT_FALSE(std::filesystem::exists(folder / "checkpoint_000000300.h5.tmp"));
  EXPECT_TRUE(latest_checkpoint(world, folder.path()).skipped.empty());
}

// Lets files grow to `bytes` only, for as long as it lives; like a full disk, but for this process alone.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }

 private:
  rlimit before_{};
  void (*handler_)(int);
};

TEST(IoCheckpoint, FullDiskLeavesTheOldFileAlone) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<3>(world, Precision::double_precision);
  const auto good =
      write_checkpoint(world, folder.path(), state_of_step(1), bodies, Precision::double_precision);
  const auto try_writing = [&] {
    return text_on_all_ranks<FileError>(world, [&] {
      write_checkpoint(world, folder.path(), state_of_step(2), bodies, Precision::double_precision);
    });
  };
  // Everywhere, early and late; then on one rank alone.
  for (const rlim_t bytes : {100, 50000, 700000}) {
    FileSizeLimit limit(bytes);
    EXPECT_NE(try_writing().find("checkpoint_000000002.h5"), std::string::npos) << bytes;
  }
  for (int rank = 0; rank < world.size(); ++rank) {
    if (rank == 1)
      continue;  // it gets a slab to write like any other, but let the file's end be rank 0's or the last's
    std::unique_ptr<FileSizeLimit> limit;
    if (world.rank() == rank) limit = std::make_unique<FileSizeLimit>(1000);
    try_writing();
  }
  world.barrier();
  EXPECT_EQ(names_in(folder.path()), std::set<std::string>{"checkpoint_000000001.h5"});
  EXPECT_NO_THROW(verify_checkpoint(world, good));
  write_checkpoint(world, folder.path(), state_of_step(2), bodies, Precision::double_precision);
  EXPECT_EQ(latest_checkpoint(world, folder.path()).file, folder / "checkpoint_000000002.h5");
}

TEST(IoCheckpoint, FolderThatCannotBeWritten) {
  const Communicator world = Communicator::world();
  SharedTemporaryFolder folder;
  const auto bodies = test_bodies<2>(world, Precision::double_precision);
  const std::string text = text_on_all_ranks<FileError>(world, [&] {
    write_checkpoint(world, folder / "missing", state_of_step(2), bodies, Precision::double_precision);
  });
  EXPECT_NE(text.find("missing/checkpoint_000000002.h5"), std::string::npos) << text;
  EXPECT_NE(text.find("No such file or directory"), std::string::npos) << text;
}

}  // namespace
}  // namespace mpm::test
