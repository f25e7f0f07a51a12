// Runs a scene from its file to its end: the one entry point of the program.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct RunOptions {
  std::filesystem::path scene;
  std::vector<std::string> overrides;                 // key.path=value
  std::optional<std::filesystem::path> output;        // default: the scene's name, in the working directory
  std::optional<std::filesystem::path> restart;       // a checkpoint
  std::optional<std::int64_t> steps;                  // at most so many in this run
  std::optional<Real> until;                          // time.end of this run [s]
  bool validate = false, explain = false, force = false;
};

// Returns done or stopped_by_signal; throws Error on all ranks together. Collective.
ExitCode run_scene(const Communicator& communicator, const RunOptions& options);

// Every key of a scene: as text, or as a JSON schema.
std::string describe_scene(int dimension, bool json);

std::string version();

// To be called from a signal handler: a checkpoint is written after the present step and the run ends.
void request_stop();

}  // namespace mpm
