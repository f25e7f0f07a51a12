// The plain explicit step that the production step is measured against: one particle at a time, Eigen, a dense
// grid, double precision, no sorting. What one would write first.
#pragma once

#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <vector>

#include "mpm_hpc/transfer/reference_transfer.hpp"

namespace mpm {

enum class PlainLaw { neo_hookean, split_neo_hookean, fixed_corotated };

// The laws written plainly from their equations; see the files of their names in materials/.
struct ReferenceMaterial {
  Real mu = 0, lambda = 0;  // [Pa]
  PlainLaw law = PlainLaw::neo_hookean;

  template <int Dim>
  Mat<Dim> kirchhoff_stress(const Mat<Dim>& F) const {
    const Mat<Dim> b = F * F.transpose(), identity = Mat<Dim>::Identity();
    const Real J = F.determinant();
    if (law == PlainLaw::fixed_corotated) {
      const Eigen::JacobiSVD<Mat<Dim>> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
      const Mat<Dim> R = svd.matrixU() * svd.matrixV().transpose();
      return 2 * mu * (F - R) * F.transpose() + lambda * (J - 1) * J * identity;
    }
    if (law == PlainLaw::neo_hookean) return mu * (b - identity) + lambda * std::log(J) * identity;
    const Mat<Dim> deviator = b - b.trace() / Dim * identity;
    return mu * std::pow(J, -2.0 / Dim) * deviator + bulk_modulus<Dim>() / 2 * (J * J - 1) * identity;
  }
  // The part of split_neo_hookean's energy that drives cracks.
  template <int Dim>
  Real energy_plus(const Mat<Dim>& F) const {
    const Real J = F.determinant();
    const Real shape = mu / 2 * (std::pow(J, -2.0 / Dim) * F.squaredNorm() - Dim);
    return J < 1 ? shape : shape + bulk_modulus<Dim>() / 2 * ((J * J - 1) / 2 - std::log(J));
  }
  template <int Dim>
  Real bulk_modulus() const {
    return lambda + 2 * mu / Dim;
  }
};

template <class Kernel, int Dim>
class ReferenceSimulation {
 public:
  ReferenceSimulation(const GridGeometry<Dim>& geometry, std::vector<ReferenceParticle<Dim>> particles,
                      const ReferenceMaterial& material)
      : geometry_(geometry), particles_(std::move(particles)), material_(material), grid_(geometry) {}

  void step(Real dt) {
    for (ReferenceParticle<Dim>& p : particles_) p.tau = material_.kirchhoff_stress<Dim>(p.F);
    grid_.clear();
    reference_particle_to_grid<Kernel>(geometry_, particles_, dt, grid_);
    for (std::size_t i = 0; i < grid_.mass.size(); ++i)
      if (grid_.mass[i] > 0) grid_.momentum[i] /= grid_.mass[i];
    reference_grid_to_particle<Kernel>(geometry_, grid_, dt, particles_);
  }

  // Sends the particles back where they came from.
  void reverse() {
    for (ReferenceParticle<Dim>& p : particles_) {
      p.v = -p.v;
      p.C = -p.C;
    }
  }

  const std::vector<ReferenceParticle<Dim>>& particles() const { return particles_; }

 private:
  GridGeometry<Dim> geometry_;
  std::vector<ReferenceParticle<Dim>> particles_;
  ReferenceMaterial material_;
  ReferenceGrid<Dim> grid_;
};

}  // namespace mpm
