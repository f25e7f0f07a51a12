#include "mpm_hpc/io/history.hpp"

#include <fcntl.h>

#include <algorithm>
#include <charconv>

#include "file_descriptor.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/text.hpp"
#include "mpm_hpc/io/text_file.hpp"
#include "mpm_hpc/io/together.hpp"

namespace mpm {

struct HistoryWriter::File {
  FileDescriptor descriptor;
  std::uint64_t end;
};

namespace {

std::string header_of(const std::vector<HistoryColumn>& columns) {
  std::string header;
  for (const HistoryColumn& column : columns)
    header += fmt::format("{}{} [{}]", header.empty() ? "" : ",", column.name, column.unit);
  return header;
}

// The rows to keep of a file that a run wrote before it was restarted.
std::string continued(const std::filesystem::path& file, const std::string& header,
                      GlobalIndex restart_step) {
  std::string text = read_text_file(file);
  text.erase(text.rfind('\n') + 1);  // no newline at the end: a row that was cut off
  std::vector<std::string> rows = split(text, '\n');
  rows.pop_back();  // behind the last newline
  if (rows.empty() || rows[0] != header)
    throw FileError(
        fmt::format("{} has other columns than this run; restart with the same effects and obstacles, or "
                    "choose another folder with --output.",
                    file.string()));
  const auto cells = std::count(header.begin(), header.end(), ',');
  std::string kept = header + "\n";
  for (std::size_t r = 1; r < rows.size(); ++r) {
    Real step = 0;
    const auto [end, error] = std::from_chars(rows[r].data(), rows[r].data() + rows[r].size(), step);
    if (error == std::errc() && step <= static_cast<Real>(restart_step) &&
        std::count(rows[r].begin(), rows[r].end(), ',') == cells)
      kept += rows[r] + "\n";
  }
  return kept;
}

}  // namespace

HistoryWriter::HistoryWriter(const Communicator& communicator, const std::filesystem::path& file,
                             const std::vector<HistoryColumn>& columns,
                             std::optional<GlobalIndex> restart_step)
    : communicator_(communicator), columns_(columns.size()) {
  debug_check(!columns.empty() && columns[0].name == "step", "the history's first column is not the step");
  on_root(communicator_, [&] {
    const std::string header = header_of(columns);
    const bool continues = restart_step && std::filesystem::exists(file);
    const std::string text = continues ? continued(file, header, *restart_step) : header + "\n";
    replace_text_file(file, text);
    file_ = std::make_unique<File>(File{FileDescriptor(file, O_WRONLY), text.size()});
  });
}

HistoryWriter::~HistoryWriter() = default;
HistoryWriter::HistoryWriter(HistoryWriter&&) noexcept = default;

void HistoryWriter::write(const std::vector<Real>& values) {
  on_root(communicator_, [&] {
    debug_check(values.size() == columns_, "a row of the history has the wrong number of cells");
    std::string row;
    char cell[32];
    for (std::size_t c = 0; c < values.size(); ++c) {
      std::snprintf(cell, sizeof(cell), "%.17g", values[c]);
      row += (c == 0 ? "" : ",") + std::string(cell);
    }
    row += '\n';
    file_->descriptor.write(file_->end, row.data(), row.size());
    file_->end += row.size();
  });
}

}  // namespace mpm
