#include <fcntl.h>
#include <mpi.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "checkpoint_files.hpp"
#include "checkpoint_header.hpp"
#include "checksum.hpp"
#include "file_descriptor.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/checkpoint.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

namespace {

// Few enough that a piece is put into its components while it is in the cache.
constexpr std::uint64_t rows_per_read = 1 << 13;

struct Rows {
  std::uint64_t begin, end;
};

Rows rows_of_rank(const Communicator& communicator, GlobalIndex particles) {
  const auto total = static_cast<std::uint64_t>(particles);
  const auto size = static_cast<std::uint64_t>(communicator.size());
  const auto start = [&](std::uint64_t rank) { return total / size * rank + std::min(rank, total % size); };
  return {start(communicator.rank()), start(communicator.rank() + 1)};
}

// Reads this rank's rows of a column, hands them to take(first row of the rank's, number, data), and returns
// their part of the checksum.
template <class Take>
std::uint64_t read_column(const FileDescriptor& descriptor, const CheckpointColumn& column, const Rows& rows,
                          Take&& take) {
  const std::uint64_t components = column.components, row_bytes = components * bytes_of(column.type);
  std::vector<char> data;
  std::uint64_t sum = 0;
  for (std::uint64_t row = rows.begin; row < rows.end; row += rows_per_read) {
    const std::uint64_t count = std::min(rows.end - row, rows_per_read);
    data.resize(count * row_bytes);
    descriptor.read(column.place + row * row_bytes, data.data(), data.size());
    sum += checksum(data.data(), count * components, bytes_of(column.type), row * components);
    take(row - rows.begin, count, data.data());
  }
  return sum;
}

// Reads all columns of all bodies and compares their checksums; take(body, column, first, number, data).
// Collective; throws FileError on all ranks.
template <class Take>
void read_columns(const Communicator& communicator, const std::filesystem::path& file,
                  const CheckpointHeader& header, Take&& take) {
  std::vector<std::uint64_t> sums;
  together(communicator, [&] {
    const FileDescriptor descriptor(file, O_RDONLY);
    for (std::size_t b = 0; b < header.bodies.size(); ++b) {
      const Rows rows = rows_of_rank(communicator, header.bodies[b].particles);
      for (const CheckpointColumn& column : header.bodies[b].columns)
        sums.push_back(read_column(descriptor, column, rows, [&](auto first, auto count, const char* data) {
          take(b, column, first, count, data);
        }));
    }
  });
  MPI_Allreduce(MPI_IN_PLACE, sums.data(), static_cast<int>(sums.size()), MPI_UINT64_T, MPI_SUM,
                mpi_comm(communicator));
  std::size_t next = 0;
  for (const CheckpointBody& body : header.bodies)
    for (const CheckpointColumn& column : body.columns)
      if (sums[next++] != column.checksum)
        checkpoint::fail_damaged(file, fmt::format("the checksum of column \"{}\" of body \"{}\" is wrong",
                                                   column.name, body.name));
}

const char* name_of(Precision precision) {
  return precision == Precision::single_precision ? "single" : "double";
}

constexpr const char* remedy = "restart it with the scene that it was written with";

// Number of the body of the scene that a body of the file is.
template <int Dim>
std::size_t matching_body(const std::filesystem::path& file, const CheckpointBody& stored,
                          const std::vector<Body<Dim>>& bodies) {
  const auto body =
      std::find_if(bodies.begin(), bodies.end(), [&](const auto& b) { return b.name == stored.name; });
  if (body == bodies.end())
    checkpoint::fail(file, fmt::format("has a body \"{}\", which the scene lacks; {}", stored.name, remedy));
  const FieldSet& set = body->particles;
  for (const CheckpointColumn& column : stored.columns) {
    const FieldId f = set.find(column.name);
    if (f == no_field)
      checkpoint::fail(
          file, fmt::format("has a column \"{}\" of body \"{}\", which no effect of the scene asks for; {}",
                            column.name, stored.name, remedy));
    if (set.traits(f).type != column.type || set.traits(f).components != column.components)
      checkpoint::fail(file,
                       fmt::format("has a column \"{}\" of body \"{}\" of another type or shape than the "
                                   "scene's; {}",
                                   column.name, stored.name, remedy));
  }
  for (FieldId f = 0; f < set.count(); ++f)
    if (set.has(f) && std::none_of(stored.columns.begin(), stored.columns.end(),
                     [&](const CheckpointColumn& c) { return c.name == set.traits(f).name; }))
      checkpoint::fail(file,
                       fmt::format("lacks the column \"{}\" of body \"{}\", which the scene asks for; {}",
                                   set.traits(f).name, stored.name, remedy));
  return static_cast<std::size_t>(body - bodies.begin());
}

template <int Dim>
std::vector<std::size_t> matching_bodies(const std::filesystem::path& file, const CheckpointHeader& header,
                                         const std::vector<Body<Dim>>& bodies, Precision precision) {
  if (header.dimension != Dim)
    checkpoint::fail(file,
                     fmt::format("is of a {}D run, the scene is {}D; {}", header.dimension, Dim, remedy));
  if (header.precision != precision)
    checkpoint::fail(file,
                     fmt::format("is of {} precision, the scene of {} precision; set precision = \"{}\"",
                                 name_of(header.precision), name_of(precision), name_of(header.precision)));
  std::vector<std::size_t> matches;
  for (const CheckpointBody& stored : header.bodies) matches.push_back(matching_body(file, stored, bodies));
  for (std::size_t b = 0; b < bodies.size(); ++b)
    if (std::count(matches.begin(), matches.end(), b) != 1)
      checkpoint::fail(file,
                       fmt::format("has no body \"{}\", which the scene has; {}", bodies[b].name, remedy));
  return matches;
}

// Rows of a file into the components of a column.
template <class Word>
void put_rows(const FieldSet& set, FieldId field, Index first, std::uint64_t count, const char* rows) {
  const std::uint64_t components = set.traits(field).components;
  for (std::uint64_t c = 0; c < components; ++c) {
    Word* out = static_cast<Word*>(set.raw(field, static_cast<int>(c))) + first;
    const char* in = rows + c * sizeof(Word);
    for (std::uint64_t i = 0; i < count; ++i) std::memcpy(&out[i], in + i * components * sizeof(Word), sizeof(Word));
  }
}

}  // namespace

template <int Dim>
CheckpointState read_checkpoint(const Communicator& communicator, const std::filesystem::path& file,
                                std::vector<Body<Dim>>& bodies, Precision precision) {
  const CheckpointHeader header = read_checkpoint_header(communicator, file);
  const std::vector<std::size_t> matches = matching_bodies(file, header, bodies, precision);
  for (std::size_t b = 0; b < header.bodies.size(); ++b) {
    const std::uint64_t share = header.bodies[b].particles / communicator.size() + 1;
    if (share > std::numeric_limits<Index>::max())
      checkpoint::fail(file, fmt::format("has {} particles in body \"{}\"; use more ranks",
                                         header.bodies[b].particles, header.bodies[b].name));
  }
  together(communicator, [&] {  // where memory may run out on one rank
    for (std::size_t b = 0; b < header.bodies.size(); ++b) {
      const Rows rows = rows_of_rank(communicator, header.bodies[b].particles);
      bodies[matches[b]].particles.resize(static_cast<Index>(rows.end - rows.begin));
    }
  });
  read_columns(communicator, file, header,
               [&](std::size_t b, const CheckpointColumn& column, std::uint64_t first, std::uint64_t count,
                   const char* rows) {
                 const FieldSet& set = bodies[matches[b]].particles;
                 const auto put = bytes_of(column.type) == 4 ? put_rows<std::uint32_t> : put_rows<std::uint64_t>;
                 put(set, set.find(column.name), static_cast<Index>(first), count, rows);
               });
  return header.state;
}

template CheckpointState read_checkpoint(const Communicator&, const std::filesystem::path&,
                                         std::vector<Body<2>>&, Precision);
template CheckpointState read_checkpoint(const Communicator&, const std::filesystem::path&,
                                         std::vector<Body<3>>&, Precision);

void verify_checkpoint(const Communicator& communicator, const std::filesystem::path& file) {
  const CheckpointHeader header = read_checkpoint_header(communicator, file);
  read_columns(communicator, file, header, [](auto&&...) {});
}

LatestCheckpoint latest_checkpoint(const Communicator& communicator, const std::filesystem::path& folder) {
  std::vector<checkpoint::File> files;
  on_root(communicator, [&] { files = checkpoint::list(folder); });
  LatestCheckpoint latest;
  for (int left = static_cast<int>(communicator.max(static_cast<GlobalIndex>(files.size()))); left > 0;
       --left) {
    std::string name = communicator.root() ? files[left - 1].path.string() : "";
    communicator.broadcast(name);
    try {
      verify_checkpoint(communicator, name);
      latest.file = name;
      break;
    } catch (const FileError& error) {
      latest.skipped.push_back(error.what());
    }
  }
  return latest;
}

}  // namespace mpm
