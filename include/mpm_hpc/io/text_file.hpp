// Small text files that are whole or absent, never half written.
#pragma once

#include <filesystem>
#include <string>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Writes beside `file` under a temporary name, syncs and renames. Throws FileError; not collective.
void replace_text_file(const std::filesystem::path& file, const std::string& text);

// Rank 0 writes `text`. Throws FileError on all ranks. Collective.
void write_text_file(const Communicator& communicator, const std::filesystem::path& file,
                     const std::string& text);

// The whole file. Throws FileError; not collective.
std::string read_text_file(const std::filesystem::path& file);

}  // namespace mpm
