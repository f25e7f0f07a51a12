#include "mpm_hpc/parallel/halo.hpp"

#include <algorithm>
#include <bit>
#include <map>

#include "bytes.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

template <int Dim>
struct Halo<Dim>::Requests {
  MPI_Comm comm = MPI_COMM_NULL;
  std::array<std::vector<MPI_Request>, 2> sends;  // by direction
  std::vector<MPI_Request> receives;
  GridFields* fields = nullptr;
  std::vector<FieldId> which;
  Direction direction = to_owners;
  bool active = false;
};

template <int Dim>
Halo<Dim>::Halo() : requests_(std::make_unique<Requests>()) {}
template <int Dim>
Halo<Dim>::Halo(Halo&&) noexcept = default;
template <int Dim>
Halo<Dim>& Halo<Dim>::operator=(Halo&& other) noexcept {
  peers_.swap(other.peers_);
  requests_.swap(other.requests_);
  std::swap(messages_, other.messages_);
  std::swap(bytes_, other.bytes_);
  std::swap(wait_seconds_, other.wait_seconds_);
  return *this;
}
template <int Dim>
Halo<Dim>::~Halo() {
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (!requests_ || finalized) return;
  settle(to_owners);
  settle(to_ghosts);
}

template <int Dim>
NodeMask nodes_within(int number, int below, int above) {
  std::array<int, Dim> offset;
  for (int a = Dim - 1; a >= 0; --a, number /= 3) offset[a] = number % 3 - 1;
  NodeMask mask = 0;
  for (int n = 0; n < nodes_per_block<Dim>; ++n) {
    const IntVec<Dim> node = node_in_block<Dim>(n);
    bool reached = true;
    for (int a = 0; a < Dim; ++a) {
      const int position = node[a] + block_side * offset[a];
      reached = reached && position >= -below && position < block_side + above;
    }
    if (reached) mask |= NodeMask{1} << n;
  }
  return mask;
}

template <int Dim>
NodeMask reachable_nodes(int number, int kernel_support) {
  // Base nodes of a block's particles lie in -1..4 of its own nodes, and the stencil ends support - 1 nodes further.
  return nodes_within<Dim>(number, 1, kernel_support);
}

namespace {

std::map<int, std::vector<BlockRequest>> exchange_requests(const Communicator& communicator,
                                                  const std::map<int, std::vector<BlockRequest>>& lists) {
  std::map<int, Communicator::Bytes> outgoing;
  for (const auto& [rank, list] : lists) outgoing[rank] = to_bytes(list);
  std::map<int, std::vector<BlockRequest>> incoming;
  for (const auto& [source, bytes] : communicator.exchange(outgoing)) incoming[source] = from_bytes<BlockRequest>(bytes);
  return incoming;
}

// The blocks within `masks` of the given ones, sorted by key, with the masks of a block merged.
template <int Dim>
std::vector<BlockRequest> surroundings(const GridGeometry<Dim>& grid, const std::vector<BlockKey>& blocks,
                                       const std::array<NodeMask, block_neighbours<Dim>>& masks) {
  std::vector<BlockRequest> reached;
  reached.reserve(blocks.size() * block_neighbours<Dim>);
  for (BlockKey key : blocks) {
    const IntVec<Dim> centre = block_of_key<Dim>(key);
    for (int n = 0; n < block_neighbours<Dim>; ++n) {
      IntVec<Dim> block = centre;
      for (int a = Dim - 1, rest = n; a >= 0; --a, rest /= 3) block[a] += rest % 3 - 1;
      block = grid.same_block(block);
      if ((block.array() >= 0).all()) reached.push_back({block_key<Dim>(block), masks[n]});
    }
  }
  std::sort(reached.begin(), reached.end(),
            [](const BlockRequest& a, const BlockRequest& b) { return a.key < b.key; });
  std::vector<BlockRequest> merged;
  for (const BlockRequest& r : reached) {
    if (merged.empty() || merged.back().key != r.key) {
      merged.push_back(r);
    } else {
      merged.back().mask |= r.mask;
    }
  }
  return merged;
}

}  // namespace

template <int Dim>
void Halo<Dim>::connect(const Communicator& communicator, const BlockTopology<Dim>& topology, const Wanted& wanted,
                        const Wanted& asked) {
  settle(to_owners);
  settle(to_ghosts);
  std::map<int, Peer> peers;
  for (const auto& [owner, list] : wanted) {
    peers[owner].rank = owner;
    for (const BlockRequest& r : list) peers[owner].ghosts.push_back({topology.find(r.key), r.mask});
  }
  for (const auto& [source, list] : asked) {
    peers[source].rank = source;
    for (const BlockRequest& r : list) peers[source].shared.push_back({topology.find(r.key), r.mask});
  }
  peers_.clear();
  for (auto& [rank, peer] : peers) peers_.push_back(std::move(peer));
  requests_->comm = mpi_comm(communicator);
}

template <int Dim>
void Halo<Dim>::rebuild(const Communicator& communicator, const Decomposition<Dim>& decomposition,
                        const std::vector<BlockKey>& occupied, int kernel_support, BlockTopology<Dim>& topology) {
  std::array<NodeMask, block_neighbours<Dim>> masks;
  for (int n = 0; n < block_neighbours<Dim>; ++n) masks[n] = reachable_nodes<Dim>(n, kernel_support);
  std::vector<BlockKey> owned;
  Wanted wanted;
  for (const BlockRequest& block : surroundings<Dim>(decomposition.grid(), occupied, masks)) {
    const int owner = decomposition.owner(block_of_key<Dim>(block.key));
    if (owner == communicator.rank()) {
      owned.push_back(block.key);
    } else {
      wanted[owner].push_back(block);
    }
  }
  const Wanted asked = exchange_requests(communicator, wanted);
  for (const auto& [source, list] : asked)
    for (const BlockRequest& request : list) owned.push_back(request.key);
  std::sort(owned.begin(), owned.end());
  owned.erase(std::unique(owned.begin(), owned.end()), owned.end());
  std::vector<BlockKey> ghosts;
  for (const auto& [owner, list] : wanted)
    for (const BlockRequest& request : list) ghosts.push_back(request.key);
  topology.rebuild(owned, ghosts, decomposition.grid());
  connect(communicator, topology, wanted, asked);
}

template <int Dim>
void Halo<Dim>::rebuild_for_rows(const Communicator& communicator, const Decomposition<Dim>& decomposition, int reach,
                                 BlockTopology<Dim>& topology) {
  std::array<NodeMask, block_neighbours<Dim>> masks;
  for (int n = 0; n < block_neighbours<Dim>; ++n) masks[n] = nodes_within<Dim>(n, reach, reach);
  std::vector<BlockKey> owned, ghosts;
  for (Slot s = 0; s < topology.size(); ++s) (s < topology.owned() ? owned : ghosts).push_back(topology.key(s));
  Wanted wished;
  const IntVec<Dim> blocks = decomposition.grid().blocks();
  for (const BlockRequest& block : surroundings<Dim>(decomposition.grid(), owned, masks)) {
    const IntVec<Dim> place = block_of_key<Dim>(block.key);
    if ((place.array() >= blocks.array()).any()) continue;
    const int owner = decomposition.owner(place);
    if (owner != communicator.rank()) wished[owner].push_back(block);
  }
  // Owners grant the blocks that are active at their place.
  Wanted granted;
  for (const auto& [source, list] : exchange_requests(communicator, wished))
    for (const BlockRequest& request : list)
      if (const Slot slot = topology.find(request.key); slot != no_slot && slot < topology.owned())
        granted[source].push_back(request);
  const Wanted wanted = exchange_requests(communicator, granted);
  for (const auto& [owner, list] : wanted)
    for (const BlockRequest& request : list)
      if (topology.find(request.key) == no_slot) ghosts.push_back(request.key);
  topology.rebuild(owned, ghosts, decomposition.grid());
  connect(communicator, topology, wanted, granted);
}

namespace {

// Visits the values of the masked nodes in message order; f(pointer into the field, number of values).
template <class T, int Dim, class Entries, class F>
void for_masked_nodes(const Entries& entries, T* data, int components, F&& f) {
  for (const auto& entry : entries) {
    T* block = data + static_cast<std::size_t>(entry.slot) * nodes_per_block<Dim> * components;
    for (NodeMask mask = entry.mask; mask; mask &= mask - 1) f(block + std::countr_zero(mask) * components);
  }
}

template <class Entries>
GlobalIndex masked_nodes(const Entries& entries) {
  GlobalIndex count = 0;
  for (const auto& entry : entries) count += std::popcount(entry.mask);
  return count;
}

}  // namespace

template <int Dim>
void Halo<Dim>::receive(Peer& peer, std::size_t bytes, int tag) {
  peer.receive.resize(bytes);
  requests_->receives.emplace_back();
  MPI_Irecv(peer.receive.data(), static_cast<int>(bytes), MPI_BYTE, peer.rank, tag, requests_->comm,
            &requests_->receives.back());
}

template <int Dim>
void Halo<Dim>::send(Peer& peer, Direction direction, int tag) {
  const std::vector<char>& bytes = peer.send[direction];
  requests_->sends[direction].emplace_back();
  MPI_Isend(bytes.data(), static_cast<int>(bytes.size()), MPI_BYTE, peer.rank, tag, requests_->comm,
            &requests_->sends[direction].back());
  ++messages_;
  bytes_ += static_cast<GlobalIndex>(bytes.size());
}

template <int Dim>
void Halo<Dim>::settle(Direction direction) {
  std::vector<MPI_Request>& sends = requests_->sends[direction];
  if (sends.empty()) return;
  const double began = MPI_Wtime();
  MPI_Waitall(static_cast<int>(sends.size()), sends.data(), MPI_STATUSES_IGNORE);
  wait_seconds_ += MPI_Wtime() - began;
  sends.clear();
}

template <int Dim>
void Halo<Dim>::start(GridFields& fields, const std::vector<FieldId>& which, Direction direction) {
  Requests& requests = *requests_;
  debug_check(!requests.active, "a halo exchange starts while another is under way");
  requests.fields = &fields;
  requests.which = which;
  requests.direction = direction;
  requests.active = true;
  settle(direction);
  requests.receives.clear();
  int components = 0;
  for (FieldId f : which) components += fields.traits(f).halo_components;
  const bool sum = direction == to_owners;
  const int tag = sum ? 1 : 2;
  with_precision(fields.precision(), [&](auto zero) {
    using T = decltype(zero);
    for (Peer& peer : peers_) {
      const auto& incoming = sum ? peer.shared : peer.ghosts;
      if (incoming.empty()) continue;
      receive(peer, masked_nodes(incoming) * components * sizeof(T), tag);
    }
    for (Peer& peer : peers_) {
      const auto& outgoing = sum ? peer.ghosts : peer.shared;
      if (outgoing.empty()) continue;
      std::vector<char>& bytes = peer.send[direction];
      bytes.resize(masked_nodes(outgoing) * components * sizeof(T));
      T* out = reinterpret_cast<T*>(bytes.data());
      for (FieldId f : which) {
        const int stored = fields.traits(f).components, sent = fields.traits(f).halo_components;
        for_masked_nodes<T, Dim>(outgoing, fields.template data<T>(f), stored, [&](const T* node) {
          for (int c = 0; c < sent; ++c) *out++ = node[c];
        });
      }
      send(peer, direction, tag);
    }
  });
}

template <int Dim>
void Halo<Dim>::finish() {
  Requests& requests = *requests_;
  const double began = MPI_Wtime();
  MPI_Waitall(static_cast<int>(requests.receives.size()), requests.receives.data(), MPI_STATUSES_IGNORE);
  wait_seconds_ += MPI_Wtime() - began;
  GridFields& fields = *requests.fields;
  const bool sum = requests.direction == to_owners;
  // Peers are unpacked in the order of their ranks, so that sums don't depend on the order of arrival.
  with_precision(fields.precision(), [&](auto zero) {
    using T = decltype(zero);
    for (Peer& peer : peers_) {
      const auto& incoming = sum ? peer.shared : peer.ghosts;
      const T* in = reinterpret_cast<const T*>(peer.receive.data());
      if (incoming.empty()) continue;
      for (FieldId f : requests.which) {
        const int stored = fields.traits(f).components, sent = fields.traits(f).halo_components;
        if (sum) {
          for_masked_nodes<T, Dim>(incoming, fields.template data<T>(f), stored, [&](T* node) {
            for (int c = 0; c < sent; ++c) node[c] += *in++;
          });
        } else {
          for_masked_nodes<T, Dim>(incoming, fields.template data<T>(f), stored, [&](T* node) {
            for (int c = 0; c < sent; ++c) node[c] = *in++;
          });
        }
      }
    }
  });
  requests.active = false;
}

template <int Dim>
void Halo<Dim>::start_sum(GridFields& fields, const std::vector<FieldId>& which) {
  start(fields, which, to_owners);
}
template <int Dim>
void Halo<Dim>::finish_sum() {
  finish();
}
template <int Dim>
void Halo<Dim>::start_fill(GridFields& fields, const std::vector<FieldId>& which) {
  start(fields, which, to_ghosts);
}
template <int Dim>
void Halo<Dim>::finish_fill() {
  finish();
}

template <int Dim>
void Halo<Dim>::fill_blocks(std::vector<char>& flags) {
  Requests& requests = *requests_;
  debug_check(!requests.active, "a halo exchange starts while another is under way");
  settle(to_ghosts);
  requests.receives.clear();
  constexpr int tag = 3;
  for (Peer& peer : peers_)
    if (!peer.ghosts.empty()) receive(peer, peer.ghosts.size(), tag);
  for (Peer& peer : peers_) {
    if (peer.shared.empty()) continue;
    std::vector<char>& bytes = peer.send[to_ghosts];
    bytes.resize(peer.shared.size());
    for (std::size_t i = 0; i < peer.shared.size(); ++i) bytes[i] = flags[peer.shared[i].slot];
    send(peer, to_ghosts, tag);
  }
  MPI_Waitall(static_cast<int>(requests.receives.size()), requests.receives.data(), MPI_STATUSES_IGNORE);
  for (Peer& peer : peers_)
    for (std::size_t i = 0; i < peer.ghosts.size(); ++i) flags[peer.ghosts[i].slot] = peer.receive[i];
}

template <int Dim>
GlobalIndex Halo<Dim>::ghost_nodes() const {
  GlobalIndex count = 0;
  for (const Peer& peer : peers_) count += masked_nodes(peer.ghosts);
  return count;
}

template <int Dim>
GlobalIndex Halo<Dim>::shared_nodes() const {
  GlobalIndex count = 0;
  for (const Peer& peer : peers_) count += masked_nodes(peer.shared);
  return count;
}

template <int Dim>
std::size_t Halo<Dim>::list_bytes() const {
  std::size_t bytes = 0;
  for (const Peer& peer : peers_) bytes += (peer.ghosts.capacity() + peer.shared.capacity()) * sizeof(Entry);
  return bytes;
}

template <int Dim>
std::size_t Halo<Dim>::buffer_bytes() const {
  std::size_t bytes = 0;
  for (const Peer& peer : peers_) bytes += peer.send[0].capacity() + peer.send[1].capacity() + peer.receive.capacity();
  return bytes;
}

template NodeMask nodes_within<2>(int, int, int);
template NodeMask nodes_within<3>(int, int, int);
template NodeMask reachable_nodes<2>(int, int);
template NodeMask reachable_nodes<3>(int, int);
template class Halo<2>;
template class Halo<3>;

}  // namespace mpm
