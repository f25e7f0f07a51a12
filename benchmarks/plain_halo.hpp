// The halo exchange written plainly: one blocking message per component and neighbour.
#pragma once

#include <cstring>
#include <map>
#include <vector>

#include "mpm_hpc/effects/state.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"

namespace mpm {

// The same nodes as the program's halo, found anew from the blocks with particles and the owners of space.
template <int Dim>
class PlainHalo {
 public:
  explicit PlainHalo(State<Dim>& state) : comm_(mpi_comm(state.communicator())) {
    struct Wanted {
      BlockKey key;
      NodeMask mask;
    };
    std::map<int, std::map<BlockKey, NodeMask>> wanted;  // by owner
    const BlockTopology<Dim>& topology = state.topology();
    for (const auto& body : state.bodies)
      for (const BlockRange& range : body.ranges) {
        const Slot* around = topology.neighbours(range.slot);
        for (int n = 0; n < block_neighbours<Dim>; ++n) {
          if (around[n] < topology.owned()) continue;
          const BlockKey key = topology.key(around[n]);
          const NodeMask mask = reachable_nodes<Dim>(n, state.distribution.options().kernel_support);
          if (mask) wanted[state.distribution.decomposition().owner(block_of_key<Dim>(key))][key] |= mask;
        }
      }
    std::map<int, Communicator::Bytes> requests;
    for (const auto& [owner, blocks] : wanted) {
      std::vector<Wanted> list;
      for (const auto& [key, mask] : blocks) {
        list.push_back({key, mask});
        add(peers_[owner].ghosts, topology.find(key), mask);
      }
      requests[owner].resize(list.size() * sizeof(Wanted));
      std::memcpy(requests[owner].data(), list.data(), requests[owner].size());
    }
    for (const auto& [source, bytes] : state.communicator().exchange(requests)) {
      std::vector<Wanted> list(bytes.size() / sizeof(Wanted));
      std::memcpy(list.data(), bytes.data(), bytes.size());
      for (const Wanted& block : list) add(peers_[source].shared, topology.find(block.key), block.mask);
    }
  }

  // Of `components` values per node, of which the first `sent` travel.
  template <class T>
  void sum(T* values, int components, int sent) {
    exchange(values, components, sent, &Peer::ghosts, &Peer::shared,
             [](T& mine, T theirs) { mine += theirs; });
  }
  template <class T>
  void fill(T* values, int components, int sent) {
    exchange(values, components, sent, &Peer::shared, &Peer::ghosts,
             [](T& mine, T theirs) { mine = theirs; });
  }
  // Of this rank since the start.
  GlobalIndex messages() const { return messages_; }
  GlobalIndex bytes() const { return bytes_; }

 private:
  struct Peer {
    std::vector<std::size_t> ghosts, shared;  // nodes
  };

  static void add(std::vector<std::size_t>& nodes, Slot slot, NodeMask mask) {
    for (int n = 0; n < nodes_per_block<Dim>; ++n)
      if (mask >> n & 1) nodes.push_back(static_cast<std::size_t>(slot) * nodes_per_block<Dim> + n);
  }

  template <class T, class F>
  void exchange(T* values, int components, int sent, std::vector<std::size_t> Peer::*out,
                std::vector<std::size_t> Peer::*in, F&& take) {
    for (auto& [rank, peer] : peers_)
      for (int c = 0; c < sent; ++c) {
        std::vector<T> sending, receiving((peer.*in).size());
        for (std::size_t node : peer.*out) sending.push_back(values[node * components + c]);
        const int bytes_out = static_cast<int>(sending.size() * sizeof(T)),
                  bytes_in = static_cast<int>(receiving.size() * sizeof(T));
        MPI_Sendrecv(sending.data(), bytes_out, MPI_BYTE, rank, 0, receiving.data(), bytes_in, MPI_BYTE, rank,
                     0, comm_, MPI_STATUS_IGNORE);
        for (std::size_t i = 0; i < receiving.size(); ++i)
          take(values[(peer.*in)[i] * components + c], receiving[i]);
        ++messages_;
        bytes_ += bytes_out;
      }
  }

  MPI_Comm comm_;
  std::map<int, Peer> peers_;  // by rank
  GlobalIndex messages_ = 0, bytes_ = 0;
};

}  // namespace mpm
