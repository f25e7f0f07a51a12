// A scene from text that a test moves step by step, looking at the state in between.
#pragma once

#include <fstream>
#include <sstream>

#include "mpm_hpc/simulation/diagnostics.hpp"
#include "support/scene_world.hpp"

namespace mpm::test {

// The text of a scene that is shipped.
inline std::string shipped_scene(const std::string& name) {
  std::ifstream file(std::string(MPM_SOURCE_DIR) + "/apps/scenes/" + name + ".toml");
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

template <int Dim>
class Stepper : public SceneWorld<Dim> {
 public:
  explicit Stepper(const std::string& text, const std::vector<std::string>& overrides = {})
      : SceneWorld<Dim>(text, effect_list<Dim>(), overrides) {}

  // One column of a history row.
  Real value(const std::string& name) {
    for (const HistoryValue& v : history_row(this->state, this->scene.effects))
      if (v.name == name) return v.value;
    throw std::logic_error("history has no column " + name);
  }

  // Steps until `end` [s], which is met exactly; f() after each step.
  template <class F>
  void advance(Real end, F&& f) {
    State<Dim>& state = this->state;
    if (state.step == 0) this->integrator->initialise(state);
    while (state.time < end * (1 - 1e-12)) {
      const Real stable = this->integrator->stable_step(state), left = end - state.time;
      state.dt = left < stable ? left : left < 2 * stable ? left / 2 : stable;
      this->integrator->step(state);
      f();
    }
  }
};

// The table of a transfer scheme; FLIP without PIC.
inline std::string transfer_text(const std::string& scheme) {
  return fmt::format("[transfer]\nscheme = \"{}\"\n{}", scheme, scheme == "flip" ? "flip_blend = 1\n" : "");
}

// Mass-weighted sum over all particles of f(x, v), of all ranks.
template <int Dim, class F>
Real sum_over(Stepper<Dim>& world, F&& f) {
  Real sum = 0;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& set = body.particles;
    Vec<Dim> x, v;
    for (int a = 0; a < Dim; ++a) {
      x[a] = set.template data<Real>(core::position, a)[p];
      v[a] = set.template data<Real>(core::velocity, a)[p];
    }
    sum += set.template data<Real>(core::mass)[p] * f(x, v);
  });
  return world.state.communicator().sum(sum);
}

}  // namespace mpm::test
