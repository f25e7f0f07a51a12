// Runs the scenes of the manufactured solutions on several spacings and fits the order.
#pragma once

#include <cmath>
#include <functional>

#include "mpm_hpc/simulation/run.hpp"
#include "support/mpi_test.hpp"
#include "support/verification.hpp"

namespace mpm::test {

inline const std::string manufactured_section = "3 elastodynamics";

// Place at a time of what started at X.
using Motion = std::function<Vec<2>(const Vec<2>&, Real)>;

struct Convergence {
  std::string name;
  std::vector<Real> spacings,
      errors;      // root mean square over the particles of the distance from the exact place [m]
  Real order = 0;  // slope of log(error) over log(spacing), least squares
};

inline Real manufactured_error(const std::string& scene, const std::vector<std::string>& overrides, Real end,
                               const Motion& exact) {
  const SharedTemporaryFolder folder;
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
  const GridGeometry<2>& grid = state.geometry();
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
        if (grid.periodic(a)) way[a] -= grid.period(a) * std::round(way[a] / grid.period(a));
      squares += way.squaredNorm();
      ++count;
    }
  }
  return std::sqrt(state.communicator().sum(squares) / state.communicator().sum(count));
}

inline Convergence converge(const std::string& name, const std::string& scene,
                            const std::vector<Real>& spacings, const std::vector<std::string>& overrides,
                            Real end, const Motion& exact) {
  Convergence c{name, spacings, {}, 0};
  Real x = 0, y = 0, xx = 0, xy = 0;
  const Real n = static_cast<Real>(spacings.size());
  Curve curve{"error", true, {"h [m]", "error [m]"}, {}};
  for (const Real h : spacings) {
    std::vector<std::string> all = overrides;
    all.push_back(fmt::format("grid.spacing={:.17g}", h));
    c.errors.push_back(manufactured_error(scene, all, end, exact));
    if (rank() == 0) std::printf("%s, h = 1/%g: error %.4g m\n", name.c_str(), 1 / h, c.errors.back());
    curve.rows.push_back({h, c.errors.back()});
    const Real a = std::log(h), b = std::log(c.errors.back());
    x += a / n;
    y += b / n;
    xx += a * a / n;
    xy += a * b / n;
  }
  curve.write();
  c.order = (xy - x * y) / (xx - x * x);
  return c;
}

// u_i = A sin(pi X_i) sin(c pi t + f_i), f = (0, pi), c = 100 m/s, at three quarters of a period.
inline Convergence along_axes(const std::string& variant, Real A, const std::vector<Real>& spacings,
                              const std::vector<std::string>& overrides) {
  const Real pi = 3.14159265358979323846;
  return converge("manufactured, along the axes, " + variant, "manufactured_axis_2d.toml", spacings,
                  overrides, 0.015, [=](const Vec<2>& X, Real t) -> Vec<2> {
                    const Real s = std::sin(100 * pi * t);
                    return X + A * s * Vec<2>(std::sin(pi * X[0]), -std::sin(pi * X[1]));
                  });
}

// Circles turn by G sin(pi t / T) (1 - 8 s^2 + 16 s^4), s = 2 (R - 1), with G = 0.2 and T = 0.1 s, to the farthest.
inline Convergence vortex(const std::string& variant, const std::vector<Real>& spacings,
                          const std::vector<std::string>& overrides) {
  const Real pi = 3.14159265358979323846;
  return converge("manufactured, vortex, " + variant, "manufactured_vortex_2d.toml", spacings, overrides,
                  0.05, [=](const Vec<2>& X, Real t) -> Vec<2> {
                    const Real s = 2 * (X.norm() - 1), h = 1 - 8 * s * s + 16 * s * s * s * s;
                    const Real angle = 0.2 * std::sin(10 * pi * t) * h, c = std::cos(angle),
                               n = std::sin(angle);
                    return {c * X[0] - n * X[1], n * X[0] + c * X[1]};
                  });
}

}  // namespace mpm::test
