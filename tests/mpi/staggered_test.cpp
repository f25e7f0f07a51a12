// The phase field in turn with implicit steps, on any number of ranks: what drives the cracks is the deformation that the step
// leaves, and passes bring force and cracks into balance.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "support/stepper.hpp"

namespace mpm::test {
namespace {

constexpr Real length = 0.125, residual = 1e-3;

// A particle of split neo-Hookean material with lambda = 0 in plane strain, so that kappa = mu.
struct Point {
  Mat<2> F;
  Real c;
  Point(const Body<2>& body, Index p) {
    for (int k = 0; k < 4; ++k) F(k / 2, k % 2) = body.particles.data<Real>(core::deformation_gradient, k)[p];
    c = body.particles.data<Real>(body.particles.find("phase"))[p];
  }
  Real energy(Real mu) const {
    const Real J = F.determinant();
    return mu / 2 * (F.squaredNorm() / J - 2) + mu / 2 * ((J * J - 1) / 2 - std::log(J));
  }
  Real equilibrium(Real mu, Real toughness) const {
    return 1 / (1 + 4 * length * (1 - residual) * energy(mu) / toughness);
  }
  // P_xx, by tau = mu / J dev(b) + kappa / 2 (J^2 - 1) I.
  Real stress(Real mu) const {
    const Real J = F.determinant(), g = (1 - residual) * c * c + residual;
    const Mat<2> b = F * F.transpose();
    const Mat<2> tau =
        mu / J * (b - b.trace() / 2 * Mat<2>::Identity()) + mu / 2 * (J * J - 1) * Mat<2>::Identity();
    return g * (tau * F.inverse().transpose())(0, 0);
  }
};

std::string scene_text(const std::string& time, Real modulus, Real toughness, Real width,
                       const std::string& more) {
  return fmt::format(
             "dimension = 2\n[domain]\nlower = [-2, -1]\nupper = [6, 2]\n[grid]\nspacing = "
             "0.125\n[time]\nend = 10\n{}"
             "[newton]\ntolerance = 1e-9\n[material.brittle]\nmodel = \"split_neo_hookean\"\ndensity = "
             "1\nyoungs_modulus = {}\n"
             "poisson_ratio = 0\nfracture_toughness = {}\n[[body]]\nmaterial = "
             "\"brittle\"\nparticles_per_cell = 4\n"
             "shape = {{type = \"box\", lower = [0, 0], upper = [{}, 1]}}\n"
             "[effect.phase_field]\nlength_scale = {}\nresidual = {}\ncorrected_toughness = false\ntolerance "
             "= 1e-10\n",
             time, modulus, toughness, width, length, residual) +
         more;
}

// A block that stretches freely, so soft that nothing slows it: c of the first step is that of the elastic deformation that
// this step leaves, after the plastic return if there is one.
TEST(Staggered, CracksAreDrivenByTheStepsOwnDeformation) {
  constexpr Real modulus = 1e-9, rate = 1, dt = 0.2, toughness = 1e-10;
  for (const std::string update : {"value", "increment"})
    for (const bool plastic : {false, true}) {
      std::string more = "update = \"" + update + "\"\n";
      if (plastic) more += "[material.brittle.plasticity]\nmodel = \"von_mises\"\nyield_stress = 2e-11\n";
      SceneWorld<2> world(
          scene_text("integrator = \"implicit\"\nmax_dt = 0.2\ncfl = 0.9\n", modulus, toughness, 1, more));
      world.for_particles([&](Body<2>& body, Index p) {
        FieldSet& f = body.particles;
        f.data<Real>(core::velocity, 0)[p] = rate * (f.data<Real>(core::position, 0)[p] - 0.5);
        f.data<Real>(core::velocity_gradient, 0)[p] = rate;
      });
      world.integrator->initialise(world.state);
      world.state.dt = dt;
      world.integrator->step(world.state);
      world.for_particles([&](Body<2>& body, Index p) {
        const Point point(body, p);
        const bool elastic = std::abs(point.F(0, 0) - 1 - rate * dt) < 1e-6;
        EXPECT_NE(elastic, plastic);
        EXPECT_NEAR(point.c, point.equilibrium(modulus / 2, toughness), 1e-6) << update;
        EXPECT_LT(point.c, 0.97);
      });
    }
}

// A strip stretched between grips in steps of a fifth of the strain that it bears. Far from the grips it is homogeneous: c and
// the force are those of its deformation, if the passes go on until they fit; a single pass is off.
TEST(Staggered, PassesBalanceForceAndCracks) {
  constexpr Real modulus = 1000, toughness = 0.2, dt = 0.1, height = 1;
  const Real largest_strain = std::sqrt(toughness / (6 * length * modulus)), pull = 2 * largest_strain * 3.48;
  std::vector<Real> worst_of;
  for (const int passes : {1, 200}) {
    Stepper<2> world(scene_text("integrator = \"quasi_static\"\nmax_dt = 0.1\n", modulus, toughness, 4,
                                fmt::format("passes = {}\npass_tolerance = 1e-7\n"
                                            "[[effect.grip]]\nname = \"left\"\nshape = {{type = \"box\", "
                                            "lower = [-1, -1], upper = [0.26, 2]}}\n"
                                            "[[effect.grip]]\nname = \"right\"\nshape = {{type = \"box\", "
                                            "lower = [3.74, -1], upper = [5, 2]}}\n"
                                            "velocity = [{}, 0]\ndirections = [\"x\"]\n",
                                            passes, pull)));
    Real impulse = 0, worst = 0;
    world.advance(0.4, [&] {
      const Real total = world.state.communicator().sum(world.state.ledger["impulse_right_x"]);
      const Real force = std::abs(total - impulse) / dt;
      impulse = total;
      std::vector<Real> sums(2, 0.0);
      Real off = 0;
      world.for_particles([&](Body<2>& body, Index p) {
        if (std::abs(body.particles.data<Real>(core::position)[p] - 2) > 0.25) return;
        const Point point(body, p);
        sums[0] += point.stress(modulus / 2);
        sums[1] += 1;
        off = std::max(off, std::abs(point.c - point.equilibrium(modulus / 2, toughness)));
      });
      world.state.communicator().sum(sums);
      worst = std::max(
          {worst, std::abs(force / (height * sums[0] / sums[1]) - 1), world.state.communicator().max(off)});
    });
    worst_of.push_back(worst);
    EXPECT_EQ(world.state.guards.contains("staggered_passes_still_changing"), false);
  }
  EXPECT_GT(worst_of[0], 0.1);  // from three fifths of the strain to four, g falls by a sixth
  EXPECT_LT(worst_of[1], 0.002);
}

}  // namespace
}  // namespace mpm::test
