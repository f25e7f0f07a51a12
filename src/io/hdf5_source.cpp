#include "hdf5_source.hpp"

namespace mpm {

Hdf5Source::Hdf5Source(const std::filesystem::path& file) {
  silence_hdf5();
  const Hdf5Id access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access, false, true);
  H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
  file_ = Hdf5Id(H5Fopen(file.c_str(), H5F_ACC_RDONLY, access), H5Fclose);
}

Hdf5Id Hdf5Source::attribute(const std::string& object, const std::string& name) const {
  const Hdf5Id owner(H5Oopen(file_, object.c_str(), H5P_DEFAULT), H5Oclose);
  if (!owner.valid() || H5Aexists(owner, name.c_str()) <= 0) return {};
  return Hdf5Id(H5Aopen(owner, name.c_str(), H5P_DEFAULT), H5Aclose);
}

template <class T>
std::optional<T> Hdf5Source::number(const std::string& object, const std::string& name, H5T_class_t kind,
                                    hid_t type) const {
  const Hdf5Id source = attribute(object, name);
  if (!source.valid()) return {};
  const Hdf5Id stored(H5Aget_type(source), H5Tclose);
  const Hdf5Id space(H5Aget_space(source), H5Sclose);
  T value{};
  if (H5Tget_class(stored) != kind || H5Sget_simple_extent_npoints(space) != 1 ||
      H5Aread(source, type, &value) < 0)
    return {};
  return value;
}

std::optional<std::int64_t> Hdf5Source::integer(const std::string& object,
                                                const std::string& attribute) const {
  return number<std::int64_t>(object, attribute, H5T_INTEGER, H5T_NATIVE_INT64);
}
std::optional<std::uint64_t> Hdf5Source::checksum(const std::string& object) const {
  return number<std::uint64_t>(object, "checksum", H5T_INTEGER, H5T_NATIVE_UINT64);
}
std::optional<double> Hdf5Source::real(const std::string& object, const std::string& attribute) const {
  return number<double>(object, attribute, H5T_FLOAT, H5T_NATIVE_DOUBLE);
}

namespace {

// A buffer for a fixed-length string of this type; nothing for other types.
std::optional<std::string> room_for_text(hid_t type) {
  if (H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0) return {};
  return std::string(H5Tget_size(type), '\0');
}

std::string without_padding(const std::string& text) { return text.substr(0, text.find('\0')); }

}  // namespace

std::optional<std::string> Hdf5Source::text(const std::string& object, const std::string& name) const {
  const Hdf5Id source = attribute(object, name);
  if (!source.valid()) return {};
  const Hdf5Id type(H5Aget_type(source), H5Tclose);
  std::optional<std::string> text = room_for_text(type);
  if (!text || H5Aread(source, type, text->data()) < 0) return {};
  return without_padding(*text);
}

std::optional<std::string> Hdf5Source::text_dataset(const std::string& path) const {
  const Hdf5Id source = dataset(path);
  if (!source.valid()) return {};
  const Hdf5Id type(H5Dget_type(source), H5Tclose);
  std::optional<std::string> text = room_for_text(type);
  if (!text || !extent(source).empty() || !read(source, type, text->data())) return {};
  return without_padding(*text);
}

std::optional<std::vector<std::string>> Hdf5Source::names(const std::string& group) const {
  const Hdf5Id source(H5Gopen2(file_, group.c_str(), H5P_DEFAULT), H5Gclose);
  H5G_info_t info;
  if (!source.valid() || H5Gget_info(source, &info) < 0) return {};
  std::vector<std::string> names;
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    const auto by_index = [&](char* name, std::size_t size) {
      return H5Lget_name_by_idx(source, ".", H5_INDEX_NAME, H5_ITER_INC, i, name, size, H5P_DEFAULT);
    };
    const ssize_t length = by_index(nullptr, 0);
    if (length <= 0) return {};
    std::string name(length, '\0');
    if (by_index(name.data(), name.size() + 1) != length) return {};
    names.push_back(std::move(name));
  }
  return names;
}

Hdf5Id Hdf5Source::dataset(const std::string& path) const {
  return Hdf5Id(H5Dopen2(file_, path.c_str(), H5P_DEFAULT), H5Dclose);
}

std::vector<std::uint64_t> Hdf5Source::extent(hid_t dataset) {
  const Hdf5Id space(H5Dget_space(dataset), H5Sclose);
  const int dimensions = H5Sget_simple_extent_ndims(space);
  std::vector<hsize_t> extent(std::max(dimensions, 0));
  if (dimensions > 0) H5Sget_simple_extent_dims(space, extent.data(), nullptr);
  return {extent.begin(), extent.end()};
}

bool Hdf5Source::has_type(hid_t dataset, FileType type) {
  const Hdf5Id stored(H5Dget_type(dataset), H5Tclose);
  return H5Tequal(stored, hdf5_type(type)) > 0;
}

std::optional<std::uint64_t> Hdf5Source::contiguous_place(hid_t dataset) {
  const Hdf5Id properties(H5Dget_create_plist(dataset), H5Pclose);
  const haddr_t place = H5Dget_offset(dataset);
  if (H5Pget_layout(properties) != H5D_CONTIGUOUS || place == HADDR_UNDEF) return {};
  return place;
}

bool Hdf5Source::read(hid_t dataset, hid_t type, void* data) {
  return H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) >= 0;
}

}  // namespace mpm
