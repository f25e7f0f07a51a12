#include "mpm_hpc/fields/block_topology.hpp"

#include <bit>

namespace mpm {

namespace {
constexpr BlockKey empty_key = ~BlockKey{0};
}

void BlockMap::reset(std::size_t expected) {
  const std::size_t size = std::bit_ceil(2 * expected + 2);
  keys_.assign(size, empty_key);
  slots_.assign(size, no_slot);
  mask_ = size - 1;
}

void BlockMap::insert(BlockKey key, Slot slot) {
  std::size_t i = hash(key) & mask_;
  while (keys_[i] != empty_key && keys_[i] != key) i = (i + 1) & mask_;
  keys_[i] = key;
  slots_[i] = slot;
}

Slot BlockMap::find(BlockKey key) const {
  if (keys_.empty()) return no_slot;
  for (std::size_t i = hash(key) & mask_; keys_[i] != empty_key; i = (i + 1) & mask_)
    if (keys_[i] == key) return slots_[i];
  return no_slot;
}

template <int Dim>
void BlockTopology<Dim>::rebuild(const std::vector<BlockKey>& owned, const std::vector<BlockKey>& ghosts,
                                 const GridGeometry<Dim>& grid) {
  owned_ = static_cast<Slot>(owned.size());
  keys_ = owned;
  keys_.insert(keys_.end(), ghosts.begin(), ghosts.end());
  map_.reset(keys_.size());
  for (Slot s = 0; s < size(); ++s) map_.insert(keys_[s], s);
  neighbours_.resize(keys_.size() * block_neighbours<Dim>);
  for (Slot s = 0; s < size(); ++s) {
    const IntVec<Dim> centre = block_of_key<Dim>(keys_[s]);
    for (int n = 0; n < block_neighbours<Dim>; ++n) {
      IntVec<Dim> block = centre;
      for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= 3) block[a] += rest % 3 - 1;
      block = grid.same_block(block);
      const bool inside = (block.array() >= 0).all();
      neighbours_[static_cast<std::size_t>(s) * block_neighbours<Dim> + n] =
          inside ? map_.find(block_key<Dim>(block)) : no_slot;
    }
  }
}

template class BlockTopology<2>;
template class BlockTopology<3>;

}  // namespace mpm
