#include "hdf5_writer.hpp"

#include <fcntl.h>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/together.hpp"

namespace mpm {

Hdf5Writer::Hdf5Writer(const Communicator& communicator, const std::filesystem::path& file)
    : communicator_(communicator), file_(file), temporary_(file) {
  temporary_ += temporary_ending;
  on_root(communicator_, [&] {
    descriptor_ = FileDescriptor(temporary_, O_WRONLY | O_CREAT | O_TRUNC);
    image_ = std::make_unique<Hdf5Image>();
  });
  together(communicator_, [&] {
    if (communicator_.root()) return;
    try {
      descriptor_ = FileDescriptor(temporary_, O_WRONLY);
    } catch (const FileError& error) {
      throw FileError(fmt::format("rank {}: {}; all nodes must share the output folder", communicator_.rank(),
                                  error.what()));
    }
  });
}

Hdf5Writer::~Hdf5Writer() {
  std::error_code ignored;
  if (communicator_.root() && image_) std::filesystem::remove(temporary_, ignored);
}

Hdf5Writer::Dataset Hdf5Writer::add(const std::string& path, FileType type, std::uint64_t rows,
                                    int components, int deflate) {
  // A dataset without rows can't have chunks.
  entries_.push_back({path, type, rows, components, rows == 0 ? 0 : deflate, 0, {}});
  return static_cast<Dataset>(entries_.size()) - 1;
}

void Hdf5Writer::lay_out(const Layout& first) {
  on_root(communicator_, [&] {
    first(*image_);
    for (Entry& entry : entries_) {
      if (entry.deflate > 0) {
        entry.id = image_->make_chunked_dataset(entry.path, entry.type, entry.rows, entry.components,
                                                entry.rows_per_chunk(), entry.deflate);
      } else {
        entry.place =
            Hdf5Image::place(image_->reserve_dataset(entry.path, entry.type, entry.rows, entry.components));
      }
    }
    descriptor_.reserve(image_->end());
  });
  Communicator::Bytes places(entries_.size() * sizeof(std::uint64_t));
  auto* place = reinterpret_cast<std::uint64_t*>(places.data());
  for (std::size_t e = 0; e < entries_.size(); ++e) place[e] = entries_[e].place;
  communicator_.broadcast(places);
  for (std::size_t e = 0; e < entries_.size(); ++e) entries_[e].place = place[e];
}

void Hdf5Writer::write(Dataset dataset, std::uint64_t first_row, std::uint64_t rows, const void* data) {
  if (fault_ || rows == 0) return;
  const Entry& entry = entries_[dataset];
  const std::size_t bytes = rows * entry.row_bytes();
  try {
    if (entry.deflate > 0) {
      const char* begin = static_cast<const char*>(data);
      pending_.insert(pending_.end(), begin, begin + bytes);
    } else {
      descriptor_.write(entry.place + first_row * entry.row_bytes(), data, bytes);
    }
  } catch (...) {
    fault_ = std::current_exception();
  }
}

void Hdf5Writer::commit(const Layout& last, bool durable) {
  together(communicator_, [&] {
    if (fault_) std::rethrow_exception(fault_);
    if (durable) descriptor_.sync();
    if (!communicator_.root()) descriptor_.close();
  });
  on_root(communicator_, [&] {
    last(*image_);
    for (Entry& entry : entries_) entry.id = Hdf5Id();
    const Hdf5Image::Bytes& bytes = image_->finish();
    for (const auto& [place, piece] : bytes.pieces) descriptor_.write(place, piece.data(), piece.size());
    descriptor_.resize(bytes.end);
    if (durable) descriptor_.sync();
    descriptor_.close();
    rename_file(temporary_, file_, durable);
    image_.reset();
  });
}

}  // namespace mpm
