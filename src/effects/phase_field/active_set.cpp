#include "mpm_hpc/effects/phase_field/active_set.hpp"

#include <algorithm>
#include <cmath>

namespace mpm {

// On the grid a disturbance decays by the factor f per cell with f + 1/f - 2 = (h / L_s)^2, from the three-point form of
// c - L_s^2 c'' = 0; slower than exp(-h / L_s) where L_s < h. The kernel reaches further by what couples two nodes.
template <int Dim>
int ActiveSet<Dim>::reach(KernelKind kernel, Real decay_length) const {
  const int kernel_reach = with_kernel(kernel, [](auto k) { return decltype(k)::support; }) - 1;
  const Real half = 1 + 0.5 / (decay_length * decay_length);
  return kernel_reach + static_cast<int>(std::ceil(std::log(1 / threshold()) / std::acosh(half)));
}

template <int Dim>
void ActiveSet<Dim>::find(State<Dim>& state, const std::vector<Candidate>& candidates, int reach) {
  const BlockTopology<Dim>& topology = state.topology();
  if (tolerance_ == 0) return;
  active_.assign(static_cast<std::size_t>(topology.size()), 0);
  occupied_.assign(static_cast<std::size_t>(topology.size()), 0);
  for (const Candidate& candidate : candidates) {
    const Body<Dim>& body = state.bodies[candidate.body];
    for (const BlockRange& range : body.ranges) {
      char& active = active_[static_cast<std::size_t>(range.slot)];
      occupied_[static_cast<std::size_t>(range.slot)] = 1;
      if (!active) active = candidate.is_driven(range);
    }
  }
  // A ring of blocks at a time. Only blocks with particles pass it on, because c doesn't reach across the others, of which
  // a rank doesn't know all surroundings.
  for (int ring = 0; ring * block_side < reach; ++ring) {
    state.halo().fill_blocks(active_);
    wider_ = active_;
    for (Slot s = 0; s < topology.owned(); ++s) {
      const Slot* around = topology.neighbours(s);
      wider_[static_cast<std::size_t>(s)] =
          occupied_[static_cast<std::size_t>(s)] &&
          std::any_of(around, around + block_neighbours<Dim>, [this](Slot other) {
            return other != no_slot && active_[static_cast<std::size_t>(other)];
          });
    }
    active_.swap(wider_);
  }
}

template <int Dim>
std::vector<int> ActiveSet<Dim>::select(const Body<Dim>& body, const std::vector<int>& ranges) const {
  if (tolerance_ == 0) return ranges;
  std::vector<int> selected;
  selected.reserve(ranges.size());
  for (const int number : ranges)
    if (active_[static_cast<std::size_t>(body.ranges[number].slot)]) selected.push_back(number);
  return selected;
}

template class ActiveSet<2>;
template class ActiveSet<3>;

}  // namespace mpm
