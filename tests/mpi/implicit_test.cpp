// Implicit steps on any number of ranks: tangent against the residual, matrix against sweeps, descent of the potential, and
// motions that are known.
#include <gtest/gtest.h>
#include <petscsys.h>

#include <cmath>

#include "mpm_hpc/time/implicit_integrator.hpp"
#include "support/stepper.hpp"

namespace mpm::test {
namespace {

struct Setting {
  int dim = 2;
  std::string material = "model = \"neo_hookean\"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\n";
  std::string kernel = "quadratic", scheme = "apic", form = "assembled", integrator = "implicit", more = "";
  Real dt = 0.02;
};

template <int Dim>
std::string list(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
}

// A block between a wall on which it slides, and a rod through it that turns.
template <int Dim>
std::string scene_text(const Setting& s) {
  return fmt::format(
             "dimension = {}\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = 0.125\nkernel = \"{}\"\n"
             "[transfer]\nscheme = \"{}\"\n[time]\nend = 10\nintegrator = \"{}\"\nmax_dt = {}\n"
             "[newton]\noperator = \"{}\"\ntolerance = 1e-8\n"
             "[material.soft]\ndensity = 2\n{}"
             "[[body]]\nmaterial = \"soft\"\nparticles_per_cell = {}\njitter = 0.3\nshape = {{type = "
             "\"box\", lower = {}, "
             "upper = {}}}\n",
             Dim, list<Dim>(-1, 0, -1), list<Dim>(2, 2, 2), s.kernel, s.scheme, s.integrator, s.dt, s.form,
             s.material, Dim == 2 ? 4 : 8, list<Dim>(0, 0, 0), list<Dim>(1, 1, 0.5)) +
         s.more;
}

// A number in [-1, 1] that depends on the particle alone.
Real noise(GlobalIndex id, int k) { return std::sin(12.9898 * static_cast<Real>(id + 1) + 78.233 * (k + 1)); }

template <int Dim>
void disturb(SceneWorld<Dim>& world, Real strain) {
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    const GlobalIndex id = f.template data<GlobalIndex>(core::id)[p];
    for (int k = 0; k < Dim * Dim; ++k)
      f.template data<Real>(core::deformation_gradient, k)[p] = (k % (Dim + 1) == 0) + strain * noise(id, k);
    for (int a = 0; a < Dim; ++a) f.template data<Real>(core::velocity, a)[p] = noise(id, 20 + a);
  });
}

// A vector over the rows that depends on the node's place alone.
template <int Dim>
std::vector<Real> field(const SceneWorld<Dim>& world, const ImplicitSystem<Dim>& system, int seed) {
  std::vector<Real> values;
  for (int r = 0; r < system.rows(); ++r) {
    const std::size_t node = system.node(r);
    const Vec<Dim> x = world.state.geometry().node_position(
        world.state.topology().first_node(static_cast<Slot>(node / nodes_per_block<Dim>)) +
        node_in_block<Dim>(static_cast<int>(node % nodes_per_block<Dim>)));
    for (int a = 0; a < Dim; ++a) values.push_back(std::sin(3 * x.sum() + 5 * x[0] * x[1] + a + 2 * seed));
  }
  return values;
}

template <int Dim>
Real dot(const State<Dim>& state, const std::vector<Real>& a, const std::vector<Real>& b) {
  Real sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
  return state.communicator().sum(sum);
}

// As given on the command line, for as long as it lives.
class PetscOption {
 public:
  PetscOption(const char* name, const std::string& value) : name_(name) {
    PetscOptionsSetValue(nullptr, name, value.c_str());
  }
  ~PetscOption() { PetscOptionsClearValue(nullptr, name_); }
  PetscOption(const PetscOption&) = delete;
  PetscOption& operator=(const PetscOption&) = delete;

 private:
  const char* name_;
};

template <int Dim>
ImplicitIntegrator<Dim>& implicit(SceneWorld<Dim>& world) {
  return dynamic_cast<ImplicitIntegrator<Dim>&>(*world.integrator);
}

const std::string tilted_obstacle_2d =
    "[effect.walls]\ny_min = \"slip\"\n[[effect.obstacle]]\nshape = {type = \"sphere\", center = [0.5, 1.1], "
    "radius = 0.3}\n"
    "condition = \"slip\"\nvelocity = [0.1, -0.2]\n";
const std::string tilted_obstacle_3d =
    "[effect.walls]\ny_min = \"slip\"\n[[effect.obstacle]]\nshape = {type = \"sphere\", center = [0.5, 1.1, "
    "0.3], radius = "
    "0.3}\ncondition = \"slip\"\nvelocity = [0.1, -0.2, 0.1]\n";

// The unprojected tangent, constraints included.
template <int Dim>
void check_tangent(Setting setting) {
  setting.more += Dim == 2 ? tilted_obstacle_2d : tilted_obstacle_3d;
  std::vector<std::vector<Real>> products;
  for (const char* form : {"assembled", "matrix_free"}) {
    setting.form = form;
    SceneWorld<Dim> world(scene_text<Dim>(setting));
    disturb<Dim>(world, 0.1);
    world.state.dt = setting.dt;
    ImplicitIntegrator<Dim>& integrator = implicit<Dim>(world);
    integrator.prepare(world.state);
    ImplicitSystem<Dim>& system = integrator.system();
    // Directions without constrained parts: what the solver's steps are. Not at the start, where inertia has no force.
    std::vector<Real> v = system.unknowns(), d = field<Dim>(world, system, 0),
                      e = field<Dim>(world, system, 1), Ad, Ae, up(v.size()), down(v.size());
    system.project(d.data());
    system.project(e.data());
    for (std::size_t k = 0; k < v.size(); ++k) v[k] += 0.2 * e[k];
    // Twice: a matrix whose blocks are in place already is filled in another way.
    system.linearise(world.state, system.unknowns().data(), true);
    system.linearise(world.state, v.data(), false);
    system.multiply(d, Ad);
    system.multiply(e, Ae);
    const Real eAd = dot(world.state, e, Ad), dAe = dot(world.state, d, Ae);
    EXPECT_NEAR(eAd, dAe, 1e-12 * std::sqrt(dot(world.state, Ad, Ad) * dot(world.state, e, e)));

    const Real step = 1e-5;
    std::vector<Real> right = v, left = v;
    for (std::size_t k = 0; k < v.size(); ++k) {
      right[k] += step * d[k];
      left[k] -= step * d[k];
    }
    system.residual(world.state, right.data(), up.data());
    system.residual(world.state, left.data(), down.data());
    std::vector<Real> difference(v.size());
    for (std::size_t k = 0; k < v.size(); ++k) difference[k] = (up[k] - down[k]) / (2 * step) - Ad[k];
    EXPECT_LE(std::sqrt(dot(world.state, difference, difference)), 1e-7 * std::sqrt(dot(world.state, Ad, Ad)))
        << form << " " << setting.material;
    // The residual is the potential's gradient.
    std::vector<Real> r(v.size());
    system.residual(world.state, v.data(), r.data());
    const Real slope = (system.potential(world.state, right.data()).value -
                        system.potential(world.state, left.data()).value) /
                       (2 * step);
    EXPECT_NEAR(slope, dot(world.state, r, d),
                1e-7 * std::sqrt(dot(world.state, r, r) * dot(world.state, d, d)));
    products.push_back(Ad);
  }
  ASSERT_EQ(products[0].size(), products[1].size());
  Real worst = 0, size = 0;
  for (std::size_t k = 0; k < products[0].size(); ++k) {
    worst = std::max(worst, std::abs(products[0][k] - products[1][k]));
    size = std::max(size, std::abs(products[0][k]));
  }
  EXPECT_LE(Communicator::world().max(worst), 1e-12 * Communicator::world().max(size)) << setting.material;
}

template <class C>
class ImplicitTest : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(ImplicitTest, Dimensions);

TYPED_TEST(ImplicitTest, TangentIsTheResidualsDerivativeAssembledOrNot) {
  constexpr int dim = TypeParam::value;
  for (const char* model :
       {"neo_hookean", "fixed_corotated", "split_neo_hookean", "hencky", "linear_elastic"})
    check_tangent<dim>(
        {.material = fmt::format("model = \"{}\"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\n", model)});
  check_tangent<dim>({.kernel = "cubic"});
  check_tangent<dim>({.kernel = "linear"});
  check_tangent<dim>({.integrator = "quasi_static"});
}

// A preconditioner that needs the matrix in another form finds the same least potential, and the matrix is the same. What is
// held stays held, though directions that aren't solved for to the end have a part along it.
TYPED_TEST(ImplicitTest, PreconditionersChangeTheWayAndNotTheResult) {
  constexpr int dim = TypeParam::value;
  // Others than linear elasticity have several least potentials, which differ at nodes with next to no weight.
  Setting setting{.material = "model = \"linear_elastic\"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\n",
                  .dt = 0.02};
  setting.more =
      "velocity = " + list<dim>(0.5, -0.5, 0.2) + "\n" + (dim == 2 ? tilted_obstacle_2d : tilted_obstacle_3d);
  std::vector<Real> expected, expected_product;
  for (const std::string type : {"jacobi", "pbjacobi", "gamg"}) {
    const PetscOption option("-newton_pc_type", type);
    SceneWorld<dim> world(scene_text<dim>(setting), effect_list<dim>(), {"newton.tolerance=1e-11"});
    world.state.dt = setting.dt;
    ImplicitIntegrator<dim>& integrator = implicit<dim>(world);
    integrator.prepare(world.state);
    ImplicitSystem<dim>& system = integrator.system();
    const std::vector<Real> start = system.unknowns();
    const NewtonResult result = system.solve(world.state);
    EXPECT_TRUE(result.converged) << type << ": " << result.reason;
    EXPECT_GT(result.iterations, 1) << type;
    std::vector<Real> v = system.unknowns(), product, way(v.size()), free;
    for (std::size_t k = 0; k < v.size(); ++k) way[k] = v[k] - start[k];
    free = way;
    system.project(free.data());
    for (std::size_t k = 0; k < v.size(); ++k) way[k] -= free[k];
    EXPECT_LE(dot(world.state, way, way), 1e-28 * dot(world.state, free, free)) << type;
    // Filled anew at the same place for all, and not for the first time.
    const std::vector<Real> at = expected.empty() ? v : expected;
    system.linearise(world.state, at.data(), false);
    system.multiply(field<dim>(world, system, 0), product);
    if (expected.empty()) {
      expected = v;
      expected_product = product;
    }
    ASSERT_EQ(v.size(), expected.size());
    Real worst = 0, largest = 0, worst_product = 0, largest_product = 0;
    for (std::size_t k = 0; k < v.size(); ++k) {
      worst = std::max(worst, system.mass(static_cast<int>(k) / dim) * std::abs(v[k] - expected[k]));
      largest = std::max(largest, system.mass(static_cast<int>(k) / dim) * std::abs(expected[k]));
      worst_product = std::max(worst_product, std::abs(product[k] - expected_product[k]));
      largest_product = std::max(largest_product, std::abs(expected_product[k]));
    }
    const Communicator& all = world.state.communicator();
    EXPECT_LE(all.max(worst), 1e-5 * all.max(largest)) << type;
    EXPECT_LE(all.max(worst_product), 1e-12 * all.max(largest_product)) << type;
  }
}

// Nothing acts on a body that flies or falls: one Newton step each, and the motion is exact.
TYPED_TEST(ImplicitTest, FreeFallIsExact) {
  constexpr int dim = TypeParam::value;
  Setting setting{.dt = 0.01};
  setting.more = "velocity = " + list<dim>(1, 2, -0.5) +
                 "\n[effect.gravity]\nacceleration = " + list<dim>(0, -10, 0) + "\n";
  Stepper<dim> world(scene_text<dim>(setting));
  world.state.dt = setting.dt;
  const int steps = 8;
  std::vector<std::pair<GlobalIndex, Vec<dim>>> start;
  std::map<GlobalIndex, Vec<dim>> from;
  auto place = [](const Body<dim>& body, Index p) {
    Vec<dim> x;
    for (int a = 0; a < dim; ++a) x[a] = body.particles.template data<Real>(core::position, a)[p];
    return x;
  };
  Vec<dim> centre = Vec<dim>::Zero();
  auto mean = [&] {
    std::vector<Real> sums(dim + 1, 0.0);
    world.for_particles([&](Body<dim>& body, Index p) {
      const Vec<dim> x = place(body, p);
      for (int a = 0; a < dim; ++a) sums[a] += x[a];
      sums[dim] += 1;
    });
    world.state.communicator().sum(sums);
    return Vec<dim>(Eigen::Map<Vec<dim>>(sums.data()) / sums[dim]);
  };
  centre = mean();
  world.integrator->initialise(world.state);
  int iterations = 0;
  for (int k = 0; k < steps; ++k) {
    world.integrator->step(world.state);
    iterations += implicit<dim>(world).last_result().iterations;
  }
  EXPECT_EQ(iterations, 0);
  Vec<dim> expected = Vec<dim>::Zero();
  const Real t = steps * setting.dt;
  expected[0] = t;
  expected[1] = 2 * t - 10 * setting.dt * setting.dt * steps * (steps + 1) / 2;
  if (dim == 3) expected[dim - 1] = -0.5 * t;
  EXPECT_LE((mean() - centre - expected).norm(), 1e-12);
  EXPECT_NEAR(world.value("min_J"), 1, 1e-12);
}

// Steps of 1, 10 and 100 times what an explicit one allows, nearly incompressible and with a stiffness contrast of 1e4.
TYPED_TEST(ImplicitTest, DescendsToTheLeastPotential) {
  constexpr int dim = TypeParam::value;
  for (const Real nu : {0.3, 0.49, 0.499})
    for (const Real factor : {1.0, 10.0, 100.0}) {
      if (dim == 3 && (nu != 0.49 || factor < 100)) continue;  // for the time it takes
      const Real modulus = 1000 * (1 - nu) / ((1 + nu) * (1 - 2 * nu)),
                 explicit_step = 0.4 * 0.125 / std::sqrt(modulus / 2);
      Setting setting{.material = fmt::format(
                          "model = \"neo_hookean\"\nyoungs_modulus = 1000\npoisson_ratio = {}\n", nu)};
      setting.dt = factor * explicit_step;
      setting.more = fmt::format(
          "velocity = {}\n[material.hard]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1e7\npoisson_ratio = "
          "{}\ndensity = 2\n"
          "[[body]]\nmaterial = \"hard\"\nparticles_per_cell = {}\nshape = {{type = \"box\", lower = {}, "
          "upper = {}}}\n"
          "[effect.walls]\ny_min = \"sticky\"\n[effect.gravity]\nacceleration = {}\n",
          list<dim>(0, -0.2, 0), nu, dim == 2 ? 4 : 8, list<dim>(0, 1, 0), list<dim>(1, 1.25, 0.5),
          list<dim>(0, -1, 0));
      Stepper<dim> world(scene_text<dim>(setting), {"newton.tolerance=1e-6"});
      world.integrator->initialise(world.state);
      for (int k = 0; k < (dim == 2 ? 2 : 1); ++k) {
        world.state.dt = std::min(setting.dt, world.integrator->stable_step(world.state));
        world.integrator->step(world.state);
        const NewtonResult& result = implicit<dim>(world).last_result();
        EXPECT_LE(result.iterations, 50) << nu << " " << factor;
        EXPECT_TRUE(result.converged);
        for (std::size_t i = 1; i < result.potentials.size(); ++i)
          EXPECT_LE(result.potentials[i], result.potentials[i - 1] + result.rounding)
              << nu << " " << factor << " iteration " << i;
      }
      EXPECT_FALSE(world.state.guards.contains("implicit_steps_halved")) << nu << " " << factor;
    }
}

// A block so stiff that a step is a hundred explicit ones stays rigid, and its motion is known. Nodes go from x to R x with
// R = exp(theta J), so v = (R - I) x / dt, which particles keep at their new places with the gradient (R - I) / dt. The least
// of sum m |v - v*|^2 has tan theta = dt L / (I + dt D) with L = sum x x m v*, D = sum m x . v*, I = sum m |x|^2 over the
// nodes. At the start L = I omega, D = 0; after a step L = I sin(theta) / dt and dt D = (1 - cos theta) (sum_p m |x_p|^2 - m h^2 / 2): each step
// takes a share theta^2 from the speed. So the angle errs by the order of dt.
TYPED_TEST(ImplicitTest, StiffBlockTurnsAsARigidOne) {
  constexpr int dim = TypeParam::value;
  constexpr Real spacing = 0.125, density = 2, omega = 5, turned = 0.5;
  Real errors[2];
  int run = 0;
  for (const Real theta : {0.05, 0.025}) {
    const Real dt = theta / omega, wave_speed = 100 * 0.4 * spacing / dt;
    Setting setting{
        .material = fmt::format("model = \"neo_hookean\"\nyoungs_modulus = {}\npoisson_ratio = 0.3\n",
                                density * wave_speed * wave_speed * 1.3 * 0.4 / 0.7),
        .dt = dt};
    std::string text = scene_text<dim>(setting);
    for (const auto& [from, to] :
         {std::pair{"lower = " + list<dim>(-1, 0, -1) + "\nupper = " + list<dim>(2, 2, 2),
                    "lower = " + list<dim>(-1, -1, -1) + "\nupper = " + list<dim>(1, 1, 1)},
          {std::string("jitter = 0.3"), std::string("jitter = 0")},
          {"lower = " + list<dim>(0, 0, 0) + ", upper = " + list<dim>(1, 1, 0.5),
           "lower = " + list<dim>(-0.5, -0.5, -0.25) + ", upper = " + list<dim>(0.5, 0.5, 0.25)}}) {
      ASSERT_NE(text.find(from), std::string::npos) << from;
      text.replace(text.find(from), from.size(), to);
    }
    text += fmt::format("velocity = [\"-{0}*y\", \"{0}*x\"{1}]\n", omega, dim == 3 ? ", 0" : "");
    Stepper<dim> world(text, {"time.cfl=1"});
    State<dim>& state = world.state;
    world.integrator->initialise(state);
    const Real mass = world.value("mass"),
               moment = sum_over<dim>(world, [](auto&x, auto&) { return x[0] * x[0] + x[1] * x[1]; }),
               whole = moment + mass * spacing * spacing / 2;
    Real angular = world.value("angular_momentum_z"), dilation = 0, angle = 0,
         energy = world.value("kinetic_energy");
    EXPECT_NEAR(angular, whole * omega, 1e-12 * whole * omega);
    // Strains of rho omega^2 r^2 / E, and as much again from the start.
    const Real strain = 2 * omega * omega * 0.5 / (wave_speed * wave_speed);
    while (angle < turned) {
      const Real step = std::atan(dt * angular / (whole + dilation));
      angular = whole * std::sin(step) / dt;
      dilation = (1 - std::cos(step)) * (2 * moment - whole);
      angle += step;
      state.dt = dt;
      world.integrator->step(state);
      EXPECT_NEAR(world.value("angular_momentum_z"), angular, 10 * strain * angular)
          << "at the angle " << angle;
      const Real now = world.value("kinetic_energy") + world.value("elastic_energy");
      EXPECT_LE(now, energy);
      energy = now;
    }
    errors[run++] = omega * dt * static_cast<Real>(state.step) - angle;
    // F is the rotation by that angle; nothing has moved away from the middle or towards it.
    Real worst = 0, radii = 0;
    world.for_particles([&](Body<dim>& body, Index p) {
      for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b) {
          const Real R = a == b ? std::cos(angle) : (a < b ? -1 : 1) * std::sin(angle);
          worst = std::max(
              worst,
              std::abs(body.particles.template data<Real>(core::deformation_gradient, a * dim + b)[p] - R));
        }
    });
    EXPECT_LE(state.communicator().max(worst), 50 * strain) << theta;
    radii = sum_over<dim>(world, [](auto& x, auto&) { return x[0] * x[0] + x[1] * x[1]; });
    EXPECT_NEAR(radii, moment, 1e-3 * moment);
    EXPECT_FALSE(state.guards.contains("implicit_steps_halved"));
  }
  EXPECT_NEAR(errors[0] / errors[1], 2, 0.2);
}

// A block on the ground: its weight is the ground's reaction, and work of gravity is the elastic energy of a slow load twice.
TYPED_TEST(ImplicitTest, QuasiStaticWeightIsCarriedByTheGround) {
  constexpr int dim = TypeParam::value;
  Setting setting{.integrator = "quasi_static"};
  setting.dt = 1;
  setting.more =
      "[effect.walls]\ny_min = \"sticky\"\n[effect.gravity]\nacceleration = " + list<dim>(0, -5, 0) + "\n";
  Stepper<dim> world(scene_text<dim>(setting), {"material.soft.poisson_ratio=0"});
  world.state.dt = 1;
  world.integrator->initialise(world.state);
  world.integrator->step(world.state);
  const Real carried =
      world.state.communicator().sum(world.state.ledger["impulse_walls_y"]);  // in one second
  const auto row = history_row(world.state, world.scene.effects);
  std::map<std::string, Real> values;
  for (const HistoryValue& v : row) values[v.name] = v.value;
  EXPECT_GT(values.at("external_work"), 0);
  EXPECT_EQ(values.at("kinetic_energy"), 0);
  const Real weight = 5 * values.at("mass");
  EXPECT_NEAR(carried, weight, 1e-7 * weight);
}

// A block slides to rest on a separating ground: mu g t off its speed, then it sticks; the ground's reaction says the same.
TYPED_TEST(ImplicitTest, BlockSlidesToRest) {
  constexpr int dim = TypeParam::value;
  Setting setting{.material = "model = \"neo_hookean\"\nyoungs_modulus = 1e5\npoisson_ratio = 0\n"};
  setting.dt = 0.01;
  setting.more = "velocity = " + list<dim>(0.5, 0, 0) +
                 "\n[effect.walls]\ny_min = \"separate\"\nfriction = 0.3\n[effect.gravity]\nacceleration = " +
                 list<dim>(0, -10, 0) + "\n";
  Stepper<dim> world(scene_text<dim>(setting), {"newton.tolerance=1e-6"});
  const Real mass = world.value("mass");
  const Real slid = dim == 2 ? 0.1 : 0.03;
  world.advance(slid, [] {});
  // The ground brings the weight into balance in the first steps.
  EXPECT_NEAR(world.value("momentum_x"), mass * (0.5 - 0.3 * 10 * slid), 0.02 * mass * 0.5);
  if (dim == 3) return;  // for the time it takes
  world.advance(0.3, [] {});
  EXPECT_LE(std::abs(world.value("momentum_x")), 1e-3 * mass * 0.5);
}

}  // namespace
}  // namespace mpm::test
