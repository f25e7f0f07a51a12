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
  std::vector<std::int64_t> peak_rss_bytes;  // of each rank
  std::vector<std::pair<std::string, Spread>> stages;            // [s]
  // Of all ranks, in the steps alone: all that is sent point to point, and the halo's share.
  Real messages_per_step = 0, bytes_per_step = 0;
  Real halo_messages_per_step = 0, halo_bytes_per_step = 0;
  std::vector<std::pair<std::string, Spread>> traffic_per_step;  // of a rank, in the steps alone
  Spread neighbours, ghost_nodes;                                // of a rank, at the end
  GlobalIndex rebalances = 0;
  Real imbalance = 1;  // largest over mean weight of a rank
  std::map<std::string, GlobalIndex> solver_iterations;
  std::map<std::string, GlobalIndex> guards;
  ExitCode exit_code = ExitCode::done;
  std::string exit_reason;
};

std::string run_json_text(const RunReport& report);

// The report of rank 0. Throws FileError on all ranks. Collective.
void write_run_json(const Communicator& communicator, const std::filesystem::path& file,
                    const RunReport& report);

}  // namespace mpm
