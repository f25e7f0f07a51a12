// The description part of a checkpoint: read and checked by rank 0, sent to the others.
#pragma once

#include <filesystem>
#include <string>

#include "mpm_hpc/io/checkpoint.hpp"

namespace mpm::checkpoint {

// The fault of a checkpoint as a FileError with the remedy.
[[noreturn]] void fail(const std::filesystem::path& file, const std::string& fault);
[[noreturn]] void fail_damaged(const std::filesystem::path& file, const std::string& detail);

// Throws FileError; not collective.
CheckpointHeader parse_header(const std::filesystem::path& file);

}  // namespace mpm::checkpoint
