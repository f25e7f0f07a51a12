// run.json: what a run was and how it went, for people, scripts and scaling studies.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Over ranks.
struct Spread {
  Real min = 0, mean = 0, max = 0;
};

// Files of one kind that a run wrote or read.
struct FileTraffic {
  GlobalIndex files = 0, bytes = 0;
  Real seconds = 0;  // of the slowest rank, with making the data
  Real gb_per_second() const { return seconds > 0 ? 1e-9 * static_cast<Real>(bytes) / seconds : 0; }
};

// What a run took memory for. Peaks are of a process's resident memory, libraries included; steady is what it had before
// the run and every array at its largest.
struct MemoryReport {
  struct Phase {
    std::string name;
    GlobalIndex peak_bytes = 0;  // of the rank with the most
    Real over_steady = 0;        // of the rank with the highest
  };
  std::vector<std::pair<std::string, GlobalIndex>> account;             // over all ranks, by holder, at the end
  std::vector<std::int64_t> before_bytes, steady_bytes, peak_bytes;     // of each rank: before, all arrays, peak
  bool has_phases = false;                                              // else `phases` share one peak
  std::vector<Phase> phases;
  Real peak_over_steady = 0;
};

struct RunReport {
  std::string version;
  std::string scene_hash;
  int ranks = 1;
  int dimension = 2;
  Precision precision = Precision::double_precision;
  GlobalIndex particles = 0;
  GlobalIndex nodes = 0;  // active ones, over all ranks
  GlobalIndex steps = 0;
  Real time = 0;  // simulated [s]
  Real wall_seconds = 0;
  Real particle_steps_per_second_per_core = 0;
  Real bytes_per_particle = 0;               // every array at its peak, over all ranks
  MemoryReport memory;
  std::vector<std::pair<std::string, FileTraffic>> files;  // by kind
  std::vector<std::pair<std::string, Spread>> stages;            // [s]
  // Of all ranks, in the steps alone: all that is sent point to point, and the halo's share.
  Real messages_per_step = 0, bytes_per_step = 0;
  Real halo_messages_per_step = 0, halo_bytes_per_step = 0;
  std::vector<std::pair<std::string, Spread>> traffic_per_step;  // of a rank, in the steps alone
  Spread neighbours, ghost_nodes;                                // of a rank, at the end
  GlobalIndex rebalances = 0;
  Real imbalance = 1;  // largest over mean weight of a rank
  std::map<std::string, GlobalIndex> solver_iterations;
  std::map<std::string, Real> solver_unknowns;  // of all ranks, mean over the solves
  std::map<std::string, Real> solver_residuals;  // the largest that a solve of Newton's method ended with, over its scale
  std::map<std::string, GlobalIndex> guards;
  ExitCode exit_code = ExitCode::done;
  std::string exit_reason;
};

std::string run_json_text(const RunReport& report);

// The report of rank 0. Throws FileError on all ranks. Collective.
void write_run_json(const Communicator& communicator, const std::filesystem::path& file,
                    const RunReport& report);

}  // namespace mpm
