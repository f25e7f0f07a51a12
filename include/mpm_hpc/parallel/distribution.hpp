// Brings particles to their owners, sorts them, and rebuilds blocks and halo; re-balances when that pays.
#pragma once

#include <array>
#include <map>
#include <utility>
#include <vector>

#include "mpm_hpc/fields/particle_order.hpp"
#include "mpm_hpc/parallel/halo.hpp"

namespace mpm {

enum class LeavePolicy {
  stop,      // a particle outside the domain ends the run
  remove,    // it is deleted and counted
  keep       // it is put back onto the wall, without the outward velocity, and counted
};

struct DistributionOptions {
  Real rebalance_threshold = 1.03;  // of max/mean weight
  Partitioner partitioner = Partitioner::automatic;
  bool weigh_by_time = false;      // scale weights with the measured compute time (not reproducible)
  LeavePolicy leave_policy = LeavePolicy::stop;
  // Sides x_min, x_max, y_min, ... through which particles leave for good, whatever the policy.
  std::array<bool, 6> open{};
  Real kernel_shift = 0.5;
  int kernel_support = 3;
  Precision precision = Precision::double_precision;
};

template <int Dim>
class Distribution {
 public:
  Distribution() = default;
  Distribution(const Communicator& communicator, const GridGeometry<Dim>& grid, const DistributionOptions& options)
      : communicator_(communicator), grid_(grid), options_(options), decomposition_(grid, options.partitioner) {}

  // Takes particles across periodic and open sides, migrates, re-balances past the threshold, sorts, rebuilds topology and halo and gives the grid fields their new size.
  // `seconds` is this rank's compute time since the last call. Throws NumericalFailure on all ranks if a particle left
  // the domain under LeavePolicy::stop. Collective.
  void redistribute(std::vector<Body<Dim>>& bodies, GridFields& fields, OrderWithinCell within, Real seconds = 0);

  const Communicator& communicator() const { return communicator_; }
  const GridGeometry<Dim>& grid() const { return grid_; }
  Decomposition<Dim>& decomposition() { return decomposition_; }
  const Decomposition<Dim>& decomposition() const { return decomposition_; }
  const BlockTopology<Dim>& topology() const { return topology_; }
  Halo<Dim>& halo() { return halo_; }
  const Halo<Dim>& halo() const { return halo_; }
  // For assembled operators: from the next redistribution on there is a halo of all nodes that a row can couple to.
  void require_row_halo() { needs_row_halo_ = true; }
  Halo<Dim>& row_halo() { return row_halo_; }
  const Halo<Dim>& row_halo() const { return row_halo_; }
  const DistributionOptions& options() const { return options_; }

  // max/mean weight after the last redistribution.
  Real imbalance() const { return imbalance_; }
  // Particles that the leave policy acted on here since the last call, and those that left through an open side.
  GlobalIndex take_removed() { return std::exchange(removed_, 0); }
  bool any_open() const { return options_.open != std::array<bool, 6>{}; }
  GlobalIndex take_left() { return std::exchange(left_, 0); }
  GlobalIndex take_kept() { return std::exchange(kept_, 0); }
  // On this rank, since the start.
  GlobalIndex migrated() const { return migrated_; }
  int sorts() const { return sorts_; }
  int rebalances() const { return rebalances_; }
  // Attempts at a new partition, of which not every one was an improvement.
  int partitions() const { return partitions_; }

 private:
  typename Decomposition<Dim>::Weights weights(const std::vector<Body<Dim>>& bodies, Real factor) const;
  void wrap(std::vector<Body<Dim>>& bodies) const;
  bool left_through_open_side(const Vec<Dim>& x) const;
  void apply_leave_policy(std::vector<Body<Dim>>& bodies);
  // Places in a body's columns: those of the particles that go away, by their new owner, and those that are free.
  struct Leaving {
    std::map<int, std::vector<Index>> particles;
    std::vector<Index> free;
    GlobalIndex count() const {
      GlobalIndex sum = 0;
      for (const auto& [owner, list] : particles) sum += static_cast<GlobalIndex>(list.size());
      return sum;
    }
  };
  // Whether the imbalance asks for a new partition, and there is hope for a better one.
  bool wants_partition(OrderWithinCell within);
  std::vector<Leaving> find_leaving(const std::vector<Body<Dim>>& bodies) const;
  // Sends particles to their owners, so that few of them exist twice at a time.
  void migrate(std::vector<Body<Dim>>& bodies);
  // All that leave, in rounds; `arrivals` by body.
  void send_and_receive(std::vector<Body<Dim>>& bodies, std::vector<Leaving>& leaving,
                        const std::vector<GlobalIndex>& arrivals);

  Communicator communicator_;
  GridGeometry<Dim> grid_;
  DistributionOptions options_;
  Decomposition<Dim> decomposition_;
  BlockTopology<Dim> topology_;
  Halo<Dim> halo_, row_halo_;
  bool needs_row_halo_ = false;
  Real imbalance_ = 1;
  GlobalIndex removed_ = 0, left_ = 0, kept_ = 0, migrated_ = 0;
  int sorts_ = 0, partitions_ = 0, rebalances_ = 0;
  // What the last partition left, and how many sorts ago: what can't be balanced isn't tried again at every sort.
  Real settled_ = 0;
  int sorts_since_partition_ = 0;
};

}  // namespace mpm
