// Joins a body's columns to its material: the stress that P2G asks for and the limits that G2P collects.
#pragma once

#include <cmath>

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

template <int Dim, class T>
struct DeformationColumns {
  const T* F[Dim * Dim];
  explicit DeformationColumns(const FieldSet& fields) {
    for (int c = 0; c < Dim * Dim; ++c) F[c] = fields.template data<T>(core::deformation_gradient, c);
  }
};

template <int Dim, class T>
class MaterialStress final : public StressSource<Dim, T> {
 public:
  MaterialStress(const State<Dim>& state, std::size_t body)
      : material_(state.material_of(body)), columns_(state.bodies[body].particles) {
    const Degradation& degradation = state.degradation[body];
    residual_ = degradation.residual;
    if (degradation.phase != no_field)
      phase_ = state.bodies[body].particles.template data<T>(degradation.phase);
  }
  void kirchhoff_stress(Index begin, Index end, T* const* tau) const override {
    material_.stress(columns_.F, phase_, static_cast<T>(residual_), begin, end, tau);
  }

 private:
  const Material<Dim>& material_;
  DeformationColumns<Dim, T> columns_;
  const T* phase_ = nullptr;
  Real residual_ = 0;
};

// Deforms a body's particles after they have moved and keeps the limits of the next step.
template <int Dim, class T>
class MaterialAdvance final : public UpdateSink<Dim, T> {
 public:
  MaterialAdvance(State<Dim>& state, std::size_t body)
      : material_(state.material_of(body)), limits_(state.limits), dt_(state.dt) {
    for (int c = 0; c < Dim * Dim; ++c)
      F_[c] = state.bodies[body].particles.template data<T>(core::deformation_gradient, c);
  }

  void updated(Index begin, Index end, const KinematicLimits& kinematic, const T* const* gradient) override {
    include(kinematic, material_.advance(F_, gradient, dt_, begin, end));
  }
  // The limits of particles that stay as they are.
  void measure(Index begin, Index end, const KinematicLimits& kinematic) {
    include(kinematic, material_.limits(F_, begin, end));
  }

 private:
  void include(const KinematicLimits& kinematic, const MaterialLimits& material) {
    limits_.kinematic.include(kinematic);
    limits_.signal_speed =
        std::max(limits_.signal_speed, kinematic.speed + std::sqrt(material.wave_modulus / material_.density()));
    limits_.stiffness_speed =
        std::max(limits_.stiffness_speed, std::sqrt(material.stiffness / material_.density()));
    limits_.min_jacobian = std::min(limits_.min_jacobian, material.min_jacobian);
  }

  const Material<Dim>& material_;
  StepLimits& limits_;
  Real dt_;
  T* F_[Dim * Dim];
};

}  // namespace mpm
