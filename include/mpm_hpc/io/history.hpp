// history.csv: global sums of the run, one row per interval.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct HistoryColumn {
  std::string name;
  std::string unit;  // "1" for pure numbers
};

// The first column is the step. Rank 0 writes; each row is in the file when write() returns.
class HistoryWriter {
 public:
  // Starts a new file, or with `restart_step` continues an existing one, whose rows after that step (and a
  // row cut off by a kill) are dropped. Throws FileError on all ranks, also if the file has other columns.
  // Collective.
  HistoryWriter(const Communicator& communicator, const std::filesystem::path& file,
                const std::vector<HistoryColumn>& columns, std::optional<GlobalIndex> restart_step = {});
  ~HistoryWriter();
  HistoryWriter(HistoryWriter&&) noexcept;

  // One value per column; those of rank 0 count. Throws FileError on all ranks. Collective.
  void write(const std::vector<Real>& values);

 private:
  struct File;

  Communicator communicator_;
  std::size_t columns_;
  std::unique_ptr<File> file_;  // on rank 0
};

}  // namespace mpm
