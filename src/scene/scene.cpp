#include "mpm_hpc/scene/scene.hpp"

#include <algorithm>
#include <cmath>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

int read_dimension(Parameters& p) {
  std::int64_t dimension = 2;
  p.integer("dimension", dimension, {.min = 2, .max = 3, .required = true, .doc = "Space dimension of the scene."});
  return static_cast<int>(dimension);
}

namespace {

// The enumerator whose name is in this place of the list.
template <class Enumeration>
Enumeration number_of(const std::vector<std::string>& names, const std::string& name) {
  return static_cast<Enumeration>(std::find(names.begin(), names.end(), name) - names.begin());
}

// Side number of "x_min", "x_max", "y_min", ...; -1 for any other text.
template <int Dim>
int side_number(const std::string& name) {
  for (int side = 0; side < 2 * Dim; ++side)
    if (name == domain_side_name(side)) return side;
  return -1;
}

template <int Dim>
void read_sides(Parameters& q, Scene<Dim>& scene) {
  std::vector<std::string> directions, sides;
  q.text_list("periodic", directions,
              {.doc = "Directions in which the domain repeats itself, such as [\"x\"]: what leaves on one "
                      "side comes in on the "
                      "other. Shapes of effects are not repeated."});
  q.text_list(
      "open", sides,
      {.doc = "Sides through which particles leave for good, counted in run.json, such as [\"x_max\"]."});
  for (const std::string& direction : directions) {
    const std::size_t a = std::string_view("xyz").substr(0, Dim).find(direction);
    if (direction.size() != 1 || a == std::string_view::npos) {
      q.error_at("periodic", fmt::format("\"{}\" is no direction here; use {}.", direction,
                                         Dim == 2 ? "\"x\" and \"y\"" : "\"x\", \"y\" and \"z\""));
    } else {
      scene.periodic[a] = true;
    }
  }
  for (const std::string& name : sides) {
    const int side = side_number<Dim>(name);
    if (side < 0)
      q.error_at("open",
                 fmt::format("\"{}\" is no side; the sides are x_min, x_max, y_min and so on.", name));
    if (scene.periodic[side / 2])
      q.error_at("open", fmt::format("{} can't be open, since {} is periodic; take one of the two out.", name,
                                     "xyz"[side / 2]));
    scene.distribution.open[side] = true;
  }
}

// The nearest domains that a periodic direction can have.
template <int Dim>
void check_periods(const Scene<Dim>& scene, const std::string& where) {
  using Grid = GridGeometry<Dim>;
  for (int a = 0; a < Dim; ++a) {
    const Real length = scene.upper[a] - scene.lower[a], cells = length / scene.spacing;
    if (!scene.periodic[a] || Grid::fits_period(cells)) continue;
    const Real blocks = std::max(std::floor(cells / block_side), Real(Grid::least_period / block_side));
    const Real below = blocks * block_side * scene.spacing, above = below + block_side * scene.spacing;
    throw UserError(
        fmt::format("{}: the domain is {:.6g} cells long in {}, but a periodic direction takes a multiple of "
                    "{} cells, {} at least; the "
                    "nearest {} m, or change grid.spacing.",
                    where, cells, "xyz"[a], block_side, static_cast<int>(Grid::least_period),
                    cells > Grid::least_period ? fmt::format("lengths are {:.6g} and {:.6g}", below, above)
                                               : fmt::format("length is {:.6g}", below)));
  }
}

template <int Dim>
void read_domain(Parameters& p, Scene<Dim>& scene) {
  std::string where_periodic;
  p.section("domain", SectionOptions("The box that holds every particle.", true), [&](Parameters& q) {
    q.vector<Dim>("lower", scene.lower, {.unit = "m", .required = true, .doc = "Lower corner."});
    q.vector<Dim>("upper", scene.upper, {.unit = "m", .required = true, .doc = "Upper corner."});
    if (!(scene.upper.array() > scene.lower.array()).all())
      q.error_at("upper", "each component of domain.upper must be larger than that of domain.lower");
    std::string policy = "stop";
    q.choice("on_leave", policy, {"stop", "delete", "keep"},
             "What happens to a particle that leaves: end the run, delete it, or put it back onto the wall.");
    scene.distribution.leave_policy = policy == "stop"     ? LeavePolicy::stop
                                      : policy == "delete" ? LeavePolicy::remove
                                                           : LeavePolicy::keep;
    read_sides(q, scene);
    where_periodic = q.where("periodic");
  });
  p.section("grid", SectionOptions("The background grid.", true), [&](Parameters& q) {
    q.real("spacing", scene.spacing,
           {.unit = "m", .min = 0, .min_exclusive = true, .required = true, .doc = "Edge h of a grid cell."});
    std::string kernel = scene.transfer.kernel_name();
    q.choice("kernel", kernel, kernel_names, "B-spline of the transfer.");
    scene.transfer.kernel = number_of<KernelKind>(kernel_names, kernel);
    if (q.describing()) return;
    for (int a = 0; a < Dim; ++a) {
      const Real blocks = (scene.upper[a] - scene.lower[a]) / scene.spacing / block_side;
      if (blocks > (1 << 20))
        q.error_at("spacing", fmt::format("the domain would need {:.3g} blocks in one direction, more than the {} that "
                                          "are possible; take a larger grid.spacing or a smaller domain",
                                          blocks, 1 << 20));
    }
    check_periods(scene, where_periodic);
  });
}

void read_transfer(Parameters& p, TransferOptions& options) {
  p.section("transfer", SectionOptions("What passes between particles and grid."), [&](Parameters& q) {
    std::string scheme = options.scheme_name(), forces = "auto";
    q.choice("scheme", scheme, scheme_names,
             "What particles keep of the grid's velocity: its mean (pic), its rotation too (rpic), its gradient (apic), its "
             "products of directions (polypic), or their own velocity plus the grid's change (flip).");
    options.scheme = number_of<Scheme>(scheme_names, scheme);
    q.choice("forces", forces, {"auto", "mls", "classical"},
             "Forces and velocity gradient by moving least squares, or by the weights' gradients; auto: mls, which the linear "
             "kernel has not.");
    const bool classical = forces == "classical" || (forces == "auto" && options.kernel == KernelKind::linear);
    options.forces = classical ? Forces::classical : Forces::mls;
    std::optional<Real> blend;
    q.optional_real("flip_blend", blend,
                    {.min = 0, .max = 1, .doc = "Share of FLIP in FLIP with a PIC blend; default 0.99. Only with scheme = \"flip\"."});
    if (q.describing()) return;
    if (blend && !options.increments())
      q.error_at("flip_blend", fmt::format("flip_blend is for scheme = \"flip\", not for \"{}\"; remove it", scheme));
    options.flip_blend = blend.value_or(options.flip_blend);
    const std::string why = why_undefined(options);
    if (!why.empty()) q.error_at(options.scheme == Scheme::polypic ? "scheme" : "forces", why);
  });
}

// Of quasi-static steps, where nothing else holds light nodes; inertia does in the others.
constexpr Real default_stabilisation = 0.1;

void read_time(Parameters& p, TimeOptions& time) {
  p.section("time", SectionOptions("Time integration.", true), [&](Parameters& q) {
    const RealOptions positive{.unit = "s", .min = 0, .min_exclusive = true};
    auto with_doc = [&positive](const char* doc) {
      RealOptions o = positive;
      o.doc = doc;
      return o;
    };
    q.real("end", time.end, {.unit = "s", .min = 0, .min_exclusive = true, .required = true, .doc = "Time at which the run ends."});
    q.choice("integrator", time.integrator, {"explicit", "implicit", "quasi_static"},
             "Symplectic Euler; backward Euler on the grid's velocities, with steps as long as the motion allows; or static "
             "equilibrium after each load step, where time only orders the loads.");
    time.implicit.inertia = time.integrator != "quasi_static";
    time.implicit.stabilisation = time.implicit.inertia ? 0 : default_stabilisation;
    std::string update = "first_order";
    q.choice("deformation_update", update, {"first_order", "second_order", "exponential"},
             "How a step deforms the particles: F <- (I + A) F, (I + A + A^2/2) F or exp(A) F with A = dt grad v; the last keeps "
             "the volume of a rigid rotation exactly.");
    time.deformation_update = update == "exponential"    ? DeformationUpdate::exponential
                              : update == "second_order" ? DeformationUpdate::second_order
                                                         : DeformationUpdate::first_order;
    q.real("cfl", time.cfl,
           {.min = 0, .min_exclusive = true, .max = 1, .doc = "Share of a cell that a wave may cross in one step."});
    time.end_where = q.where("end");
    time.dt_where = q.where("dt");
    q.optional_real("dt", time.dt, with_doc("Fixed step, used as long as it is stable; default: adaptive."));
    q.optional_real("max_dt", time.max_dt, with_doc("Upper bound of the adaptive step."));
    if (!q.describing() && time.is_implicit() && !time.dt && !time.max_dt)
      q.error_at("integrator", fmt::format("{} steps have no bound of stability; give time.max_dt, such as a tenth of the time "
                                           "in which the load changes, or a fixed time.dt",
                                           time.integrator));
    q.optional_integer("max_steps", time.max_steps, {.min = 0, .doc = "Number of steps after which the run ends."});
  });
}

void read_newton(Parameters& p, TimeOptions& time) {
  p.section("newton", SectionOptions("Newton's method of implicit and quasi-static steps."), [&](Parameters& q) {
    NewtonOptions& newton = time.implicit.newton;
    q.real("tolerance", newton.tolerance,
           {.min = 1e-12, .max = 1e-1, .doc = "Residual over the largest of the forces that balance in it."});
    q.integer("max_iterations", newton.max_iterations, {.min = 1, .doc = "Iterations after which a step is halved."});
    q.integer("max_krylov", newton.max_krylov, {.min = 1, .doc = "PCG iterations for one Newton direction."});
    std::string form = "assembled";
    q.choice("operator", form, {"assembled", "matrix_free"},
             "The tangent as a PETSc matrix, or applied by sweeps over the particles: less memory, more time.");
    q.real("stabilisation", time.implicit.stabilisation,
           {.min = 0, .doc = "Holds nodes with next to no weight to their neighbours, against a step's displacements only and as "
                             "a share of the material's stiffness; default 0.1 for quasi_static, 0 for implicit."});
    std::string projection = "auto";
    q.choice("projection", projection, {"auto", "always", "never"},
             "When the tangent is made semi-definite, which gives directions of descent but slower convergence: auto, until "
             "the residual is small.");
    newton.projection = projection == "always"  ? Projection::always
                        : projection == "never" ? Projection::never
                                                : Projection::automatic;
    time.implicit.matrix_free = form == "matrix_free";
    if (!p.describing() && p.has("newton") && !time.is_implicit())
      p.error_at("newton", "explicit steps solve no equations; choose time.integrator = \"implicit\" or \"quasi_static\", or "
                     "drop [newton].");
  });
}

void read_output(Parameters& p, OutputOptions& output) {
  p.section("output", SectionOptions("Frames, history and checkpoints."), [&](Parameters& q) {
    q.real("every", output.every, {.unit = "s", .min = 0, .doc = "Time between frames; 0: only the first and the last."});
    q.optional_real("history_every", output.history_every,
                    {.unit = "s", .min = 0, .doc = "Time between rows of history.csv; default: a tenth of every."});
    q.optional_real("checkpoint_every", output.checkpoint_every,
                    {.unit = "s", .min = 0, .min_exclusive = true, .doc = "Time between checkpoints; default: only at the end."});
    q.boolean("frames", output.frames, {.doc = "Whether frames are written."});
    q.boolean("checkpoint", output.checkpoint, {.doc = "Whether checkpoints are written, the one at the end included."});
    q.text_list("fields", output.fields, {.doc = "Fields of the frames; default: those meant for output."});
    output.fields_where = q.where("fields");
    q.choice("precision", output.precision, {"single", "double"}, "Precision of the fields in frames.");
    q.integer("compression", output.compression,
              {.min = 0, .max = 9, .doc = "Deflate level of the frames; 0 writes much faster."});
  });
}

void read_parallel(Parameters& p, DistributionOptions& options) {
  p.section("parallel", SectionOptions("Distribution over the ranks."), [&](Parameters& q) {
    q.real("rebalance_threshold", options.rebalance_threshold,
           {.min = 1, .doc = "Largest over mean load of a rank past which the blocks are partitioned anew, if that wins 2 %."});
    std::string partitioner = "auto";
    q.choice("partitioner", partitioner, {"auto", "bisection", "metis", "curve"},
             "Who divides the blocks among the ranks: bisection across the longest side of what is left, METIS, pieces of "
             "Hilbert's curve, or auto: METIS where bisection leaves an imbalance, and the curve for many ranks and for a "
             "body that is small in its domain.");
    options.partitioner = partitioner == "metis"       ? Partitioner::metis
                          : partitioner == "bisection" ? Partitioner::bisection
                          : partitioner == "curve"     ? Partitioner::curve
                                                       : Partitioner::automatic;
    std::string weights = "count";
    q.choice("weights", weights, {"count", "time"},
             "Load of a block: its particles, or these times the measured time, which differs from run to run.");
    options.weigh_by_time = weights == "time";
  });
}

// Returns the places of the toughnesses that materials have.
template <int Dim>
std::vector<std::string> read_materials(Parameters& p, Scene<Dim>& scene) {
  std::vector<std::string> toughnesses;
  p.named_sections("material", SectionOptions("A material, named by its table.", true),
                   [&](Parameters& q, const std::string& name) {
                     auto material = make_material<Dim>(q, name);
                     if (!material) return;
                     if (material->can_fracture()) toughnesses.push_back(q.where("fracture_toughness"));
                     scene.materials.push_back(std::move(material));
                   });
  return toughnesses;
}

template <int Dim>
void read_bodies(Parameters& p, Scene<Dim>& scene) {
  p.section_list("body", SectionOptions("A body of one material.", true), [&](Parameters& q, int i) {
    BodyDefinition<Dim> body;
    body.where = q.where();
    body.name = fmt::format("body_{}", i);
    q.text("name", body.name, {.doc = "Name in outputs and messages; default body_0, body_1, ..."});
    q.text("material", body.material, {.required = true, .doc = "Name of its [material.NAME] table."});
    const bool shaped = declare_shape<Dim>(q, "shape", body.shape, false, "Solid that is filled with particles.");
    const bool clouded =
        q.text("point_cloud", body.cloud, {.doc = "File of particles instead of a shape: CSV, or HDF5 (.h5, .hdf5)."});
    body.cloud_where = q.where("point_cloud");
    body.seeding.origin = scene.lower;
    body.seeding.spacing = scene.spacing;
    body.seeding.seed = scene.seed + static_cast<std::uint64_t>(i);
    declare_seeding<Dim>(q, body.seeding);
    // Bodies that touch take their points from one tile, which keeps them apart across the surface.
    if (body.seeding.sampling == Sampling::poisson_disk) body.seeding.seed = scene.seed;
    const std::vector<std::string> place = place_variables(Dim);
    declare_formulas(q, "velocity", place, Dim, body.velocity,
                     {.unit = "m/s",
                      .doc = "Velocity at the start: numbers, or formulas in x, y, z in SI, such as \"0.1*sin(pi*x/50)\". "
                             "Default 0."});
    body.velocity_where = q.where("velocity");
    Formulas deformation;
    const bool deformed = declare_formulas(
        q, "deformation_gradient", place, Dim * Dim, deformation,
        {.doc = "F at the start, row by row: numbers, or formulas in x, y, z; the shape is the deformed one, and density "
                "holds for det F = 1. Default: the unit tensor."},
        Dim);
    body.deformation_where = q.where("deformation_gradient");
    if (deformed) body.deformation_gradient = std::move(deformation);
    if constexpr (Dim == 2) {
      q.real("angular_velocity", body.angular_velocity[2], {.unit = "rad/s", .doc = "Spin at the start."});
    } else {
      q.vector<3>("angular_velocity", body.angular_velocity, {.unit = "rad/s", .doc = "Spin at the start."});
    }
    q.optional_vector<Dim>("center", body.center, {.unit = "m", .doc = "Point about which it spins; default: the middle of its bounds."});
    if (q.describing()) return;
    if (shaped == clouded)
      q.error_at("shape", fmt::format("body \"{}\" needs either a shape or a point_cloud", body.name));
    if (clouded && deformed)
      q.error_at("deformation_gradient",
                 "the particles of a point_cloud have their own deformation; give the file columns F_xx, F_xy, ...");
    if (clouded) body.cloud = q.resolve(body.cloud).string();
    const auto known = std::find_if(scene.materials.begin(), scene.materials.end(),
                                    [&](const auto& m) { return m->name() == body.material; });
    if (known == scene.materials.end()) {
      std::string names;
      for (const auto& m : scene.materials) names += (names.empty() ? "" : ", ") + m->name();
      q.error_at("material", fmt::format("there is no [material.{}]; the scene has: {}", body.material, names));
    }
    for (const auto& other : scene.bodies)
      if (other.name == body.name) q.error_at("name", fmt::format("two bodies are named \"{}\"; rename one", body.name));
    scene.bodies.push_back(std::move(body));
  });
}

}  // namespace

template <int Dim>
Scene<Dim> read_scene(Parameters& p, const std::vector<EffectEntry<Dim>>& effects) {
  Scene<Dim> scene;
  if (!p.describing()) {
    scene.text = p.scene_text();
    scene.where = p.file_name();
  }
  p.text("title", scene.title, {.doc = "What the scene shows."});
  std::string precision = "double";
  p.choice("precision", precision, {"double", "single"},
           "Type of particle and grid values; positions are double in either case.");
  scene.precision = precision == "single" ? Precision::single_precision : Precision::double_precision;
  p.integer("seed", scene.seed, {.min = 0, .doc = "Seed of everything random (jitter, Poisson disks)."});
  declare_definitions(p);
  read_domain(p, scene);
  read_transfer(p, scene.transfer);
  read_time(p, scene.time);
  read_newton(p, scene.time);
  read_output(p, scene.output);
  read_parallel(p, scene.distribution);
  const std::vector<std::string> toughnesses = read_materials(p, scene);
  read_bodies(p, scene);
  scene.effects = read_effects(p, effects);
  p.finish();
  const bool breaks = std::any_of(scene.effects.begin(), scene.effects.end(),
                                  [](const auto& effect) { return effect->uses_toughness(); });
  require(breaks || toughnesses.empty(),
          "{}: fracture_toughness does nothing, since no effect of the scene breaks by it; add [effect.phase_field], or "
          "drop the key.",
          toughnesses.empty() ? "" : toughnesses.front());
  scene.distribution.precision = scene.precision;
  return scene;
}

template Scene<2> read_scene<2>(Parameters&, const std::vector<EffectEntry<2>>&);
template Scene<3> read_scene<3>(Parameters&, const std::vector<EffectEntry<3>>&);

}  // namespace mpm
