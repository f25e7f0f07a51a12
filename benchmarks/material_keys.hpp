// Every model and rule of the scenes, as keys of a material's table.
#pragma once

#include <string>
#include <vector>

namespace mpm {

struct MaterialKeys {
  std::string name, keys;  // keys without the density
};

// Of the stiffness of the elastic block, with limits at a tenth of its strain; neo_hookean comes first.
inline std::vector<MaterialKeys> material_keys() {
  const std::string elastic = "youngs_modulus = 1e6\npoisson_ratio = 0.3\n", fluid = "bulk_modulus = 1e6\n",
                    yield = "plasticity.yield_stress = 2e3\n",
                    limits = "plasticity.critical_compression = 0.002\nplasticity.critical_stretch = 0.002\n",
                    ellipse =
                        "plasticity.friction_angle = 0.7\nplasticity.cohesion = 0.5\n"
                        "plasticity.initial_plastic_volume = 0.999\n";
  std::vector<MaterialKeys> cases;
  // The name is MODEL or MODEL+RULE.
  const auto add = [&cases](const std::string& name, const std::string& keys) {
    const std::size_t plus = name.find('+');
    std::string text = "model = \"" + name.substr(0, plus) + "\"\n" + keys;
    if (plus != std::string::npos) text += "plasticity.model = \"" + name.substr(plus + 1) + "\"\n";
    cases.push_back({name, text});
  };
  for (const char* model :
       {"neo_hookean", "split_neo_hookean", "fixed_corotated", "hencky", "linear_elastic"})
    add(model, elastic);
  add("snow", elastic + "critical_compression = 0.002\ncritical_stretch = 0.002\n");
  for (const char* model : {"linear_fluid", "tait_fluid", "lazy_liquid"}) add(model, fluid);
  cases.push_back({"viscous_fluid", "model = \"linear_fluid\"\n" + fluid + "viscosity = 1\n"});
  for (const std::string model : {"hencky", "split_neo_hookean"}) {
    add(model + "+tresca", elastic + yield);
    add(model + "+von_mises", elastic + yield + "plasticity.hardening_modulus = 1e4\n");
    add(model + "+clamped_stretches", elastic + limits);
  }
  add("fixed_corotated+clamped_stretches", elastic + limits);
  add("hencky+drucker_prager", elastic + "plasticity.friction_angle = 0.5\n");
  add("hencky+modified_cam_clay", elastic + ellipse);
  add("split_neo_hookean+nacc", elastic + ellipse);
  return cases;
}

}  // namespace mpm
