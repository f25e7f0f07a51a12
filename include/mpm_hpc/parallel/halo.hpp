// Sums and copies node values across ranks: one packed non-blocking message per neighbour and direction.
#pragma once

#include <array>
#include <map>
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

// Nodes of the neighbour `number` at most `below` nodes before the block's first node and `above` after its last.
template <int Dim>
NodeMask nodes_within(int number, int below, int above);

// What a rank asks of a block's owner.
struct BlockRequest {
  BlockKey key;
  NodeMask mask;
};

template <int Dim>
class Halo {
 public:
  // From the sorted keys of the blocks that hold this rank's particles: finds the ghosts, tells their owners, and
  // rebuilds the topology. Collective.
  void rebuild(const Communicator& communicator, const Decomposition<Dim>& decomposition,
               const std::vector<BlockKey>& occupied, int kernel_support, BlockTopology<Dim>& topology);

  // The halo of the rows of an assembled operator: every node within `reach` of this rank's owned nodes, as far as its
  // owner has it. A row may couple nodes that none of this rank's own particles reach; their blocks join the topology
  // behind the other ghosts. Fills only. Collective, after rebuild() of the halo that made the topology.
  void rebuild_for_rows(const Communicator& communicator, const Decomposition<Dim>& decomposition, int reach,
                        BlockTopology<Dim>& topology);

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

  // Gives the ghost blocks their owners' flags, one byte per block. No other exchange may be under way.
  void fill_blocks(std::vector<char>& flags);

  // Sent by this rank since the start.
  GlobalIndex messages() const { return messages_; }
  GlobalIndex bytes() const { return bytes_; }
  // Spent waiting for messages from peers, and for own ones to leave their buffers [s].
  Real wait_seconds() const { return wait_seconds_; }
  int neighbours() const { return static_cast<int>(peers_.size()); }
  // Node values that this rank sends in one sum (ghost nodes) and one fill (owned nodes), per component.
  GlobalIndex ghost_nodes() const;
  GlobalIndex shared_nodes() const;
  std::size_t list_bytes() const;    // who shares which nodes
  std::size_t buffer_bytes() const;  // of messages

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
    std::array<std::vector<char>, 2> send;  // by direction
    std::vector<char> receive;
  };
  struct Requests;
  // A rank that has what it needs goes on while its own messages are on their way: their buffers are waited for when the
  // same direction needs them again. Else the faster of two ranks would wait for the slower one in each of a step's exchanges.
  enum Direction { to_owners, to_ghosts };
  using Wanted = std::map<int, std::vector<BlockRequest>>;
  void connect(const Communicator& communicator, const BlockTopology<Dim>& topology, const Wanted& wanted,
               const Wanted& asked);
  // Posts the receipt of so many bytes, and sends what the peer's buffer holds; of all exchanges.
  void receive(Peer& peer, std::size_t bytes, int tag);
  void send(Peer& peer, Direction direction, int tag);
  // Waits until the messages of this direction have left their buffers.
  void settle(Direction direction);
  void start(GridFields& fields, const std::vector<FieldId>& which, Direction direction);
  void finish();

  std::vector<Peer> peers_;
  std::unique_ptr<Requests> requests_;
  GlobalIndex messages_ = 0, bytes_ = 0;
  Real wait_seconds_ = 0;
};

}  // namespace mpm
