#include "mpm_hpc/time/contact_states.hpp"

#include <algorithm>

namespace mpm {

template <int Dim>
void ContactStates<Dim>::begin(const std::vector<NodeConstraint<Dim>>& constraints,
                               const ImplicitSystem<Dim>& system, bool inertia) {
  contacts_.clear();
  for (const NodeConstraint<Dim>& demand : constraints) {
    const int row = system.row_of(demand.node);
    if (row < 0) continue;
    Motion motion = demand.contact.friction > 0 && !inertia ? Motion::sticks : Motion::slides;
    if (demand.contact.condition == ContactCondition::sticky) motion = Motion::sticks;
    if (demand.contact.condition == ContactCondition::separate &&
        demand.normal.dot(system.start_velocity(row) - demand.velocity) > 0)
      motion = Motion::open;
    contacts_.push_back({demand, row, motion});
  }
  std::stable_sort(contacts_.begin(), contacts_.end(),
                   [](const auto& a, const auto& b) { return a.row < b.row; });
}

template <int Dim>
template <class F>
void ContactStates<Dim>::for_nodes(F&& f) const {
  for (std::size_t first = 0, last = 0; first < contacts_.size(); first = last) {
    while (last < contacts_.size() && contacts_[last].row == contacts_[first].row) ++last;
    f(first, last);
  }
}

// Gram and Schmidt; where demands contradict each other, the first counts.
template <int Dim>
typename ContactStates<Dim>::Held ContactStates<Dim>::held(std::size_t first, std::size_t last) const {
  Held held;
  auto hold = [&](std::size_t contact, const Vec<Dim>& direction, const Vec<Dim>& velocity) {
    Vec<Dim> rest = direction;
    for (int k = 0; k < held.count; ++k) rest -= held.basis.col(k).dot(direction) * held.basis.col(k);
    const Real length = rest.norm();
    if (held.count == Dim || length < 1e-6) return;
    rest /= length;
    // direction . v = direction . velocity, of which the part along the others is given.
    const Real wanted = (direction.dot(velocity) - direction.dot(held.velocity)) / length;
    held.owner[held.count] = static_cast<int>(contact);
    held.basis.col(held.count++) = rest;
    held.velocity += wanted * rest;
  };
  for (std::size_t c = first; c < last; ++c) {
    const auto& [demand, row, motion, friction] = contacts_[c];
    if (motion == Motion::open) continue;
    if (demand.contact.condition == ContactCondition::sticky) {
      for (int a = 0; a < Dim; ++a)
        if (demand.directions[a]) hold(c, Vec<Dim>::Unit(a), demand.velocity);
      continue;
    }
    hold(c, demand.normal, demand.velocity);
    if (motion == Motion::sticks)
      for (int a = 0; a < Dim; ++a) hold(c, Vec<Dim>::Unit(a), demand.velocity);
  }
  return held;
}

template <int Dim>
void ContactStates<Dim>::apply(ImplicitSystem<Dim>& system) const {
  system.clear_constraints();
  for_nodes([&](std::size_t first, std::size_t last) {
    const Held h = held(first, last);
    const int row = contacts_[first].row;
    if (h.count > 0) system.constrain(row, h.basis, h.count, h.velocity);
    Vec<Dim> friction = Vec<Dim>::Zero();
    for (std::size_t c = first; c < last; ++c)
      if (contacts_[c].motion == Motion::slides) friction += contacts_[c].friction;
    system.set_load(row, friction);
  });
}

template <int Dim>
GlobalIndex ContactStates<Dim>::update(const ImplicitSystem<Dim>& system, const Communicator& communicator,
                                       int pass) {
  constexpr int early_passes = 3;
  Real largest = 0, fastest = 0;
  for (const Touch& c : contacts_) {
    largest = std::max(largest, system.reaction(c.row).norm());
    fastest = std::max(fastest, (system.velocity(c.row) - c.demand.velocity).norm());
  }
  std::vector<Real> scales = {largest, fastest};
  communicator.max(scales);
  const Real impulse_tolerance = 1e-6 * scales[0], speed_tolerance = 1e-9 * scales[1];
  GlobalIndex changes = 0;
  for (Touch& c : contacts_) {
    const Contact& contact = c.demand.contact;
    if (contact.condition == ContactCondition::sticky) continue;
    const Vec<Dim>& n = c.demand.normal;
    const Vec<Dim> impulse = system.reaction(c.row), relative = system.velocity(c.row) - c.demand.velocity;
    const Motion before = c.motion;
    const Vec<Dim> friction_before = c.friction;
    const Real push = n.dot(impulse);
    if (c.motion == Motion::open) {
      if (n.dot(relative) < -speed_tolerance) c.motion = Motion::slides;
    } else if (contact.condition == ContactCondition::separate && push < -impulse_tolerance) {
      c.motion = Motion::open;
    } else if (contact.friction > 0) {
      const Real most = contact.friction * std::abs(push);
      if (c.motion == Motion::sticks) {
        const Vec<Dim> tangential = impulse - push * n;
        if (tangential.norm() > most + impulse_tolerance) {
          c.motion = Motion::slides;
          c.friction = most / tangential.norm() * tangential;
        }
      } else {
        const Vec<Dim> slip = relative - n.dot(relative) * n;
        // Friction that would turn the slip round: it sticks, or is less.
        if (c.friction.dot(slip) > 0) {
          if (pass < early_passes) {
            c.motion = Motion::sticks;
          } else {
            c.friction *= 0.5;
          }
        } else if (slip.norm() > speed_tolerance) {
          c.friction = -most / slip.norm() * slip;
        }
      }
    }
    if (c.motion != Motion::slides) c.friction.setZero();
    if (c.motion != before || (c.friction - friction_before).norm() > 1e-3 * scales[0]) ++changes;
  }
  return changes;
}

template <int Dim>
std::vector<Exchange<Dim>> ContactStates<Dim>::exchanges(const ImplicitSystem<Dim>& system,
                                                         const std::vector<Reaction<Dim>*>& reactions) const {
  std::vector<Exchange<Dim>> sums(reactions.size());
  auto give = [&](const Touch& contact, const Vec<Dim>& impulse) {
    const auto it = std::find(reactions.begin(), reactions.end(), contact.demand.reaction);
    Exchange<Dim>& sum = sums[static_cast<std::size_t>(it - reactions.begin())];
    sum.impulse += impulse;
    sum.work += impulse.dot(system.velocity(contact.row));
  };
  for_nodes([&](std::size_t first, std::size_t last) {
    const Held h = held(first, last);
    for (int k = 0; k < h.count; ++k) {
      const Touch& contact = contacts_[static_cast<std::size_t>(h.owner[k])];
      give(contact, h.basis.col(k).dot(system.reaction(contact.row)) * h.basis.col(k));
    }
    for (std::size_t c = first; c < last; ++c)
      if (contacts_[c].motion == Motion::slides) give(contacts_[c], contacts_[c].friction);
  });
  return sums;
}

template class ContactStates<2>;
template class ContactStates<3>;

}  // namespace mpm
