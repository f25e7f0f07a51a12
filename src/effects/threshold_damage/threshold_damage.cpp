#include "mpm_hpc/effects/threshold_damage/threshold_damage.hpp"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/body_names.hpp"
#include "mpm_hpc/effects/material_columns.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

namespace {

constexpr const char* dissipated = "damage_dissipation";
constexpr Real broken = 0.1;  // c below which a particle counts as broken

}  // namespace

template <int Dim>
ThresholdDamage<Dim>::ThresholdDamage(Parameters& p) : where_(p.where()), where_bodies_(p.where("bodies")) {
  p.real("strength", strength_,
         {.unit = "Pa",
          .min = 0,
          .min_exclusive = true,
          .required = true,
          .doc = "Largest principal Cauchy stress sigma_f past which a particle is damaged."});
  p.real("softening", softening_,
         {.min = 0,
          .min_exclusive = true,
          .doc = "H_s in c = 1 - H_s (1 - sigma_f/sigma): c is 0 at sigma = sigma_f H_s/(H_s - 1), and never "
                 "for H_s <= 1."});
  p.real("residual", residual_,
         {.min = 0,
          .max = 1,
          .max_exclusive = true,
          .doc = "Share r of the tensile stiffness that a broken particle keeps."});
  p.text_list("bodies", body_names_, {.doc = "Names of the bodies that can be damaged. Default: all."});
}

template <int Dim>
std::string ThresholdDamage<Dim>::explain() const {
  return fmt::format("threshold_damage: from {:.6g} Pa on, H_s = {:.6g}, r = {:.3g}", strength_, softening_,
                     residual_);
}

template <int Dim>
void ThresholdDamage<Dim>::declare_fields(State<Dim>& state) {
  damaged_ = named_bodies(state, body_names_, where_bodies_);
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    require(state.degradation[b].phase == no_field,
            "{}: effect.threshold_damage and effect.phase_field can't both weaken a scene's stress; take one "
            "of them out.",
            where_);
    if (damaged_[b])
      require_ability(state.material_of(b), MaterialAbility::split_energy, "effect.threshold_damage");
  }
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    if (!damaged_[b]) continue;
    const FieldId phase = state.bodies[b].particles.add(
        {.name = "phase", .units = "1", .type = real_type(state.precision), .in_output = true, .initial = 1});
    state.degradation[b] = {phase, residual_};
  }
  state.ledger[dissipated];
}

template <int Dim>
void ThresholdDamage<Dim>::join(StepHooks<Dim>& hooks) {
  hooks.before_p2g.push_back([this](State<Dim>& state) { update(state); });
}

template <int Dim>
void ThresholdDamage<Dim>::update(State<Dim>& state) {
  for (std::size_t b = 0; b < state.bodies.size(); ++b)
    if (damaged_[b])
      with_precision(state.precision, [&](auto zero) { update_body<decltype(zero)>(state, b); });
}

template <int Dim>
template <class T>
void ThresholdDamage<Dim>::update_body(State<Dim>& state, std::size_t body_number) {
  using S = Pack<T>;
  constexpr int components = SymTensor<T, Dim>::size, W = pack_width<T>;
  const Body<Dim>& body = state.bodies[body_number];
  const Material<Dim>& material = state.material_of(body_number);
  const FieldSet& f = body.particles;
  MaterialColumns<Dim, T> columns = material_columns<T>(state, body_number);
  columns.phase = nullptr;  // the stress of the undamaged material
  const T* const* F = columns.F;
  T* phase = f.template data<T>(state.degradation[body_number].phase);
  const T* volume = f.template data<T>(core::volume);
  alignas(64) T storage[components][chunk_particles];
  T* tau[components];
  for (int c = 0; c < components; ++c) tau[c] = storage[c];
  alignas(64) T energy[chunk_particles];
  Real lost = 0;
  for (const BlockRange& range : body.ranges)
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      material.stress(columns, begin, end, tau);
      bool has_energy = false;
      for (Index p = begin; p < end; p += W) {
        SymTensor<S, Dim> t;
        for (int c = 0; c < components; ++c) t.m[c] = load<S>(tau[c] + (p - begin));
        // Most particles are far below the strength, which a bound of the eigenvalue shows for whole packs.
        const S excess =
            largest_eigenvalue_bound(t) - static_cast<T>(strength_) * determinant(load_tensor<S, Dim>(F, p));
        if (excess.maxCoeff() <= 0) continue;
        for (Index lane = p; lane < p + W; ++lane) {
          Mat<Dim> sigma;
          Tensor<Real, Dim> deformation;
          for (int a = 0; a < Dim; ++a)
            for (int b = 0; b < Dim; ++b) {
              sigma(a, b) = storage[SymTensor<T, Dim>::index(a, b)][lane - begin];
              deformation(a, b) = F[a * Dim + b][lane];
            }
          sigma /= determinant(deformation);
          Eigen::SelfAdjointEigenSolver<Mat<Dim>> eigen;
          eigen.computeDirect(sigma, Eigen::EigenvaluesOnly);
          const Real largest = eigen.eigenvalues()[Dim - 1];
          if (!(largest > strength_)) continue;
          const Real before = phase[lane], after = std::min(before, phase_at(largest));
          if (!(after < before)) continue;
          phase[lane] = static_cast<T>(after);
          if (!has_energy) material.energy_plus(columns, begin, end, energy);
          has_energy = true;
          lost += volume[lane] * energy[lane - begin] * (1 - residual_) * (before * before - after * after);
        }
      }
    }
  state.ledger[dissipated] += lost;
}

template <int Dim>
void ThresholdDamage<Dim>::history(State<Dim>& state, std::vector<HistoryValue>& row) {
  Real broken_volume = 0, volume = 0, smallest = 1;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (std::size_t b = 0; b < state.bodies.size(); ++b) {
      if (!damaged_[b]) continue;
      const FieldSet& f = state.bodies[b].particles;
      const T *V = f.template data<T>(core::volume), *c = f.template data<T>(state.degradation[b].phase);
      for (Index p = 0; p < f.size(); ++p) {
        volume += V[p];
        if (c[p] < static_cast<T>(broken)) broken_volume += V[p];
        smallest = std::min(smallest, static_cast<Real>(c[p]));
      }
    }
  });
  const Real total = state.communicator().sum(volume);
  row.push_back({"fracture_energy", "J", state.ledger[dissipated]});
  row.push_back({"broken_fraction", "1", total > 0 ? broken_volume / total : 0});
  row.push_back({"min_phase", "1", smallest, HistoryValue::Kind::min});
}

template class ThresholdDamage<2>;
template class ThresholdDamage<3>;

}  // namespace mpm
