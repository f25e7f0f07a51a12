// Particles inside of a shape, on a lattice or scattered, the same for any number of ranks.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/shape.hpp"
#include "mpm_hpc/scene/poisson_tile.hpp"

namespace mpm {

class Parameters;

enum class Sampling { lattice, poisson_disk };

template <int Dim>
struct SeedingOptions {
  Vec<Dim> origin = Vec<Dim>::Zero();  // a corner of a grid cell [m]
  Real spacing = 0;                    // edge of a grid cell [m]
  Sampling sampling = Sampling::lattice;
  int particles_per_cell = 1 << Dim;  // on a lattice a perfect square in 2D, cube in 3D
  Real jitter = 0;                     // largest shift per direction over the edge of a sub-cell, 0 to 0.5
  std::uint64_t seed = 0;
  // Where particles may be; needed if the shape is unbounded.
  BoundingBox<Dim> domain = BoundingBox<Dim>::everything();
};

// Declares particles_per_cell, sampling and jitter, the options that belong to a body.
template <int Dim>
void declare_seeding(Parameters& p, SeedingOptions<Dim>& options);

// Lattice: that of sub-cell centres of the cells that the shape's bounds meet. A particle exists if its lattice
// point is inside before the jitter; a lattice point on the surface counts to the solid on its upper side, so
// that bodies that touch neither share nor lose one. The jitter hashes the seed with the point's place in the
// lattice. Poisson disk: the points of a periodic tile that lie inside.
template <int Dim>
class Seeding {
 public:
  // Throws UserError for an unbounded shape, a spacing <= 0 or a number of particles that is no power.
  Seeding(Shape<Dim> shape, const SeedingOptions<Dim>& options);

  GlobalIndex cells() const;
  // First cell of part r of P: rank r seeds particles(first_cell(r, P), first_cell(r + 1, P)).
  GlobalIndex first_cell(int part, int parts) const;
  // In the order of the cells, first direction fastest, then of the sub-cells.
  std::vector<Vec<Dim>> particles(GlobalIndex begin_cell, GlobalIndex end_cell) const;
  // Of space over particles [m^Dim].
  Real particle_volume() const { return volume_; }
  // Volume of the part of the shape in these cells [m^Dim]: exact where a cell is whole, else from a fine lattice.
  Real shape_volume(GlobalIndex begin_cell, GlobalIndex end_cell) const;

 private:
  using LatticePoint = Eigen::Matrix<std::int64_t, Dim, 1>;

  // Half the diagonal of a cell, with room for the shift that decides ties [m].
  Real cell_radius() const;
  // Calls f(cell, its centre's distance from the shape) for the cells that are not wholly outside.
  template <class F>
  void for_cells(GlobalIndex begin_cell, GlobalIndex end_cell, F&& f) const;
  Vec<Dim> jittered(const Vec<Dim>& x, const LatticePoint& sub_cell) const;

  Shape<Dim> shape_;
  SeedingOptions<Dim> options_;
  int per_direction_ = 1;  // on a lattice
  Real volume_;
  std::shared_ptr<const PoissonTile<Dim>> tile_;
  LatticePoint lower_;   // first cell
  LatticePoint counts_;  // cells per direction
};

// The Dim-th root of particles_per_cell; throws UserError that names the nearest valid numbers.
template <int Dim>
int particles_per_direction(int particles_per_cell);

}  // namespace mpm
