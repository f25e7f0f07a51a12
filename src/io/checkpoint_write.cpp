#include <mpi.h>

#include <algorithm>
#include <charconv>
#include <cstring>

#include "checkpoint_files.hpp"
#include "checksum.hpp"
#include "hdf5_writer.hpp"
#include "id_slices.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/checkpoint.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

std::string checkpoint_name(GlobalIndex step) { return fmt::format("checkpoint_{:09d}.h5", step); }

std::vector<checkpoint::File> checkpoint::list(const std::filesystem::path& folder) {
  constexpr std::string_view beginning = "checkpoint_", ending = ".h5";
  std::vector<File> files;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(beginning) || !name.ends_with(ending)) continue;
    const char* first = name.data() + beginning.size();
    const char* last = name.data() + name.size() - ending.size();
    File file{0, entry.path()};
    const auto [end, error] = std::from_chars(first, last, file.step);
    if (error == std::errc() && end == last && name == checkpoint_name(file.step)) files.push_back(file);
  }
  std::sort(files.begin(), files.end(), [](const File& a, const File& b) { return a.step < b.step; });
  return files;
}

namespace {

// A bulk dataset and this rank's part of its checksum.
struct Column {
  FieldId field;
  Hdf5Writer::Dataset dataset;
  std::uint64_t checksum = 0;
};

template <class T>
void make_checked_dataset(Hdf5Image& image, const std::string& path, const std::vector<T>& values) {
  const Hdf5Id dataset = image.make_dataset<T>(path, values);
  image.set_attribute(dataset, "checksum", checksum(values.data(), values.size(), sizeof(T), 0));
}

void lay_out_state(Hdf5Image& image, const CheckpointState& state) {
  const Hdf5Id scene = image.make_text_dataset(checkpoint::scene_path, state.scene_text);
  image.set_attribute(scene, "checksum", checksum(state.scene_text.data(), state.scene_text.size(), 1, 0));
  make_checked_dataset(image, checkpoint::owners_path, state.owners);
  make_checked_dataset(image, checkpoint::curve_cuts_path, state.curve_cuts);
  image.make_group(checkpoint::numbers_group);
  for (const auto& [name, values] : state.numbers) {
    debug_check(!name.empty() && name.find('/') == std::string::npos,
                "a number's name in a checkpoint has a slash");
    make_checked_dataset(image, std::string(checkpoint::numbers_group) + "/" + name, values);
  }
}

// Elements of rows [begin, end) of one column, `offset` bytes into each packed particle.
template <class Word>
void gather_rows(const IdSlices::Piece& piece, std::size_t begin, std::size_t end, std::size_t offset,
                 std::size_t components, char* to) {
  for (std::size_t i = begin; i < end; ++i)
    for (std::size_t c = 0; c < components; ++c, to += sizeof(Word))
      std::memcpy(to, piece.rows[i].second + offset + c * sizeof(Word), sizeof(Word));
}

// One round's rows of every column; `rows` is scratch.
void write_piece(Hdf5Writer& writer, const FieldSet& set, const IdSlices::Piece& piece,
                 std::vector<Column>& columns, std::vector<std::vector<char>>& rows) {
  const std::size_t size = piece.rows.size();
  const auto bytes_in_row = [&](FieldId f) {
    return static_cast<std::size_t>(bytes_of(set.traits(f).type)) * set.traits(f).components;
  };
  for (FieldId f = 0; f < set.count(); ++f) rows[f].resize(size * bytes_in_row(f));
  // All columns of few particles at a time: packed particles are far apart in memory, so touch them once.
  constexpr std::size_t block = 256;
  for (std::size_t begin = 0; begin < size; begin += block) {
    std::size_t offset = 0;
    for (FieldId f = 0; f < set.count(); ++f) {
      const auto gather =
          bytes_of(set.traits(f).type) == 4 ? gather_rows<std::uint32_t> : gather_rows<std::uint64_t>;
      gather(piece, begin, std::min(begin + block, size), offset, set.traits(f).components,
             rows[f].data() + begin * bytes_in_row(f));
      offset += bytes_in_row(f);
    }
  }
  for (Column& column : columns) {
    const FieldTraits& traits = set.traits(column.field);
    const std::vector<char>& values = rows[column.field];
    writer.write(column.dataset, piece.first_row, size, values.data());
    column.checksum += checksum(values.data(), size * traits.components, bytes_of(traits.type),
                                piece.first_row * traits.components);
  }
}

// What is neither the file of this step nor the newest earlier one goes, and so do leftovers of killed runs.
void remove_superseded(const std::filesystem::path& folder, GlobalIndex step) {
  std::vector<checkpoint::File> files = checkpoint::list(folder);
  GlobalIndex previous = -1;
  for (const auto& file : files)
    if (file.step < step) previous = std::max(previous, file.step);
  std::error_code ignored;
  for (const auto& file : files)
    if (file.step != step && file.step != previous) std::filesystem::remove(file.path, ignored);
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("checkpoint_") && name.ends_with(std::string(".h5") + temporary_ending))
      std::filesystem::remove(entry.path(), ignored);
  }
}

}  // namespace

template <int Dim>
std::filesystem::path write_checkpoint(const Communicator& communicator, const std::filesystem::path& folder,
                                       const CheckpointState& state, const std::vector<Body<Dim>>& bodies,
                                       Precision precision) {
  std::vector<IdSlices> slices;
  for (const Body<Dim>& body : bodies) slices.emplace_back(communicator, body.particles, core::id);

  const std::filesystem::path file = folder / checkpoint_name(state.step);
  Hdf5Writer writer(communicator, file);
  std::vector<std::vector<Column>> columns(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const FieldSet& set = bodies[b].particles;
    for (FieldId f = 0; f < set.count(); ++f)
      if (set.has(f))
        columns[b].push_back(
            {f, writer.add(checkpoint::column_path(b, set.traits(f).name), file_type(set.traits(f).type),
                           slices[b].total(), set.traits(f).components)});
  }
  writer.lay_out([&](Hdf5Image& image) {
    const Hdf5Id root = image.open("/");
    image.set_attribute(root, "format", std::string(checkpoint::format_name));
    image.set_attribute(root, "format_version", std::int64_t{checkpoint_format});
    image.set_attribute(root, "code_version", state.code_version);
    image.set_attribute(root, "dimension", std::int64_t{Dim});
    image.set_attribute(root, "precision",
                        std::string(precision == Precision::single_precision ? "single" : "double"));
    image.set_attribute(root, "ranks", std::int64_t{communicator.size()});
    image.set_attribute(root, "step", state.step);
    image.set_attribute(root, "time", state.time);
    image.set_attribute(root, "dt", state.dt);
    lay_out_state(image, state);
    image.make_group(checkpoint::bodies_group);
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      const Hdf5Id group = image.make_group(checkpoint::body_path(b));
      image.set_attribute(group, "name", bodies[b].name);
      image.set_attribute(group, "particles", static_cast<std::int64_t>(slices[b].total()));
    }
  });

  std::vector<std::uint64_t> checksums;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    std::vector<std::vector<char>> scratch(bodies[b].particles.count());
    for (int round = 0; round < slices[b].rounds(); ++round)
      write_piece(writer, bodies[b].particles, slices[b].piece(round), columns[b], scratch);
    for (const Column& column : columns[b]) checksums.push_back(column.checksum);
  }
  MPI_Allreduce(MPI_IN_PLACE, checksums.data(), static_cast<int>(checksums.size()), MPI_UINT64_T, MPI_SUM,
                mpi_comm(communicator));
  writer.commit(
      [&](Hdf5Image& image) {
        std::size_t next = 0;
        for (std::size_t b = 0; b < bodies.size(); ++b)
          for (const Column& column : columns[b]) {
            const FieldTraits& traits = bodies[b].particles.traits(column.field);
            const Hdf5Id dataset = image.open(checkpoint::column_path(b, traits.name));
            image.set_attribute(dataset, "units", traits.units);
            image.set_attribute(dataset, "checksum", checksums[next++]);
          }
        image.set_attribute(image.open("/"), "complete", std::int64_t{1});
      },
      true);
  if (communicator.root()) {
    try {
      remove_superseded(folder, state.step);
    } catch (const std::filesystem::filesystem_error&) {
      // A checkpoint too many harms nobody.
    }
  }
  return file;
}

template std::filesystem::path write_checkpoint(const Communicator&, const std::filesystem::path&,
                                                const CheckpointState&, const std::vector<Body<2>>&,
                                                Precision);
template std::filesystem::path write_checkpoint(const Communicator&, const std::filesystem::path&,
                                                const CheckpointState&, const std::vector<Body<3>>&,
                                                Precision);

}  // namespace mpm
