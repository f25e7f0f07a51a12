// Compressed datasets: every rank compresses the chunks that begin in its rows, rank 0 only assigns their
// places.
#include <mpi.h>

#include <algorithm>
#include <cstring>

#include "hdf5_writer.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

namespace {

// The chunks of `rows_per_chunk` rows that `data` is made of, as HDF5's filters leave them. Throws FileError.
std::vector<DeflatedChunk> deflated_chunks(FileType type, int components, std::uint64_t rows_per_chunk,
                                           int deflate, const std::vector<char>& data) {
  const std::size_t row_bytes = static_cast<std::size_t>(bytes_of(type)) * std::max(components, 1);
  const std::uint64_t rows = data.size() / row_bytes;
  std::vector<DeflatedChunk> chunks;
  if (rows == 0) return chunks;
  // The filters of a file of our own in memory make sure that any HDF5 can read the chunks.
  Hdf5Image image;
  const Hdf5Id dataset =
      image.make_chunked_dataset("chunks", type, rows, components, rows_per_chunk, deflate);
  bool ok = H5Dwrite(dataset, hdf5_type(type), H5S_ALL, H5S_ALL, H5P_DEFAULT, data.data()) >= 0;
  for (std::uint64_t row = 0; ok && row < rows; row += rows_per_chunk) {
    const hsize_t corner[2] = {row, 0};
    hsize_t bytes = 0;
    ok = H5Dget_chunk_storage_size(dataset, corner, &bytes) >= 0;
    DeflatedChunk& chunk = chunks.emplace_back();
    chunk.bytes.resize(bytes);
    ok = ok && H5Dread_chunk(dataset, H5P_DEFAULT, corner, &chunk.skipped_filters, chunk.bytes.data()) >= 0;
  }
  if (!ok) throw FileError("HDF5 can't compress the output (out of memory?)");
  return chunks;
}

struct ChunkSize {
  std::uint64_t bytes, skipped_filters;
};

}  // namespace

std::uint64_t Hdf5Writer::Entry::rows_per_chunk() const { return std::min<std::uint64_t>(rows, 1 << 15); }

// Makes pending_ the rows of the chunks that begin here, padded to whole chunks, and returns the first one's
// number.
std::uint64_t Hdf5Writer::take_over_split_chunks(const Entry& entry) {
  const std::uint64_t per_chunk = entry.rows_per_chunk(), row_bytes = entry.row_bytes();
  const std::uint64_t rows = pending_.size() / row_bytes;
  const std::uint64_t first =
      static_cast<std::uint64_t>(communicator_.exclusive_sum(static_cast<GlobalIndex>(rows)));
  std::vector<std::uint64_t> ends(communicator_.size());
  const std::uint64_t end = first + rows;
  MPI_Allgather(&end, 1, MPI_UINT64_T, ends.data(), 1, MPI_UINT64_T, mpi_comm(communicator_));

  const std::uint64_t first_chunk = (first + per_chunk - 1) / per_chunk;
  const std::uint64_t given = std::min(rows, first_chunk * per_chunk - first);
  std::map<int, Communicator::Bytes> outgoing;
  if (given > 0) {
    // The owner is the first rank whose rows reach beyond the chunk's first row.
    const std::uint64_t corner = (first_chunk - 1) * per_chunk;
    const int owner = static_cast<int>(std::upper_bound(ends.begin(), ends.end(), corner) - ends.begin());
    Communicator::Bytes& message = outgoing[owner];
    const char* header = reinterpret_cast<const char*>(&first);
    message.assign(header, header + sizeof(first));
    message.insert(message.end(), pending_.begin(),
                   pending_.begin() + static_cast<std::ptrdiff_t>(given * row_bytes));
  }
  const auto incoming = communicator_.exchange(outgoing);

  pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(given * row_bytes));
  const std::uint64_t chunks = (rows - given + per_chunk - 1) / per_chunk;
  pending_.resize(chunks * per_chunk * row_bytes);
  for (const auto& [source, message] : incoming) {
    std::uint64_t row = 0;
    std::memcpy(&row, message.data(), sizeof(row));
    std::memcpy(&pending_[(row - first_chunk * per_chunk) * row_bytes], message.data() + sizeof(row),
                message.size() - sizeof(row));
  }
  return first_chunk;
}

std::vector<std::uint64_t> Hdf5Writer::place_chunks(Entry& entry, std::uint64_t first_chunk,
                                                    const std::vector<DeflatedChunk>& chunks) {
  Communicator::Bytes mine;
  for (const DeflatedChunk& chunk : chunks) {
    const ChunkSize size{chunk.bytes.size(), chunk.skipped_filters};
    mine.insert(mine.end(), reinterpret_cast<const char*>(&size), reinterpret_cast<const char*>(&size + 1));
  }
  // Ranks own consecutive chunks, so that the sizes arrive in the order of the file.
  const std::vector<Communicator::Bytes> sizes = communicator_.gather(mine);
  Communicator::Bytes places;
  on_root(communicator_, [&] {
    std::uint64_t row = 0;
    for (const Communicator::Bytes& part : sizes)
      for (std::size_t at = 0; at < part.size(); at += sizeof(ChunkSize), row += entry.rows_per_chunk()) {
        ChunkSize size;
        std::memcpy(&size, &part[at], sizeof(size));
        const std::uint64_t place = image_->reserve_chunk(entry.id, row, size.bytes,
                                                          static_cast<std::uint32_t>(size.skipped_filters));
        places.insert(places.end(), reinterpret_cast<const char*>(&place),
                      reinterpret_cast<const char*>(&place + 1));
      }
  });
  communicator_.broadcast(places);
  std::vector<std::uint64_t> result(chunks.size());
  if (!chunks.empty())
    std::memcpy(result.data(), &places[first_chunk * sizeof(std::uint64_t)],
                chunks.size() * sizeof(std::uint64_t));
  return result;
}

void Hdf5Writer::close(Dataset dataset) {
  Entry& entry = entries_[dataset];
  if (entry.deflate == 0) return;
  agree_on_fault(communicator_, fault_);
  const std::uint64_t first_chunk = take_over_split_chunks(entry);
  std::vector<DeflatedChunk> chunks;
  together(communicator_, [&] {
    chunks = deflated_chunks(entry.type, entry.components, entry.rows_per_chunk(), entry.deflate, pending_);
  });
  pending_.clear();
  const std::vector<std::uint64_t> places = place_chunks(entry, first_chunk, chunks);
  try {
    for (std::size_t c = 0; c < chunks.size(); ++c)
      descriptor_.write(places[c], chunks[c].bytes.data(), chunks[c].bytes.size());
  } catch (...) {
    fault_ = std::current_exception();
  }
}

}  // namespace mpm
