// Axis-aligned boxes, possibly empty or unbounded.
#pragma once

#include <limits>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

template <int Dim>
struct BoundingBox {
  // Empty until something is added.
  Vec<Dim> lower = Vec<Dim>::Constant(std::numeric_limits<Real>::infinity());
  Vec<Dim> upper = Vec<Dim>::Constant(-std::numeric_limits<Real>::infinity());

  static BoundingBox everything() {
    BoundingBox box;
    std::swap(box.lower, box.upper);
    return box;
  }

  bool is_empty() const { return (lower.array() > upper.array()).any(); }
  bool is_finite() const { return is_empty() || (lower.allFinite() && upper.allFinite()); }
  bool contains(const Vec<Dim>& x) const {
    return (x.array() >= lower.array()).all() && (x.array() <= upper.array()).all();
  }
  Vec<Dim> extent() const { return upper - lower; }

  void add(const Vec<Dim>& x) {
    lower = lower.cwiseMin(x);
    upper = upper.cwiseMax(x);
  }
  BoundingBox merged(const BoundingBox& other) const {
    return {lower.cwiseMin(other.lower), upper.cwiseMax(other.upper)};
  }
  BoundingBox intersected(const BoundingBox& other) const {
    return {lower.cwiseMax(other.lower), upper.cwiseMin(other.upper)};
  }
};

}  // namespace mpm
