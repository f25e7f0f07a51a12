// The index frames.hdf.series, which tells ParaView the time of each frame.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

struct FrameEntry {
  std::string name;  // of the file, beside the index
  Real time = 0;     // [s]
};

inline constexpr const char* frame_series_name = "frames.hdf.series";

std::string frame_name(int number);  // frame_000000.hdf

// Empty when the folder has no index. Throws FileError; none of these is collective.
std::vector<FrameEntry> read_frame_series(const std::filesystem::path& folder);
void write_frame_series(const std::filesystem::path& folder, const std::vector<FrameEntry>& frames);

// Removes the frames later than `time` and their entries, so that a restarted run can go on.
void trim_frame_series(const std::filesystem::path& folder, Real time);

}  // namespace mpm
