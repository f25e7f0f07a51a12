// history.csv, run.json and the output folder: agreed on by all ranks, continued by a restart, never lost by
// accident.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "io_test_bodies.hpp"
#include "mpm_hpc/io/frame_series.hpp"
#include "mpm_hpc/io/history.hpp"
#include "mpm_hpc/io/output_folder.hpp"
#include "mpm_hpc/io/run_json.hpp"
#include "support/mpi_test.hpp"

namespace mpm::test {
namespace {

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class IoRunFiles : public testing::Test {
 protected:
  void put(const std::string& name, const std::string& text = "content") {
    if (world_.root()) {
      std::filesystem::create_directories((folder_ / name).parent_path());
      std::ofstream(folder_ / name) << text;
    }
    world_.barrier();
  }
  std::string text(const std::string& name) {
    world_.barrier();
    const std::string text = text_of(folder_ / name);
    world_.barrier();
    return text;
  }
  std::set<std::string> names(const std::string& folder) {
    world_.barrier();
    std::set<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / folder))
      names.insert(entry.path().filename());
    world_.barrier();
    return names;
  }

  Communicator world_ = Communicator::world();
  SharedTemporaryFolder folder_;
};

const std::vector<HistoryColumn> columns = {{"step", "1"}, {"time", "s"}, {"mass", "kg"}};

TEST_F(IoRunFiles, HistoryIsThereAfterEachRow) {
  HistoryWriter history(world_, folder_ / "history.csv", columns);
  EXPECT_EQ(text("history.csv"), "step [1],time [s],mass [kg]\n");
  history.write({0, 0, 1.0 / 3});
  EXPECT_EQ(text("history.csv"), "step [1],time [s],mass [kg]\n0,0,0.33333333333333331\n");
  history.write({20000000, 5e-324, NAN});
  EXPECT_EQ(text("history.csv"),
            "step [1],time [s],mass [kg]\n0,0,0.33333333333333331\n20000000,4.9406564584124654e-324,nan\n");
}

TEST_F(IoRunFiles, HistoryGoesOnAfterARestart) {
  put("history.csv", "step [1],time [s],mass [kg]\n0,0,1\n10,1,1\n20,2,1\n30,3,1\n40,4");
  {
    HistoryWriter history(world_, folder_ / "history.csv", columns, 20);
    EXPECT_EQ(text("history.csv"), "step [1],time [s],mass [kg]\n0,0,1\n10,1,1\n20,2,1\n");
    history.write({25, 2.5, 1});
  }
  EXPECT_EQ(text("history.csv"), "step [1],time [s],mass [kg]\n0,0,1\n10,1,1\n20,2,1\n25,2.5,1\n");
  HistoryWriter elsewhere(world_, folder_ / "new.csv", columns, 20);
  EXPECT_EQ(text("new.csv"), "step [1],time [s],mass [kg]\n");
}

TEST_F(IoRunFiles, HistoryOfAnotherRun) {
  const std::string before = "step [1],time [s]\n0,0\n";
  put("history.csv", before);
  const std::string fault = text_on_all_ranks<FileError>(
      world_, [&] { HistoryWriter(world_, folder_ / "history.csv", columns, 0); });
  EXPECT_NE(fault.find("has other columns than this run"), std::string::npos) << fault;
  EXPECT_EQ(text("history.csv"), before);
  text_on_all_ranks<FileError>(world_,
                               [&] { HistoryWriter(world_, folder_ / "missing/history.csv", columns); });
}

TEST_F(IoRunFiles, RunJson) {
  RunReport report;
  report.version = "0.1.0";
  report.ranks = 4;
  report.precision = Precision::single_precision;
  report.particles = GlobalIndex{1} << 40;
  report.time = 0.1;
  report.imbalance = NAN;
  report.memory.peak_bytes = {1, 2};
  report.memory.account = {{"grid/node", 64}};
  report.files = {{"frames", {2, 3'000'000'000, 1.5}}};
  report.stages = {{"p2g", {1, 2, 3}}, {"g2p", {4, 5, 6}}};
  report.traffic_per_step = {{"halo_bytes", {7, 8, 9}}};
  report.solver_iterations = {{"krylov", 12}};
  report.solver_unknowns = {{"krylov", 34.5}};
  report.guards = {{"inverted_elements", 2}};
  report.exit_code = ExitCode::numerical_failure;
  report.exit_reason = "particle 3 \xff left";
  write_run_json(world_, folder_ / "run.json", report);
  const auto json = nlohmann::json::parse(text("run.json"));
  for (const char* key : {"version",
                          "scene_hash",
                          "ranks",
                          "dimension",
                          "precision",
                          "particles",
                          "nodes",
                          "steps",
                          "time",
                          "wall_seconds",
                          "particle_steps_per_second_per_core",
                          "bytes_per_particle",
                          "peak_rss_bytes",
                          "memory",
                          "files",
                          "stages",
                          "messages_per_step",
                          "bytes_per_step",
                          "halo_messages_per_step",
                          "halo_bytes_per_step",
                          "traffic_per_step",
                          "neighbours",
                          "ghost_nodes",
                          "imbalance",
                          "solver_iterations",
                          "solver_unknowns",
                          "guards",
                          "exit"})
    EXPECT_TRUE(json.contains(key)) << key;
  EXPECT_EQ(json["particles"], GlobalIndex{1} << 40);
  EXPECT_EQ(json["peak_rss_bytes"], nlohmann::json({1, 2}));
  EXPECT_EQ(json["memory"]["account"]["grid/node"], 64);
  EXPECT_EQ(json["files"]["frames"]["gb_per_second"], 2);
  EXPECT_EQ(json["precision"], "single");
  EXPECT_EQ(json["time"], 0.1);
  EXPECT_TRUE(json["imbalance"].is_null());
  EXPECT_EQ(json["stages"]["g2p"]["max"], 6);
  EXPECT_EQ(json["traffic_per_step"]["halo_bytes"]["mean"], 8);
  EXPECT_EQ(json["solver_unknowns"]["krylov"], 34.5);
  EXPECT_EQ(json["exit"]["code"], 3);
  EXPECT_EQ(names("."), std::set<std::string>{"run.json"});
  text_on_all_ranks<FileError>(world_, [&] { write_run_json(world_, folder_ / "missing/run.json", report); });
}

TEST_F(IoRunFiles, NewFolder) {
  prepare_output_folder(world_, {folder_ / "a/b"});
  EXPECT_TRUE(names("a/b").empty());
  put("a/b/notes.txt");
  put("a/b/history.csv.tmp");  // a run that was killed at once
  prepare_output_folder(world_, {folder_ / "a/b"});
  EXPECT_EQ(names("a/b"), std::set<std::string>{"notes.txt"});
}

TEST_F(IoRunFiles, ExistingRun) {
  for (const char* file :
       {"run.json", "history.csv", "frames.hdf.series", "frame_000012.hdf", "checkpoint_000000000.h5"}) {
    put(std::string("out/") + file);
    const std::string fault =
        text_on_all_ranks<UserError>(world_, [&] { prepare_output_folder(world_, {folder_ / "out"}); });
    EXPECT_NE(fault.find("--force"), std::string::npos) << fault;
    EXPECT_NE(fault.find("--output"), std::string::npos) << fault;
    EXPECT_EQ(text(std::string("out/") + file), "content");
    if (world_.root()) std::filesystem::remove(folder_ / "out" / file);
    world_.barrier();
  }
}

TEST_F(IoRunFiles, ForceRemovesTheRunAndNothingElse) {
  const std::set<std::string> others = {"scene.toml", "notes.csv", "frame_12.hdf", "frame_000001.hdf.bak",
                                        "checkpoint_000000001.h5.old"};
  for (const std::string& name : others) put("out/" + name);
  for (const char* name : {"run.json", "history.csv", "frames.hdf.series", "frame_000000.hdf",
                           "frame_1000000.hdf", "checkpoint_000000001.h5", "checkpoint_000000002.h5.tmp"})
    put(std::string("out/") + name);
  put("out/checkpoint_000000003.h5/kept");
  prepare_output_folder(world_, {folder_ / "out", true});
  std::set<std::string> left = others;
  left.insert("checkpoint_000000003.h5");  // a folder is nothing of ours
  EXPECT_EQ(names("out"), left);
}

TEST_F(IoRunFiles, RestartIntoTheSameFolder) {
  for (const char* name : {"run.json", "history.csv", "frame_000000.hdf", "frame_000001.hdf",
                           "frame_000002.hdf", "checkpoint_000000010.h5", "checkpoint_000000020.h5"})
    put(std::string("out/") + name);
  if (world_.root())
    write_frame_series(folder_ / "out",
                       {{"frame_000000.hdf", 0}, {"frame_000001.hdf", 0.5}, {"frame_000002.hdf", 1}});
  const std::set<std::string> expected = {"run.json",
                                          "history.csv",
                                          "frame_000000.hdf",
                                          "frame_000001.hdf",
                                          "frames.hdf.series",
                                          "checkpoint_000000010.h5",
                                          "checkpoint_000000020.h5"};
  const RestartPoint restart{folder_ / "out/checkpoint_000000010.h5", 0.5};
  // Another spelling of the same folder, and --force, which must not remove what the restart needs.
  prepare_output_folder(world_, {folder_ / "out/../out", true, restart});
  EXPECT_EQ(names("out"), expected);
  ASSERT_EQ(read_frame_series(folder_ / "out").size(), 2u);

  // From elsewhere, the run in the folder is another one.
  put("elsewhere/checkpoint_000000010.h5");
  text_on_all_ranks<UserError>(world_, [&] {
    prepare_output_folder(
        world_, {folder_ / "out", false, RestartPoint{folder_ / "elsewhere/checkpoint_000000010.h5", 0.5}});
  });
  EXPECT_EQ(names("out"), expected);
}

TEST_F(IoRunFiles, FolderThatCannotBeMade) {
  put("file");
  const std::string below =
      text_on_all_ranks<FileError>(world_, [&] { prepare_output_folder(world_, {folder_ / "file/out"}); });
  EXPECT_NE(below.find("can't use the output folder"), std::string::npos) << below;
  EXPECT_NE(below.find("--output"), std::string::npos) << below;
  text_on_all_ranks<FileError>(world_, [&] { prepare_output_folder(world_, {folder_ / "file"}); });
  text_on_all_ranks<FileError>(world_, [&] { prepare_output_folder(world_, {"/proc/mpm_output"}); });
}

}  // namespace
}  // namespace mpm::test
