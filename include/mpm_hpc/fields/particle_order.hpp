// Sorts a body's particles by block and cell and pads each block to whole packs.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"

namespace mpm {

// First node of the stencil of a particle at x: floor(xi - shift) with xi = (x - origin) / h and the kernel's shift
// (0 linear, 1/2 quadratic, 1 cubic). A particle belongs to the block of this node.
inline std::int32_t base_node(Real x, Real origin, Real inverse_spacing, Real shift) {
  // std::floor in the form that GCC takes into lanes.
  const Real place = (x - origin) * inverse_spacing - shift;
  const std::int32_t node = static_cast<std::int32_t>(place);
  return node - (node > place);
}
template <int Dim>
inline IntVec<Dim> base_node(const GridGeometry<Dim>& grid, const Vec<Dim>& x, Real shift) {
  IntVec<Dim> base;
  for (int a = 0; a < Dim; ++a) base[a] = base_node(x[a], grid.origin()[a], grid.inverse_spacing(), shift);
  return base;
}

// Particles [begin, end), one after the other, of which all lie in one block or all are padding.
template <int Dim>
struct BlockRun {
  Index begin, end;
  bool padding;               // then the rest says nothing
  IntVec<Dim> block;
  const std::uint8_t* cells;  // number of each particle's base node inside the block
};

// What is known of the blocks met last. Particles that have drifted from a block lie in two blocks per direction and change
// between these every few particles: one place for each combination of even and odd coordinates holds them all.
template <int Dim, class Value>
class RecentBlocks {
 public:
  RecentBlocks() { blocks_.fill(IntVec<Dim>::Constant(-1)); }

  // The value of a block, from find() if it isn't known.
  template <class F>
  Value operator()(const IntVec<Dim>& block, F&& find) {
    int place = 0;
    for (int a = 0; a < Dim; ++a) place = 2 * place + block[a] % 2;
    if (blocks_[place] != block) {
      values_[place] = find();
      blocks_[place] = block;
    }
    return values_[place];
  }

 private:
  std::array<IntVec<Dim>, 1 << Dim> blocks_;
  std::array<Value, 1 << Dim> values_{};
};

// Calls f(run) for all particles in their order. Their places are found in lanes, a few hundred at a time, so that what is
// done for a block is done once for a run.
template <int Dim, class F>
void for_each_run(const Body<Dim>& body, const GridGeometry<Dim>& grid, Real shift, F&& f) {
  constexpr Index at_once = 256;
  constexpr std::uint64_t padding = ~std::uint64_t{0};
  const GlobalIndex* ids = body.particles.template data<GlobalIndex>(core::id);
  alignas(64) std::int32_t base[Dim][at_once];
  alignas(64) std::uint64_t block[at_once];  // coordinates side by side
  alignas(64) std::uint8_t cells[at_once];
  for (Index first = 0; first < body.particles.size(); first += at_once) {
    const Index count = std::min(at_once, body.particles.size() - first);
    for (int a = 0; a < Dim; ++a) {
      const Real* x = body.particles.template data<Real>(core::position, a) + first;
      const Real origin = grid.origin()[a], inverse_spacing = grid.inverse_spacing();
      std::int32_t* node = base[a];
      for (Index i = 0; i < count; ++i) node[i] = base_node(x[i], origin, inverse_spacing, shift);
    }
    for (Index i = 0; i < count; ++i) {
      std::uint64_t place = 0;
      std::int32_t cell = 0;
      for (int a = 0; a < Dim; ++a) {
        place = place << key_bits | static_cast<std::uint32_t>(base[a][i]) / block_side;
        cell = cell * block_side + base[a][i] % block_side;
      }
      block[i] = ids[first + i] < 0 ? padding : place;
      cells[i] = static_cast<std::uint8_t>(cell);
    }
    for (Index i = 0; i < count;) {
      BlockRun<Dim> run{first + i, first + i + 1, block[i] == padding, {}, cells + i};
      for (int a = 0; a < Dim; ++a) run.block[a] = base[a][i] / block_side;
      while (++i < count && block[i] == block[i - 1]) ++run.end;
      f(static_cast<const BlockRun<Dim>&>(run));
    }
  }
}

// The place in a periodic grid with the same nodes around it, such that its base node is one of the domain.
template <int Dim>
Vec<Dim> wrapped_place(const GridGeometry<Dim>& grid, Vec<Dim> x, Real shift);

enum class OrderWithinCell {
  stable,    // keep the present order
  canonical  // by identity, so that the order doesn't depend on the history
};

// Drops padding, sorts the rest by (block key, cell) and pads each block with massless copies of its last particle.
// Fills body.ranges with slot = position in the returned list of occupied keys, which is sorted.
template <int Dim>
std::vector<BlockKey> order_particles(Body<Dim>& body, const GridGeometry<Dim>& grid, Real shift, int pad,
                                      OrderWithinCell within);

}  // namespace mpm
