// Poisson-disk sampling over the ranks: the particles of one rank, wherever they are, and volumes that add up to the shape's.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

template <int Dim>
void check() {
  const std::string zeros = Dim == 2 ? "[0, 0]" : "[0, 0, 0]", ones = Dim == 2 ? "[1, 1]" : "[1, 1, 1]",
                    middle = Dim == 2 ? "[0.5, 0.5]" : "[0.5, 0.5, 0.5]";
  test::SceneWorld<Dim> world(fmt::format(
      "dimension = {}\nseed = 3\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = 0.1\n[time]\nend = 1\n"
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 10\npoisson_ratio = 0.3\ndensity = 2\n"
      "[[body]]\nmaterial = \"m\"\nshape = {{type = \"sphere\", center = {}, radius = 0.4}}\n"
      "sampling = \"poisson_disk\"\nparticles_per_cell = 7\n",
      Dim, zeros, ones, middle));
  const Seeding<Dim> seeding(world.scene.bodies[0].shape, world.scene.bodies[0].seeding);
  const auto alone = seeding.particles(0, seeding.cells());
  Real mass = 0, count = 0;
  world.for_particles([&](const Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    const auto id = static_cast<std::size_t>(f.template data<GlobalIndex>(core::id)[p]);
    ASSERT_LT(id, alone.size());
    for (int a = 0; a < Dim; ++a) EXPECT_EQ(f.template data<Real>(core::position, a)[p], alone[id][a]);
    mass += f.template data<Real>(core::mass)[p];
    ++count;
  });
  const Communicator& communicator = world.state.communicator();
  EXPECT_EQ(communicator.sum(count), static_cast<Real>(alone.size()));
  const Real exact = Dim == 2 ? std::numbers::pi * 0.16 : 4 * std::numbers::pi / 3 * 0.064;
  EXPECT_NEAR(communicator.sum(mass), 2 * exact, 0.004 * exact);
}

TEST(Sampling, PoissonDiskIsTheSameOnAnyNumberOfRanks) {
  check<2>();
  check<3>();
}

}  // namespace
