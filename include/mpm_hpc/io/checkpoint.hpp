// Everything a run needs to go on, in one HDF5 file that any number of ranks can read.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Number of the file's layout; a program reads its own and older ones.
inline constexpr int checkpoint_format = 1;

// The state of a run besides its particles.
struct CheckpointState {
  GlobalIndex step = 0;
  Real time = 0, dt = 0;  // [s]
  std::string code_version;
  std::string scene_text;
  std::map<std::string, std::vector<Real>> numbers;  // of the integrator and the effects; names without '/'
  std::vector<std::int32_t> owners;                  // of the coarse blocks, for `ranks` ranks
  std::vector<GlobalIndex> curve_cuts;               // in place of the owners; older files have none
  int ranks = 1;                                     // set by the writer
};

struct CheckpointColumn {
  std::string name;
  ScalarType type = ScalarType::float64;
  int components = 1;
  std::uint64_t place = 0;     // of the first byte in the file
  std::uint64_t checksum = 0;  // of the elements
};

struct CheckpointBody {
  std::string name;
  GlobalIndex particles = 0;
  std::vector<CheckpointColumn> columns;
};

struct CheckpointHeader {
  int dimension = 2;
  Precision precision = Precision::double_precision;
  CheckpointState state;
  std::vector<CheckpointBody> bodies;
};

// Writes folder/checkpoint_STEP.h5: under a temporary name, synced, renamed. Then removes what is neither
// this file nor the newest one of an earlier step; files of later steps belong to a course of the run that
// was given up. Padding is left out, particles are ordered by identity. Throws FileError on all ranks, with
// all earlier checkpoints untouched. Transient memory: about a tenth of the particles'. Returns the file.
// Collective.
template <int Dim>
std::filesystem::path write_checkpoint(const Communicator& communicator, const std::filesystem::path& folder,
                                       const CheckpointState& state, const std::vector<Body<Dim>>& bodies,
                                       Precision precision);

// Everything but the particles; checks all but their checksums. Throws FileError on all ranks, which names
// the file, the fault and a remedy. Collective.
CheckpointHeader read_checkpoint_header(const Communicator& communicator, const std::filesystem::path& file);

// Gives each rank an equal share of each body's particles; the caller brings them to their owners. The bodies
// have their columns and no particles. Throws FileError on all ranks, also if bodies or columns are not those
// of the file. Collective.
template <int Dim>
CheckpointState read_checkpoint(const Communicator& communicator, const std::filesystem::path& file,
                                std::vector<Body<Dim>>& bodies, Precision precision);

// Reads the whole file. Throws FileError on all ranks. Collective.
void verify_checkpoint(const Communicator& communicator, const std::filesystem::path& file);

struct LatestCheckpoint {
  std::optional<std::filesystem::path> file;
  std::vector<std::string> skipped;  // why newer ones were passed over
};

// The checkpoint of the highest step in the folder that verifies. Collective.
LatestCheckpoint latest_checkpoint(const Communicator& communicator, const std::filesystem::path& folder);

std::string checkpoint_name(GlobalIndex step);  // checkpoint_000000000.h5

}  // namespace mpm
