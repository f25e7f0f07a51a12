// Orders of kernels and transfers on the manufactured solutions, over 32 to 128 cells in each direction of the periodic
// domain.
#include "support/manufactured.hpp"

using namespace mpm;

namespace {

const std::vector<Real> spacings = {1.0 / 16, 1.0 / 32, 1.0 / 64};

std::vector<std::string> scheme(const std::string& kernel, const std::string& name) {
  return {"define.A=1e-4", "body.0.particles_per_cell=16", "grid.kernel=" + kernel,
          "transfer.scheme=" + name};
}

TEST(ManufacturedOrders, QuadraticAndPic) {
  const test::Convergence c = test::along_axes("quadratic APIC", 1e-4, spacings, scheme("quadratic", "apic"));
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
  const test::Convergence pic = test::along_axes("quadratic PIC", 1e-4, spacings, scheme("quadratic", "pic"));
  test::verify(test::manufactured_section, pic.name + ": order", pic.order, test::between(0.5, 1.3));
  test::verify(test::manufactured_section, pic.name + ": error over that of APIC at h = 1/64",
               pic.errors.back() / c.errors.back(), test::between(100, 1000));
}

TEST(ManufacturedOrders, Cubic) {
  const test::Convergence c = test::along_axes("cubic APIC", 1e-4, spacings, scheme("cubic", "apic"));
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
}

// With two per cell and direction the particles' places within the cells show once they cross them.
TEST(ManufacturedOrders, PlateauOfFewParticles) {
  const test::Convergence c =
      test::along_axes("quadratic APIC, large displacements, 4 per cell", 0.05, spacings, {});
  test::verify(test::manufactured_section, c.name + ": 1/h at which the plateau starts", c.plateau,
               test::at_least(32), "1/m");
}

TEST(ManufacturedOrders, LinearKernelDoesNotConverge) {
  const test::Convergence c =
      test::along_axes("linear APIC, large displacements, to h = 1/64", 0.05, spacings,
                       {"body.0.particles_per_cell=16", "grid.kernel=linear"});
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_most(0.5));
}

TEST(ManufacturedOrders, VortexQuadratic) {
  const test::Convergence c =
      test::vortex("quadratic APIC, circles", test::Filling::circles, 4, spacings, {});
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
}

TEST(ManufacturedOrders, VortexCubic) {
  const test::Convergence c =
      test::vortex("cubic APIC, circles", test::Filling::circles, 4, spacings, {"grid.kernel=cubic"});
  test::verify(test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8));
}

TEST(ManufacturedOrders, VortexOnALattice) {
  const test::Convergence c =
      test::vortex("quadratic APIC, lattice", test::Filling::lattice, 4, spacings, {});
  test::verify_short(
      test::manufactured_section, c.name + ": order", c.order, test::at_least(1.8), test::at_least(1.5),
      "a lattice fills the ring with a staircase at the rims, whose torque turns the free ring; circles of "
      "particles have the order");
}

}  // namespace
