// Nodes and their mirror images about the sides of the domain.
#pragma once

#include <array>

#include "mpm_hpc/effects/boundary/contact.hpp"
#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// A side is a mirror if the velocity at the image of a place is R v: R turns the component along the normal (slip) or all of
// them (sticky), so that they vanish on the side itself and are linear next to it, where stopping the nodes beyond would make
// them quadratic. Only a plane on nodes or midway between them maps nodes to nodes.
template <int Dim>
class Mirrors {
 public:
  // Makes the side of the grid a mirror, if its plane and condition allow it.
  void add(const GridGeometry<Dim>& grid, int side, ContactCondition condition);
  bool has(int side) const { return sides_[side].mirror; }
  bool any() const;

  // Sets of velocity components, one bit each.
  using Components = std::uint8_t;
  static bool in(Components set, int a) { return set >> a & 1; }

  // A node and what takes the first member's velocity to its own.
  struct Member {
    std::uint32_t node;  // in the order of the grid fields
    Components turned;   // by R
    Components stopped;  // that any of the sides between the two turns
  };
  // A node inside the domain or on its sides, which comes first, and its images.
  struct Group {
    std::uint32_t first;  // member
    std::uint8_t count;
    Components vanishing;               // on a side where the first node lies
    std::array<std::int8_t, Dim> side;  // the mirror next to it in each direction, -1: none
  };

  // Lists the groups of this rank's nodes anew if the blocks have changed.
  void find_groups(const State<Dim>& state);
  const std::vector<Group>& groups() const { return groups_; }
  const Member* members(const Group& group) const { return &members_[group.first]; }
  // Nodes beyond a mirror and too far from it to have an image.
  const std::vector<Member>& far_nodes() const { return far_nodes_; }
  std::size_t allocated_bytes() const;

 private:
  // Farther than this from a side, in half spacings, no node has an image that the kernels reach from inside.
  static constexpr int reach = 3;
  struct Side {
    bool mirror = false;
    std::int32_t twice = 0;  // node coordinate of the plane, doubled
    Components turned = 0;
  };

  // Distance of a node from a side, inwards, in half spacings.
  int depth(int side, std::int32_t node) const {
    return (side % 2 ? -1 : 1) * (2 * node - sides_[side].twice);
  }
  bool near(const IntVec<Dim>& first_node_of_block) const;
  void add_node(const State<Dim>& state, Slot slot, int number);

  std::array<Side, 2 * Dim> sides_;
  std::vector<Group> groups_;
  std::vector<Member> members_, far_nodes_;
  int sort_ = -1;  // that the groups are of
};

}  // namespace mpm
