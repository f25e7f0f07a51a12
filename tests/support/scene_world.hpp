// The state of a scene given as text, with its particles, and the effects' share of a step without mechanics.
#pragma once

#include <fmt/format.h>

#include "mpm_hpc/effects/effect_list.hpp"
#include "mpm_hpc/scene/scene.hpp"
#include "mpm_hpc/simulation/setup.hpp"

namespace mpm::test {

template <int Dim>
class SceneWorld {
 public:
  explicit SceneWorld(const std::string& text, const std::vector<EffectEntry<Dim>>& effects = effect_list<Dim>(),
                      const std::vector<std::string>& overrides = {}) {
    Parameters parameters = Parameters::read_text(text, "scene.toml", overrides);
    read_dimension(parameters);
    scene = read_scene<Dim>(parameters, effects);
    declare_state(Communicator::world(), scene, state);
    hooks = join_effects(scene);
    integrator = make_integrator(scene, state, hooks);
    create_particles(scene, state);
  }
  SceneWorld(const SceneWorld&) = delete;
  SceneWorld& operator=(const SceneWorld&) = delete;

  // The hooks between P2G and G2P with both halo exchanges, in the integrator's order; the particles don't move.
  void run_effects() {
    std::vector<FieldId> summed, filled;
    for (FieldId f = 0; f < state.fields.count(); ++f) {
      if (state.fields.traits(f).sums_ghosts) summed.push_back(f);
      if (state.fields.traits(f).fills_ghosts) filled.push_back(f);
    }
    for (const auto& hook : hooks.before_p2g) hook(state);
    for (FieldId f : summed) state.fields.zero(f);
    run_ranges(hooks.on_p2g);
    state.halo().sum(state.fields, summed);
    for (const auto* stage : {&hooks.on_grid, &hooks.end_of_grid, &hooks.after_grid})
      for (const auto& hook : *stage) hook(state);
    state.halo().fill(state.fields, filled);
    run_ranges(hooks.on_g2p);
  }

  // This rank's parts of the effects' history columns, by name.
  std::map<std::string, Real> history() {
    std::vector<HistoryValue> row;
    for (auto& effect : scene.effects) effect->history(state, row);
    std::map<std::string, Real> values;
    for (const HistoryValue& v : row) values[v.name] = v.value;
    return values;
  }

  FieldId grid_field(const std::string& name) const {
    for (FieldId f = 0; f < state.fields.count(); ++f)
      if (state.fields.traits(f).name == name) return f;
    throw std::logic_error("there is no grid field " + name);
  }

  // f(body, particle) for this rank's particles without padding.
  template <class F>
  void for_particles(F&& f) {
    for (auto& body : state.bodies)
      for (Index p = 0; p < body.particles.size(); ++p)
        if (!body.is_padding(p)) f(body, p);
  }

  Scene<Dim> scene;
  State<Dim> state;
  StepHooks<Dim> hooks;
  std::unique_ptr<Integrator<Dim>> integrator;

 private:
  void run_ranges(const std::vector<typename StepHooks<Dim>::RangeHook>& stage) {
    for (const auto& hook : stage)
      for (std::size_t b = 0; b < state.bodies.size(); ++b) {
        hook(state, b, state.bodies[b].boundary);
        hook(state, b, state.bodies[b].interior);
      }
  }
};

}  // namespace mpm::test
