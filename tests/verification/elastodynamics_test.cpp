// Bars, rods, discs and rotations against closed forms (verification.md section 3).
#include <cmath>

#include "support/two_discs.hpp"

using namespace mpm;
using test::Stepper;
using test::sum_over;
using test::transfer_text;

namespace {

constexpr Real pi = 3.14159265358979323846;
const std::string section = "3 elastodynamics";

// The first axial mode of a bar that is fixed at x = 0: L = 25, E = 100, rho = 1, v = 0.1 sin(pi x / 2L), whose momentum
// goes like cos(omega t) with omega = (pi / 2L) sqrt(E / rho) = 0.6283. nu = 0: the sides do nothing.
void vibrating_bar(const std::string& scheme) {
  constexpr Real L = 25, speed = 0.1, period = 10, periods = 10;
  Stepper<2> world(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [28, 8]\n[grid]\nspacing = 0.5\n[time]\nend = 101\n" +
      transfer_text(scheme) +
      "[material.bar]\nmodel = \"neo_hookean\"\nyoungs_modulus = 100\npoisson_ratio = 0\ndensity = 1\n"
      "[[body]]\nmaterial = \"bar\"\nparticles_per_cell = 4\nshape = {type = \"box\", lower = [0, 3], upper "
      "= [25, "
      "5]}\n"
      "[effect.walls]\nx_min = \"slip\"\n");
  world.for_particles([&](Body<2>& body, Index p) {
    const Real x = body.particles.data<Real>(core::position, 0)[p];
    body.particles.data<Real>(core::velocity, 0)[p] = speed * std::sin(pi * x / (2 * L));
    if (body.particles.has(core::velocity_gradient))
      body.particles.data<Real>(core::velocity_gradient, 0)[p] =
          speed * pi / (2 * L) * std::cos(pi * x / (2 * L));
  });
  const auto momentum = [&] { return sum_over(world, [](const Vec<2>&, const Vec<2>& v) { return v[0]; }); };
  const Real start = momentum();
  // Crossings of zero and the extremes between them.
  std::vector<Real> zeros, extremes;
  test::Curve curve{"bar_" + scheme, false, {"time [s]", scheme, "reference cos(omega t)"}, {}};
  Real before = start, extreme = 0;
  world.advance(periods * period, [&] {
    const Real now = momentum(), t = world.state.time;
    if ((now > 0) != (before > 0)) {
      zeros.push_back(t - world.state.dt * now / (now - before));
      extremes.push_back(extreme);
      extreme = 0;
    }
    extreme = std::max(extreme, std::abs(now) / start);
    before = now;
    if (world.state.step % 8 == 0) curve.rows.push_back({t, now / start, std::cos(2 * pi * t / period)});
  });
  curve.write();
  ASSERT_GE(zeros.size(), 19u);
  const Real measured = 2 * (zeros.back() - zeros.front()) / static_cast<Real>(zeros.size() - 1);
  test::verify(section, "vibrating bar, " + scheme + ": period", measured, test::within(period, 0.005), "s");
  // The middle of the tenth period's half-waves over the start.
  test::verify(section, "vibrating bar, " + scheme + ": amplitude after 10 periods", extremes.back(),
               test::at_least(0.99));
}

TEST(Elastodynamics, VibratingBarApic) { vibrating_bar("apic"); }
TEST(Elastodynamics, VibratingBarFlip) { vibrating_bar("flip"); }
TEST(Elastodynamics, VibratingBarPolypic) { vibrating_bar("polypic"); }

// A rod that hits a wall at v0 is stopped and sent back by a wave that runs to its free end and back: force rho c v0 per
// area for 2 L / c, and away at v0. nu = 0.
TEST(Elastodynamics, RodOnAWall) {
  constexpr Real L = 1, width = 0.04, density = 1, modulus = 1e4, v0 = 0.5, h = 0.005;
  const Real c = std::sqrt(modulus / density), mass = density * L * width;
  Stepper<2> world(fmt::format(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [1.3, 0.12]\n[grid]\nspacing = {}\n[time]\nend = "
      "1\n{}"
      "[material.rod]\nmodel = \"neo_hookean\"\nyoungs_modulus = {}\npoisson_ratio = 0\ndensity = {}\n"
      "[[body]]\nmaterial = \"rod\"\nparticles_per_cell = 4\nvelocity = [{}, 0]\n"
      "shape = {{type = \"box\", lower = [0.03, 0.04], upper = [1.03, 0.08]}}\n"
      "[effect.walls]\nx_min = \"separate\"\n",
      h, transfer_text("apic"), modulus, density, -v0));
  const auto momentum = [&] { return sum_over(world, [](const Vec<2>&, const Vec<2>& v) { return v[0]; }); };
  test::Curve curve{"rod", false, {"time c / L", "momentum / (m v0)"}, {}};
  // The way to the wall, the contact and the way back.
  Real quarter = 0, three_quarters = 0, before = momentum(), fastest = 0;
  const Real whole = 2 * mass * v0;
  world.advance(0.06 / v0 + 2 * L / c + 0.03 / v0, [&] {
    const Real now = momentum(), t = world.state.time, dt = world.state.dt;
    const auto crossed = [&](Real level) { return before < level && now >= level; };
    const auto when = [&](Real level) { return t - dt * (now - level) / (now - before); };
    if (crossed(-mass * v0 + 0.25 * whole)) quarter = when(-mass * v0 + 0.25 * whole);
    if (crossed(-mass * v0 + 0.75 * whole)) three_quarters = when(-mass * v0 + 0.75 * whole);
    fastest = std::max(fastest, now);
    before = now;
    if (world.state.step % 4 == 0) curve.rows.push_back({t * c / L, now / (mass * v0)});
  });
  curve.write();
  // Half of the change of momentum between a quarter and three quarters of it.
  const Real force = 0.5 * whole / (three_quarters - quarter);
  test::verify(section, "rod on a wall: stress over rho c v0", force / width / (density * c * v0),
               test::within(1, 0.02));
  test::verify(section, "rod on a wall: contact time over 2 L / c", whole / force / (2 * L / c),
               test::within(1, 0.02));
  test::verify(section, "rod on a wall: speed of the rebound over v0", before / (mass * v0),
               test::within(1, 0.02));
}

TEST(Elastodynamics, TwoDiscsApic) { test::two_discs("apic", 1.0 / 80, 0.4, 0.94); }
TEST(Elastodynamics, TwoDiscsFlip) { test::two_discs("flip", 1.0 / 80, 0.4, 0.97); }

// A disc that turns ten times keeps its radius of gyration.
void rotation(const std::string& scheme) {
  Stepper<2> world(
      "dimension = 2\n[domain]\nlower = [-1, -1]\nupper = [1, 1]\n[grid]\nspacing = 0.05\n[time]\nend = "
      "10\ncfl = 0.3\n" +
      transfer_text(scheme) +
      "[material.stiff]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1000\npoisson_ratio = 0.3\ndensity = 1\n"
      "[[body]]\nmaterial = \"stiff\"\nangular_velocity = 6.283185307179586\n"
      "shape = {type = \"sphere\", center = [0, 0], radius = 0.4}\n");
  const Real mass = sum_over(world, [](const Vec<2>&, const Vec<2>&) { return 1.0; });
  const auto radius = [&] {
    return std::sqrt(sum_over(world, [](const Vec<2>& x, const Vec<2>&) { return x.squaredNorm(); }) / mass);
  };
  const Real start = radius();
  // It starts without strain, so that it first swings about the radius that the spin stretches it to, by about
  // rho omega^2 R^2 / 4E = 0.2 %; means over a turn leave that out.
  test::Curve curve{"rotation_" + scheme, false, {"turns", "radius of gyration over its first"}, {}};
  Real early = 0, late = 0, early_count = 0, late_count = 0;
  world.advance(10, [&] {
    const Real now = radius() / start, t = world.state.time;
    if (world.state.step % 20 == 0) curve.rows.push_back({t, now});
    if (t < 1) {
      early += now;
      ++early_count;
    } else if (t > 9) {
      late += now;
      ++late_count;
    }
  });
  curve.write();
  test::verify(section, "rotating disc, " + scheme + ": drift of the radius over 10 turns",
               std::abs(late / late_count - early / early_count), test::at_most(1e-3));
}

TEST(Elastodynamics, RotatingDiscApic) { rotation("apic"); }
TEST(Elastodynamics, RotatingDiscFlip) { rotation("flip"); }
TEST(Elastodynamics, RotatingDiscPolypic) { rotation("polypic"); }

}  // namespace
