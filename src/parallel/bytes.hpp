// Vectors of plain values as the bytes of a message, and back. An empty vector may have no address, and
// memcpy must not be given a null pointer even for no bytes.
#pragma once

#include <cstring>
#include <vector>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

template <class T>
Communicator::Bytes to_bytes(const std::vector<T>& values) {
  Communicator::Bytes bytes(values.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

template <class T>
std::vector<T> from_bytes(const Communicator::Bytes& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!bytes.empty()) std::memcpy(static_cast<void*>(values.data()), bytes.data(), bytes.size());
  return values;
}

}  // namespace mpm
