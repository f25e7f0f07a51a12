// Manufactured solutions (verification.md section 3) from their scene files: the error of the particles' places against
// the closed form, and how it falls with the spacing.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <functional>

#include "mpm_hpc/simulation/run.hpp"
#include "support/mpi_test.hpp"

using namespace mpm;

namespace {

constexpr Real pi = 3.14159265358979323846;

// Root mean square over the particles of the distance [m] to the exact place at `end` of what started at X.
Real run_to(const std::string& scene, const std::vector<std::string>& overrides, Real end,
            const std::function<Vec<2>(const Vec<2>&, Real)>& exact) {
  const test::SharedTemporaryFolder folder;
  RunOptions options;
  options.output = folder.path() / "run";
  options.until = end;
  std::vector<std::string> all = {"output.frames=false", "output.checkpoint=false", "output.every=0"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  Parameters p = Parameters::read_file(std::string(MPM_SOURCE_DIR) + "/apps/scenes/" + scene, all);
  read_dimension(p);
  Run<2> run(Communicator::world(), read_scene<2>(p), options);
  run.prepare();
  EXPECT_EQ(run.run(), ExitCode::done);
  const State<2>& state = run.state();
  Real squares = 0, count = 0;
  for (const Body<2>& body : state.bodies) {
    const FieldSet& f = body.particles;
    const FieldId start = f.find("initial_position");
    for (Index i = 0; i < f.size(); ++i) {
      if (body.is_padding(i)) continue;
      const Vec<2> X(f.data<Real>(start, 0)[i], f.data<Real>(start, 1)[i]);
      const Vec<2> x(f.data<Real>(core::position, 0)[i], f.data<Real>(core::position, 1)[i]);
      Vec<2> way = x - exact(X, state.time);
      for (int a = 0; a < 2; ++a)
        if (const GridGeometry<2>& grid = state.geometry(); grid.periodic(a))
          way[a] -= grid.period(a) * std::round(way[a] / grid.period(a));
      squares += way.squaredNorm();
      ++count;
    }
  }
  return std::sqrt(state.communicator().sum(squares) / state.communicator().sum(count));
}

// The error at each spacing, printed with the order from the one before it; returns the last order.
Real last_order(const std::string& scene, const std::vector<Real>& spacings,
                const std::vector<std::string>& overrides, Real end,
                const std::function<Vec<2>(const Vec<2>&, Real)>& exact, Real& error) {
  Real order = 0, before = 0;
  for (std::size_t i = 0; i < spacings.size(); ++i) {
    std::vector<std::string> all = overrides;
    all.push_back(fmt::format("grid.spacing={}", spacings[i]));
    error = run_to(scene, all, end, exact);
    if (i > 0) order = std::log(before / error) / std::log(spacings[i - 1] / spacings[i]);
    before = error;
    if (test::rank() == 0)
      std::printf("%s, h = 1/%g: error %.3g%s\n", scene.c_str(), 1 / spacings[i], error,
                  i > 0 ? fmt::format(", order {:.2f} (expected 1.8 to 2)", order).c_str() : "");
  }
  return order;
}

Vec<2> along_axes(const Vec<2>& X, Real t, Real A) {
  const Real phase = 100 * pi * t;
  return X + A * Vec<2>(std::sin(pi * X[0]) * std::sin(phase), std::sin(pi * X[1]) * std::sin(phase + pi));
}

Vec<2> vortex(const Vec<2>& X, Real t) {
  const Real s = 2 * (X.norm() - 1), h = 1 - 8 * s * s + 16 * s * s * s * s,
             angle = 0.2 * std::sin(10 * pi * t) * h;
  const Real c = std::cos(angle), n = std::sin(angle);
  return {c * X[0] - n * X[1], n * X[0] + c * X[1]};
}

TEST(Manufactured, AlongTheAxesWithSmallDisplacements) {
  constexpr Real A = 1e-4;
  Real error = 0;
  const Real order = last_order(
      "manufactured_axis_2d.toml", {1.0 / 16, 1.0 / 32}, {"define.A=1e-4", "body.0.particles_per_cell=16"},
      0.015, [](const Vec<2>& X, Real t) { return along_axes(X, t, A); }, error);
  EXPECT_LT(error, 0.01 * A);
  EXPECT_GT(order, 1.8);
}

TEST(Manufactured, AlongTheAxesWhereParticlesCrossCells) {
  constexpr Real A = 0.05;
  Real error = 0;
  const Real order = last_order(
      "manufactured_axis_2d.toml", {1.0 / 16, 1.0 / 32}, {"body.0.particles_per_cell=16"}, 0.015,
      [](const Vec<2>& X, Real t) { return along_axes(X, t, A); }, error);
  EXPECT_LT(error, 0.01 * A);
  EXPECT_GT(order, 1.8);
}

// At the end the middle of the ring has turned by 0.2 rad.
TEST(Manufactured, Vortex) {
  Real error = 0;
  const Real order = last_order("manufactured_vortex_2d.toml", {1.0 / 16, 1.0 / 32}, {}, 0.05, vortex, error);
  EXPECT_LT(error, 0.025 * 0.2);
  EXPECT_GT(order, 1.5);
}

}  // namespace
