// What a rigid surface does to the velocity of the material that touches it.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/base/types.hpp"

namespace mpm {

enum class ContactCondition { sticky, slip, separate };

struct Contact {
  ContactCondition condition = ContactCondition::sticky;
  Real friction = 0;  // Coulomb's coefficient, on slip and separate

  // The velocity after contact, both relative to the surface; the normal points from the surface to the
  // material (physics.md section 2).
  template <int Dim>
  Vec<Dim> apply(const Vec<Dim>& normal, const Vec<Dim>& velocity) const {
    if (condition == ContactCondition::sticky) return Vec<Dim>::Zero();
    const Real approach = normal.dot(velocity);
    const Real removed = condition == ContactCondition::slip ? approach : std::min(approach, 0.0);
    if (removed == 0) return velocity;
    const Vec<Dim> tangential = velocity - approach * normal;
    const Real speed = tangential.norm();
    const Real kept = speed > 0 ? std::max(0.0, 1 - friction * std::abs(removed) / speed) : 0;
    return (approach - removed) * normal + kept * tangential;
  }

  // "slip with friction 0.3", for --explain.
  std::string describe() const;
};

// The conditions' names in the scene, in the order of the enumeration.
inline const std::vector<std::string> contact_condition_names = {"sticky", "slip", "separate"};

// Throws LogicError for a name that isn't a condition's.
ContactCondition contact_condition(const std::string& name);

// Reads `condition` and `friction`; UserError for friction on a sticky surface.
Contact read_contact(Parameters& p);

}  // namespace mpm
