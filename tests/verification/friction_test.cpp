// A block that slides down a slope with Coulomb friction (verification.md section 5): x = g t^2 (sin theta - mu cos theta) / 2.
#include <cmath>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/scene_world.hpp"
#include "support/verification.hpp"

using namespace mpm;

namespace {

constexpr Real degree = 3.14159265358979323846 / 180, theta = 24 * degree, g = 9.81;
const Real friction = std::tan(15 * degree);

// Way of the block's centre down a surface that falls by `slope` below the x axis, against the closed form;
// gravity makes up for the rest of theta. The block is stiff, since what it gains at the start is of first order in the step:
// a node that is slower than mu |dv_n| sticks.
void slide(const std::string& name, Real slope, const std::string& shape, const std::string& surface) {
  test::SceneWorld<2> world(fmt::format(
      "dimension = 2\n[domain]\nlower = [0, -0.5]\nupper = [1.5, 0.5]\n[grid]\nspacing = 0.02\n[time]\nend = "
      "1\n"
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1e7\npoisson_ratio = 0.3\ndensity = 100\n"
      "[[body]]\nmaterial = \"m\"\nshape = {}\n"
      "[effect.gravity]\nacceleration = [{:.17g}, {:.17g}]\n{}",
      shape, g * std::sin(theta - slope), -g * std::cos(theta - slope), surface));
  State<2>& state = world.state;
  ExplicitIntegrator<2> integrator(state, std::move(world.hooks), {});
  integrator.initialise(state);
  auto centre = [&] {
    std::vector<Real> sums(3, 0);
    world.for_particles([&](const Body<2>& body, Index p) {
      ++sums[2];
      for (int a = 0; a < 2; ++a) sums[a] += body.particles.data<Real>(core::position, a)[p];
    });
    state.communicator().sum(sums);
    return Vec<2>(sums[0] / sums[2], sums[1] / sums[2]);
  };
  const Vec<2> start = centre();
  constexpr Real end = 0.8;
  while (state.time < end) {
    state.dt = std::min(integrator.stable_step(state), end - state.time);
    integrator.step(state);
  }
  const Vec<2> way = centre() - start, down(std::cos(slope), -std::sin(slope));
  const Real expected = g * end * end * (std::sin(theta) - friction * std::cos(theta)) / 2;
  test::verify("5 plasticity", "block on a slope, " + name + ": way after 0.8 s", way.dot(down),
               test::within(expected, 1e-3), "m");
}

TEST(Friction, ABlockSlidesOnTheFloorUnderTurnedGravity) {
  const std::string walls =
      fmt::format("[effect.walls]\ny_min = \"separate\"\nfriction = {:.17g}\n", friction);
  slide("floor, gravity turned", 0, "{type = \"box\", lower = [0.1, -0.5], upper = [0.4, -0.4]}", walls);
}

// A slope that the grid isn't aligned with.
TEST(Friction, ABlockSlidesOnATiltedPlane) {
  const std::string normal = fmt::format("[{:.17g}, {:.17g}]", std::sin(theta), std::cos(theta));
  const std::string plane = fmt::format(
      "[[effect.obstacle]]\nshape = {{type = \"plane\", point = [0.3, 0.2], normal = {}}}\ncondition = "
      "\"separate\"\n"
      "friction = {:.17g}\n",
      normal, friction);
  const std::string box = fmt::format(
      "{{type = \"box\", lower = [0.3, 0.2], upper = [0.6, 0.3], rotate = {{angle = {:.17g}, about = [0.3, "
      "0.2]}}}}",
      -theta);
  slide("tilted plane", theta, box, plane);
}

}  // namespace
