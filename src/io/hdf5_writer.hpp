// One HDF5 file written by all ranks: rank 0 lays it out in memory, every rank writes its rows, and the file
// appears under its name only when it is whole.
#pragma once

#include <exception>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "file_descriptor.hpp"
#include "hdf5_image.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct DeflatedChunk {
  std::vector<char> bytes;
  std::uint32_t skipped_filters = 0;
};

// Use: constructor, add() the bulk datasets, lay_out(), write() and close() them, commit(). Members marked
// collective throw FileError on all ranks; a writer that is destroyed before commit() leaves nothing behind.
class Hdf5Writer {
 public:
  using Dataset = int;
  using Layout = std::function<void(Hdf5Image&)>;  // runs on rank 0

  Hdf5Writer(const Communicator& communicator, const std::filesystem::path& file);  // collective
  ~Hdf5Writer();
  Hdf5Writer(const Hdf5Writer&) = delete;
  Hdf5Writer& operator=(const Hdf5Writer&) = delete;

  // `rows` over all ranks; components 0: one-dimensional; deflate 0: contiguous, 1 to 9: compressed. The same
  // on all ranks.
  Dataset add(const std::string& path, FileType type, std::uint64_t rows, int components, int deflate = 0);
  // Collective. `first` makes groups, attributes and small datasets.
  void lay_out(const Layout& first);

  // This rank's rows; contiguous datasets take them in any order, compressed ones in the order of ranks and
  // rows. A failure is kept for commit().
  void write(Dataset dataset, std::uint64_t first_row, std::uint64_t rows, const void* data);
  // A fault of the caller's while it made data, to be thrown on all ranks in its stead; the first one counts.
  void keep_fault(const std::exception_ptr& fault) {
    if (!fault_) fault_ = fault;
  }
  // After a dataset's last write(). Collective when the dataset is compressed, else without effect.
  void close(Dataset dataset);
  // Collective. `last` adds what is known at the end; `durable` waits until the disk has everything.
  void commit(const Layout& last, bool durable);

 private:
  struct Entry {
    std::string path;
    FileType type;
    std::uint64_t rows;
    int components, deflate;
    std::uint64_t place = 0;
    Hdf5Id id;  // on rank 0, compressed datasets only

    std::size_t row_bytes() const {
      return static_cast<std::size_t>(bytes_of(type)) * std::max(components, 1);
    }
    std::uint64_t rows_per_chunk() const;
  };
  std::uint64_t take_over_split_chunks(const Entry& entry);
  std::vector<std::uint64_t> place_chunks(Entry& entry, std::uint64_t first_chunk,
                                          const std::vector<DeflatedChunk>& chunks);

  Communicator communicator_;
  std::filesystem::path file_, temporary_;
  FileDescriptor descriptor_;
  std::unique_ptr<Hdf5Image> image_;  // on rank 0
  std::vector<Entry> entries_;
  std::vector<char> pending_;  // rows of the compressed dataset that is being written
  std::exception_ptr fault_;
};

}  // namespace mpm
