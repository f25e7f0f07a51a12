// Volumes of imported particles whose file gives none.
#pragma once

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// V_p = m_p h^d / sum_i m_i w_ip with equal masses (physics.md section 1), and the masses that follow from the
// material's density. Collective; the particles are sorted.
template <int Dim>
void volumes_from_grid_density(State<Dim>& state, std::size_t body);

}  // namespace mpm
