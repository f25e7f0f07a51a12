// Which rank owns which part of space.
#pragma once

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/parallel/communicator.hpp"
#include "mpm_hpc/parallel/curve.hpp"
#include "mpm_hpc/parallel/partition.hpp"

namespace mpm {

// Owners of grains, known of the whole domain on every rank, so that a body can move into empty space without asking. Either
// a table of coarse blocks (cubes of 2^k blocks), divided on rank 0; k grows with the domain so that the table never exceeds
// max_entries. Or cuts of a curve through the blocks, one per rank.
template <int Dim>
class Decomposition {
 public:
  static constexpr GlobalIndex max_entries = GlobalIndex{1} << 21;
  // Where the partitioner is automatic, more ranks or fewer occupied entries of a coarse table per rank take the curve.
  static constexpr int most_table_ranks = 256;
  static constexpr GlobalIndex least_entries = 16;
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
  // Number of the grain, whose blocks have one owner, that a block belongs to: of the coarse block, or on the curve.
  GlobalIndex grain(const IntVec<Dim>& block) const {
    return on_curve_ ? curve_place<Dim>(home(block), levels_) : coarse_index(home(block));
  }
  int owner(const IntVec<Dim>& block) const {
    return on_curve_ ? piece_of(cuts_, grain(block)) : owners_[grain(block)];
  }

  // Where the partitioner is automatic and there are no owners yet, decides between table and curve. `occupied`: grains of
  // this rank. Returns whether grains have other numbers than before. Collective.
  bool choose(const Communicator& communicator, GlobalIndex occupied);
  bool on_curve() const { return on_curve_; }

  // Partitions anew from the ranks' weights by grain. A table is divided on rank 0, and the parts renamed so that little
  // weight leaves its present owner; on the curve the cuts move. Keeps the present owners unless the new imbalance is at least
  // `gain` better (always, when there are none yet). Returns whether owners changed. Collective.
  bool partition(const Communicator& communicator, const Weights& local_weights, Real gain);

  // The ranks' largest load over the mean; 1 if there is none. Collective.
  Real imbalance(const Communicator& communicator, Real load) const;

  const GridGeometry<Dim>& grid() const { return grid_; }
  bool empty() const { return on_curve_ ? !cut_ : owners_.empty(); }
  // The table, empty on the curve; and the cuts, empty where there is a table.
  const std::vector<std::int32_t>& owners() const { return owners_; }
  const CurveCuts& cuts() const { return cuts_; }
  void set_owners(std::vector<std::int32_t> owners) { owners_ = std::move(owners); }
  // Takes over those of a checkpoint written on the same number of ranks, if they fit the grid and the partitioner; else the
  // next partition starts from nothing.
  void restore(const std::vector<std::int32_t>& owners, const CurveCuts& cuts, int ranks);
  GlobalIndex entries() const { return entries_; }
  std::size_t allocated_bytes() const {
    return owners_.capacity() * sizeof(std::int32_t) + cuts_.capacity() * sizeof(GlobalIndex);
  }
  // One line for people: what the owners are kept in, and why.
  std::string describe() const;

 private:
  bool partition_table(const Communicator& communicator, const Weights& local_weights, Real gain);
  bool cut(const Communicator& communicator, const Weights& local_weights, Real gain);

  GridGeometry<Dim> grid_;
  IntVec<Dim> counts_ = IntVec<Dim>::Zero();  // coarse blocks per direction
  static constexpr std::int32_t first_home_ = GridGeometry<Dim>::margin / block_side;
  IntVec<Dim> last_home_ = IntVec<Dim>::Constant(first_home_);
  int shift_ = 0;
  Partitioner partitioner_ = Partitioner::automatic;
  GlobalIndex entries_ = 0;
  std::vector<std::int32_t> owners_;
  bool on_curve_ = false, cut_ = false;
  int levels_ = 0;  // of the curve
  CurveCuts cuts_;
  std::string why_curve_;
};

}  // namespace mpm
