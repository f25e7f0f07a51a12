// Nodes and their mirror images about the sides of the domain.
#pragma once

#include <array>
#include <cstdlib>

#include "mpm_hpc/effects/boundary/contact.hpp"
#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// A side is a mirror if the velocity v' at the image of a place is R v: R turns the component along the normal (slip) or all
// of them (sticky), so that they vanish on the side itself and are linear next to it, where stopping the nodes beyond would
// make them quadratic. Only a plane on nodes or midway between them maps nodes to nodes.
template <int Dim>
class Mirrors {
 public:
  // Makes the side of the grid a mirror, if its plane is one. Returns whether it is.
  bool add(const GridGeometry<Dim>& grid, int side, ContactCondition condition);
  bool has(int side) const { return sides_[side].mirror; }
  bool any() const;

  // A node inside the domain or on its sides, which comes first, and those of its images that have mass.
  template <class T>
  struct Group {
    struct Member {
      T* values;
      Vec<Dim> sign;  // diagonal of R, by which the first member's velocity is this one's
    };
    std::array<Member, 1 << Dim> members;
    int count = 0;
    Vec<Dim> free = Vec<Dim>::Ones();  // 0 for components that vanish on a side where the node lies
    std::array<int, Dim> side;         // the mirror next to it in each direction, -1: none

    // The common velocity v that keeps the momentum, sum m R v_i / sum m, of the velocities that `of` gives for a member.
    template <class F>
    Vec<Dim> mean(F&& of) const {
      Vec<Dim> momentum = Vec<Dim>::Zero();
      Real mass = 0;
      for (int i = 0; i < count; ++i) {
        const T* values = of(members[i]);
        const Real m = members[i].values[Dim];
        for (int a = 0; a < Dim; ++a) momentum[a] += m * members[i].sign[a] * values[a];
        mass += m;
      }
      return momentum.cwiseProduct(free) / mass;
    }
  };

  // Calls source(group) for all groups that a mirror has to do with, and alone(node, values) for the nodes with mass beyond a
  // mirror that belong to none.
  template <class T, class Source, class Alone>
  void for_groups(const State<Dim>& state, Source&& source, Alone&& alone) const {
    for (Slot s = 0; s < state.topology().owned(); ++s)
      if (near(state.topology().first_node(s)))
        for_massive_nodes<T>(state, s, [&](const IntVec<Dim>& node, T* values) {
          visit(state, s, node, values, source, alone);
        });
  }

 private:
  // Farther than this from a side, in half spacings, no node has an image with mass: that of the cubic kernel's widest stencil.
  static constexpr int reach = 3;
  struct Side {
    bool mirror = false;
    std::int32_t twice = 0;  // node coordinate of the plane, doubled
    ContactCondition condition;
  };

  // Distance of a node from a side, inwards, in half spacings.
  int depth(int side, std::int32_t node) const {
    return (side % 2 ? -1 : 1) * (2 * node - sides_[side].twice);
  }
  // Whether the block of this first node has nodes that for_groups() visits.
  bool near(const IntVec<Dim>& first) const {
    for (int side = 0; side < 2 * Dim; ++side)
      if (sides_[side].mirror && depth(side, first[side / 2] + (side % 2 ? block_side - 1 : 0)) <= reach)
        return true;
    return false;
  }
  // The values of an owned node in this block or next to it; null if there are none, or without mass.
  template <class T>
  static T* massive_node(const State<Dim>& state, Slot s, const IntVec<Dim>& node) {
    const IntVec<Dim> first = state.topology().first_node(s);
    std::array<int, Dim> offset;
    int number = 0;
    for (int a = 0; a < Dim; ++a) {
      offset[a] = (node[a] - first[a]) >> 2;
      number = number * block_side + ((node[a] - first[a]) & 3);
    }
    static_assert(block_side == 4);
    const Slot slot = state.topology().neighbours(s)[neighbour_number<Dim>(offset)];
    if (slot == no_slot || slot >= state.topology().owned()) return nullptr;
    T* values = state.template node_values_of<T>(slot) + number * node_values;
    return values[Dim] > 0 ? values : nullptr;
  }

  template <class T, class Source, class Alone>
  void visit(const State<Dim>& state, Slot s, const IntVec<Dim>& node, T* values, Source& source,
             Alone& alone) const {
    Group<T> group;
    IntVec<Dim> image = node;
    bool beyond = false, far = false, on_side = false;
    for (int a = 0; a < Dim; ++a) {
      group.side[a] = -1;
      for (const int side : {2 * a, 2 * a + 1}) {
        const int d = depth(side, node[a]);
        if (!sides_[side].mirror || d > reach) continue;
        group.side[a] = side;
        image[a] = sides_[side].twice - node[a];
        if (d == 0) {
          on_side = true;
          group.free = group.free.cwiseProduct((Vec<Dim>::Ones() + sign(side)) / 2);
        } else if (d < 0) {
          beyond = true;
          far = far || d < -reach;
        }
      }
    }
    if (beyond) {
      IntVec<Dim> inside = node;
      for (int a = 0; a < Dim; ++a)
        if (group.side[a] >= 0 && depth(group.side[a], node[a]) < 0) inside[a] = image[a];
      if (far || !massive_node<T>(state, s, inside)) alone(node, values);
      return;
    }
    for (int turned = 0; turned < 1 << Dim; ++turned) {
      IntVec<Dim> place = node;
      Vec<Dim> turns = Vec<Dim>::Ones();
      bool other = true;  // than the images with fewer turns
      for (int a = 0; a < Dim; ++a) {
        if (!(turned >> a & 1)) continue;
        other = other && image[a] != node[a];
        place[a] = image[a];
        if (other) turns = turns.cwiseProduct(sign(group.side[a]));
      }
      if (!other) continue;
      if (T* found = turned ? massive_node<T>(state, s, place) : values)
        group.members[group.count++] = {found, turns};
    }
    if (on_side || group.count > 1) source(group);
  }

  Vec<Dim> sign(int side) const {
    Vec<Dim> turns = Vec<Dim>::Ones();
    if (sides_[side].condition == ContactCondition::sticky) return -turns;
    turns[side / 2] = -1;
    return turns;
  }

  std::array<Side, 2 * Dim> sides_;
};

}  // namespace mpm
