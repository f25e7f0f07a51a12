// The one list of effects: a line here and a folder make an effect.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/effects/effect.hpp"

namespace mpm {

// How the scene names an effect and what makes it. `read` gets the effect's own table.
template <int Dim>
struct EffectEntry {
  std::string key;  // [effect.key] or, when it may occur several times, [[effect.key]]
  std::string doc;
  bool several = false;
  std::function<std::unique_ptr<Effect<Dim>>(Parameters&)> read;
};

// In the order in which their hooks run.
template <int Dim>
std::vector<EffectEntry<Dim>> effect_list();

// Builds the effects that the scene names, or describes all of them, from the table [effect].
template <int Dim>
std::vector<std::unique_ptr<Effect<Dim>>> read_effects(Parameters& root, const std::vector<EffectEntry<Dim>>& list);

}  // namespace mpm
