// Aligned columns for tests that call the loops of the materials.
#pragma once

#include <cstdint>
#include <vector>

#include "mpm_hpc/materials/material_columns.hpp"

namespace mpm::test {

// Columns of `count` particles, each on a cache line of its own.
template <class T>
class Columns {
 public:
  Columns(int components, int count, T value = 0) : count_(count) {
    const int stride = (count + 63) / 64 * 64;
    data_.assign(static_cast<std::size_t>(components * stride + 64), value);
    auto address = reinterpret_cast<std::uintptr_t>(data_.data());
    T* first = data_.data() + (64 - address % 64) % 64 / sizeof(T);
    for (int k = 0; k < components; ++k) pointers_.push_back(first + k * stride);
  }
  Columns(const Columns&) = delete;
  T* operator[](int component) const { return pointers_[component]; }
  T* const* data() const { return pointers_.data(); }
  int count() const { return count_; }

 private:
  int count_;
  std::vector<T> data_;
  std::vector<T*> pointers_;
};

}  // namespace mpm::test
