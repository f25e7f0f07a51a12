// Particles that lie on grid nodes, where a kernel may have a weight of 0 and a slope that isn't: nothing may come of it.
#include <gtest/gtest.h>

#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

// What a scene's text has beside the block.
struct Extra {
  const char *precision = "double", *integrator = "explicit", *effect = "";
};

// Every second row of particles lies on nodes, the last one of the block as well. It flies.
template <int Dim>
std::unique_ptr<test::SceneWorld<Dim>> block_on_nodes(const std::string& kernel, const Extra& extra) {
  const auto vector = [](const char* x, const char* y, const char* z) {
    return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
  };
  const bool breaks = *extra.effect != 0, implicit = std::string(extra.integrator) == "implicit";
  auto world = std::make_unique<test::SceneWorld<Dim>>(fmt::format(
      "dimension = {}\nprecision = \"{}\"\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = 1\nkernel = \"{}\"\n"
      "[time]\nend = 10\nintegrator = \"{}\"\n{}"
      "[material.m]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = 1e4\npoisson_ratio = 0.25\ndensity = 1000\n{}"
      "[[body]]\nmaterial = \"m\"\nparticles_per_cell = {}\nvelocity = {}\n"
      "shape = {{type = \"box\", lower = {}, upper = {}}}\n{}",
      Dim, extra.precision, vector("-4", "-4", "-4"), vector("12", "12", "12"), kernel, extra.integrator,
      implicit ? "dt = 0.05\n" : "", breaks ? "fracture_toughness = 100\n" : "", Dim == 2 ? 4 : 8,
      vector("1", "0.5", "0.7"), vector("0", "0", "0"), vector("6", "5", "4"), extra.effect));
  world->for_particles([](Body<Dim>& body, Index p) {
    for (int a = 0; a < Dim; ++a) body.particles.template data<Real>(core::position, a)[p] += 0.25;
  });
  sort_particles(world->state, OrderWithinCell::stable);
  world->state.dt = 0.05;
  return world;
}

// The flight of a rigid body leaves F as it is.
template <int Dim>
void check_flight(const std::string& kernel, const Extra& extra) {
  const auto world = block_on_nodes<Dim>(kernel, extra);
  State<Dim>& state = world->state;
  world->integrator->initialise(state);
  world->integrator->step(state);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    Real strain = 0;
    world->for_particles([&strain](Body<Dim>& body, Index p) {
      for (int c = 0; c < Dim * Dim; ++c) {
        const Real unity = c % (Dim + 1) == 0 ? 1 : 0;
        strain = std::max(strain, std::abs(body.particles.template data<T>(core::deformation_gradient, c)[p] - unity));
      }
    });
    EXPECT_LT(strain, 100 * std::numeric_limits<T>::epsilon())
        << Dim << "D " << kernel << " " << extra.precision << " " << extra.integrator;
  });
}

TEST(OnNodes, FlyWithoutStrain) {
  for (const char* kernel : {"linear", "quadratic", "cubic"})
    for (const Extra& extra : {Extra{}, Extra{.precision = "single"}, Extra{.integrator = "implicit"}}) {
      check_flight<2>(kernel, extra);
      check_flight<3>(kernel, extra);
    }
}

// What nothing drives stays whole.
template <int Dim>
void check_phase(const std::string& kernel, const std::string& keys) {
  const std::string effect =
      "[effect.phase_field]\nlength_scale = 2\nactive_tolerance = 0\noperator = " + keys + "\n";
  const auto world = block_on_nodes<Dim>(kernel, {.effect = effect.c_str()});
  world->run_effects();
  Real least = 1;
  world->for_particles([&least](Body<Dim>& body, Index p) {
    least = std::min(least, body.particles.template data<Real>(body.particles.find("phase"))[p]);
  });
  EXPECT_GT(least, 1 - 1e-6) << Dim << "D " << kernel << " " << keys;
}

TEST(OnNodes, StayWhole) {
  for (const char* kernel : {"linear", "quadratic", "cubic"})
    for (const char* keys :
         {"\"stencil\"", "\"matrix_free\"", "\"assembled\"", "\"stencil\"\nmobility = 10", "\"stencil\"\nreaction = \"lumped\""}) {
      check_phase<2>(kernel, keys);
      check_phase<3>(kernel, keys);
    }
}

}  // namespace
