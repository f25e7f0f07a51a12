#include "mpm_hpc/fields/particle_order.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

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

namespace {

// The blocks of a body's particles, numbered as they first appear, and how many particles each of their cells has.
template <int Dim>
class OccupiedBlocks {
 public:
  explicit OccupiedBlocks(std::size_t expected) { map_.reset(expected); room_ = expected; }

  Slot find_or_add(BlockKey key) {
    Slot slot = map_.find(key);
    if (slot != no_slot) return slot;
    slot = static_cast<Slot>(keys_.size());
    keys_.push_back(key);
    cells_.resize(keys_.size() * nodes_per_block<Dim>, 0);
    if (keys_.size() > room_) {
      room_ *= 2;
      map_.reset(room_);
      for (std::size_t k = 0; k < keys_.size(); ++k) map_.insert(keys_[k], static_cast<Slot>(k));
    } else {
      map_.insert(key, slot);
    }
    return slot;
  }

  const std::vector<BlockKey>& keys() const { return keys_; }
  // One number per cell of the block.
  Index* cells(Slot slot) { return &cells_[static_cast<std::size_t>(slot) * nodes_per_block<Dim>]; }

 private:
  BlockMap map_;
  std::size_t room_;
  std::vector<BlockKey> keys_;
  std::vector<Index> cells_;
};

}  // namespace

template <int Dim>
std::vector<BlockKey> order_particles(Body<Dim>& body, const GridGeometry<Dim>& grid, Real shift, int pad,
                                      OrderWithinCell within) {
  constexpr Index no_cell = -1;
  FieldSet& fields = body.particles;
  const Index n = fields.size();
  OccupiedBlocks<Dim> blocks(body.ranges.size() * 2 + 1024);
  // Columns, which come in large pages: vectors of this length would be mapped and cleared page by page at every sort.
  AlignedBuffer cell_of(sizeof(Index) * static_cast<std::size_t>(n), 0);
  Index* cell = static_cast<Index*>(cell_of.data());
  RecentBlocks<Dim, Slot> recent;
  for_each_run(body, grid, shift, [&](const BlockRun<Dim>& run) {
    if (run.padding) {
      std::fill(cell + run.begin, cell + run.end, no_cell);
      return;
    }
    const Slot slot = recent(run.block, [&] { return blocks.find_or_add(block_key<Dim>(run.block)); });
    Index* counts = blocks.cells(slot);
    for (Index p = run.begin; p < run.end; ++p) {
      const int c = run.cells[p - run.begin];
      cell[p] = slot * nodes_per_block<Dim> + c;
      ++counts[c];
    }
  });

  // Counting sort with the blocks in the order of their keys; the counts become the places of the next particles.
  const std::vector<BlockKey>& keys = blocks.keys();
  std::vector<Slot> by_key(keys.size());
  std::iota(by_key.begin(), by_key.end(), 0);
  std::sort(by_key.begin(), by_key.end(), [&keys](Slot a, Slot b) { return keys[a] < keys[b]; });
  body.ranges.clear();
  body.ranges.reserve(keys.size());
  std::vector<Index> ends;  // of each range without its padding
  ends.reserve(keys.size());
  Index position = 0;
  for (std::size_t k = 0; k < by_key.size(); ++k) {
    const Index begin = position;
    Index* cells = blocks.cells(by_key[k]);
    for (int c = 0; c < nodes_per_block<Dim>; ++c) position += std::exchange(cells[c], position);
    ends.push_back(position);
    position = begin + (position - begin + pad - 1) / pad * pad;
    body.ranges.push_back({static_cast<Slot>(k), begin, position});
  }
  AlignedBuffer source_of(sizeof(Index) * static_cast<std::size_t>(position), 0);
  const std::span<Index> source(static_cast<Index*>(source_of.data()), static_cast<std::size_t>(position));
  Index* next = keys.empty() ? nullptr : blocks.cells(0);
  if (within == OrderWithinCell::canonical) {
    const GlobalIndex* ids = fields.template data<GlobalIndex>(core::id);
    std::vector<Index> order;
    order.reserve(static_cast<std::size_t>(n));
    for (Index p = 0; p < n; ++p)
      if (cell[p] != no_cell) order.push_back(p);
    std::sort(order.begin(), order.end(), [ids](Index a, Index b) { return ids[a] < ids[b]; });
    for (const Index p : order) source[next[cell[p]]++] = p;
  } else {
    for (Index p = 0; p < n; ++p)
      if (cell[p] != no_cell) source[next[cell[p]]++] = p;
  }
  for (std::size_t k = 0; k < ends.size(); ++k)
    for (Index p = ends[k]; p < body.ranges[k].end; ++p) source[p] = source[ends[k] - 1];
  fields.gather(source);

  GlobalIndex* new_ids = fields.template data<GlobalIndex>(core::id);
  for (std::size_t k = 0; k < ends.size(); ++k)
    for (Index p = ends[k]; p < body.ranges[k].end; ++p) {
      new_ids[p] = padding_id;
      for (const FieldId f : {core::mass, core::volume}) {
        if (fields.traits(f).type == ScalarType::float32) {
          fields.template data<float>(f)[p] = 0;
        } else {
          fields.template data<double>(f)[p] = 0;
        }
      }
    }

  std::vector<BlockKey> occupied(keys.size());
  for (std::size_t k = 0; k < by_key.size(); ++k) occupied[k] = keys[by_key[k]];
  return occupied;
}

template Vec<2> wrapped_place<2>(const GridGeometry<2>&, Vec<2>, Real);
template Vec<3> wrapped_place<3>(const GridGeometry<3>&, Vec<3>, Real);
template std::vector<BlockKey> order_particles<2>(Body<2>&, const GridGeometry<2>&, Real, int, OrderWithinCell);
template std::vector<BlockKey> order_particles<3>(Body<3>&, const GridGeometry<3>&, Real, int, OrderWithinCell);

}  // namespace mpm
