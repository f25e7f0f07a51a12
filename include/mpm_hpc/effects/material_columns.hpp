// The columns of a body that its material works on.
#pragma once

#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// Adds the columns that a material keeps for itself; they stand right behind those of the core.
template <int Dim>
void add_own_columns(const Material<Dim>& material, Precision precision, FieldSet& particles) {
  for (const OwnColumn& column : material.own_columns())
    particles.add({.name = column.name,
                   .units = column.units,
                   .type = real_type(precision),
                   .in_output = true,
                   .initial = column.initial});
}

template <class T, int Dim>
MaterialColumns<Dim, T> material_columns(const State<Dim>& state, std::size_t body) {
  const FieldSet& fields = state.bodies[body].particles;
  MaterialColumns<Dim, T> columns;
  for (int c = 0; c < Dim * Dim; ++c) {
    if (fields.has(core::deformation_gradient))
      columns.F[c] = fields.template data<T>(core::deformation_gradient, c);
    if (fields.has(core::velocity_gradient))
      columns.velocity_gradient[c] = fields.template data<T>(core::velocity_gradient, c);
  }
  const int own = static_cast<int>(state.material_of(body).own_columns().size());
  for (int k = 0; k < own; ++k) columns.own[k] = fields.template data<T>(core::count + k);
  columns.volume = fields.template data<T>(core::volume);
  const Degradation& degradation = state.degradation[body];
  if (degradation.phase != no_field) columns.phase = fields.template data<T>(degradation.phase);
  columns.residual = degradation.residual;
  return columns;
}

}  // namespace mpm
