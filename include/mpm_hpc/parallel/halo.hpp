// Sums and copies node values across ranks: one packed non-blocking message per neighbour and direction.
#pragma once

#include <memory>
#include <vector>

#include "mpm_hpc/fields/grid_fields.hpp"
#include "mpm_hpc/parallel/communicator.hpp"
#include "mpm_hpc/parallel/decomposition.hpp"

namespace mpm {

// Nodes of a block that take part, one bit per node number.
using NodeMask = std::uint64_t;

// Nodes that the stencils of an occupied block's particles can reach in its neighbour `number` (0..3^Dim-1), with a drift
// of one cell to either side since the sort: one plane on the low side, three on the high side.
template <int Dim>
NodeMask reachable_nodes(int number, int kernel_support);

template <int Dim>
class Halo {
 public:
  // From the sorted keys of the blocks that hold this rank's particles: finds the ghosts, tells their owners, and
  // rebuilds the topology. Collective.
  void rebuild(const Communicator& communicator, const Decomposition<Dim>& decomposition,
               const std::vector<BlockKey>& occupied, int kernel_support, BlockTopology<Dim>& topology);

  // Adds the ghosts' values to their owners' nodes, for the given fields in one message per neighbour.
  void start_sum(GridFields& fields, const std::vector<FieldId>& which);
  void finish_sum();
  // Copies the owners' values to the ghosts.
  void start_fill(GridFields& fields, const std::vector<FieldId>& which);
  void finish_fill();

  void sum(GridFields& fields, const std::vector<FieldId>& which) {
    start_sum(fields, which);
    finish_sum();
  }
  void fill(GridFields& fields, const std::vector<FieldId>& which) {
    start_fill(fields, which);
    finish_fill();
  }

  // Sent by this rank since the start.
  GlobalIndex messages() const { return messages_; }
  GlobalIndex bytes() const { return bytes_; }
  int neighbours() const { return static_cast<int>(peers_.size()); }
  // Node values that this rank sends in one sum (ghost nodes) and one fill (owned nodes), per component.
  GlobalIndex ghost_nodes() const;
  GlobalIndex shared_nodes() const;
  std::size_t allocated_bytes() const;

  Halo();
  Halo(Halo&&) noexcept;
  Halo& operator=(Halo&&) noexcept;
  ~Halo();

 private:
  struct Entry {
    Slot slot;
    NodeMask mask;
  };
  struct Peer {
    int rank = 0;
    std::vector<Entry> ghosts, shared;  // here, owned by the peer; owned here, ghosts at the peer
    std::vector<char> send, receive;
  };
  struct Requests;
  void start(GridFields& fields, const std::vector<FieldId>& which, bool sum);
  void finish();

  std::vector<Peer> peers_;
  std::unique_ptr<Requests> requests_;
  GlobalIndex messages_ = 0, bytes_ = 0;
};

}  // namespace mpm
