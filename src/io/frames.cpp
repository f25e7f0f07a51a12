#include "mpm_hpc/io/frames.hpp"

#include <mpi.h>

#include <algorithm>
#include <numeric>

#include "frame_columns.hpp"
#include "hdf5_writer.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

namespace {

// Particles converted at a time, whose rows stay in the cache; a multiple of every pack width.
constexpr Index piece_size = 1 << 13;
constexpr std::uint8_t vertex_cell = 1;  // VTK_VERTEX

// This rank's rows in the frame.
struct Partition {
  std::int64_t first = 0, rows = 0;
  std::vector<std::int64_t> rows_of_rank;
  std::int64_t total = 0;
};

template <int Dim>
Partition partition_of(const Communicator& communicator, const std::vector<Body<Dim>>& bodies) {
  Partition partition;
  for (const Body<Dim>& body : bodies) partition.rows += body.real_particles();
  partition.rows_of_rank.resize(communicator.size());
  MPI_Allgather(&partition.rows, 1, MPI_INT64_T, partition.rows_of_rank.data(), 1, MPI_INT64_T,
                mpi_comm(communicator));
  const auto begin = partition.rows_of_rank.begin();
  partition.first = std::accumulate(begin, begin + communicator.rank(), std::int64_t{0});
  partition.total = std::accumulate(begin, partition.rows_of_rank.end(), std::int64_t{0});
  return partition;
}

// Some particles [begin, end) of a body, and those of them that are no padding.
struct Piece {
  std::size_t body;
  Index begin, end;
  std::vector<Index> particles;
};

// Pieces without real particles are left out.
template <int Dim>
std::vector<Piece> pieces_of(const std::vector<Body<Dim>>& bodies) {
  std::vector<Piece> pieces;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const Index size = bodies[b].particles.size();
    for (Index begin = 0; begin < size; begin += piece_size) {
      Piece piece{b, begin, std::min(size - begin, piece_size) + begin, {}};
      piece.particles.reserve(static_cast<std::size_t>(piece.end - begin));
      for (Index p = begin; p < piece.end; ++p)
        if (!bodies[b].is_padding(p)) piece.particles.push_back(p);
      if (!piece.particles.empty()) pieces.push_back(std::move(piece));
    }
  }
  return pieces;
}

template <int Dim>
void write_column(Hdf5Writer& writer, Hdf5Writer::Dataset dataset, const FrameColumn& column,
                  const std::vector<Body<Dim>>& bodies, const std::vector<Piece>& pieces, std::int64_t row) {
  std::vector<char> rows;
  for (const auto& [body, begin, end, particles] : pieces) {
    try {
      fill_frame_rows(column, bodies, body, begin, end, particles, rows);
    } catch (...) {
      writer.keep_fault(std::current_exception());
    }
    writer.write(dataset, row, particles.size(), rows.data());
    row += static_cast<std::int64_t>(particles.size());
  }
  writer.close(dataset);
}

// Rows [first, first + rows) with the values value(0), value(1), ...
template <class T, class Value>
void write_series(Hdf5Writer& writer, Hdf5Writer::Dataset dataset, std::int64_t first, std::int64_t rows,
                  Value&& value) {
  std::vector<T> values;
  for (std::int64_t begin = 0; begin < rows; begin += piece_size) {
    values.resize(std::min<std::int64_t>(rows - begin, piece_size));
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = value(begin + static_cast<std::int64_t>(i));
    writer.write(dataset, first + begin, values.size(), values.data());
  }
  writer.close(dataset);
}

}  // namespace

template <int Dim>
FrameWriter<Dim>::FrameWriter(const Communicator& communicator, std::filesystem::path folder,
                              FrameOptions options)
    : communicator_(communicator), folder_(std::move(folder)), options_(std::move(options)) {
  std::int64_t count = 0;
  on_root(communicator_, [&] {
    frames_ = read_frame_series(folder_);
    count = static_cast<std::int64_t>(frames_.size());
  });
  MPI_Bcast(&count, 1, MPI_INT64_T, 0, mpi_comm(communicator_));
  frames_.resize(count);
  for (FrameEntry& frame : frames_) {
    communicator_.broadcast(frame.name);
    MPI_Bcast(&frame.time, 1, MPI_DOUBLE, 0, mpi_comm(communicator_));
  }
}

template <int Dim>
void FrameWriter<Dim>::check_fields(const FrameOptions& options, const std::vector<Body<Dim>>& bodies,
                                    const std::vector<DerivedField>& derived) {
  frame_columns(bodies, derived, options);
}

template <int Dim>
void FrameWriter<Dim>::write(GlobalIndex step, Real time, const std::vector<Body<Dim>>& bodies,
                             const std::vector<DerivedField>& derived) {
  const std::vector<FrameColumn> columns = frame_columns(bodies, derived, options_);
  const FrameColumn position = position_column(bodies);
  const Partition partition = partition_of(communicator_, bodies);
  const int ranks = communicator_.size(), deflate = options_.deflate;
  const bool replaces = !frames_.empty() && frames_.back().time == time;
  const std::string name = replaces ? frames_.back().name : next_name();

  Hdf5Writer writer(communicator_, folder_ / name);
  const std::string group = "VTKHDF/";
  const auto points = writer.add(group + "Points", position.type, partition.total, 3, deflate);
  const auto connectivity = writer.add(group + "Connectivity", FileType::int64, partition.total, 0, deflate);
  const auto offsets = writer.add(group + "Offsets", FileType::int64, partition.total + ranks, 0, deflate);
  const auto types = writer.add(group + "Types", FileType::uint8, partition.total, 0, deflate);
  const auto body_numbers =
      writer.add(group + "PointData/body", FileType::int32, partition.total, 0, deflate);
  std::vector<Hdf5Writer::Dataset> datasets;
  for (const FrameColumn& column : columns)
    datasets.push_back(writer.add(group + "PointData/" + column.name, column.type, partition.total,
                                  column.components == 1 ? 0 : column.components, deflate));
  writer.lay_out([&](Hdf5Image& image) {
    const Hdf5Id root = image.make_group("VTKHDF");
    image.set_attribute(root, "Version", std::vector<std::int64_t>{1, 0});
    image.set_attribute(root, "Type", std::string("UnstructuredGrid"));
    // Made by name: groups that HDF5 makes on its own way carry the time of day, and equal runs would differ
    // in bytes.
    for (const char* folder : {"PointData", "FieldData"}) image.make_group(group + folder);
    for (const char* count : {"NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds"})
      image.make_dataset<std::int64_t>(group + count, partition.rows_of_rank);
    image.make_dataset<double>(group + "FieldData/TimeValue", std::span(&time, 1));
    image.make_dataset<std::int64_t>(group + "FieldData/step", std::span(&step, 1));
  });

  const std::vector<Piece> pieces = pieces_of(bodies);
  write_column(writer, points, position, bodies, pieces, partition.first);
  write_series<std::int64_t>(writer, connectivity, partition.first, partition.rows, [](auto i) { return i; });
  write_series<std::int64_t>(writer, offsets, partition.first + communicator_.rank(), partition.rows + 1,
                             [](auto i) { return i; });
  write_series<std::uint8_t>(writer, types, partition.first, partition.rows,
                             [](auto) { return vertex_cell; });
  std::int64_t row = partition.first;
  for (const Piece& piece : pieces) {
    const std::vector<std::int32_t> numbers(piece.particles.size(), static_cast<std::int32_t>(piece.body));
    writer.write(body_numbers, row, numbers.size(), numbers.data());
    row += static_cast<std::int64_t>(numbers.size());
  }
  writer.close(body_numbers);
  for (std::size_t c = 0; c < columns.size(); ++c)
    write_column(writer, datasets[c], columns[c], bodies, pieces, partition.first);
  writer.commit(
      [&](Hdf5Image& image) {
        image.set_attribute(image.open(group + "Points"), "units", position.units);
        for (const FrameColumn& column : columns)
          if (!column.units.empty())
            image.set_attribute(image.open(group + "PointData/" + column.name), "units", column.units);
      },
      false);

  if (replaces) return;
  frames_.push_back({name, time});
  on_root(communicator_, [&] { write_frame_series(folder_, frames_); });
}

template <int Dim>
std::string FrameWriter<Dim>::next_name() const {
  int number = 0;
  for (const FrameEntry& frame : frames_) {
    int used = -1;
    if (std::sscanf(frame.name.c_str(), "frame_%d.hdf", &used) == 1) number = std::max(number, used + 1);
  }
  return frame_name(number);
}

template class FrameWriter<2>;
template class FrameWriter<3>;

}  // namespace mpm
