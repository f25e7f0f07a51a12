// Values on the nodes of the active blocks, with traits that drive the halo.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/fields/block_topology.hpp"
#include "mpm_hpc/fields/field_set.hpp"
#include "mpm_hpc/math/row.hpp"

namespace mpm {

// Values per node of the fields that the row kernels work on: momentum (then velocity) and mass, padded in 2D.
inline constexpr int node_values = row_values;

struct GridFieldTraits {
  std::string name;
  std::string units;
  int components = 1;       // stored node by node: data[(slot * nodes_per_block + node) * components + c]
  int halo_components = 1;  // the first ones, which travel; the rest is padding
  bool sums_ghosts = false;   // joins the halo sum after P2G
  bool fills_ghosts = false;  // joins the halo fill before G2P
};

// The scalar type of all grid fields is that of the scene's precision.
class GridFields {
 public:
  explicit GridFields(Precision precision = Precision::double_precision) : precision_(precision) {}

  FieldId add(const GridFieldTraits& traits) {
    fields_.push_back({traits, {}});
    return static_cast<FieldId>(fields_.size()) - 1;
  }
  int count() const { return static_cast<int>(fields_.size()); }
  const GridFieldTraits& traits(FieldId f) const { return fields_[f].traits; }
  Precision precision() const { return precision_; }

  // Room for this many nodes in every field, plus one row of overrun for the row kernels; values are undefined.
  void resize(std::size_t nodes) {
    nodes_ = nodes;
    for (std::size_t f = 0; f < fields_.size(); ++f)
      fields_[f].buffer.allocate(bytes(f) + 4 * AlignedBuffer::line, 7 * static_cast<int>(f));
  }
  std::size_t nodes() const { return nodes_; }
  void zero(FieldId f) { std::memset(fields_[f].buffer.data(), 0, bytes(f) + 4 * AlignedBuffer::line); }

  template <class T>
  T* data(FieldId f) const {
    return static_cast<T*>(fields_[f].buffer.data());
  }
  std::size_t allocated_bytes(FieldId f) const { return fields_[f].buffer.allocated(); }

 private:
  struct Field {
    GridFieldTraits traits;
    AlignedBuffer buffer;
  };
  std::size_t bytes(std::size_t f) const {
    return nodes_ * fields_[f].traits.components * (precision_ == Precision::single_precision ? 4 : 8);
  }
  std::vector<Field> fields_;
  std::size_t nodes_ = 0;
  Precision precision_;
};

}  // namespace mpm
