// The scene as the user wrote it: domain, bodies, materials, effects, time, output.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/effects/effect_list.hpp"
#include "mpm_hpc/math/formula.hpp"
#include "mpm_hpc/scene/seeding.hpp"
#include "mpm_hpc/time/implicit_system.hpp"

namespace mpm {

template <int Dim>
struct BodyDefinition {
  std::string name, material, where;
  Shape<Dim> shape;                       // particles on a lattice inside, or ...
  std::string cloud, cloud_where;         // ... from this file: CSV, or HDF5 (.h5, .hdf5)
  SeedingOptions<Dim> seeding;
  Formulas velocity;                      // at the start [m/s], of the place
  std::optional<Formulas> deformation_gradient;  // at the start, of the place; row by row
  std::string velocity_where, deformation_where;
  Vec<3> angular_velocity = Vec<3>::Zero();  // [rad/s]; in 2D only the third component
  std::optional<Vec<Dim>> center;         // of the spin; default: the middle of the bounds
};

struct TimeOptions {
  Real end = 0;                   // [s]
  std::string end_where, dt_where;  // their places in the scene, for messages
  std::string integrator = "explicit";
  DeformationUpdate deformation_update = DeformationUpdate::first_order;
  Real cfl = 0.4;
  std::optional<Real> dt;         // fixed step [s]
  std::optional<Real> max_dt;     // [s]
  std::optional<std::int64_t> max_steps;
  ImplicitOptions implicit;       // of the other integrators

  bool is_implicit() const { return integrator != "explicit"; }
};

struct OutputOptions {
  Real every = 0;                          // time between frames [s]; 0: only first and last
  std::optional<Real> history_every, checkpoint_every;  // [s]
  bool frames = true, checkpoint = true;
  std::vector<std::string> fields;
  std::string fields_where;
  std::string precision = "single";
  int compression = 0;
};

template <int Dim>
struct Scene {
  std::string title, where;
  Precision precision = Precision::double_precision;
  std::uint64_t seed = 1;
  Vec<Dim> lower = Vec<Dim>::Zero(), upper = Vec<Dim>::Ones();
  Real spacing = 0;
  TransferOptions transfer;
  DistributionOptions distribution;
  TimeOptions time;
  OutputOptions output;
  std::vector<std::unique_ptr<Material<Dim>>> materials;  // by order of the file
  std::vector<BodyDefinition<Dim>> bodies;
  std::vector<std::unique_ptr<Effect<Dim>>> effects;
  std::string text;  // verbatim

  std::array<bool, Dim> periodic{};

  GridGeometry<Dim> geometry() const { return {lower, upper, spacing, periodic}; }
};

// `dimension`, the one key that decides how the rest is read.
int read_dimension(Parameters& p);

// Reads and checks everything that needs no particles. `effects` is the list of effects to choose from. Throws UserError.
template <int Dim>
Scene<Dim> read_scene(Parameters& p, const std::vector<EffectEntry<Dim>>& effects = effect_list<Dim>());

}  // namespace mpm
