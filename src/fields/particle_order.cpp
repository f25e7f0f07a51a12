#include "mpm_hpc/fields/particle_order.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace mpm {

template <int Dim>
Vec<Dim> wrapped_place(const GridGeometry<Dim>& grid, Vec<Dim> x, Real shift) {
  for (int a = 0; a < Dim; ++a) {
    if (!grid.periodic(a)) continue;
    auto base = [&] {
      return std::floor((x[a] - grid.origin()[a]) * grid.inverse_spacing() - shift) - grid.margin;
    };
    const Real last = grid.cells()[a] - 1;
    if (const Real turns = std::floor(base() / grid.cells()[a]); turns != 0) x[a] -= turns * grid.period(a);
    // Rounding may leave it on the wrong side of the seam.
    if (base() > last) x[a] -= grid.period(a);
    for (Real nudge = 1e-16 * grid.period(a); base() < 0; nudge *= 2) x[a] += nudge;
  }
  return x;
}

template <int Dim>
std::vector<BlockKey> order_particles(Body<Dim>& body, const GridGeometry<Dim>& grid, Real shift, int pad,
                                      OrderWithinCell within) {
  FieldSet& fields = body.particles;
  const Index n = fields.size();
  const GlobalIndex* ids = fields.template data<GlobalIndex>(core::id);
  std::vector<Index> order;
  order.reserve(n);
  for (Index p = 0; p < n; ++p)
    if (ids[p] >= 0) order.push_back(p);
  if (within == OrderWithinCell::canonical)
    std::sort(order.begin(), order.end(), [ids](Index a, Index b) { return ids[a] < ids[b]; });

  // Blocks in the order of first appearance, with the cell of each particle.
  const Real* x[Dim];
  for (int a = 0; a < Dim; ++a) x[a] = fields.template data<Real>(core::position, a);
  std::vector<BlockKey> keys;
  std::vector<std::uint32_t> bin(order.size());
  BlockMap map;
  map.reset(body.ranges.size() * 2 + 1024);
  std::size_t map_room = body.ranges.size() * 2 + 1024;
  BlockKey last_key = ~BlockKey{0};
  Slot last_slot = no_slot;
  for (std::size_t i = 0; i < order.size(); ++i) {
    Vec<Dim> position;
    for (int a = 0; a < Dim; ++a) position[a] = x[a][order[i]];
    const IntVec<Dim> base = base_node(grid, position, shift);
    IntVec<Dim> block;
    std::uint32_t cell = 0;
    for (int a = 0; a < Dim; ++a) {
      block[a] = base[a] / block_side;
      cell = cell * block_side + static_cast<std::uint32_t>(base[a] % block_side);
    }
    const BlockKey key = block_key<Dim>(block);
    if (key != last_key) {
      last_key = key;
      last_slot = map.find(key);
      if (last_slot == no_slot) {
        last_slot = static_cast<Slot>(keys.size());
        keys.push_back(key);
        if (keys.size() > map_room) {
          map_room *= 2;
          map.reset(map_room);
          for (std::size_t k = 0; k < keys.size(); ++k) map.insert(keys[k], static_cast<Slot>(k));
        } else {
          map.insert(key, last_slot);
        }
      }
    }
    bin[i] = static_cast<std::uint32_t>(last_slot) * nodes_per_block<Dim> + cell;
  }

  // Counting sort with the blocks in the order of their keys.
  std::vector<Slot> by_key(keys.size());
  std::iota(by_key.begin(), by_key.end(), 0);
  std::sort(by_key.begin(), by_key.end(), [&keys](Slot a, Slot b) { return keys[a] < keys[b]; });
  std::vector<Index> start(keys.size() * nodes_per_block<Dim>, 0);
  for (std::uint32_t b : bin) ++start[b];
  body.ranges.clear();
  body.ranges.reserve(keys.size());
  Index position = 0;
  for (std::size_t k = 0; k < by_key.size(); ++k) {
    const Index begin = position;
    Index* cells = &start[static_cast<std::size_t>(by_key[k]) * nodes_per_block<Dim>];
    for (int c = 0; c < nodes_per_block<Dim>; ++c) {
      const Index count = cells[c];
      cells[c] = position;
      position += count;
    }
    const Index count = position - begin;
    position = begin + (count + pad - 1) / pad * pad;
    body.ranges.push_back({static_cast<Slot>(k), begin, position});
  }
  std::vector<Index> source(position, -1);
  for (std::size_t i = 0; i < order.size(); ++i) source[start[bin[i]]++] = order[i];
  std::vector<Index> padding;
  for (Index p = 0; p < position; ++p)
    if (source[p] < 0) {
      source[p] = source[p - 1];
      padding.push_back(p);
    }
  fields.gather(source);

  GlobalIndex* new_ids = fields.template data<GlobalIndex>(core::id);
  for (const FieldId f : {core::mass, core::volume}) {
    if (fields.traits(f).type == ScalarType::float32) {
      for (Index p : padding) fields.template data<float>(f)[p] = 0;
    } else {
      for (Index p : padding) fields.template data<double>(f)[p] = 0;
    }
  }
  for (Index p : padding) new_ids[p] = padding_id;

  std::vector<BlockKey> occupied(keys.size());
  for (std::size_t k = 0; k < by_key.size(); ++k) occupied[k] = keys[by_key[k]];
  return occupied;
}

template Vec<2> wrapped_place<2>(const GridGeometry<2>&, Vec<2>, Real);
template Vec<3> wrapped_place<3>(const GridGeometry<3>&, Vec<3>, Real);
template std::vector<BlockKey> order_particles<2>(Body<2>&, const GridGeometry<2>&, Real, int, OrderWithinCell);
template std::vector<BlockKey> order_particles<3>(Body<3>&, const GridGeometry<3>&, Real, int, OrderWithinCell);

}  // namespace mpm
