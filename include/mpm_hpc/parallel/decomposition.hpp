// Which rank owns which part of space.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/parallel/communicator.hpp"
#include "mpm_hpc/parallel/partition.hpp"

namespace mpm {

// Owners of the coarse blocks (cubes of 2^k blocks). The table covers the whole domain on every rank, so that a body can
// move into empty space without asking; k grows with the domain so that the table never exceeds max_entries.
template <int Dim>
class Decomposition {
 public:
  static constexpr GlobalIndex max_entries = GlobalIndex{1} << 21;
  using Weights = BlockWeights;

  Decomposition() = default;
  explicit Decomposition(const GridGeometry<Dim>& grid, Partitioner partitioner = Partitioner::automatic);

  // Number of the coarse block that holds a block.
  GlobalIndex coarse_index(const IntVec<Dim>& block) const {
    GlobalIndex index = 0;
    for (int a = 0; a < Dim; ++a) index = index * counts_[a] + (block[a] >> shift_);
    return index;
  }
  // The block whose owner a block shares: itself, or for one of the margin the nearest block of the domain, so that a node
  // beyond a side and its mirror image inside have one owner.
  IntVec<Dim> home(IntVec<Dim> block) const {
    for (int a = 0; a < Dim; ++a) block[a] = std::clamp(block[a], first_home_, last_home_[a]);
    return block;
  }
  int owner(const IntVec<Dim>& block) const { return owners_[coarse_index(home(block))]; }

  // Partitions anew on rank 0 from the ranks' weights, and renames the parts so that little weight leaves its
  // present owner. Keeps the present owners unless the new imbalance is at least `gain` better (always, when there are
  // none yet). Returns whether owners changed. Collective.
  bool partition(const Communicator& communicator, const Weights& local_weights, Real gain);

  // Largest weight of a rank over the mean, for the present owners. Collective.
  Real imbalance(const Communicator& communicator, const Weights& local_weights) const;

  const GridGeometry<Dim>& grid() const { return grid_; }
  bool empty() const { return owners_.empty(); }
  const std::vector<std::int32_t>& owners() const { return owners_; }
  // Takes over the owners of a checkpoint written on the same number of ranks.
  void set_owners(std::vector<std::int32_t> owners) { owners_ = std::move(owners); }
  GlobalIndex entries() const { return entries_; }
  std::size_t allocated_bytes() const { return owners_.capacity() * sizeof(std::int32_t); }

 private:
  GridGeometry<Dim> grid_;
  IntVec<Dim> counts_ = IntVec<Dim>::Zero();  // coarse blocks per direction
  static constexpr std::int32_t first_home_ = GridGeometry<Dim>::margin / block_side;
  IntVec<Dim> last_home_ = IntVec<Dim>::Constant(first_home_);
  int shift_ = 0;
  Partitioner partitioner_ = Partitioner::automatic;
  GlobalIndex entries_ = 0;
  std::vector<std::int32_t> owners_;
};

}  // namespace mpm
