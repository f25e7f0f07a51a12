// Where nodes, cells and blocks of the background grid are; all integer coordinates are non-negative.
#pragma once

#include <array>
#include <cmath>
#include <string>

#include "mpm_hpc/base/error.hpp"
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

inline constexpr int key_bits = 21;  // per coordinate

namespace detail {

// Bits that are in place after the groups of 2^step bits have moved apart, so that Dim - 1 others fit between two of them;
// step 0 is the end. All are there before the first move.
template <int Dim>
inline constexpr BlockKey spread_masks[5] = {0x1249249249249249, 0x10c30c30c30c30c3, 0x100f00f00f00f00f, 0x1f0000ff0000ff,
                                             0x1f00000000ffff};
template <>
inline constexpr BlockKey spread_masks<2>[5] = {0x5555555555555555, 0x3333333333333333, 0x0f0f0f0f0f0f0f0f, 0x00ff00ff00ff00ff,
                                                0x0000ffff0000ffff};

// Every bit of a coordinate to Dim times its place, by halves; and back.
template <int Dim>
constexpr BlockKey spread(BlockKey bits) {
  bits &= (BlockKey{1} << key_bits) - 1;
  for (int step = 4; step >= 0; --step) bits = (bits | bits << ((Dim - 1) << step)) & spread_masks<Dim>[step];
  return bits;
}
template <int Dim>
constexpr BlockKey collect(BlockKey bits) {
  bits &= spread_masks<Dim>[0];
  for (int step = 0; step < 4; ++step) bits = (bits | bits >> ((Dim - 1) << step)) & spread_masks<Dim>[step + 1];
  return (bits | bits >> ((Dim - 1) << 4)) & ((BlockKey{1} << key_bits) - 1);
}

}  // namespace detail

template <int Dim>
BlockKey block_key(const IntVec<Dim>& block) {
  BlockKey key = 0;
  for (int a = 0; a < Dim; ++a) key |= detail::spread<Dim>(static_cast<std::uint32_t>(block[a])) << (Dim - 1 - a);
  return key;
}

template <int Dim>
IntVec<Dim> block_of_key(BlockKey key) {
  IntVec<Dim> block;
  for (int a = 0; a < Dim; ++a) block[a] = static_cast<std::int32_t>(detail::collect<Dim>(key >> (Dim - 1 - a)));
  return block;
}

// "x_min", "x_max", "y_min", ... for side number 0, 1, 2, ...
inline std::string domain_side_name(int side) {
  return std::string(1, "xyz"[side / 2]) + (side % 2 ? "_max" : "_min");
}

// Uniform grid over the domain box with a margin of two blocks on each side, where the stencils of particles at (and up
// to one cell beyond) the domain's faces end. In a periodic direction the domain repeats itself: it is a whole number of
// blocks long, and the margin's blocks are those of the other side.
template <int Dim>
class GridGeometry {
 public:
  static constexpr int margin = 2 * block_side;

  GridGeometry() = default;
  // lower, upper: the domain [m]; spacing: h [m]. The grid starts at lower and covers upper. Throws LogicError unless
  // fits_period() holds in the periodic directions.
  GridGeometry(const Vec<Dim>& lower, const Vec<Dim>& upper, Real spacing,
               const std::array<bool, Dim>& periodic = {})
      : lower_(lower), upper_(upper), spacing_(spacing), inverse_spacing_(1 / spacing), periodic_(periodic) {
    origin_ = lower - Vec<Dim>::Constant(margin * spacing);
    for (int a = 0; a < Dim; ++a) {
      cells_[a] = static_cast<std::int32_t>(std::ceil((upper[a] - lower[a]) / spacing * (1 - 1e-12)));
      if (periodic[a]) {
        debug_check(fits_period((upper[a] - lower[a]) / spacing),
                    "a periodic direction is no whole number of blocks");
        cells_[a] = static_cast<std::int32_t>(std::lround((upper[a] - lower[a]) / spacing));
      }
      blocks_[a] = (cells_[a] + 2 * margin) / block_side + 1;
    }
  }

  // A block must not be its own neighbour, nor the same one on both sides.
  static constexpr int least_period = 3 * block_side;  // [cells]
  // Whether a direction so many cells long can be periodic.
  static bool fits_period(Real cells) {
    const Real blocks = cells / block_side;
    return std::abs(blocks - std::round(blocks)) < 1e-9 * blocks && std::lround(cells) >= least_period;
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
  // A periodic direction has no outside.
  bool contains(const Vec<Dim>& x) const {
    for (int a = 0; a < Dim; ++a)
      if (!periodic_[a] && !(x[a] >= lower_[a] && x[a] <= upper_[a])) return false;
    return true;
  }

  bool periodic(int direction) const { return periodic_[direction]; }
  bool any_periodic() const {
    for (const bool p : periodic_)
      if (p) return true;
    return false;
  }
  // Length [m] after which a periodic direction repeats itself.
  Real period(int direction) const { return cells_[direction] * spacing_; }
  // The block that holds the same nodes: inside the domain in periodic directions, else the block itself.
  IntVec<Dim> same_block(IntVec<Dim> block) const {
    constexpr std::int32_t first = margin / block_side;
    for (int a = 0; a < Dim; ++a) {
      if (!periodic_[a]) continue;
      const std::int32_t count = cells_[a] / block_side, place = (block[a] - first) % count;
      block[a] = first + (place < 0 ? place + count : place);
    }
    return block;
  }

 private:
  Vec<Dim> lower_, upper_, origin_;
  Real spacing_ = 0, inverse_spacing_ = 0;
  IntVec<Dim> cells_, blocks_;
  std::array<bool, Dim> periodic_{};
};

}  // namespace mpm
