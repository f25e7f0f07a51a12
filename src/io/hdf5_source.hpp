// Reads an HDF5 file on one rank; what isn't there or has another shape comes back empty.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "hdf5_ids.hpp"

namespace mpm {

class Hdf5Source {
 public:
  // Takes no lock, because many parallel file systems have none.
  explicit Hdf5Source(const std::filesystem::path& file);
  bool valid() const { return file_.valid(); }

  // Attributes of a group or dataset; "/" is the root.
  std::optional<std::int64_t> integer(const std::string& object, const std::string& attribute) const;
  std::optional<std::uint64_t> checksum(const std::string& object) const;
  std::optional<double> real(const std::string& object, const std::string& attribute) const;
  std::optional<std::string> text(const std::string& object, const std::string& attribute) const;

  std::optional<std::vector<std::string>> names(const std::string& group) const;  // of its members, sorted
  Hdf5Id dataset(const std::string& path) const;  // invalid when there is none
  static std::vector<std::uint64_t> extent(hid_t dataset);
  static bool has_type(hid_t dataset, FileType type);
  static std::optional<std::uint64_t> contiguous_place(hid_t dataset);

  std::optional<std::string> text_dataset(const std::string& path) const;
  // One-dimensional, of exactly this type.
  template <class T>
  std::optional<std::vector<T>> values(const std::string& path) const {
    const Hdf5Id source = dataset(path);
    if (!source.valid() || !has_type(source, file_type_of<T>())) return {};
    const std::vector<std::uint64_t> size = extent(source);
    if (size.size() != 1) return {};
    std::vector<T> result(size[0]);
    if (size[0] > 0 && !read(source, hdf5_type(file_type_of<T>()), result.data())) return {};
    return result;
  }

 private:
  Hdf5Id attribute(const std::string& object, const std::string& name) const;
  static bool read(hid_t dataset, hid_t type, void* data);
  template <class T>
  std::optional<T> number(const std::string& object, const std::string& name, H5T_class_t kind,
                          hid_t type) const;

  Hdf5Id file_;
};

}  // namespace mpm
