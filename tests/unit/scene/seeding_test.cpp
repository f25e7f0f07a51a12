#include "mpm_hpc/scene/seeding.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"

namespace mpm {
namespace {

constexpr Real pi = std::numbers::pi;

template <int Dim>
SeedingOptions<Dim> options(Real spacing, int particles_per_cell, Real jitter = 0) {
  SeedingOptions<Dim> o;
  o.spacing = spacing;
  o.particles_per_cell = particles_per_cell;
  o.jitter = jitter;
  o.seed = 42;
  return o;
}

template <int Dim>
std::vector<Vec<Dim>> all(const Seeding<Dim>& seeding) {
  return seeding.particles(0, seeding.cells());
}

template <int Dim>
void check_slabs() {
  const Seeding<Dim> seeding(Shape<Dim>::sphere(Vec<Dim>::Constant(0.3), 0.41),
                             options<Dim>(0.1, 1 << Dim, 0.3));
  const auto whole = all(seeding);
  ASSERT_GT(whole.size(), 100u);
  for (int parts : {1, 2, 3, 7, 1000}) {
    std::vector<Vec<Dim>> joined;
    for (int part = 0; part < parts; ++part) {
      const auto slab =
          seeding.particles(seeding.first_cell(part, parts), seeding.first_cell(part + 1, parts));
      joined.insert(joined.end(), slab.begin(), slab.end());
    }
    EXPECT_EQ(joined, whole) << parts;  // bitwise, in the same order
  }
}

TEST(Seeding, TheSameForAnyNumberOfSlabs2D) { check_slabs<2>(); }
TEST(Seeding, TheSameForAnyNumberOfSlabs3D) { check_slabs<3>(); }

TEST(Seeding, BoxesAreFilledExactly) {
  // 10 x 4 cells of 9 particles; the faces lie on cell faces.
  const Seeding<2> plate(Shape<2>::box({0, 0}, {1, 0.4}), options<2>(0.1, 9));
  EXPECT_EQ(all(plate).size(), 360u);
  EXPECT_NEAR(plate.particle_volume() * 360, 0.4, 1e-15);
  const Seeding<3> block(Shape<3>::box({-1, 0, 2}, {0, 0.5, 3}), options<3>(0.25, 8));
  EXPECT_EQ(all(block).size(), 4u * 2 * 4 * 8);
  EXPECT_DOUBLE_EQ(block.particle_volume(), std::pow(0.25, 3) / 8);
  // The first particle is the centre of the first sub-cell.
  EXPECT_NEAR((all(plate)[0] - Vec<2>(0.1 / 6, 0.1 / 6)).norm(), 0, 1e-16);
}

// Faces through lattice points: half-open, so that touching bodies tile space, whatever the roundoff.
TEST(Seeding, TouchingBodiesShareNoPoint) {
  for (Real h : {0.1, 0.3, 1.0 / 7}) {
    const Real quarter = h / 4;  // lattice points at quarter, 3 quarter, ...
    const Seeding<2> left(Shape<2>::box({quarter, quarter}, {quarter + 5 * h, quarter + 3 * h}),
                          options<2>(h, 4));
    const Seeding<2> right(Shape<2>::box({quarter + 5 * h, quarter}, {quarter + 9 * h, quarter + 3 * h}),
                           options<2>(h, 4));
    EXPECT_EQ(all(left).size(), 10u * 6) << h;
    EXPECT_EQ(all(right).size(), 8u * 6) << h;
    for (const auto& x : all(left)) EXPECT_LT(x.x(), quarter + 4.9 * h);
  }
}

TEST(Seeding, VolumesConverge) {
  const Seeding<2> disc(Shape<2>::sphere({0.1, 0.2}, 1), options<2>(0.02, 4));
  EXPECT_NEAR(all(disc).size() * disc.particle_volume(), pi, 2e-3);
  const Seeding<3> ball(Shape<3>::sphere({0.1, 0.2, 0.3}, 1), options<3>(0.05, 8));
  EXPECT_NEAR(all(ball).size() * ball.particle_volume(), 4 * pi / 3, 5e-3);
}

TEST(Seeding, JitterStaysInItsSubCellAndIsUniform) {
  const Shape<2> box = Shape<2>::box({0, 0}, {10, 10});
  const auto lattice = all(Seeding<2>(box, options<2>(0.2, 4)));
  const auto shaken = all(Seeding<2>(box, options<2>(0.2, 4, 0.25)));
  auto other_seed = options<2>(0.2, 4, 0.25);
  other_seed.seed = 43;
  const auto other = all(Seeding<2>(box, other_seed));
  ASSERT_EQ(shaken.size(), 10000u);
  Vec<2> mean = Vec<2>::Zero(), square = Vec<2>::Zero();
  Real mixed = 0;
  int same = 0;
  for (std::size_t i = 0; i < shaken.size(); ++i) {
    const Vec<2> shift = (shaken[i] - lattice[i]) / 0.1;  // over the edge of a sub-cell
    EXPECT_LE(shift.cwiseAbs().maxCoeff(), 0.25 + 1e-12);
    mean += shift / 1e4;
    square += shift.cwiseAbs2() / 1e4;
    mixed += shift.x() * shift.y() / 1e4;
    same += shaken[i] == other[i];
  }
  // Uniform on [-1/4, 1/4]: variance 1/48; five standard errors of the mean are 0.0072.
  EXPECT_LT(mean.cwiseAbs().maxCoeff(), 0.0072);
  EXPECT_NEAR(square.x(), 1.0 / 48, 1e-3);
  EXPECT_NEAR(square.y(), 1.0 / 48, 1e-3);
  EXPECT_NEAR(mixed, 0, 1.1e-3);
  EXPECT_EQ(same, 0);
}

// The jitter belongs to the place in the lattice, not to the body's bounds.
TEST(Seeding, JitterDoesNotDependOnTheBody) {
  const auto small = all(Seeding<2>(Shape<2>::box({1, 1}, {2, 2}), options<2>(0.5, 4, 0.2)));
  const auto large = all(Seeding<2>(Shape<2>::box({0, 0}, {3, 3}), options<2>(0.5, 4, 0.2)));
  for (const auto& x : small) EXPECT_NE(std::find(large.begin(), large.end(), x), large.end());
}

std::string refusal(int particles_per_cell, int dim) {
  try {
    dim == 2 ? particles_per_direction<2>(particles_per_cell)
             : particles_per_direction<3>(particles_per_cell);
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Seeding, OnlyPowersAreParticleCounts) {
  for (int n = 1; n <= 10; ++n) {
    EXPECT_EQ(particles_per_direction<2>(n * n), n);
    EXPECT_EQ(particles_per_direction<3>(n * n * n), n);
  }
  EXPECT_EQ(refusal(8, 2),
            "particles_per_cell = 8 is no perfect square; the nearest that are so are 4 and 9; or take "
            "sampling = \"poisson_disk\".");
  EXPECT_EQ(refusal(40, 3),
            "particles_per_cell = 40 is no perfect cube; the nearest that are so are 27 and 64; or take "
            "sampling = \"poisson_disk\".");
  EXPECT_NE(refusal(0, 2), "accepted");
  Parameters p = Parameters::read_text("[body]\nparticles_per_cell = 5", "s.toml");
  SeedingOptions<2> o;
  try {
    p.section("body", [&](Parameters& q) { declare_seeding<2>(q, o); });
    FAIL();
  } catch (const UserError& error) {
    EXPECT_STREQ(
        error.what(),
        "s.toml:2:22: particles_per_cell = 5 is no perfect square; the nearest that are so are 4 and 9; or take "
        "sampling = \"poisson_disk\".");
  }
}

TEST(Seeding, UnboundedShapesNeedADomain) {
  const auto ground = Shape<2>::plane({0, 0.5}, {0, 1});
  EXPECT_THROW(Seeding<2>(ground, options<2>(0.1, 4)), UserError);
  auto limited = options<2>(0.1, 4);
  limited.domain = {Vec<2>(0, 0), Vec<2>(2, 3)};
  EXPECT_EQ(all(Seeding<2>(ground, limited)).size(), 20u * 5 * 4);
  EXPECT_THROW(Seeding<2>(ground, options<2>(0, 4)), UserError);
  const auto nothing = Shape<2>::intersection_of({Shape<2>::sphere({0, 0}, 1), Shape<2>::sphere({5, 0}, 1)});
  EXPECT_EQ(all(Seeding<2>(nothing, options<2>(0.1, 4))).size(), 0u);
}

}  // namespace
}  // namespace mpm
