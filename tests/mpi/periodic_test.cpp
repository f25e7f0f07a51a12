// Periodic and open sides: a body doesn't notice where the seam is, a medium without ends stays as it is, and what leaves
// through an open side is gone and counted.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

constexpr Real h = 1.0 / 16;

template <int Dim>
std::string list(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
}

// 16 cells in each direction but the second, which has 12.
template <int Dim>
std::string scene_text(const std::string& sides, const std::string& body, const std::string& more = "") {
  return fmt::format(
      "dimension = {}\n[domain]\nlower = {}\nupper = {}\n{}\n[grid]\nspacing = {}\n[time]\nend = 1\n"
      "[material.m]\nmodel = \"neo_hookean\"\nyoungs_modulus = 10\npoisson_ratio = 0.3\ndensity = 2\n"
      "[[body]]\nmaterial = \"m\"\n{}\n{}",
      Dim, list<Dim>(-0.25, 0.5, 3), list<Dim>(0.75, 1.25, 4), sides, h, body, more);
}

template <int Dim>
std::string all_periodic() {
  return Dim == 2 ? "periodic = [\"x\", \"y\"]" : "periodic = [\"x\", \"y\", \"z\"]";
}

template <int Dim>
void run(test::SceneWorld<Dim>& world, Real end, int steps) {
  ExplicitIntegrator<Dim> integrator(world.state, std::move(world.hooks), {});
  integrator.initialise(world.state);
  world.state.dt = end / steps;
  for (int step = 0; step < steps; ++step) integrator.step(world.state);
}

// Places, deformations and velocities of all particles by identity, on every rank.
template <int Dim>
std::vector<Real> particles(test::SceneWorld<Dim>& world, GlobalIndex count) {
  constexpr int values = 2 * Dim + Dim * Dim;
  std::vector<Real> all(static_cast<std::size_t>(count * values), 0);
  world.for_particles([&](const Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    Real* out = &all[static_cast<std::size_t>(f.template data<GlobalIndex>(core::id)[p] * values)];
    for (int a = 0; a < Dim; ++a) *out++ = f.template data<Real>(core::position, a)[p];
    for (int a = 0; a < Dim; ++a) *out++ = f.template data<Real>(core::velocity, a)[p];
    for (int c = 0; c < Dim * Dim; ++c) *out++ = f.template data<Real>(core::deformation_gradient, c)[p];
  });
  world.state.communicator().sum(all);
  return all;
}

template <class D>
class Periodic : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(Periodic, Dimensions);

// A spinning, compressed ball flies across the seams; another one flies the same way through the middle of the domain.
template <int Dim>
void compare_flights(const std::string& kernel, const std::string& scheme) {
  auto body = [](Real x, Real y, Real z) {
    const std::string center = list<Dim>(x, y, z);
    return fmt::format(
        "shape = {{type = \"sphere\", center = {}, radius = 0.15}}\nvelocity = {}\nangular_velocity = {}\n"
        "deformation_gradient = {}",
        center, list<Dim>(1.5, 0.7, -0.6), Dim == 2 ? "2" : "[1, 0, 2]",
        Dim == 2 ? "[[0.9, 0.05], [0, 1.1]]" : "[[0.9, 0.05, 0], [0, 1.1, 0], [0, 0, 1]]");
  };
  // The shift is a whole number of blocks in each direction: 2, 1 and 2 of them. The second ball reaches over the upper side in x
  // at the start already.
  auto text = [&](const std::string& ball) {
    std::string scene =
        scene_text<Dim>(all_periodic<Dim>(), ball, "[transfer]\nscheme = \"" + scheme + "\"\n");
    const std::string grid = "[grid]\n";
    return scene.replace(scene.find(grid), grid.size(), grid + "kernel = \"" + kernel + "\"\n");
  };
  test::SceneWorld<Dim> first(text(body(0.2, 0.8, 3.6)));
  test::SceneWorld<Dim> second(text(body(0.7, 1.05, 3.1)));
  GlobalIndex count = 0;
  first.for_particles([&](const Body<Dim>&, Index) { ++count; });
  count = first.state.communicator().sum(count);
  const std::vector<Real> start = particles<Dim>(second, count);
  run(first, 0.15, 60);
  run(second, 0.15, 60);
  const std::vector<Real> a = particles<Dim>(first, count), b = particles<Dim>(second, count);
  Vec<Dim> period, shift;
  for (int d = 0; d < Dim; ++d) {
    period[d] = first.state.geometry().period(d);
    shift[d] = d == 0 ? 0.5 : d == 1 ? 0.25 : -0.5;
  }
  constexpr int values = 2 * Dim + Dim * Dim;
  Real worst = 0, crossed = 0;
  for (std::size_t p = 0; p < a.size(); p += values) {
    for (int d = 0; d < Dim; ++d) {
      const Real apart = b[p + d] - a[p + d] - shift[d], turns = std::round(apart / period[d]);
      worst = std::max(worst, std::abs(apart - turns * period[d]));
      crossed += turns != 0;
    }
    for (int c = Dim; c < values; ++c) worst = std::max(worst, std::abs(b[p + c] - a[p + c]));
  }
  if (test::rank() == 0)
    std::printf(
        "%dD, %s %s: largest difference between the two flights %.2g (expected < 1e-12), %g coordinates "
        "wrapped\n",
        Dim, kernel.c_str(), scheme.c_str(), worst, crossed);
  // Nodes of little mass at the rim of a body amplify rounding, most with forces that jump from cell to cell.
  EXPECT_LT(worst, kernel == "linear" ? 1e-11 : 1e-12);
  EXPECT_GT(crossed, 10);
  EXPECT_EQ(a.size(), start.size());
}

TYPED_TEST(Periodic, ABodyDoesNotNoticeTheSeam) {
  constexpr int Dim = TypeParam::value;
  compare_flights<Dim>("quadratic", "apic");
  compare_flights<Dim>("cubic", "apic");
  compare_flights<Dim>("linear", "flip");
}

// The phase field's system couples the nodes on both sides of the seam, however it is applied.
TYPED_TEST(Periodic, ACrackDoesNotNoticeTheSeam) {
  constexpr int Dim = TypeParam::value;
  for (const std::string solver : {"stencil", "matrix_free", "assembled"}) {
    auto world_at = [&](const Vec<Dim>& by) {
      auto point = [&](Real x, Real y, Real z) {
        return list<Dim>(x + by[0], y + by[1], z + (Dim == 3 ? by[Dim - 1] : 0));
      };
      std::string text = scene_text<Dim>(
          all_periodic<Dim>(),
          "shape = {type = \"box\", lower = " + point(0, 0.625, 3.25) +
              ", upper = " + point(0.375, 0.875, 3.5) + "}\nvelocity = " + list<Dim>(1.5, 0.7, -0.6),
          "[effect.phase_field]\noperator = \"" + solver +
              "\"\ntolerance = 1e-12\nactive_tolerance = 0\n[[effect.phase_field.crack]]\nshape = {type = "
              "\"box\", lower = " +
              point(0.15, 0.6, 3.2) + ", upper = " + point(0.25, 0.75, 3.6) + "}\n");
      const std::string model = "neo_hookean\"";
      text.replace(text.find(model), model.size(), "split_neo_hookean\"\nfracture_toughness = 1");
      return std::make_unique<test::SceneWorld<Dim>>(text);
    };
    Vec<Dim> shift = Vec<Dim>::Constant(0.5);
    shift[1] = 0.25;
    const auto first = world_at(Vec<Dim>::Zero()), second = world_at(shift);
    auto phases = [](test::SceneWorld<Dim>& world) {
      std::vector<Real> all(6 * 2 * 4 * 2 * 4 * 2 * 2, 0);
      world.for_particles([&](const Body<Dim>& body, Index p) {
        const FieldSet& f = body.particles;
        all.at(static_cast<std::size_t>(f.template data<GlobalIndex>(core::id)[p])) =
            f.template data<Real>(f.find("phase"))[p];
      });
      world.state.communicator().sum(all);
      return all;
    };
    constexpr int steps = Dim == 2 ? 40 : 12;
    run(*first, 0.0025 * steps, steps);
    run(*second, 0.0025 * steps, steps);
    const std::vector<Real> a = phases(*first), b = phases(*second);
    Real worst = 0, least = 1, most = 0;
    for (std::size_t p = 0; p < a.size(); ++p) {
      worst = std::max(worst, std::abs(a[p] - b[p]));
      if (a[p] > 0) least = std::min(least, a[p]);
      most = std::max(most, a[p]);
    }
    EXPECT_LT(worst, 1e-9) << solver;
    EXPECT_LT(least, 0.5);
    EXPECT_GT(most, 0.8);
  }
}

TYPED_TEST(Periodic, MomentumIsConservedAcrossTheSeam) {
  constexpr int Dim = TypeParam::value;
  test::SceneWorld<Dim> world(scene_text<Dim>(
      all_periodic<Dim>(), "shape = {type = \"box\", lower = " + list<Dim>(-0.25, 0.5, 3) +
                               ", upper = " + list<Dim>(0.25, 1, 3.5) + "}\nvelocity = " +
                               (Dim == 2 ? "[\"1 + 0.2*sin(9*y)\", \"-1 + x\"]"
                                         : "[\"1 + 0.2*sin(9*y)\", \"-1 + x\", \"0.5*cos(5*z)\"]")));
  auto momentum = [&] {
    std::vector<Real> sums(Dim + 1, 0);
    world.for_particles([&](const Body<Dim>& body, Index p) {
      const FieldSet& f = body.particles;
      const Real m = f.template data<Real>(core::mass)[p];
      sums[Dim] += m;
      for (int a = 0; a < Dim; ++a) sums[a] += m * f.template data<Real>(core::velocity, a)[p];
    });
    world.state.communicator().sum(sums);
    return sums;
  };
  const std::vector<Real> before = momentum();
  run(world, 0.4, 160);
  const std::vector<Real> after = momentum();
  EXPECT_EQ(after[Dim], before[Dim]);
  for (int a = 0; a < Dim; ++a) EXPECT_NEAR(after[a], before[a], 1e-12 * before[Dim]) << a;
}

TYPED_TEST(Periodic, AUniformMediumStaysUniform) {
  constexpr int Dim = TypeParam::value;
  test::SceneWorld<Dim> world(scene_text<Dim>(
      all_periodic<Dim>(),
      "shape = {type = \"box\", lower = " + list<Dim>(-0.25, 0.5, 3) +
          ", upper = " + list<Dim>(0.75, 1.25, 4) + "}\nvelocity = " + list<Dim>(1.1, -0.6, 0.3) +
          "\ndeformation_gradient = " +
          (Dim == 2 ? "[[1.05, 0.02], [0, 0.97]]" : "[[1.05, 0.02, 0], [0, 0.97, 0], [0, 0, 1]]")));
  run(world, 0.3, 100);
  Real worst = 0;
  const Real F[] = {1.05, 0.02, 0, 0.97}, v[] = {1.1, -0.6, 0.3};
  GlobalIndex count = 0;
  world.for_particles([&](const Body<Dim>& body, Index p) {
    ++count;
    const FieldSet& f = body.particles;
    for (int a = 0; a < Dim; ++a) {
      worst = std::max(worst, std::abs(f.template data<Real>(core::velocity, a)[p] - v[a]));
      for (int b = 0; b < Dim; ++b)
        worst = std::max(worst, std::abs(f.template data<Real>(core::deformation_gradient, a * Dim + b)[p] -
                                         (a < 2 && b < 2 ? F[2 * a + b] : a == b)));
    }
  });
  EXPECT_EQ(world.state.communicator().sum(count), 16 * 12 * (Dim == 2 ? 4 : 16 * 8));
  EXPECT_LT(world.state.communicator().max(worst), 1e-12);
  // Every node of the domain has the same mass, and there are no others.
  GlobalIndex nodes = 0;
  const Real mass = 2 * std::pow(h, Dim) / (1.05 * 0.97);
  for (Slot s = 0; s < world.state.topology().owned(); ++s)
    for_massive_nodes<Real>(world.state, s, [&](const IntVec<Dim>&, const Real* values) {
      ++nodes;
      EXPECT_NEAR(values[Dim], mass, 1e-12 * mass);
    });
  EXPECT_EQ(world.state.communicator().sum(nodes), 16 * 12 * (Dim == 2 ? 1 : 16));
}

TYPED_TEST(Periodic, PlacesOnTheSeamAreWrappedWhateverTheirRounding) {
  constexpr int Dim = TypeParam::value;
  for (const Real lower : {0.0, -0.03125, 0.1, -1e3, 1e6}) {
    const GridGeometry<Dim> grid(Vec<Dim>::Constant(lower), Vec<Dim>::Constant(lower + 12 * h), h, [] {
      std::array<bool, Dim> all;
      all.fill(true);
      return all;
    }());
    for (const Real shift : {0.0, 0.5, 1.0})
      for (const Real seam : {lower + shift * h, lower + (12 + shift) * h, lower - 36 * h, lower + 5.3 * h})
        for (int ulps = -40; ulps <= 40; ++ulps) {
          const Real x =
              seam + ulps * 0.1 * std::numeric_limits<Real>::epsilon() * std::max(1.0, std::abs(lower));
          const Vec<Dim> wrapped = wrapped_place<Dim>(grid, Vec<Dim>::Constant(x), shift);
          const IntVec<Dim> base = base_node<Dim>(grid, wrapped, shift);
          EXPECT_GE(base[0], grid.margin);
          EXPECT_LT(base[0], grid.margin + 12);
          const Real apart = (x - wrapped[0]) / grid.period(0);
          EXPECT_NEAR(apart, std::round(apart), 1e-14 * std::max(1.0, std::abs(lower / h)));
        }
  }
}

TYPED_TEST(Periodic, ParticlesLeaveThroughOpenSidesOnly) {
  constexpr int Dim = TypeParam::value;
  // Half of the box is beyond x_max at the end; nothing stops it, but a closed side would end the run.
  test::SceneWorld<Dim> world(scene_text<Dim>(
      "open = [\"x_max\"]", "shape = {type = \"box\", lower = " + list<Dim>(0.25, 0.75, 3.25) + ", upper = " +
                                list<Dim>(0.5, 1, 3.5) + "}\nvelocity = " + list<Dim>(2, 0, 0)));
  run(world, 0.1875, 60);
  sort_particles(world.state, OrderWithinCell::stable);
  GlobalIndex kept = 0;
  world.for_particles([&](const Body<Dim>& body, Index p) {
    ++kept;
    EXPECT_LE(body.particles.template data<Real>(core::position, 0)[p], 0.75);
  });
  const Communicator& c = world.state.communicator();
  EXPECT_EQ(c.sum(kept), 4 * 8 * (Dim == 2 ? 1 : 8));
  EXPECT_EQ(c.sum(world.state.distribution.take_left()), 4 * 8 * (Dim == 2 ? 1 : 8));
  EXPECT_EQ(c.sum(world.state.distribution.take_removed()), 0);

  test::SceneWorld<Dim> closed(scene_text<Dim>(
      "open = [\"y_max\"]", "shape = {type = \"box\", lower = " + list<Dim>(0.25, 0.75, 3.25) + ", upper = " +
                                list<Dim>(0.5, 1, 3.5) + "}\nvelocity = " + list<Dim>(2, 0, 0)));
  EXPECT_THROW(run(closed, 0.375, 120), NumericalFailure);
}

std::string fault(const std::string& sides, const std::string& more = "",
                  const std::string& lower = "[0, 0.75]", const std::string& upper = "[0.25, 1]") {
  const std::string body = "shape = {type = \"box\", lower = " + lower + ", upper = " + upper + "}";
  try {
    test::SceneWorld<2> world(scene_text<2>(sides, body, more));
  } catch (const UserError& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "accepted";
}

TEST(PeriodicScene, BadSidesAreRefused) {
  EXPECT_EQ(fault("periodic = [\"u\"]"), "scene.toml:5:12: \"u\" is no direction here; use \"x\" and \"y\".");
  EXPECT_EQ(fault("open = [\"left\"]"),
            "scene.toml:5:8: \"left\" is no side; the sides are x_min, x_max, y_min and so on.");
  EXPECT_EQ(fault("periodic = [\"x\"]\nopen = [\"x_min\"]"),
            "scene.toml:6:8: x_min can't be open, since x is periodic; take one of the two out.");
  EXPECT_EQ(fault("periodic = [\"x\"]", "[grid2]").rfind("scene.toml", 0), 0u);
  EXPECT_EQ(fault("periodic = [\"x\"]", "[effect.walls]\nx_min = \"slip\""),
            "scene.toml:19:9: x_min can't be a wall, since domain.periodic has x; take one of the two out.");
  EXPECT_EQ(fault("open = [\"y_max\"]", "[effect.walls]\ny_max = \"slip\""),
            "scene.toml:19:9: y_max can't be a wall, since domain.open has it; take one of the two out.");
  auto with_spacing = [](const std::string& spacing) {
    std::string text =
        scene_text<2>("periodic = [\"y\"]", "shape = {type = \"box\", lower = [0, 0.75], upper = [0.25, 1]}");
    const std::string old = fmt::format("spacing = {}", h);
    text.replace(text.find(old), old.size(), "spacing = " + spacing);
    try {
      test::SceneWorld<2> world(text);
    } catch (const UserError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  // A body may reach over a seam, but not onto itself.
  EXPECT_EQ(fault("periodic = [\"x\", \"y\"]", "", "[-0.3, 0.75]", "[0.25, 1.4]"), "accepted");
  EXPECT_EQ(fault("periodic = [\"x\"]", "", "[-0.5, 0.75]", "[0.6, 1]"),
            "scene.toml:15:1: body \"body_0\" is 1.0625 m long in the periodic direction x, longer than the "
            "domain, and would "
            "overlap itself; shorten it or enlarge the domain");
  EXPECT_EQ(with_spacing("0.05"),
            "scene.toml:5:12: the domain is 15 cells long in y, but a periodic direction takes a multiple of "
            "4 cells, 12 at "
            "least; the nearest lengths are 0.6 and 0.8 m, or change grid.spacing.");
  EXPECT_EQ(with_spacing("0.09375"),
            "scene.toml:5:12: the domain is 8 cells long in y, but a periodic direction takes a multiple of "
            "4 cells, 12 at "
            "least; the nearest length is 1.125 m, or change grid.spacing.");
}

}  // namespace
