#include "checkpoint_header.hpp"

#include <fcntl.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "checkpoint_files.hpp"
#include "checksum.hpp"
#include "file_descriptor.hpp"
#include "hdf5_source.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/together.hpp"

namespace mpm {

void checkpoint::fail(const std::filesystem::path& file, const std::string& fault) {
  throw FileError(fmt::format("checkpoint {} {}.", file.string(), fault));
}

void checkpoint::fail_damaged(const std::filesystem::path& file, const std::string& detail) {
  fail(file, "is damaged (" + detail + "); restart from the checkpoint before it or from a copy");
}

namespace {

using checkpoint::fail;
using checkpoint::fail_damaged;

// What HDF5 says about a file that it can't open is of no use to anybody: find out ourselves what is wrong.
void check_container(const std::filesystem::path& file) {
  std::error_code error;
  const auto status = std::filesystem::status(file, error);
  if (status.type() == std::filesystem::file_type::not_found)
    fail(file, "does not exist; give the path of a checkpoint_*.h5 of an output folder");
  if (status.type() != std::filesystem::file_type::regular)
    fail(file, "is no regular file; give the path of a checkpoint_*.h5 of an output folder");

  const FileDescriptor descriptor(file, O_RDONLY);
  const std::uint64_t size = descriptor.size();
  if (size == 0) fail(file, "is empty; restart from the checkpoint before it or from a copy");
  // Superblock version 2 or 3 (HDF5 File Format Specification 3.0, section II.A): signature, version, sizes
  // of offsets and lengths, flags, then base address, extension and end of file.
  unsigned char superblock[36] = {};
  descriptor.read(0, superblock, std::min<std::uint64_t>(size, sizeof(superblock)));
  constexpr unsigned char signature[8] = {0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};
  if (std::memcmp(superblock, signature, std::min<std::uint64_t>(size, sizeof(signature))) != 0)
    fail(file, "is no HDF5 file; give the path of a checkpoint_*.h5 of an output folder");
  std::uint64_t end = size < sizeof(superblock) ? sizeof(superblock) : 0;
  if (size >= sizeof(superblock) && (superblock[8] == 2 || superblock[8] == 3) && superblock[9] == 8)
    std::memcpy(&end, superblock + 28, sizeof(end));
  if (size < end)
    fail(file,
         fmt::format("is cut short ({} of {} bytes); restart from the checkpoint before it or from a copy",
                     size, end));
}

template <class T>
T need(const std::filesystem::path& file, std::optional<T> value, const std::string& what) {
  if (!value) fail_damaged(file, what + " can't be read");
  return std::move(*value);
}

template <class T>
void check_sum(const std::filesystem::path& file, const Hdf5Source& source, const std::string& path,
               const T& values) {
  const std::uint64_t sum = checksum(values.data(), values.size(), sizeof(values[0]), 0);
  if (need(file, source.checksum(path), "the checksum of " + path) != sum)
    fail_damaged(file, "the checksum of " + path + " is wrong");
}

template <class T>
std::vector<T> checked_values(const std::filesystem::path& file, const Hdf5Source& source,
                              const std::string& path) {
  std::vector<T> values = need(file, source.values<T>(path), path);
  check_sum(file, source, path, values);
  return values;
}

void check_kind(const std::filesystem::path& file, const Hdf5Source& source) {
  if (source.text("/", "format").value_or("") != checkpoint::format_name)
    fail(file,
         "is an HDF5 file, but no checkpoint of mpm_hpc; give the path of a checkpoint_*.h5 of an output "
         "folder");
  const std::int64_t version = need(file, source.integer("/", "format_version"), "the format's version");
  if (version > checkpoint_format)
    fail(file,
         fmt::format(
             "was written by a newer version of mpm_hpc (format {}, code {}), this one reads formats up "
             "to {}; restart with that version or a newer one",
             version, source.text("/", "code_version").value_or("unknown"), checkpoint_format));
  if (version < 1) fail_damaged(file, "the format's version is not positive");
  if (source.integer("/", "complete") != 1)
    fail(file, "was never completed; restart from the checkpoint before it");
}

CheckpointColumn parse_column(const std::filesystem::path& file, const Hdf5Source& source,
                              const std::string& path, const CheckpointBody& body, const std::string& name,
                              std::uint64_t file_size) {
  const std::string what = fmt::format("column \"{}\" of body \"{}\"", name, body.name);
  CheckpointColumn column{.name = name};
  const Hdf5Id dataset = source.dataset(path);
  if (!dataset.valid()) fail_damaged(file, what + " can't be read");
  const std::vector<std::uint64_t> extent = Hdf5Source::extent(dataset);
  const ScalarType types[] = {ScalarType::float32, ScalarType::float64, ScalarType::int64};
  const auto type = std::find_if(std::begin(types), std::end(types),
                                 [&](ScalarType t) { return Hdf5Source::has_type(dataset, file_type(t)); });
  if (extent.size() != 2 || extent[0] != static_cast<std::uint64_t>(body.particles) || extent[1] < 1 ||
      extent[1] > std::numeric_limits<int>::max() || type == std::end(types))
    fail_damaged(file, what + " has the wrong shape or type");
  column.type = *type;
  column.components = static_cast<int>(extent[1]);
  column.checksum = need(file, source.checksum(path), "the checksum of " + what);
  if (body.particles == 0) return column;
  column.place = need(file, Hdf5Source::contiguous_place(dataset), what + " (repacked?)");
  const std::uint64_t row_bytes = extent[1] * bytes_of(column.type);
  if (column.place > file_size || extent[0] > (file_size - column.place) / row_bytes)
    fail_damaged(file, what + " reaches beyond the file's end");
  return column;
}

}  // namespace

CheckpointHeader checkpoint::parse_header(const std::filesystem::path& file) {
  check_container(file);
  const Hdf5Source source(file);
  if (!source.valid()) fail_damaged(file, "HDF5 can't open it");
  check_kind(file, source);

  CheckpointHeader header;
  const std::int64_t dimension = need(file, source.integer("/", "dimension"), "the dimension");
  const std::string precision = need(file, source.text("/", "precision"), "the precision");
  if ((dimension != 2 && dimension != 3) || (precision != "single" && precision != "double"))
    fail_damaged(file, "dimension or precision is unknown");
  header.dimension = static_cast<int>(dimension);
  header.precision = precision == "single" ? Precision::single_precision : Precision::double_precision;

  CheckpointState& state = header.state;
  state.step = need(file, source.integer("/", "step"), "the step");
  state.time = need(file, source.real("/", "time"), "the time");
  state.dt = need(file, source.real("/", "dt"), "the time step");
  state.ranks = static_cast<int>(need(file, source.integer("/", "ranks"), "the number of ranks"));
  state.code_version = need(file, source.text("/", "code_version"), "the code's version");
  state.scene_text = need(file, source.text_dataset(scene_path), "the scene");
  check_sum(file, source, scene_path, state.scene_text);
  state.owners = checked_values<std::int32_t>(file, source, owners_path);
  if (const auto paths = need(file, source.names("/"), "the list of its parts");
      std::find(paths.begin(), paths.end(), curve_cuts_path) != paths.end())
    state.curve_cuts = checked_values<GlobalIndex>(file, source, curve_cuts_path);
  for (const std::string& name : need(file, source.names(numbers_group), "the list of numbers"))
    state.numbers[name] = checked_values<Real>(file, source, std::string(numbers_group) + "/" + name);

  const std::uint64_t file_size = std::filesystem::file_size(file);
  const std::size_t bodies = need(file, source.names(bodies_group), "the list of bodies").size();
  for (std::size_t b = 0; b < bodies; ++b) {
    CheckpointBody body;
    body.name = need(file, source.text(body_path(b), "name"), fmt::format("the name of body {}", b));
    body.particles =
        need(file, source.integer(body_path(b), "particles"), fmt::format("the size of body {}", b));
    for (const std::string& name :
         need(file, source.names(body_path(b)), fmt::format("the list of columns of body {}", b)))
      body.columns.push_back(parse_column(file, source, column_path(b, name), body, name, file_size));
    header.bodies.push_back(std::move(body));
  }
  return header;
}

namespace {

using Json = nlohmann::json;

Json to_json(const CheckpointHeader& header) {
  const CheckpointState& s = header.state;
  Json bodies = Json::array();
  for (const CheckpointBody& body : header.bodies) {
    Json columns = Json::array();
    for (const CheckpointColumn& c : body.columns)
      columns.push_back({c.name, static_cast<int>(c.type), c.components, c.place, c.checksum});
    bodies.push_back({body.name, body.particles, columns});
  }
  return {header.dimension, static_cast<int>(header.precision),
          bodies,           s.step,
          s.time,           s.dt,
          s.ranks,          s.code_version,
          s.scene_text,     s.numbers,
          s.curve_cuts};
}

CheckpointHeader from_json(const Json& json) {
  CheckpointHeader header;
  header.dimension = json[0];
  header.precision = static_cast<Precision>(json[1].get<int>());
  for (const Json& b : json[2]) {
    CheckpointBody body{b[0], b[1], {}};
    for (const Json& c : b[2])
      body.columns.push_back({c[0], static_cast<ScalarType>(c[1].get<int>()), c[2], c[3], c[4]});
    header.bodies.push_back(std::move(body));
  }
  CheckpointState& s = header.state;
  s.step = json[3];
  s.time = json[4];
  s.dt = json[5];
  s.ranks = json[6];
  s.code_version = json[7];
  s.scene_text = json[8];
  s.numbers = json[9].get<std::map<std::string, std::vector<Real>>>();
  s.curve_cuts = json[10].get<std::vector<GlobalIndex>>();
  return header;
}

}  // namespace

CheckpointHeader read_checkpoint_header(const Communicator& communicator, const std::filesystem::path& file) {
  CheckpointHeader header;
  Communicator::Bytes description, owners;
  on_root(communicator, [&] {
    header = checkpoint::parse_header(file);
    const std::vector<std::uint8_t> binary = Json::to_cbor(to_json(header));
    description.assign(binary.begin(), binary.end());
    const char* begin = reinterpret_cast<const char*>(header.state.owners.data());
    owners.assign(begin, begin + header.state.owners.size() * sizeof(std::int32_t));
  });
  communicator.broadcast(description);
  communicator.broadcast(owners);
  if (communicator.root()) return header;
  header = from_json(Json::from_cbor(description));
  header.state.owners.resize(owners.size() / sizeof(std::int32_t));
  if (!owners.empty()) std::memcpy(header.state.owners.data(), owners.data(), owners.size());
  return header;
}

}  // namespace mpm
