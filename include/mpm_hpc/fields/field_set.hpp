// Typed particle columns with traits; sorting, migration, output and checkpoint work from the traits alone, so an
// effect that adds a column needs no change anywhere else.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/fields/aligned_buffer.hpp"

namespace mpm {

enum class ScalarType { float32, float64, int64 };

constexpr int bytes_of(ScalarType t) { return t == ScalarType::float32 ? 4 : 8; }

template <class T>
constexpr ScalarType scalar_type_of() {
  if constexpr (std::is_same_v<T, float>) return ScalarType::float32;
  if constexpr (std::is_same_v<T, double>) return ScalarType::float64;
  if constexpr (std::is_same_v<T, GlobalIndex>) return ScalarType::int64;
}

constexpr ScalarType real_type(Precision p) {
  return p == Precision::single_precision ? ScalarType::float32 : ScalarType::float64;
}

// Position of a column in its FieldSet; -1 = the body doesn't have it.
using FieldId = int;
inline constexpr FieldId no_field = -1;

struct FieldTraits {
  std::string name;
  std::string units;  // "1" for pure numbers
  ScalarType type = ScalarType::float64;
  int components = 1;      // 0: nothing is stored; stored component by component: component c of particle p is data(c)[p]
  bool in_output = false;  // written to frames unless the scene chooses its own list
  Real initial = 0;        // value of the diagonal components (or all, when not square) of a new particle
  bool identity = false;   // the initial value is the unit tensor
};

// Columns of equal length. Every column migrates with its particle and is part of the checkpoint.
class FieldSet {
 public:
  FieldId add(const FieldTraits& traits);
  FieldId find(std::string_view name) const;  // no_field when absent or empty
  // Whether the column holds anything.
  bool has(FieldId f) const { return columns_[f].traits.components > 0; }

  int count() const { return static_cast<int>(columns_.size()); }
  const FieldTraits& traits(FieldId f) const { return columns_[f].traits; }

  Index size() const { return size_; }
  // Keeps the values of the first min(old, new) particles; new ones are uninitialised.
  void resize(Index size);

  template <class T>
  T* data(FieldId f, int component = 0) const {
    return static_cast<T*>(columns_[f].components[component].data());
  }
  void* raw(FieldId f, int component) const { return columns_[f].components[component].data(); }

  // Component-by-component new[i] = old[source[i]]; needs one spare component buffer of each width only.
  void gather(std::span<const Index> source);

  // Bytes one particle takes in a message or file.
  int bytes_per_particle() const;
  std::size_t allocated_bytes(FieldId f) const;
  std::size_t spare_bytes() const { return spare_[0].allocated() + spare_[1].allocated(); }

  // Appends bytes of the given particles to out, particle by particle; the inverse makes them the given ones.
  void pack(std::span<const Index> particles, std::vector<char>& out) const;
  void unpack(const char* in, std::span<const Index> particles);

 private:
  struct Column {
    FieldTraits traits;
    std::vector<AlignedBuffer> components;
    int first_stagger;
  };
  static constexpr int stagger_step = 5;  // odd, so that all 64 lines of a page are used in turn
  std::vector<Column> columns_;
  // One per width: a wide buffer that became a narrow column's would stay there, half of it unused.
  std::array<AlignedBuffer, 2> spare_;
  Index size_ = 0;
  int component_count_ = 0;
};

}  // namespace mpm
