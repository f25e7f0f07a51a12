// The bytes of an HDF5 file, laid out by the HDF5 library in memory without the bulk data.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "hdf5_ids.hpp"

namespace mpm {

// HDF5 must not touch the disk while it writes: a failed write inside H5Fclose leaves a broken handle that
// crashes MPI_Finalize, and a failed collective write goes unnoticed or hangs. So HDF5 writes into this
// image, which can't fail, and the caller brings the image and the bulk data to disk. All members throw
// FileError.
class Hdf5Image {
 public:
  struct Bytes {
    std::map<std::uint64_t, std::vector<char>> pieces;  // by place in the file, without overlaps
    std::uint64_t end = 0;                              // size of the file
    bool discard_bulk = false;

    void put(std::uint64_t place, const char* data, std::size_t size);
    void get(std::uint64_t place, char* data, std::size_t size) const;  // zero where nothing was put
  };

  Hdf5Image();
  ~Hdf5Image();
  Hdf5Image(const Hdf5Image&) = delete;
  Hdf5Image& operator=(const Hdf5Image&) = delete;

  // Groups on the way to a path are made as needed.
  Hdf5Id make_group(const std::string& path);
  Hdf5Id open(const std::string& path);  // a group or dataset; "/" is the root
  template <class T>
  void set_attribute(hid_t object, const std::string& name, const T& value) {
    set_attribute(object, name, file_type_of<T>(), &value, nullptr);
  }
  void set_attribute(hid_t object, const std::string& name, const std::string& text);  // fixed length, ASCII
  void set_attribute(hid_t object, const std::string& name, const std::vector<std::int64_t>& values);

  // A dataset with its data.
  template <class T>
  Hdf5Id make_dataset(const std::string& path, std::span<const T> values) {
    return make_dataset(path, file_type_of<T>(), values.data(), values.size());
  }
  Hdf5Id make_text_dataset(const std::string& path, const std::string& text);

  // Room for rows x components elements, whose data the caller writes at place(); `components` 0:
  // one-dimensional.
  Hdf5Id reserve_dataset(const std::string& path, FileType type, std::uint64_t rows, int components);
  static std::uint64_t place(hid_t dataset);  // 0 if there are no rows

  // A compressed dataset, whose chunks of `rows_per_chunk` rows the caller writes at the places of
  // reserve_chunk().
  Hdf5Id make_chunked_dataset(const std::string& path, FileType type, std::uint64_t rows, int components,
                              std::uint64_t rows_per_chunk, int deflate);
  // `skipped_filters` as H5Dread_chunk gives it: a filter that fails on a chunk is left out for it.
  std::uint64_t reserve_chunk(hid_t dataset, std::uint64_t first_row, std::size_t bytes,
                              std::uint32_t skipped_filters);

  std::uint64_t end() const { return bytes_.end; }
  // Closes the HDF5 file; no other call may follow.
  const Bytes& finish();

 private:
  Hdf5Id make_dataset(const std::string& path, FileType type, const void* data, std::size_t count);
  void set_attribute(hid_t object, const std::string& name, FileType type, const void* data,
                     const std::size_t* count);
  Hdf5Id create(const std::string& path, hid_t type, hid_t space, hid_t properties);

  Bytes bytes_;
  std::vector<char> scratch_;
  Hdf5Id file_, links_;
};

}  // namespace mpm
