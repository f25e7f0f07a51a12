// What boundaries ask of the velocities of single nodes, for integrators that solve for them.
#pragma once

#include <array>
#include <vector>

#include "mpm_hpc/effects/boundary/contact.hpp"

namespace mpm {

template <int Dim>
class Reaction;

// One boundary's demand on one owned node.
template <int Dim>
struct NodeConstraint {
  std::size_t node;                    // slot * nodes_per_block + node in block
  Vec<Dim> velocity;                   // of the surface [m/s]
  Contact contact;                     // sticky where no normal is given
  Vec<Dim> normal = Vec<Dim>::Zero();  // from the surface to the material
  std::array<bool, Dim> directions{};  // of a sticky one: the components that it prescribes
  Reaction<Dim>* reaction = nullptr;   // whose it is
};

template <int Dim>
class NodeConstraints {
 public:
  void clear() {
    entries_.clear();
    reactions_.clear();
  }
  // What follows belongs to this boundary; one that touches no node is named as well.
  void begin(Reaction<Dim>& reaction) { reactions_.push_back(&reaction); }
  void touch(std::size_t node, const Contact& contact, const Vec<Dim>& normal,
             const Vec<Dim>& surface_velocity) {
    NodeConstraint<Dim> entry{
        .node = node, .velocity = surface_velocity, .contact = contact, .normal = normal};
    if (contact.condition == ContactCondition::sticky) entry.directions.fill(true);
    add(std::move(entry));
  }
  void prescribe(std::size_t node, const std::array<bool, Dim>& directions, const Vec<Dim>& velocity) {
    add({.node = node, .velocity = velocity, .contact = {}, .directions = directions});
  }

  const std::vector<NodeConstraint<Dim>>& entries() const { return entries_; }
  const std::vector<Reaction<Dim>*>& reactions() const { return reactions_; }

 private:
  void add(NodeConstraint<Dim> entry) {
    entry.reaction = reactions_.back();
    entries_.push_back(std::move(entry));
  }

  std::vector<NodeConstraint<Dim>> entries_;
  std::vector<Reaction<Dim>*> reactions_;
};

}  // namespace mpm
