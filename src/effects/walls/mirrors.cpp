#include "mpm_hpc/effects/walls/mirrors.hpp"

#include <cmath>

#include "mpm_hpc/effects/boundary/node_loop.hpp"

namespace mpm {

namespace {

// The place in the grid fields of an owned node in a block or next to it; -1 if there is none.
template <int Dim>
std::int64_t owned_node(const BlockTopology<Dim>& topology, Slot slot, const IntVec<Dim>& node) {
  const IntVec<Dim> from_first = node - topology.first_node(slot);
  std::array<int, Dim> offset;
  int number = 0;
  for (int a = 0; a < Dim; ++a) {
    offset[a] = (from_first[a] + block_side) / block_side - 1;
    number = number * block_side + from_first[a] - offset[a] * block_side;
  }
  const Slot found = topology.neighbours(slot)[neighbour_number<Dim>(offset)];
  if (found == no_slot || found >= topology.owned()) return -1;
  return static_cast<std::int64_t>(found) * nodes_per_block<Dim> + number;
}

}  // namespace

template <int Dim>
void Mirrors<Dim>::add(const GridGeometry<Dim>& grid, int side, ContactCondition condition) {
  const int a = side / 2;
  // Nearer to each other than this, two mirrors would have images in common.
  constexpr std::int32_t least_cells = 4;
  const Real plane = side % 2 ? grid.upper()[a] : grid.lower()[a];
  const Real twice = 2 * (plane - grid.origin()[a]) * grid.inverse_spacing();
  if (condition == ContactCondition::separate || grid.cells()[a] < least_cells ||
      std::abs(twice - std::round(twice)) > 2 * surface_tolerance)
    return;
  const Components all = (1 << Dim) - 1, normal = static_cast<Components>(1 << a);
  sides_[side] = {true, static_cast<std::int32_t>(std::lround(twice)),
                  condition == ContactCondition::sticky ? all : normal};
}

template <int Dim>
bool Mirrors<Dim>::any() const {
  for (const Side& side : sides_)
    if (side.mirror) return true;
  return false;
}

// Whether the block has nodes that groups are made of.
template <int Dim>
bool Mirrors<Dim>::near(const IntVec<Dim>& first) const {
  for (int side = 0; side < 2 * Dim; ++side)
    if (sides_[side].mirror && depth(side, first[side / 2] + (side % 2 ? block_side - 1 : 0)) <= reach)
      return true;
  return false;
}

template <int Dim>
void Mirrors<Dim>::find_groups(const State<Dim>& state) {
  if (sort_ == state.distribution.sorts()) return;
  sort_ = state.distribution.sorts();
  groups_.clear();
  members_.clear();
  far_nodes_.clear();
  for (Slot slot = 0; slot < state.topology().owned(); ++slot)
    if (near(state.topology().first_node(slot)))
      for (int number = 0; number < nodes_per_block<Dim>; ++number) add_node(state, slot, number);
}

template <int Dim>
void Mirrors<Dim>::add_node(const State<Dim>& state, Slot slot, int number) {
  const IntVec<Dim> node = state.topology().first_node(slot) + node_in_block<Dim>(number);
  Group group{static_cast<std::uint32_t>(members_.size()), 0, 0, {}};
  IntVec<Dim> image = node, inside = node;
  Components stopped = 0;
  bool far = false;
  for (int a = 0; a < Dim; ++a) {
    group.side[a] = -1;
    for (const int side : {2 * a, 2 * a + 1}) {
      const int d = depth(side, node[a]);
      if (!sides_[side].mirror || d > reach) continue;
      group.side[a] = static_cast<std::int8_t>(side);
      image[a] = sides_[side].twice - node[a];
      if (d == 0) group.vanishing |= sides_[side].turned;
      if (d >= 0) continue;
      inside[a] = image[a];
      stopped |= sides_[side].turned;
      far = far || d < -reach;
    }
  }
  const auto place =
      static_cast<std::uint32_t>(static_cast<std::size_t>(slot) * nodes_per_block<Dim> + number);
  if (stopped) {
    if (far || owned_node(state.topology(), slot, inside) < 0) far_nodes_.push_back({place, 0, stopped});
    return;
  }
  members_.push_back({place, 0, 0});
  for (int turns = 1; turns < 1 << Dim; ++turns) {
    IntVec<Dim> other = node;
    Member member{0, 0, 0};
    bool is_new = true;  // not on the side that it would be turned about
    for (int a = 0; a < Dim; ++a) {
      if (!in(static_cast<Components>(turns), a)) continue;
      is_new = is_new && image[a] != node[a];
      if (!is_new) break;
      other[a] = image[a];
      member.turned ^= sides_[group.side[a]].turned;
      member.stopped |= sides_[group.side[a]].turned;
    }
    const std::int64_t found = is_new ? owned_node(state.topology(), slot, other) : -1;
    if (found < 0) continue;
    member.node = static_cast<std::uint32_t>(found);
    members_.push_back(member);
  }
  group.count = static_cast<std::uint8_t>(members_.size() - group.first);
  if (group.vanishing || group.count > 1) {
    groups_.push_back(group);
  } else {
    members_.pop_back();
  }
}

template <int Dim>
std::size_t Mirrors<Dim>::allocated_bytes() const {
  return capacity_bytes(groups_) + capacity_bytes(members_) + capacity_bytes(far_nodes_);
}

template class Mirrors<2>;
template class Mirrors<3>;

}  // namespace mpm
