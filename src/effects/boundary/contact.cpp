#include "mpm_hpc/effects/boundary/contact.hpp"

#include <algorithm>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

ContactCondition contact_condition(const std::string& name) {
  const auto& names = contact_condition_names;
  const auto found = std::find(names.begin(), names.end(), name);
  debug_check(found != names.end(), "unknown contact condition");
  return static_cast<ContactCondition>(found - names.begin());
}

std::string Contact::describe() const {
  const std::string& name = contact_condition_names[static_cast<int>(condition)];
  return friction > 0 ? fmt::format("{} with friction {:.6g}", name, friction) : name;
}

Contact read_contact(Parameters& p) {
  Contact contact;
  std::string condition = "sticky";
  p.choice("condition", condition, contact_condition_names,
           "sticky: no relative motion; slip: none along the normal; separate: as slip, but free to leave.");
  p.real("friction", contact.friction,
         {.min = 0, .doc = "Coulomb's friction coefficient, for slip and separate."});
  contact.condition = contact_condition(condition);
  if (contact.condition == ContactCondition::sticky && contact.friction > 0)
    p.error_at("friction",
               "friction has no effect on a sticky surface; choose condition = \"slip\" or \"separate\", or "
               "drop it.");
  return contact;
}

}  // namespace mpm
