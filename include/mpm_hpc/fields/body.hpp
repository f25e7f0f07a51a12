// A body: particles of one material, sorted by grid block.
#pragma once

#include <string>
#include <vector>

#include "mpm_hpc/fields/block_topology.hpp"
#include "mpm_hpc/fields/field_set.hpp"
#include "mpm_hpc/math/simd.hpp"

namespace mpm {

// Columns that every body has, in the order in which they are declared. Those that its material keeps for itself follow.
namespace core {
inline constexpr FieldId id = 0;                    // global identity; negative marks padding
inline constexpr FieldId position = 1;              // x [m], always double
inline constexpr FieldId velocity = 2;              // v [m/s]
inline constexpr FieldId velocity_gradient = 3;     // C [1/s], row-major
inline constexpr FieldId deformation_gradient = 4;  // F, row-major
inline constexpr FieldId mass = 5;                  // m [kg]
inline constexpr FieldId volume = 6;                // V0, initial volume [m^3]
inline constexpr int count = 7;
}  // namespace core

inline constexpr GlobalIndex padding_id = -1;

// Particles [begin, end) lie in the block of this slot; both are multiples of the pack width.
struct BlockRange {
  Slot slot;
  Index begin, end;
};

// Which of the columns that not every body needs it has; the others have no components and no bytes.
struct BodyColumns {
  bool velocity_gradient = true, deformation_gradient = true;
};

template <int Dim>
struct Body {
  std::string name;
  int material = 0;
  FieldSet particles;
  std::vector<BlockRange> ranges;  // in the order of the blocks' keys
  // Numbers of the ranges whose stencils reach ghosts, and of those that don't.
  std::vector<int> boundary, interior;

  FieldId velocity_modes = no_field;  // of the PolyPIC transfer [m/s]

  Body(std::string body_name, int material_number, Precision precision, const BodyColumns& columns = {});

  bool is_padding(Index p) const { return particles.template data<GlobalIndex>(core::id)[p] < 0; }
  Index real_particles() const;
};

// Particles that the kernels handle in one run: the scratch of their stages and the tile stay in L1.
inline constexpr int chunk_particles = 64;

// Particles per pack, to which each block's range is padded.
inline int padding_width(Precision p) {
  return p == Precision::single_precision ? pack_width<float> : pack_width<double>;
}

}  // namespace mpm
