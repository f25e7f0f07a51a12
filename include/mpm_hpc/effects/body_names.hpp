// Which bodies an effect acts on, when the scene names some of them.
#pragma once

#include <string>
#include <vector>

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// By body: whether its name is among these, or no name is given. Throws UserError for an unknown name; `where` is the place
// of the list in the scene.
template <int Dim>
std::vector<char> named_bodies(const State<Dim>& state, const std::vector<std::string>& names,
                               const std::string& where);

}  // namespace mpm
