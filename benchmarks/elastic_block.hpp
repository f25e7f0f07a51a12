// The block that the benchmarks move: elastic, in free flight, on the program's own step or the plain one.
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "harness.hpp"
#include "mpm_hpc/effects/phase_field/phase_law.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/scene/scene.hpp"
#include "mpm_hpc/simulation/diagnostics.hpp"
#include "mpm_hpc/simulation/report.hpp"
#include "mpm_hpc/simulation/setup.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "reference_step.hpp"

namespace mpm {

enum class Phase { none, mobility, rate_independent };
// What is broken of a block with a phase field: nothing; a flat crack of two rows of particles half-way through the block, as
// in a plate that tears; or the lower half of its volume, driven a thousand times past breaking.
enum class Damage { intact, cracked, half_broken };

struct BlockCase {
  bool single = false;
  PlainLaw law = PlainLaw::neo_hookean;
  Phase phase = Phase::none;
  int cells = 20;  // per direction
  const char* phase_operator = "auto";
  Damage damage = Damage::intact;  // with a phase field
  bool at_rest = false;            // it stretches without flying, as a plate does
  TransferOptions transfer = {};
  // So soft that it flies as if free, but in the same steps.
  bool slack = false;
  // Keys of the material's table, but for the density, in place of `law`.
  std::string material = {};
};

inline const char* name_of(PlainLaw law) {
  switch (law) {
    case PlainLaw::neo_hookean: return "neo_hookean";
    case PlainLaw::split_neo_hookean: return "split_neo_hookean";
    case PlainLaw::fixed_corotated: return "fixed_corotated";
  }
  return "";
}

inline const char* name_of(Phase phase) {
  switch (phase) {
    case Phase::none: return "elastic";
    case Phase::mobility: return "phase_mobility";
    case Phase::rate_independent: return "phase_rate_independent";
  }
  return "";
}

// An elastic block in free flight that stretches a little. One cell of drift takes about 15 steps.
constexpr Real spacing = 0.01, density = 1000, youngs_modulus = 1e6, poisson_ratio = 0.3;
constexpr Real stretching = 0.02;  // peak speed of the deformation over the wave speed
constexpr Real stretching_at_rest = 5e-4;  // the same of a plate that tears: branching_plate_2d.toml reaches 4e-4
constexpr Real flight = 0.2;       // speed of the flight over the wave speed
constexpr Real cfl = 0.4;
constexpr int free_cells = 8;  // around the block
template <int Dim>
constexpr int particles_per_cell = Dim == 3 ? 8 : 4;

// Blocks by the number of their particles.
struct BlockSize {
  const char* name;
  int cells, dimension;  // cells per direction
};
inline std::vector<BlockSize> block_sizes(const BenchOptions& options) {
  if (options.small) return {{"2k", 6, 3}, {"2d_2k", 22, 2}};
  return {{"64k", 20, 3}, {"512k", 40, 3}, {"2d_64k", 128, 2}, {"2d_512k", 360, 2}};
}

// Calls f with the dimension as a compile-time constant.
void with_dimension(int dimension, auto&& f) {
  if (dimension == 2) {
    f(std::integral_constant<int, 2>());
  } else {
    f(std::integral_constant<int, 3>());
  }
}

struct Elasticity {
  Real mu = youngs_modulus / (2 * (1 + poisson_ratio));
  Real lambda = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  Real wave_speed = std::sqrt((lambda + 2 * mu) / density);
};

// Tough enough that the phase stays near 1 where it is intact; at rest so brittle that it is driven everywhere nevertheless.
inline PhaseLaw phase_law(Phase phase, bool at_rest = false) {
  PhaseLaw law{.length = spacing / 2, .residual = 1e-3, .toughness = (at_rest ? 1e-4 : 0.1) * youngs_modulus * spacing};
  if (phase == Phase::mobility)
    law.inverse_mobility = 1e3 * cfl * spacing / ((1 + flight) * Elasticity().wave_speed);
  return law;
}

// The same number in all directions, or the first ones of a list.
template <int Dim>
std::string in_each_direction(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
}
template <int Dim>
std::string in_each_direction(Real x) {
  return in_each_direction<Dim>(x, x, x);
}

template <int Dim>
std::string scene_text(const BlockCase& c) {
  const Real wave = Elasticity().wave_speed, speed = c.at_rest ? 0 : flight * wave;
  const Real lower = free_cells * spacing, upper = lower + c.cells * spacing, end = upper + free_cells * spacing;
  std::string text = fmt::format(
      "dimension = {}\nprecision = \"{}\"\n"
      "[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {}\nkernel = \"{}\"\n"
      "[transfer]\nscheme = \"{}\"\nforces = \"{}\"\n[time]\nend = 1\n"
      "[material.block]\ndensity = {}\n{}",
      Dim, c.single ? "single" : "double", in_each_direction<Dim>(0), in_each_direction<Dim>(end), spacing,
      c.transfer.kernel_name(), c.transfer.scheme_name(), c.transfer.forces_name(), density,
      c.material.empty() ? fmt::format("model = \"{}\"\nyoungs_modulus = {}\npoisson_ratio = {}\n", name_of(c.law),
                                       c.slack ? 1e-6 * youngs_modulus : youngs_modulus, poisson_ratio)
                         : c.material);
  const PhaseLaw law = phase_law(c.phase, c.at_rest);
  if (c.phase != Phase::none) text += fmt::format("fracture_toughness = {}\n", law.toughness);
  text += fmt::format(
      "[[body]]\nname = \"block\"\nmaterial = \"block\"\nparticles_per_cell = {}\njitter = 0.25\n"
      "velocity = {}\n[body.shape]\ntype = \"box\"\nlower = {}\nupper = {}\n",
      particles_per_cell<Dim>, in_each_direction<Dim>(speed, 0.7 * speed, 0.4 * speed), in_each_direction<Dim>(lower),
      in_each_direction<Dim>(upper));
  if (c.phase != Phase::none)
    text += fmt::format(
        "[effect.phase_field]\nlength_scale = {}\nresidual = {}\ncorrected_toughness = false\noperator = \"{}\"\n", law.length,
        law.residual, c.phase_operator);
  if (c.phase == Phase::mobility) text += fmt::format("mobility = {}\n", 1 / law.inverse_mobility);
  if (c.damage != Damage::intact) {
    const Real middle = (lower + upper) / 2, below = lower - spacing, above = upper + spacing;
    const bool crack = c.damage == Damage::cracked;
    text += fmt::format("[[effect.phase_field.crack]]\nshape = {{type = \"box\", lower = {}, upper = {}}}\n",
                        in_each_direction<Dim>(below, crack ? middle - spacing / 2 : below, below),
                        in_each_direction<Dim>(middle, crack ? middle + spacing / 2 : above, above));
  }
  return text;
}

// Calls f(particles, particle number) for this rank's particles without padding.
template <int Dim, class F>
void for_particles(const State<Dim>& state, F&& f) {
  for (const Body<Dim>& body : state.bodies)
    for (Index p = 0; p < body.particles.size(); ++p)
      if (!body.is_padding(p)) f(body.particles, p);
}

// This rank's particles, one behind the other as plain code keeps them.
template <int Dim>
std::vector<ReferenceParticle<Dim>> reference_particles(const State<Dim>& state) {
  std::vector<ReferenceParticle<Dim>> particles;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_particles(state, [&particles](const FieldSet& f, Index p) {
      ReferenceParticle<Dim>& r = particles.emplace_back();
      for (int a = 0; a < Dim; ++a) {
        r.x[a] = f.template data<Real>(core::position, a)[p];
        r.v[a] = f.template data<T>(core::velocity, a)[p];
        for (int b = 0; b < Dim; ++b) {
          r.C(a, b) = f.template data<T>(core::velocity_gradient, Dim * a + b)[p];
          r.F(a, b) = f.template data<T>(core::deformation_gradient, Dim * a + b)[p];
        }
      }
      r.mass = f.template data<T>(core::mass)[p];
      r.volume = f.template data<T>(core::volume)[p];
    });
  });
  return particles;
}

// A box of the production grid around this rank's particles, with room for their flight.
template <int Dim>
GridGeometry<Dim> reference_geometry(const State<Dim>& state, const std::vector<ReferenceParticle<Dim>>& particles) {
  Vec<Dim> lower = state.geometry().upper(), upper = state.geometry().lower();
  for (const ReferenceParticle<Dim>& p : particles) {
    lower = lower.cwiseMin(p.x);
    upper = upper.cwiseMax(p.x);
  }
  return {lower, upper, spacing};
}

// The program's own step on a state made from a scene.
template <int Dim>
class ElasticBlock {
 public:
  ElasticBlock(const Communicator& communicator, const BlockCase& c) : ElasticBlock(communicator, scene_text<Dim>(c)) {
    with_precision(state_.precision, [&](auto zero) { this->template stretch<decltype(zero)>(c); });
    if (c.slack) largest_step_ = cfl * spacing / ((1 + flight + stretching) * Elasticity().wave_speed);
    integrator_->initialise(state_);
  }

  ElasticBlock(const Communicator& communicator, const std::string& scene) {
    Parameters parameters = Parameters::read_text(scene, "elastic block", {});
    read_dimension(parameters);
    scene_ = read_scene<Dim>(parameters);
    declare_state(communicator, scene_, state_);
    StepHooks<Dim> hooks;
    for (auto& effect : scene_.effects) effect->join(hooks);
    StepSizeOptions options;
    options.cfl = cfl;
    integrator_ = std::make_unique<ExplicitIntegrator<Dim>>(state_, std::move(hooks), options);
    create_particles(scene_, state_);
    integrator_->initialise(state_);
    particles_ = count_particles(state_);
  }

  void steps(int count) {
    for (int i = 0; i < count; ++i) {
      state_.dt = std::min(largest_step_, integrator_->stable_step(state_));
      state_.observed = i == count - 1;
      integrator_->step(state_);
    }
  }

  // Sends the block back where it came from, so that it stays in its small domain.
  void reverse() {
    with_precision(state_.precision, [&](auto zero) {
      using T = decltype(zero);
      const FieldSet& f = state_.bodies[0].particles;
      for (const FieldId field : {core::velocity, core::velocity_gradient})
        for (int c = 0; c < f.traits(field).components; ++c)
          for (Index p = 0; p < f.size(); ++p) f.template data<T>(field, c)[p] = -f.template data<T>(field, c)[p];
    });
  }

  State<Dim>& state() { return state_; }
  GlobalIndex particles() const { return particles_; }
  Real bytes_per_particle() const {
    return state_.communicator().sum(static_cast<Real>(total_bytes(memory_account(state_, scene_.effects)))) /
           static_cast<Real>(particles_);
  }
  // Solves and iterations since the start.
  SolverWork solver_work() const {
    SolverWork sum;
    for (const auto& [name, work] : state_.solvers) {
      sum.solves += work.solves;
      sum.iterations += work.iterations;
    }
    return sum;
  }

 private:
  // A velocity that grows linearly from the middle: alternately longer and thinner, shorter and thicker.
  template <class T>
  void stretch(const BlockCase& c) {
    const FieldSet& f = state_.bodies[0].particles;
    const Real rate = (c.at_rest ? stretching_at_rest : stretching) * Elasticity().wave_speed / (c.cells * spacing / 2),
               middle = (free_cells + c.cells / 2.0) * spacing;
    const Mat<Dim> gradient = rate * Eigen::Vector3d(1, -0.4, 0.3).template head<Dim>().asDiagonal().toDenseMatrix();
    for (int a = 0; a < Dim; ++a)
      for (Index p = 0; p < f.size(); ++p) {
        f.template data<T>(core::velocity, a)[p] +=
            static_cast<T>(gradient(a, a) * (f.template data<Real>(core::position, a)[p] - middle));
        if (f.has(core::velocity_gradient))
          f.template data<T>(core::velocity_gradient, (Dim + 1) * a)[p] = static_cast<T>(gradient(a, a));
      }
  }

  Scene<Dim> scene_;
  State<Dim> state_;
  std::unique_ptr<ExplicitIntegrator<Dim>> integrator_;
  GlobalIndex particles_ = 0;
  Real largest_step_ = std::numeric_limits<Real>::infinity();
};

}  // namespace mpm
