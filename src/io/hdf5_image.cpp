#include "hdf5_image.hpp"

#include <algorithm>
#include <cstring>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

namespace {

// The driver's view of an open file; HDF5 wants its own part first.
struct ImageFile {
  H5FD_t base{};
  Hdf5Image::Bytes* bytes = nullptr;
};

Hdf5Image::Bytes& bytes_of_file(const H5FD_t* file) {
  return *reinterpret_cast<const ImageFile*>(file)->bytes;
}

H5FD_t* open_image(const char*, unsigned, hid_t access, haddr_t) {
  const auto* bytes = static_cast<Hdf5Image::Bytes* const*>(H5Pget_driver_info(access));
  return bytes ? &(new (std::nothrow) ImageFile{{}, *bytes})->base : nullptr;
}
herr_t close_image(H5FD_t* file) {
  delete reinterpret_cast<ImageFile*>(file);
  return 0;
}
herr_t query_image(const H5FD_t*, unsigned long* flags) {
  *flags = H5FD_FEAT_AGGREGATE_METADATA | H5FD_FEAT_AGGREGATE_SMALLDATA | H5FD_FEAT_IGNORE_DRVRINFO |
           H5FD_FEAT_DEFAULT_VFD_COMPATIBLE;
  return 0;
}
haddr_t end_of_image(const H5FD_t* file, H5FD_mem_t) { return bytes_of_file(file).end; }
herr_t set_end_of_image(H5FD_t* file, H5FD_mem_t, haddr_t end) {
  bytes_of_file(file).end = end;
  return 0;
}
herr_t read_image(H5FD_t* file, H5FD_mem_t, hid_t, haddr_t place, size_t size, void* data) {
  bytes_of_file(file).get(place, static_cast<char*>(data), size);
  return 0;
}
herr_t write_image(H5FD_t* file, H5FD_mem_t type, hid_t, haddr_t place, size_t size, const void* data) {
  Hdf5Image::Bytes& bytes = bytes_of_file(file);
  if (type == H5FD_MEM_DRAW && bytes.discard_bulk) return 0;
  try {
    bytes.put(place, static_cast<const char*>(data), size);
  } catch (const std::bad_alloc&) {
    return -1;
  }
  return 0;
}

hid_t image_driver() {
  static const hid_t driver = [] {
    static H5FD_class_t table{};
#ifdef H5FD_CLASS_VERSION  // HDF5 1.14
    table.version = H5FD_CLASS_VERSION;
    table.value = static_cast<H5FD_class_value_t>(600);
#endif
    table.name = "mpm_image";
    table.maxaddr = (haddr_t{1} << 62) - 1;
    table.fc_degree = H5F_CLOSE_STRONG;
    table.fapl_size = sizeof(Hdf5Image::Bytes*);
    table.open = open_image;
    table.close = close_image;
    table.query = query_image;
    table.get_eoa = end_of_image;
    table.set_eoa = set_end_of_image;
    table.get_eof = end_of_image;
    table.read = read_image;
    table.write = write_image;
    return H5FDregister(&table);
  }();
  return driver;
}

void check(bool ok, const std::string& doing) {
  if (!ok) throw FileError(fmt::format("HDF5 can't {} (out of memory?)", doing));
}

Hdf5Id checked(hid_t id, Hdf5Id::Close close, const std::string& doing) {
  check(id >= 0, doing);
  return Hdf5Id(id, close);
}

Hdf5Id space_of(std::uint64_t rows, int components) {
  const hsize_t extent[2] = {rows, static_cast<hsize_t>(components)};
  return checked(H5Screate_simple(components == 0 ? 1 : 2, extent, nullptr), H5Sclose, "make a dataspace");
}

// Without times of change, so that equal runs give equal files.
Hdf5Id properties_of(hid_t kind) {
  Hdf5Id properties = checked(H5Pcreate(kind), H5Pclose, "make a property list");
  check(H5Pset_obj_track_times(properties, false) >= 0, "make a property list");
  return properties;
}

Hdf5Id text_type(const std::string& text) {
  Hdf5Id type = checked(H5Tcopy(H5T_C_S1), H5Tclose, "make a type");
  check(H5Tset_size(type, std::max<std::size_t>(text.size(), 1)) >= 0 &&
            H5Tset_strpad(type, H5T_STR_NULLPAD) >= 0,
        "make a type");
  return type;
}

}  // namespace

void Hdf5Image::Bytes::put(std::uint64_t place, const char* data, std::size_t size) {
  std::uint64_t begin = place, stop = place + size;
  auto first = pieces.upper_bound(place);
  if (first != pieces.begin() && std::prev(first)->first + std::prev(first)->second.size() > place) --first;
  auto last = first;
  for (; last != pieces.end() && last->first < stop; ++last) {
    begin = std::min(begin, last->first);
    stop = std::max(stop, last->first + last->second.size());
  }
  std::vector<char> merged(stop - begin);
  for (auto piece = first; piece != last; ++piece)
    std::memcpy(&merged[piece->first - begin], piece->second.data(), piece->second.size());
  std::memcpy(merged.data() + (place - begin), data, size);
  pieces.erase(first, last);
  pieces.emplace(begin, std::move(merged));
}

void Hdf5Image::Bytes::get(std::uint64_t place, char* data, std::size_t size) const {
  std::memset(data, 0, size);
  auto piece = pieces.upper_bound(place);
  if (piece != pieces.begin()) --piece;
  for (; piece != pieces.end() && piece->first < place + size; ++piece) {
    const std::uint64_t begin = std::max(place, piece->first);
    const std::uint64_t stop = std::min(place + size, piece->first + piece->second.size());
    if (begin < stop) std::memcpy(data + (begin - place), &piece->second[begin - piece->first], stop - begin);
  }
}

Hdf5Image::Hdf5Image() {
  silence_hdf5();
  const Hdf5Id access = checked(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "make a property list");
  const Hdf5Id creation = properties_of(H5P_FILE_CREATE);
  Bytes* bytes = &bytes_;
  // The format of 1.8 checks its own metadata, and every reader of today knows it. Big datasets begin on a
  // page.
  check(H5Pset_driver(access, image_driver(), &bytes) >= 0 &&
            H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_V18) >= 0 &&
            H5Pset_alignment(access, 1 << 16, 4096) >= 0 && H5Pset_attr_phase_change(creation, 64, 48) >= 0,
        "make a property list");
  links_ = checked(H5Pcreate(H5P_LINK_CREATE), H5Pclose, "make a property list");
  check(H5Pset_create_intermediate_group(links_, 1) >= 0, "make a property list");
  file_ = checked(H5Fcreate("image", H5F_ACC_TRUNC, creation, access), H5Fclose, "lay out a file");
}

Hdf5Image::~Hdf5Image() = default;

Hdf5Id Hdf5Image::make_group(const std::string& path) {
  return checked(H5Gcreate2(file_, path.c_str(), links_, properties_of(H5P_GROUP_CREATE), H5P_DEFAULT),
                 H5Gclose, "make group " + path);
}

Hdf5Id Hdf5Image::open(const std::string& path) {
  return checked(H5Oopen(file_, path.c_str(), H5P_DEFAULT), H5Oclose, "open " + path);
}

void Hdf5Image::set_attribute(hid_t object, const std::string& name, FileType type, const void* data,
                              const std::size_t* count) {
  const hsize_t extent = count ? *count : 1;
  const Hdf5Id space = checked(count ? H5Screate_simple(1, &extent, nullptr) : H5Screate(H5S_SCALAR),
                               H5Sclose, "make a dataspace");
  const Hdf5Id attribute =
      checked(H5Acreate2(object, name.c_str(), hdf5_type(type), space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
              "make attribute " + name);
  check(H5Awrite(attribute, hdf5_type(type), data) >= 0, "set attribute " + name);
}

void Hdf5Image::set_attribute(hid_t object, const std::string& name,
                              const std::vector<std::int64_t>& values) {
  const std::size_t count = values.size();
  set_attribute(object, name, FileType::int64, values.data(), &count);
}

void Hdf5Image::set_attribute(hid_t object, const std::string& name, const std::string& text) {
  const Hdf5Id type = text_type(text);
  const Hdf5Id space = checked(H5Screate(H5S_SCALAR), H5Sclose, "make a dataspace");
  const Hdf5Id attribute = checked(H5Acreate2(object, name.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT),
                                   H5Aclose, "make attribute " + name);
  check(H5Awrite(attribute, type, text.c_str()) >= 0, "set attribute " + name);
}

Hdf5Id Hdf5Image::create(const std::string& path, hid_t type, hid_t space, hid_t properties) {
  return checked(H5Dcreate2(file_, path.c_str(), type, space, links_, properties, H5P_DEFAULT), H5Dclose,
                 "make dataset " + path);
}

Hdf5Id Hdf5Image::make_dataset(const std::string& path, FileType type, const void* data, std::size_t count) {
  Hdf5Id dataset = create(path, hdf5_type(type), space_of(count, 0), properties_of(H5P_DATASET_CREATE));
  if (count > 0)
    check(H5Dwrite(dataset, hdf5_type(type), H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0,
          "fill dataset " + path);
  return dataset;
}

Hdf5Id Hdf5Image::make_text_dataset(const std::string& path, const std::string& text) {
  const Hdf5Id type = text_type(text);
  check(H5Tset_cset(type, H5T_CSET_UTF8) >= 0, "make a type");
  const Hdf5Id space = checked(H5Screate(H5S_SCALAR), H5Sclose, "make a dataspace");
  Hdf5Id dataset = create(path, type, space, properties_of(H5P_DATASET_CREATE));
  check(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text.c_str()) >= 0, "fill dataset " + path);
  return dataset;
}

Hdf5Id Hdf5Image::reserve_dataset(const std::string& path, FileType type, std::uint64_t rows,
                                  int components) {
  const Hdf5Id properties = properties_of(H5P_DATASET_CREATE);
  check(H5Pset_layout(properties, H5D_CONTIGUOUS) >= 0 &&
            H5Pset_alloc_time(properties, H5D_ALLOC_TIME_EARLY) >= 0 &&
            H5Pset_fill_time(properties, H5D_FILL_TIME_NEVER) >= 0,
        "make a property list");
  return create(path, hdf5_type(type), space_of(rows, components), properties);
}

std::uint64_t Hdf5Image::place(hid_t dataset) {
  const haddr_t place = H5Dget_offset(dataset);
  return place == HADDR_UNDEF ? 0 : place;
}

Hdf5Id Hdf5Image::make_chunked_dataset(const std::string& path, FileType type, std::uint64_t rows,
                                       int components, std::uint64_t rows_per_chunk, int deflate) {
  const Hdf5Id properties = properties_of(H5P_DATASET_CREATE);
  const hsize_t chunk[2] = {rows_per_chunk, static_cast<hsize_t>(components)};
  check(H5Pset_chunk(properties, components == 0 ? 1 : 2, chunk) >= 0 && H5Pset_shuffle(properties) >= 0 &&
            H5Pset_deflate(properties, static_cast<unsigned>(deflate)) >= 0 &&
            H5Pset_fill_time(properties, H5D_FILL_TIME_NEVER) >= 0,
        "make a property list");
  return create(path, hdf5_type(type), space_of(rows, components), properties);
}

std::uint64_t Hdf5Image::reserve_chunk(hid_t dataset, std::uint64_t first_row, std::size_t bytes,
                                       std::uint32_t skipped_filters) {
  const hsize_t corner[2] = {first_row, 0};
  scratch_.resize(std::max(scratch_.size(), bytes));
  bytes_.discard_bulk = true;
  const herr_t written =
      H5Dwrite_chunk(dataset, H5P_DEFAULT, skipped_filters, corner, bytes, scratch_.data());
  bytes_.discard_bulk = false;
  haddr_t place = HADDR_UNDEF;
  hsize_t size = 0;
  unsigned filters = 0;
  check(written >= 0 && H5Dget_chunk_info_by_coord(dataset, corner, &filters, &place, &size) >= 0 &&
            place != HADDR_UNDEF && size == bytes,
        "place a chunk");
  return place;
}

const Hdf5Image::Bytes& Hdf5Image::finish() {
  const hid_t file = file_;
  check(H5Fflush(file, H5F_SCOPE_GLOBAL) >= 0, "lay out a file");
  file_ = Hdf5Id();
  return bytes_;
}

}  // namespace mpm
