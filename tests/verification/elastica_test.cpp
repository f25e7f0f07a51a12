// A slender cantilever under a dead load at its end, in quasi-static steps, against the elastica (verification.md section 3).
#include <cmath>

#include "support/stepper.hpp"
#include "support/verification.hpp"

using namespace mpm;

namespace {

// End of the elastica over L: k = P L^2 / (E I), down, back; by an independent integration of the boundary value problem.
struct Point {
  Real k, down, back;
};
constexpr Point elastica[] = {{1, 0.30172, 0.05643},
                              {2, 0.49346, 0.16064},
                              {3, 0.60325, 0.25442},
                              {5, 0.71379, 0.38763},
                              {10, 0.81061, 0.55500}};

// L = 10, H = 1/2: shear and stretch, which the elastica leaves out, make 0.2 %. E I = 1000 per depth, so that the load 100 at
// the end of the ramp is k = 10.
TEST(Elastica, CantileverUnderDeadLoad) {
  constexpr Real L = 10;
  test::Stepper<2> world(
      "dimension = 2\n[domain]\nlower = [-2, -10]\nupper = [12, 3]\n[grid]\nspacing = 0.0625\n"
      "[time]\nend = 1\nintegrator = \"quasi_static\"\nmax_dt = 0.01\ncfl = 0.9\n"
      "[material.strip]\nmodel = \"hencky\"\nyoungs_modulus = 9.6e4\npoisson_ratio = 0\ndensity = 1\n"
      "[[body]]\nmaterial = \"strip\"\nparticles_per_cell = 4\nshape = {type = \"box\", lower = [-1, -0.25], "
      "upper = [10, 0.25]}\n"
      "[[effect.grip]]\nname = \"clamp\"\nshape = {type = \"box\", lower = [-1.5, -2], upper = [0, 2]}\n"
      "[[effect.traction]]\nshape = {type = \"box\", lower = [9.9375, -1], upper = [10.5, 1]}\ntraction = "
      "[0, -100]\narea = 1\n"
      "ramp = 1\n");
  // The particles around the end's middle, whose mean place is on the middle line.
  std::vector<char> at_end;
  const auto middle_of_end = [&] {
    std::vector<Real> sums(3, 0.0);
    world.for_particles([&](Body<2>& body, Index p) {
      const auto id = static_cast<std::size_t>(body.particles.data<GlobalIndex>(core::id)[p]);
      if (id >= at_end.size() || !at_end[id]) return;
      for (int a = 0; a < 2; ++a)
        sums[static_cast<std::size_t>(a)] += body.particles.data<Real>(core::position, a)[p];
      sums[2] += 1;
    });
    world.state.communicator().sum(sums);
    return Vec<2>(sums[0] / sums[2], sums[1] / sums[2]);
  };
  const auto total = static_cast<std::size_t>(count_particles(world.state));
  std::vector<Real> marks(total, 0.0);
  world.for_particles([&](Body<2>& body, Index p) {
    const Real x = body.particles.data<Real>(core::position, 0)[p];
    if (x > L - 0.03125) marks[static_cast<std::size_t>(body.particles.data<GlobalIndex>(core::id)[p])] = 1;
  });
  world.state.communicator().sum(marks);
  for (const Real mark : marks) at_end.push_back(mark > 0);
  const Vec<2> start = middle_of_end();

  test::Curve curve{"elastica",
                    false,
                    {"k = P L^2 / (E I)", "down/L", "back/L", "reference down/L", "reference back/L"},
                    {}};
  for (const Point& point : elastica) {
    world.advance(point.k / 10, [] {});
    const Vec<2> moved = (middle_of_end() - start) / L;
    curve.rows.push_back({point.k, -moved[1], -moved[0], point.down, point.back});
    test::verify("3 elastodynamics", fmt::format("elastica, k = {}: end down over L", point.k), -moved[1],
                 test::within(point.down, 0.02));
    test::verify("3 elastodynamics", fmt::format("elastica, k = {}: end back over L", point.k), -moved[0],
                 test::within(point.back, 0.02));
  }
  curve.write();
}

}  // namespace
