// Manufactured solutions (verification.md section 3) from their scene files: the error of the particles' places against
// the closed form, and how it falls with the spacing.
#include "support/manufactured.hpp"

using namespace mpm;

namespace {

const std::vector<Real> spacings = {1.0 / 16, 1.0 / 32};
const std::string fine = "body.0.particles_per_cell=16";

TEST(Manufactured, AlongTheAxesWithSmallDisplacements) {
  constexpr Real A = 1e-4;
  const test::Convergence c = test::along_axes("small displacements", A, spacings, {"define.A=1e-4", fine});
  test::verify(test::manufactured_section, c.name + ": error over amplitude at h = 1/32", c.errors.back() / A,
               test::at_most(0.005));
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
}

TEST(Manufactured, AlongTheAxesWhereParticlesCrossCells) {
  constexpr Real A = 0.05;
  const test::Convergence c = test::along_axes("large displacements", A, spacings, {fine});
  test::verify(test::manufactured_section, c.name + ": error over amplitude at h = 1/32", c.errors.back() / A,
               test::at_most(0.005));
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
}

// The solution is odd about the sides of the unit box, so slip walls there change nothing.
TEST(Manufactured, AlongTheAxesBetweenSlipWalls) {
  std::vector<std::string> walls = {"domain.periodic=[]", "domain.upper=[1, 1]", "body.0.shape.upper=[1, 1]"};
  for (const std::string side : {"x_min", "x_max", "y_min", "y_max"})
    walls.push_back("effect.walls." + side + "=slip");
  for (const Real A : {1e-4, 0.05}) {
    std::vector<std::string> overrides = walls;
    overrides.insert(overrides.end(), {fmt::format("define.A={}", A), fine});
    const test::Convergence c = test::along_axes(fmt::format("between slip walls, A = {}", A), A, spacings, overrides);
    test::verify(test::manufactured_section, c.name + ": error over amplitude at h = 1/32", c.errors.back() / A,
                 test::at_most(0.005));
    test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
  }
}

// At the end the middle of the ring has turned by 0.2 rad.
TEST(Manufactured, Vortex) {
  const test::Convergence c = test::vortex("circles", test::Filling::circles, 2, spacings, {});
  test::verify(test::manufactured_section, c.name + ": error over way at h = 1/32", c.errors.back() / 0.2,
               test::at_most(0.025));
  test::verify(test::manufactured_section, c.name + ": order, 4 particles per cell", c.order,
               test::at_least(1.8));
}

// The failing control: the forces jump where particles cross cells.
TEST(Manufactured, LinearKernelDoesNotConverge) {
  const test::Convergence c =
      test::along_axes("linear APIC, large displacements", 0.05, spacings, {fine, "grid.kernel=linear"});
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_most(0.5));
}

}  // namespace
