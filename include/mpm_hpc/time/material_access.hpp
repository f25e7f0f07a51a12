// Joins a body's columns to its material: the stress that P2G asks for and what becomes of the particles that G2P moved.
#pragma once

#include <cmath>

#include "mpm_hpc/effects/material_columns.hpp"

namespace mpm {

template <int Dim, class T>
class MaterialStress final : public StressSource<Dim, T> {
 public:
  MaterialStress(const State<Dim>& state, std::size_t body)
      : material_(state.material_of(body)), columns_(material_columns<T>(state, body)) {}
  void kirchhoff_stress(Index begin, Index end, T* const* tau) const override {
    material_.stress(columns_, begin, end, tau);
  }

 private:
  const Material<Dim>& material_;
  MaterialColumns<Dim, T> columns_;
};

// Deforms a body's particles after they have moved and keeps the limits of the next step.
template <int Dim, class T>
class MaterialAdvance final : public UpdateSink<Dim, T> {
 public:
  MaterialAdvance(State<Dim>& state, std::size_t body)
      : material_(state.material_of(body)),
        columns_(material_columns<T>(state, body)),
        state_(state),
        step_{state.dt, state.deformation_update} {}
  ~MaterialAdvance() override {
    if (material_.plasticity()) state_.ledger["plastic_work"] += plastic_work_;
    const std::vector<const char*> names = material_.guards();
    for (std::size_t k = 0; k < names.size(); ++k) state_.guards[names[k]] += guards_[k];
  }
  MaterialAdvance(const MaterialAdvance&) = delete;
  MaterialAdvance& operator=(const MaterialAdvance&) = delete;

  void updated(Index begin, Index end, const KinematicLimits& kinematic, const T* const* gradient) override {
    const MaterialUpdate update = material_.advance(columns_, gradient, step_, begin, end);
    plastic_work_ += update.plastic_work;
    for (int k = 0; k < max_material_guards; ++k) guards_[k] += update.guards[k];
    include(kinematic, update.limits);
  }
  // The limits of particles that stay as they are.
  void measure(Index begin, Index end, const KinematicLimits& kinematic) {
    include(kinematic, material_.limits(columns_, begin, end));
  }

 private:
  void include(const KinematicLimits& kinematic, const MaterialLimits& material) {
    StepLimits& limits = state_.limits;
    const Real density = material_.density();
    limits.kinematic.include(kinematic);
    limits.signal_speed = std::max(limits.signal_speed, kinematic.speed + std::sqrt(material.wave_modulus / density));
    limits.stiffness_speed = std::max(limits.stiffness_speed, std::sqrt(material.stiffness / density));
    limits.min_jacobian = std::min(limits.min_jacobian, material.min_jacobian);
    limits.viscosity = std::max(limits.viscosity, material.viscosity / density);
  }

  const Material<Dim>& material_;
  MaterialColumns<Dim, T> columns_;
  State<Dim>& state_;
  DeformationStep step_;
  Real plastic_work_ = 0;
  GlobalIndex guards_[max_material_guards] = {};
};

}  // namespace mpm
