#include "mpm_hpc/effects/effect_list.hpp"

#include "mpm_hpc/effects/body_force/body_force.hpp"
#include "mpm_hpc/effects/gravity/gravity.hpp"
#include "mpm_hpc/effects/grips/grip.hpp"
#include "mpm_hpc/effects/obstacles/obstacle.hpp"
#include "mpm_hpc/effects/phase_field/phase_field.hpp"
#include "mpm_hpc/effects/threshold_damage/threshold_damage.hpp"
#include "mpm_hpc/effects/traction/traction.hpp"
#include "mpm_hpc/effects/walls/walls.hpp"

namespace mpm {

namespace {

template <class E, int Dim>
EffectEntry<Dim> once(const char* key, const char* doc) {
  return {key, doc, false, [](Parameters& p) { return std::make_unique<E>(p); }};
}
template <class E, int Dim>
EffectEntry<Dim> several(const char* key, const char* doc) {
  return {key, doc, true, [](Parameters& p) { return std::make_unique<E>(p); }};
}

}  // namespace

template <int Dim>
std::vector<EffectEntry<Dim>> effect_list() {
  return {
      once<Gravity<Dim>, Dim>("gravity", "Constant acceleration of every particle."),
      once<BodyForce<Dim>, Dim>("body_force", "Force on all material, given by formulas of place and time."),
      several<Traction<Dim>, Dim>("traction", "Force per area on the surface layer of a body."),
      once<PhaseField<Dim>, Dim>("phase_field", "Phase-field fracture of bodies whose material has a toughness."),
      once<ThresholdDamage<Dim>, Dim>("threshold_damage",
                                      "Damage of each particle by itself past a largest principal stress."),
      once<Walls<Dim>, Dim>("walls", "Conditions on the sides of the domain."),
      several<Obstacle<Dim>, Dim>("obstacle", "Rigid obstacle given by a shape, at rest or moving."),
      several<Grip<Dim>, Dim>("grip", "Region whose material moves with a prescribed velocity."),
  };
}

template <int Dim>
std::vector<std::unique_ptr<Effect<Dim>>> read_effects(Parameters& root, const std::vector<EffectEntry<Dim>>& list) {
  std::vector<std::unique_ptr<Effect<Dim>>> effects;
  root.section("effect", SectionOptions("Effects; one that isn't named here costs nothing."), [&](Parameters& table) {
    for (const EffectEntry<Dim>& entry : list) {
      if (!table.has(entry.key)) {
        // Declared all the same, so that a misspelt neighbour is told what it may be.
        if (!entry.several) table.section(entry.key, SectionOptions(entry.doc.c_str()), [](Parameters&) {});
        continue;
      }
      if (entry.several) {
        table.section_list(entry.key, SectionOptions(entry.doc.c_str()),
                           [&](Parameters& p, int) { effects.push_back(entry.read(p)); });
      } else {
        table.section(entry.key, SectionOptions(entry.doc.c_str()), [&](Parameters& p) { effects.push_back(entry.read(p)); });
      }
    }
  });
  return effects;
}

template std::vector<EffectEntry<2>> effect_list<2>();
template std::vector<EffectEntry<3>> effect_list<3>();
template std::vector<std::unique_ptr<Effect<2>>> read_effects<2>(Parameters&, const std::vector<EffectEntry<2>>&);
template std::vector<std::unique_ptr<Effect<3>>> read_effects<3>(Parameters&, const std::vector<EffectEntry<3>>&);

}  // namespace mpm
