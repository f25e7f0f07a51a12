#include "mpm_hpc/simulation/setup.hpp"

#include <fmt/ranges.h>

#include <Eigen/LU>
#include <algorithm>
#include <exception>
#include <optional>
#include <utility>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/material_columns.hpp"
#include "mpm_hpc/fields/point_cloud.hpp"
#include "mpm_hpc/io/point_cloud_hdf5.hpp"
#include "mpm_hpc/io/together.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/scene/point_cloud.hpp"
#include "mpm_hpc/simulation/cloud_volume.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "mpm_hpc/time/implicit_integrator.hpp"

namespace mpm {

template <int Dim>
void declare_state(const Communicator& communicator, Scene<Dim>& scene, State<Dim>& state) {
  state.precision = scene.precision;
  state.transfer = scene.transfer;
  state.deformation_update = scene.time.deformation_update;
  DistributionOptions options = scene.distribution;
  with_kernel(scene.transfer.kernel, [&options](auto kernel) {
    options.kernel_shift = kernel.shift;
    options.kernel_support = kernel.support;
  });
  state.distribution = Distribution<Dim>(communicator, scene.geometry(), options);
  state.materials = std::move(scene.materials);
  for (const BodyDefinition<Dim>& definition : scene.bodies) {
    const auto material = std::find_if(state.materials.begin(), state.materials.end(),
                                       [&](const auto& m) { return m->name() == definition.material; });
    const BodyColumns columns{.velocity_gradient = state.transfer.affine() || (*material)->needs_velocity_gradient(),
                              .deformation_gradient = (*material)->needs_deformation_gradient()};
    state.bodies.emplace_back(definition.name, static_cast<int>(material - state.materials.begin()), state.precision,
                              columns);
    Body<Dim>& body = state.bodies.back();
    add_own_columns(**material, state.precision, body.particles);
    if (state.transfer.scheme == Scheme::polypic)
      body.velocity_modes = body.particles.add({.name = "velocity_modes",
                                                .units = "m/s",
                                                .type = real_type(state.precision),
                                                .components = product_modes<Dim> * Dim});
  }
  state.degradation.resize(state.bodies.size());
  state.fields = GridFields(state.precision);
  state.nodes = state.fields.add({.name = "node",
                                  .units = "kg m/s, kg",
                                  .components = node_values,
                                  .halo_components = Dim + 1,
                                  .sums_ghosts = true,
                                  .fills_ghosts = true});
  if (state.transfer.increments())
    state.changes = state.fields.add({.name = "change",
                                      .units = "kg m/s",
                                      .components = node_values,
                                      .halo_components = Dim,
                                      .sums_ghosts = true,
                                      .fills_ghosts = true});
  for (auto& effect : scene.effects) effect->declare_fields(state);
}

template <int Dim>
StepHooks<Dim> join_effects(const Scene<Dim>& scene) {
  StepHooks<Dim> hooks;
  hooks.implicit = scene.time.is_implicit();
  for (const auto& effect : scene.effects) effect->join(hooks);
  return hooks;
}

template <int Dim>
std::unique_ptr<Integrator<Dim>> make_integrator(const Scene<Dim>& scene, State<Dim>& state, StepHooks<Dim> hooks) {
  const TimeOptions& time = scene.time;
  if (!time.is_implicit()) {
    StepSizeOptions options;
    options.cfl = time.cfl;
    return std::make_unique<ExplicitIntegrator<Dim>>(state, std::move(hooks), options);
  }
  for (const Body<Dim>& body : state.bodies)
    require_ability(*state.materials[static_cast<std::size_t>(body.material)], MaterialAbility::tangent,
                    fmt::format("time.integrator = \"{}\"", time.integrator));
  typename ImplicitIntegrator<Dim>::Options options;
  options.system = time.implicit;
  options.cfl = time.cfl;
  if (time.max_dt) options.largest_step = *time.max_dt;
  if (time.dt) options.largest_step = *time.dt;
  return std::make_unique<ImplicitIntegrator<Dim>>(state, std::move(hooks), options);
}

namespace {

constexpr GlobalIndex particles_at_once = 1 << 16;

bool is_hdf5(const std::string& file) {
  return file.ends_with(".h5") || file.ends_with(".hdf5");
}

// This rank's share of a body's particles, piece by piece, so that seeded ones needn't all exist beside the columns.
template <int Dim>
class ParticleShare {
 public:
  // Collective.
  ParticleShare(const Communicator& communicator, const BodyDefinition<Dim>& definition)
      : communicator_(communicator), definition_(definition) {
    together(communicator, [&] {
      const int rank = communicator.rank(), ranks = communicator.size();
      if (!definition.cloud.empty()) {
        if (!is_hdf5(definition.cloud)) cloud_ = read_point_cloud_csv<Dim>(definition.cloud, rank, ranks);
        return;
      }
      seeding_.emplace(definition.shape, definition.seeding);
      volume_ = seeding_->particle_volume();
      cell_ = seeding_->first_cell(rank, ranks);
      end_cell_ = seeding_->first_cell(rank + 1, ranks);
      cells_at_once_ = particles_at_once / definition.seeding.particles_per_cell + 1;
    });
  }

  // Scattered particles share the volume of the shape evenly, whatever number of them fell into it. Collective.
  void share_volume(GlobalIndex total) {
    if (definition_.seeding.sampling != Sampling::poisson_disk || !seeding_) return;
    volume_ = communicator_.sum(seeding_->shape_volume(cell_, end_cell_)) / static_cast<Real>(total);
  }

  // f gets a PointCloud and must not communicate. Collective.
  template <class F>
  void for_each_piece(F&& f) const {
    if (!seeding_) {
      if (is_hdf5(definition_.cloud)) {
        read_point_cloud_hdf5<Dim>(communicator_, definition_.cloud, definition_.cloud_where, f);
      } else {
        f(cloud_);
      }
      return;
    }
    PointCloud<Dim> piece;
    for (GlobalIndex cell = cell_; cell < end_cell_; cell += cells_at_once_) {
      piece.positions = seeding_->particles(cell, std::min(cell + cells_at_once_, end_cell_));
      piece.volumes.assign(piece.positions.size(), volume_);
      f(std::as_const(piece));
    }
  }

 private:
  const Communicator& communicator_;
  const BodyDefinition<Dim>& definition_;
  PointCloud<Dim> cloud_;
  std::optional<Seeding<Dim>> seeding_;
  Real volume_ = 0;  // of a seeded particle [m^Dim]
  GlobalIndex cell_ = 0, end_cell_ = 0, cells_at_once_ = 1;
};

// What must be known of a share before its columns are filled.
template <int Dim>
struct Survey {
  GlobalIndex count = 0;
  Vec<Dim> lower = Vec<Dim>::Constant(std::numeric_limits<Real>::infinity()), upper = -lower;
  std::optional<Vec<Dim>> outside;  // a particle outside of the domain
  bool has_volumes = false, has_deformations = false;

  Survey(const ParticleShare<Dim>& share, const GridGeometry<Dim>& geometry) {
    share.for_each_piece([&](const PointCloud<Dim>& piece) {
      count += static_cast<GlobalIndex>(piece.positions.size());
      has_volumes = has_volumes || !piece.volumes.empty();
      has_deformations = has_deformations || !piece.deformation_gradients.empty();
      for (const Vec<Dim>& x : piece.positions) {
        lower = lower.cwiseMin(x);
        upper = upper.cwiseMax(x);
        if (!geometry.contains(x)) outside = x;
      }
    });
  }
};

// Box of the body's particles on all ranks. Collective.
template <int Dim>
BoundingBox<Dim> box_of(const Communicator& communicator, const Survey<Dim>& survey) {
  std::vector<Real> upper(2 * Dim);
  for (int a = 0; a < Dim; ++a) {
    upper[a] = survey.upper[a];
    upper[Dim + a] = -survey.lower[a];
  }
  communicator.max(upper);
  BoundingBox<Dim> box;
  for (int a = 0; a < Dim; ++a) {
    box.upper[a] = upper[a];
    box.lower[a] = -upper[Dim + a];
  }
  return box;
}

// Its particles would lie on its own ones from across the seam.
template <int Dim>
void refuse_overlap(const GridGeometry<Dim>& grid, const BodyDefinition<Dim>& definition,
                    const BoundingBox<Dim>& box) {
  for (int a = 0; a < Dim; ++a)
    require(!grid.periodic(a) || box.upper[a] - box.lower[a] < grid.period(a),
            "{}: body \"{}\" is {:.6g} m long in the periodic direction {}, longer than the domain, and "
            "would overlap itself; "
            "shorten it or enlarge the domain",
            definition.where, definition.name, box.upper[a] - box.lower[a], "xyz"[a], grid.period(a));
}

template <class T>
void fill_initial(const FieldSet& fields, FieldId f) {
  const FieldTraits& traits = fields.traits(f);
  int side = 0;
  while (side * side < traits.components) ++side;
  for (int c = 0; c < traits.components; ++c) {
    const Real value = traits.identity ? (c % (side + 1) == 0 ? 1.0 : 0.0) : traits.initial;
    std::fill_n(fields.data<T>(f, c), fields.size(), static_cast<T>(value));
  }
}

// What a body's formulas say of a particle at x.
template <int Dim>
struct StartingMotion {
  Vec<Dim> velocity;
  Mat<Dim> velocity_gradient, deformation_gradient = Mat<Dim>::Identity();

  StartingMotion(const BodyDefinition<Dim>& definition, const Vec<Dim>& x) {
    definition.velocity.evaluate(x.data(), velocity.data());
    // Far below the length in which a field that the grid resolves changes, far above rounding.
    velocity_gradient = gradient<Dim>(definition.velocity, x, 0.01 * definition.seeding.spacing);
    require(velocity.allFinite() && velocity_gradient.allFinite(),
            "{}: the velocity {} or its slope is no finite number at ({:.6g}) m; correct the formula.",
            definition.velocity_where, definition.velocity.text(), fmt::join(x.data(), x.data() + Dim, ", "));
    if (!definition.deformation_gradient) return;
    Mat<Dim> transposed;
    definition.deformation_gradient->evaluate(x.data(), transposed.data());  // Eigen stores column by column
    deformation_gradient = transposed.transpose();
    const Real J = deformation_gradient.determinant();
    require(deformation_gradient.allFinite() && J > 0,
            "{}: det F = {:.6g} at ({:.6g}) m, it must be positive; correct deformation_gradient.",
            definition.deformation_where, J, fmt::join(x.data(), x.data() + Dim, ", "));
  }
};

// The particles of a piece become those from `first` on.
template <int Dim, class T>
void fill_piece(const FieldSet& f, Index first, const BodyDefinition<Dim>& definition, const PointCloud<Dim>& cloud,
                const Vec<Dim>& centre, Real density, GlobalIndex first_id) {
  // Velocity of a rigid rotation: v = W (x - centre), W_ab = -eps_abc omega_c.
  Mat<Dim> spin = Mat<Dim>::Zero();
  spin(0, 1) = -definition.angular_velocity[2];
  spin(1, 0) = definition.angular_velocity[2];
  if constexpr (Dim == 3) {
    spin(0, 2) = definition.angular_velocity[1];
    spin(2, 0) = -definition.angular_velocity[1];
    spin(1, 2) = -definition.angular_velocity[0];
    spin(2, 1) = definition.angular_velocity[0];
  }
  for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
    const Index p = first + static_cast<Index>(i);
    const Vec<Dim>& x = cloud.positions[i];
    const StartingMotion<Dim> start(definition, x);
    Vec<Dim> v = start.velocity + spin * (x - centre);
    if (!cloud.velocities.empty()) v += cloud.velocities[i];
    const Mat<Dim> C = start.velocity_gradient + spin;
    f.template data<GlobalIndex>(core::id)[p] = first_id + p;
    for (int a = 0; a < Dim; ++a) {
      f.template data<Real>(core::position, a)[p] = x[a];
      f.template data<T>(core::velocity, a)[p] = static_cast<T>(v[a]);
      for (int b = 0; b < Dim; ++b) {
        if (f.has(core::velocity_gradient))
          f.template data<T>(core::velocity_gradient, a * Dim + b)[p] = static_cast<T>(C(a, b));
        if (!cloud.deformation_gradients.empty() && f.has(core::deformation_gradient))
          f.template data<T>(core::deformation_gradient, a * Dim + b)[p] =
              static_cast<T>(cloud.deformation_gradients[i](a, b));
        if (definition.deformation_gradient)
          f.template data<T>(core::deformation_gradient, a * Dim + b)[p] =
              static_cast<T>(start.deformation_gradient(a, b));
      }
    }
    const Real volume = cloud.volumes.empty() ? 1 : cloud.volumes[i] / start.deformation_gradient.determinant();
    f.template data<T>(core::volume)[p] = static_cast<T>(volume);
    f.template data<T>(core::mass)[p] = static_cast<T>(density * volume);
  }
}

}  // namespace

template <int Dim>
void create_particles(Scene<Dim>& scene, State<Dim>& state) {
  const Communicator& communicator = state.communicator();
  GlobalIndex next_id = 0;
  std::vector<std::size_t> without_volume;
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    const BodyDefinition<Dim>& definition = scene.bodies[b];
    ParticleShare<Dim> share(communicator, definition);
    const Survey<Dim> survey(share, state.geometry());
    const GlobalIndex total = communicator.sum(survey.count);
    require(total > 0, "{}: body \"{}\" has no particles; its shape holds no lattice point, so enlarge it or refine grid.spacing",
            definition.where, definition.name);
    together(communicator, [&] {
      if (!survey.outside) return;
      std::string place;
      for (int a = 0; a < Dim; ++a) place += fmt::format("{}{:.6g}", a ? ", " : "", (*survey.outside)[a]);
      throw UserError(fmt::format("{}: body \"{}\" reaches out of the domain at ({}) m; move it or enlarge domain.lower "
                                  "and domain.upper",
                                  definition.where, definition.name, place));
    });
    require(state.bodies[b].particles.has(core::deformation_gradient) ||
                !(communicator.any(survey.has_deformations) || definition.deformation_gradient),
            "{}: body \"{}\" is a fluid, which has no deformation gradient to start with; leave it out of the body and of its "
            "point cloud",
            definition.where, definition.name);
    share.share_volume(total);
    const GlobalIndex first_id = next_id + communicator.exclusive_sum(survey.count);
    next_id += total;
    const BoundingBox<Dim> box = box_of(communicator, survey);
    refuse_overlap(state.geometry(), definition, box);
    const Vec<Dim> centre = definition.center.value_or(0.5 * (box.lower + box.upper));
    FieldSet& fields = state.bodies[b].particles;
    fields.resize(static_cast<Index>(survey.count));
    for (FieldId f = 0; f < fields.count(); ++f) {
      switch (fields.traits(f).type) {
        case ScalarType::float32: fill_initial<float>(fields, f); break;
        case ScalarType::float64: fill_initial<double>(fields, f); break;
        case ScalarType::int64: fill_initial<GlobalIndex>(fields, f); break;
      }
    }
    Index first = 0;
    std::exception_ptr fault;  // of a formula; pieces are read together, so no rank may leave early
    share.for_each_piece([&](const PointCloud<Dim>& piece) {
      try {
        with_precision(state.precision, [&](auto zero) {
          fill_piece<Dim, decltype(zero)>(fields, first, definition, piece, centre, state.material_of(b).density(), first_id);
        });
      } catch (const UserError&) {
        if (!fault) fault = std::current_exception();
      }
      first += static_cast<Index>(piece.positions.size());
    });
    agree_on_fault(communicator, fault);
    if (!communicator.any(survey.has_volumes)) without_volume.push_back(b);
  }
  for (auto& effect : scene.effects) effect->initialise(state);
  sort_particles(state, OrderWithinCell::canonical);
  for (std::size_t b : without_volume) volumes_from_grid_density(state, b);
}

template void declare_state<2>(const Communicator&, Scene<2>&, State<2>&);
template void declare_state<3>(const Communicator&, Scene<3>&, State<3>&);
template StepHooks<2> join_effects(const Scene<2>&);
template StepHooks<3> join_effects(const Scene<3>&);
template std::unique_ptr<Integrator<2>> make_integrator(const Scene<2>&, State<2>&, StepHooks<2>);
template std::unique_ptr<Integrator<3>> make_integrator(const Scene<3>&, State<3>&, StepHooks<3>);
template void create_particles<2>(Scene<2>&, State<2>&);
template void create_particles<3>(Scene<3>&, State<3>&);

}  // namespace mpm
