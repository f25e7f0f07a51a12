// What a material reads and writes of its particles: pointers to the columns of one body.
#pragma once

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/simd.hpp"

namespace mpm {

// A column that a law keeps for itself, one number per particle; bodies of other materials don't have it.
struct OwnColumn {
  const char* name;
  const char* units;  // "1" for pure numbers
  Real initial = 0;   // value of a new particle
};

inline constexpr int max_own_columns = 2;
// Guards of one law whose actions are counted.
inline constexpr int max_material_guards = 3;

// Columns by component, row-major, every pointer aligned to a cache line. What the body doesn't have is null.
template <int Dim, class T>
struct MaterialColumns {
  T* F[Dim * Dim] = {};                        // deformation gradient; a fluid has none
  const T* velocity_gradient[Dim * Dim] = {};  // d v_i / d x_j [1/s]
  T* own[max_own_columns] = {};                // as Material::own_columns() lists them
  const T* volume = nullptr;                   // V0 [m^3]
  const T* phase = nullptr;                    // c: 1 intact, 0 broken; null: undamaged
  Real residual = 0;                           // r of g = (1 - r) c^2 + r, which scales what drives cracks
};

// g of the particles from p on.
template <class S, int Dim, class T>
inline S degradation(const MaterialColumns<Dim, T>& columns, Index p) {
  const S c = load<S>(columns.phase + p);
  return broadcast<S>(1 - columns.residual) * c * c + broadcast<S>(columns.residual);
}

}  // namespace mpm
