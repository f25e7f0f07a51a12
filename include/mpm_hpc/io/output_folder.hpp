// The folder of a run; results of another run are never overwritten by accident.
#pragma once

#include <filesystem>
#include <optional>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct RestartPoint {
  std::filesystem::path checkpoint;
  Real time = 0;  // [s]
};

struct OutputFolderRequest {
  std::filesystem::path folder;
  bool force = false;  // replace the run that is in the folder
  std::optional<RestartPoint> restart = {};
};

// Makes the folder ready to be written to:
// - a folder without a run is created or used as it is;
// - one that holds the checkpoint of the restart is continued: frames later than it are removed;
// - with `force` the files of the run in it go (frames, checkpoints, history.csv, run.json), and nothing
//   else;
// - otherwise a run in it is a UserError. Throws UserError, or FileError if the folder can't be made or
//   written, on all ranks. Collective.
void prepare_output_folder(const Communicator& communicator, const OutputFolderRequest& request);

}  // namespace mpm
