// HDF5 identifiers with owners, and the few calls that readers and writers share.
#pragma once

#include <hdf5.h>

#include <bit>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/fields/field_set.hpp"

namespace mpm {

static_assert(std::endian::native == std::endian::little,
              "files are little-endian and are read and written as they are");

class Hdf5Id {
 public:
  using Close = herr_t (*)(hid_t);

  Hdf5Id() = default;
  Hdf5Id(hid_t id, Close close) : id_(id), close_(close) {}
  Hdf5Id(Hdf5Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Hdf5Id& operator=(Hdf5Id&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Hdf5Id() {
    if (id_ >= 0) close_(id_);
  }

  operator hid_t() const { return id_; }
  bool valid() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
  Close close_ = nullptr;
};

// Element types of our files.
enum class FileType { uint8, int32, int64, uint64, float32, float64 };

inline hid_t hdf5_type(FileType type) {
  switch (type) {
    case FileType::uint8:
      return H5T_STD_U8LE;
    case FileType::int32:
      return H5T_STD_I32LE;
    case FileType::int64:
      return H5T_STD_I64LE;
    case FileType::uint64:
      return H5T_STD_U64LE;
    case FileType::float32:
      return H5T_IEEE_F32LE;
    default:
      return H5T_IEEE_F64LE;
  }
}

constexpr int bytes_of(FileType type) {
  switch (type) {
    case FileType::uint8:
      return 1;
    case FileType::int32:
    case FileType::float32:
      return 4;
    default:
      return 8;
  }
}

constexpr FileType file_type(ScalarType type) {
  switch (type) {
    case ScalarType::float32:
      return FileType::float32;
    case ScalarType::float64:
      return FileType::float64;
    default:
      return FileType::int64;
  }
}

template <class T>
constexpr FileType file_type_of() {
  if constexpr (std::is_same_v<T, std::uint8_t> || std::is_same_v<T, char>) return FileType::uint8;
  if constexpr (std::is_same_v<T, std::int32_t>) return FileType::int32;
  if constexpr (std::is_same_v<T, std::int64_t>) return FileType::int64;
  if constexpr (std::is_same_v<T, std::uint64_t>) return FileType::uint64;
  if constexpr (std::is_same_v<T, float>) return FileType::float32;
  if constexpr (std::is_same_v<T, double>) return FileType::float64;
}

// HDF5 prints its error stack unless told otherwise; our messages say what went wrong.
inline void silence_hdf5() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }

}  // namespace mpm
