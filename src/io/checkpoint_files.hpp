// Names inside a checkpoint and in its folder, shared by writer and reader.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm::checkpoint {

inline constexpr const char* format_name = "mpm_hpc checkpoint";
inline constexpr const char* scene_path = "scene";
inline constexpr const char* owners_path = "owners";
inline constexpr const char* curve_cuts_path = "curve_cuts";
inline constexpr const char* numbers_group = "numbers";
inline constexpr const char* bodies_group = "bodies";

// Bodies are numbered, so that their names may hold any character; the name is an attribute.
inline std::string body_path(std::size_t body) {
  return std::string(bodies_group) + "/" + std::to_string(body);
}
inline std::string column_path(std::size_t body, const std::string& column) {
  return body_path(body) + "/" + column;
}

struct File {
  GlobalIndex step = 0;
  std::filesystem::path path;
};

// Checkpoints of a folder in the order of their steps; not those that are still being written. Not
// collective.
std::vector<File> list(const std::filesystem::path& folder);

}  // namespace mpm::checkpoint
