// Where nodes, cells and blocks of the background grid are; all integer coordinates are non-negative.
#pragma once

#include <cmath>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

inline constexpr int block_side = 4;  // nodes per block and direction

template <int Dim>
inline constexpr int nodes_per_block = Dim == 2 ? 16 : 64;
template <int Dim>
inline constexpr int block_neighbours = Dim == 2 ? 9 : 27;

// Key of a block: its coordinates interleaved bit by bit (Morton order), so that sorting by key keeps blocks that are
// near in space near in memory.
using BlockKey = std::uint64_t;

template <int Dim>
BlockKey block_key(const IntVec<Dim>& block) {
  BlockKey key = 0;
  for (int bit = 0; bit < 21; ++bit)
    for (int a = 0; a < Dim; ++a) key |= static_cast<BlockKey>((block[a] >> bit) & 1) << (bit * Dim + Dim - 1 - a);
  return key;
}

template <int Dim>
IntVec<Dim> block_of_key(BlockKey key) {
  IntVec<Dim> block = IntVec<Dim>::Zero();
  for (int bit = 0; bit < 21; ++bit)
    for (int a = 0; a < Dim; ++a) block[a] |= static_cast<std::int32_t>((key >> (bit * Dim + Dim - 1 - a)) & 1) << bit;
  return block;
}

// Uniform grid over the domain box with a margin of two blocks on each side, where the stencils of particles at (and up
// to one cell beyond) the domain's faces end.
template <int Dim>
class GridGeometry {
 public:
  static constexpr int margin = 2 * block_side;

  GridGeometry() = default;
  // lower, upper: the domain [m]; spacing: h [m]. The grid starts at lower and covers upper.
  GridGeometry(const Vec<Dim>& lower, const Vec<Dim>& upper, Real spacing)
      : lower_(lower), upper_(upper), spacing_(spacing), inverse_spacing_(1 / spacing) {
    origin_ = lower - Vec<Dim>::Constant(margin * spacing);
    for (int a = 0; a < Dim; ++a) {
      cells_[a] = static_cast<std::int32_t>(std::ceil((upper[a] - lower[a]) / spacing * (1 - 1e-12)));
      blocks_[a] = (cells_[a] + 2 * margin) / block_side + 1;
    }
  }

  const Vec<Dim>& lower() const { return lower_; }
  const Vec<Dim>& upper() const { return upper_; }
  Real spacing() const { return spacing_; }
  Real inverse_spacing() const { return inverse_spacing_; }
  // Position of node (0, 0, 0).
  const Vec<Dim>& origin() const { return origin_; }
  const IntVec<Dim>& cells() const { return cells_; }
  const IntVec<Dim>& blocks() const { return blocks_; }

  Vec<Dim> node_position(const IntVec<Dim>& node) const {
    return origin_ + spacing_ * node.template cast<Real>();
  }
  bool contains(const Vec<Dim>& x) const {
    return (x.array() >= lower_.array()).all() && (x.array() <= upper_.array()).all();
  }

 private:
  Vec<Dim> lower_, upper_, origin_;
  Real spacing_ = 0, inverse_spacing_ = 0;
  IntVec<Dim> cells_, blocks_;
};

}  // namespace mpm
