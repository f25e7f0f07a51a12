// Poisson-disk sampling: distances, density, volumes, and the same points for any number of slabs.
#include "mpm_hpc/scene/poisson_tile.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/scene/seeding.hpp"

namespace mpm {
namespace {

template <int Dim>
SeedingOptions<Dim> options(Real spacing, int particles_per_cell) {
  SeedingOptions<Dim> o;
  o.spacing = spacing;
  o.particles_per_cell = particles_per_cell;
  o.sampling = Sampling::poisson_disk;
  o.seed = 7;
  return o;
}

template <int Dim>
Real nearest_two(std::vector<Vec<Dim>> points, Real reach) {
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) { return a[0] < b[0]; });
  Real least = reach;
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t j = i + 1; j < points.size() && points[j][0] - points[i][0] < least; ++j)
      least = std::min(least, (points[j] - points[i]).norm());
  return least;
}

// A box of more than one tile, whose seams must not show.
template <int Dim>
void check_tile(int particles_per_cell) {
  const PoissonTile<Dim> tile(particles_per_cell, 7);
  const int cells = tile.side() + 3;
  const Real h = 0.1;
  const Seeding<Dim> seeding(Shape<Dim>::box(Vec<Dim>::Zero(), Vec<Dim>::Constant(cells * h)),
                             options<Dim>(h, particles_per_cell));
  const auto points = seeding.particles(0, seeding.cells());
  const Real possible = h * densest_distance<Dim>(particles_per_cell),
             least = nearest_two<Dim>(points, possible);
  const Real density = static_cast<Real>(points.size()) / std::pow(cells, Dim);
  std::printf(
      "%dD, %d per cell, tile of %d cells: nearest two at %.3f of the largest possible distance (expected "
      "about 0.7), "
      "density %.3f per cell\n",
      Dim, particles_per_cell, tile.side(), least / possible, density);
  EXPECT_GT(least, 0.6 * possible);
  EXPECT_LE(least, possible);
  EXPECT_NEAR(density, particles_per_cell, 0.03 * particles_per_cell);
  // Exactly so many over a whole tile.
  std::size_t sum = 0;
  Eigen::Matrix<std::int64_t, Dim, 1> place;
  for (int cell = 0, all = static_cast<int>(std::lround(std::pow(tile.side(), Dim))); cell < all; ++cell) {
    for (int a = 0, rest = cell; a < Dim; ++a, rest /= tile.side())
      place[a] = rest % tile.side() - 2 * tile.side();
    sum += tile.cell(place).size();
  }
  EXPECT_EQ(sum, static_cast<std::size_t>(particles_per_cell * std::lround(std::pow(tile.side(), Dim))));
}

TEST(PoissonTile, DistanceAndDensity2D) {
  for (const int particles_per_cell : {1, 5, 16}) check_tile<2>(particles_per_cell);
}
TEST(PoissonTile, DistanceAndDensity3D) {
  for (const int particles_per_cell : {1, 8, 40}) check_tile<3>(particles_per_cell);
}

TEST(PoissonTile, EveryPartOfABodyIsAboutAsDense) {
  const Seeding<2> seeding(Shape<2>::box({0, 0}, {8, 8}), options<2>(0.5, 6));
  std::vector<int> counts(16, 0);  // of 4 x 4 cells each
  for (const Vec<2>& x : seeding.particles(0, seeding.cells()))
    ++counts[static_cast<std::size_t>(4 * static_cast<int>(x[0] / 2) + static_cast<int>(x[1] / 2))];
  Real squares = 0;
  for (const int count : counts) squares += (count - 96) * (count - 96);
  const Real scatter = std::sqrt(squares / 16), independent = std::sqrt(96.0);
  std::printf("counts of 96 scatter by %.2f (independent points: %.2f)\n", scatter, independent);
  EXPECT_LT(scatter, 0.5 * independent);
}

template <int Dim>
void check_slabs() {
  const Seeding<Dim> seeding(Shape<Dim>::sphere(Vec<Dim>::Constant(0.3), 0.41), options<Dim>(0.1, 6));
  const auto whole = seeding.particles(0, seeding.cells());
  ASSERT_GT(whole.size(), 100u);
  const Real exact = Dim == 2 ? std::numbers::pi * 0.41 * 0.41 : 4 * std::numbers::pi / 3 * std::pow(0.41, 3);
  EXPECT_NEAR(static_cast<Real>(whole.size()) * seeding.particle_volume(), exact, 0.04 * exact);
  EXPECT_NEAR(seeding.shape_volume(0, seeding.cells()), exact, 0.002 * exact);
  for (int parts : {2, 3, 7}) {
    std::vector<Vec<Dim>> joined;
    Real volume = 0;
    for (int part = 0; part < parts; ++part) {
      const GlobalIndex begin = seeding.first_cell(part, parts), end = seeding.first_cell(part + 1, parts);
      const auto slab = seeding.particles(begin, end);
      joined.insert(joined.end(), slab.begin(), slab.end());
      volume += seeding.shape_volume(begin, end);
    }
    EXPECT_EQ(joined, whole) << parts;  // bitwise, in the same order
    EXPECT_NEAR(volume, seeding.shape_volume(0, seeding.cells()), 1e-14);
  }
}

TEST(PoissonTile, TheSameForAnyNumberOfSlabs) {
  check_slabs<2>();
  check_slabs<3>();
}

TEST(PoissonTile, TouchingBodiesKeepTheirDistance) {
  const Seeding<2> left(Shape<2>::box({0, 0}, {0.5, 1}), options<2>(0.1, 9));
  const Seeding<2> right(Shape<2>::box({0.5, 0}, {1, 1}), options<2>(0.1, 9));
  auto points = left.particles(0, left.cells());
  for (const Vec<2>& x : right.particles(0, right.cells())) points.push_back(x);
  const Real possible = 0.1 * densest_distance<2>(9);
  EXPECT_GT(nearest_two<2>(points, possible), 0.6 * possible);
}

std::string fault(const std::string& body, SeedingOptions<2>& o) {
  Parameters p = Parameters::read_text("[body]\n" + body, "s.toml");
  try {
    p.section("body", [&](Parameters& q) { declare_seeding<2>(q, o); });
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PoissonTile, Keys) {
  SeedingOptions<2> o;
  EXPECT_EQ(fault("sampling = \"poisson_disk\"\nparticles_per_cell = 5", o), "accepted");
  EXPECT_EQ(o.sampling, Sampling::poisson_disk);
  o = {};
  EXPECT_EQ(fault("sampling = \"jittered\"", o), "accepted");
  EXPECT_EQ(o.jitter, 0.5);
  o = {};
  EXPECT_EQ(fault("jitter = 0.2", o), "accepted");
  EXPECT_EQ(o.jitter, 0.2);
  EXPECT_EQ(
      fault("sampling = \"poisson_disk\"\njitter = 0.2", o),
      "s.toml:3:10: jitter has no effect with sampling = \"poisson_disk\"; take \"jittered\", or drop it.");
}

}  // namespace
}  // namespace mpm
