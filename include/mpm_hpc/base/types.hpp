// The scalar, index and small-vector types that every layer shares.
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace mpm {

// Scalar of everything that is not a particle or grid column (those are float or double, see Precision).
using Real = double;
// Local counts: particles, blocks or nodes that one rank holds.
using Index = std::int32_t;
// Global counts and identities, over all ranks.
using GlobalIndex = std::int64_t;

template <int Dim>
using Vec = Eigen::Matrix<Real, Dim, 1>;
template <int Dim>
using Mat = Eigen::Matrix<Real, Dim, Dim>;
// Integer grid coordinates of a node, a cell or a block.
template <int Dim>
using IntVec = Eigen::Matrix<std::int32_t, Dim, 1>;

// Scalar type of particle and grid columns, chosen by the scene. Positions are always stored in double:
// a float would round the cell-relative step of a particle far from the origin.
enum class Precision { single_precision, double_precision };

// Calls f with a value of type float or double.
template <class F>
decltype(auto) with_precision(Precision p, F&& f) {
  if (p == Precision::single_precision) return f(float{});
  return f(double{});
}

}  // namespace mpm
