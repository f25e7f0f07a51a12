#include "mpm_hpc/io/output_folder.hpp"

#include <fcntl.h>

#include <regex>
#include <vector>

#include "file_descriptor.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/frame_series.hpp"
#include "mpm_hpc/io/together.hpp"

namespace mpm {

namespace fs = std::filesystem;

namespace {

bool is_part_of_run(const std::string& name) {
  static const std::regex pattern(
      R"((run\.json|history\.csv|frames\.hdf\.series|frame_\d{6,}\.hdf|checkpoint_\d{9,}\.h5)(\.tmp)?)");
  return std::regex_match(name, pattern);
}

std::vector<fs::path> files_of_run(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.is_regular_file() && is_part_of_run(entry.path().filename().string()))
      files.push_back(entry.path());
  return files;
}

bool holds(const fs::path& folder, const fs::path& file) {
  std::error_code ignored;
  return fs::equivalent(folder, file.has_parent_path() ? file.parent_path() : fs::path("."), ignored);
}

void check_writable(const fs::path& folder) {
  const fs::path probe = folder / (std::string("run.json") + temporary_ending);
  FileDescriptor(probe, O_WRONLY | O_CREAT).close();
  fs::remove(probe);
}

void prepare(const OutputFolderRequest& request) {
  const fs::path& folder = request.folder;
  fs::create_directories(folder);
  const std::vector<fs::path> files = files_of_run(folder);
  // A lone temporary file is what a killed run left behind, not a result.
  const bool has_run = std::any_of(files.begin(), files.end(),
                                   [](const fs::path& file) { return file.extension() != temporary_ending; });
  const bool continues = request.restart && holds(folder, request.restart->checkpoint);
  if (has_run && !continues && !request.force)
    throw UserError(
        fmt::format("the output folder {} holds a run already; choose another one with --output, or "
                    "replace the run with --force.",
                    folder.string()));
  check_writable(folder);
  if (continues) {
    trim_frame_series(folder, request.restart->time);
  } else {
    for (const fs::path& file : files) fs::remove(file);
  }
}

}  // namespace

void prepare_output_folder(const Communicator& communicator, const OutputFolderRequest& request) {
  on_root(communicator, [&] {
    try {
      prepare(request);
    } catch (const fs::filesystem_error& error) {
      throw FileError(fmt::format("can't use the output folder {}: {}; choose another one with --output.",
                                  request.folder.string(), error.code().message()));
    } catch (const FileError& error) {
      throw FileError(fmt::format("can't use the output folder {}: {}; choose another one with --output.",
                                  request.folder.string(), error.what()));
    }
  });
  together(communicator, [&] {
    std::error_code ignored;
    if (!fs::is_directory(request.folder, ignored))
      throw FileError(
          fmt::format("rank {} can't see the output folder {}; choose one that all nodes share with "
                      "--output.",
                      communicator.rank(), request.folder.string()));
  });
}

}  // namespace mpm
