// Copies of some of the particles' columns, for what must be taken back.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// Columns of type double, as implicit steps have them. The particles keep their order between save() and restore().
template <int Dim>
class ParticleCopies {
 public:
  void add(std::size_t body, FieldId field) { columns_.push_back({body, field, {}}); }
  bool empty() const { return columns_.empty(); }

  void save(const State<Dim>& state) {
    for (Column& column : columns_) {
      const FieldSet& f = state.bodies[column.body].particles;
      const auto size = static_cast<std::size_t>(f.size());
      column.values.resize(size * static_cast<std::size_t>(f.traits(column.field).components));
      for (int c = 0; c < f.traits(column.field).components; ++c)
        std::copy_n(f.template data<Real>(column.field, c), size, column.values.data() + c * size);
    }
  }

  void restore(State<Dim>& state) const {
    for (const Column& column : columns_) {
      const FieldSet& f = state.bodies[column.body].particles;
      const auto size = static_cast<std::size_t>(f.size());
      for (int c = 0; c < f.traits(column.field).components; ++c)
        std::copy_n(column.values.data() + c * size, size, f.template data<Real>(column.field, c));
    }
  }

  // Of any value since save(), on this rank.
  Real largest_change(const State<Dim>& state) const {
    Real largest = 0;
    for (const Column& column : columns_) {
      const FieldSet& f = state.bodies[column.body].particles;
      const auto size = static_cast<std::size_t>(f.size());
      for (int c = 0; c < f.traits(column.field).components; ++c) {
        const Real *now = f.template data<Real>(column.field, c), *before = column.values.data() + c * size;
        for (std::size_t p = 0; p < size; ++p) largest = std::max(largest, std::abs(now[p] - before[p]));
      }
    }
    return largest;
  }

  std::size_t allocated_bytes() const {
    std::size_t sum = 0;
    for (const Column& column : columns_) sum += capacity_bytes(column.values);
    return sum;
  }

 private:
  struct Column {
    std::size_t body;
    FieldId field;
    std::vector<Real> values;
  };
  std::vector<Column> columns_;
};

}  // namespace mpm
