// Runs the scenes of the manufactured solutions on several spacings and fits the order.
#pragma once

#include <cmath>
#include <fstream>
#include <functional>

#include "mpm_hpc/simulation/run.hpp"
#include "support/mpi_test.hpp"
#include "support/stepper.hpp"
#include "support/verification.hpp"

namespace mpm::test {

inline const std::string manufactured_section = "3 elastodynamics";

// Place at a time of what started at X.
using Motion = std::function<Vec<2>(const Vec<2>&, Real)>;

struct Convergence {
  std::string name;
  std::vector<Real> spacings,
      errors;        // root mean square over the particles of the distance from the exact place [m]
  Real order = 0;    // slope of log(error) over log(spacing), least squares
  Real plateau = 0;  // 1/h up to which each refinement wins an order of one at least [1/m]
};

// `scene`: its text.
inline Real manufactured_error(const std::string& scene, const std::vector<std::string>& overrides, Real end,
                               const Motion& exact) {
  const SharedTemporaryFolder folder;
  RunOptions options;
  options.output = folder.path() / "run";
  options.until = end;
  std::vector<std::string> all = {"output.frames=false", "output.checkpoint=false", "output.every=0"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  Parameters p = Parameters::read_text(scene, "scene.toml", all);
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

// Letters and figures of a text, the rest as underscores.
inline std::string file_name(std::string text) {
  for (char& c : text)
    if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
  return text;
}

// `scene_of`: the scene's text for a spacing.
inline Convergence converge(const std::string& name, const std::function<std::string(Real)>& scene_of,
                            const std::vector<Real>& spacings, const std::vector<std::string>& overrides,
                            Real end, const Motion& exact) {
  Convergence c{name, spacings, {}, 0, 1 / spacings[0]};
  bool gains = true;
  Real x = 0, y = 0, xx = 0, xy = 0;
  const Real n = static_cast<Real>(spacings.size());
  Curve curve{file_name(name), true, {"h [m]", "error [m]"}, {}};
  for (const Real h : spacings) {
    std::vector<std::string> all = overrides;
    all.push_back(fmt::format("grid.spacing={:.17g}", h));
    c.errors.push_back(manufactured_error(scene_of(h), all, end, exact));
    if (rank() == 0) std::printf("%s, h = 1/%g: error %.4g m\n", name.c_str(), 1 / h, c.errors.back());
    curve.rows.push_back({h, c.errors.back()});
    if (const std::size_t n = c.errors.size(); n > 1) {
      gains = gains && c.errors[n - 1] / c.errors[n - 2] <= h / spacings[n - 2];
      if (gains) c.plateau = 1 / h;
    }
    const Real a = std::log(h), b = std::log(c.errors.back());
    x += a / n;
    y += b / n;
    xx += a * a / n;
    xy += a * b / n;
  }
  curve.write();
  c.order = (xy - x * y) / (xx - x * x);
  if (rank() == 0) std::printf("%s: no plateau up to 1/h = %g\n", name.c_str(), c.plateau);
  return c;
}

// u_i = A sin(pi X_i) sin(c pi t + f_i), f = (0, pi), c = 100 m/s, at three quarters of a period.
inline Convergence along_axes(const std::string& variant, Real A, const std::vector<Real>& spacings,
                              const std::vector<std::string>& overrides) {
  const Real pi = 3.14159265358979323846;
  const std::string scene = shipped_scene("manufactured_axis_2d");
  return converge(
      "manufactured, along the axes, " + variant, [&](Real) { return scene; }, spacings, overrides, 0.015,
      [=](const Vec<2>& X, Real t) -> Vec<2> {
        const Real s = std::sin(100 * pi * t);
        return X + A * s * Vec<2>(std::sin(pi * X[0]), -std::sin(pi * X[1]));
      });
}

// How the vortex' ring is filled: by a lattice that is cut off at the rims, or by circles of particles whose volumes are those
// of their share of the ring. The ring floats freely: what a lattice's staircase at the rims, where the body force is largest,
// leaves of its torque turns all of it, by an amount that rises and falls with the spacing.
enum class Filling { lattice, circles };

// Writes the circles of a ring from R = 0.75 to 1.25.
inline void write_circles(const std::string& file, Real distance) {
  const Real pi = 3.14159265358979323846, inner = 0.75, width = 0.5;
  const int rings = static_cast<int>(std::lround(width / distance));
  std::ofstream out(file);
  out << "x,y,volume\n";
  for (int r = 0; r < rings; ++r) {
    const Real thickness = width / rings, R = inner + (r + 0.5) * thickness;
    const int count = static_cast<int>(std::lround(2 * pi * R / distance));
    for (int n = 0; n < count; ++n) {
      const Real angle = 2 * pi * (n + std::fmod(r * 0.618033988749895, 1.0)) / count;  // circles out of step
      out << fmt::format("{:.17g},{:.17g},{:.17g}\n", R * std::cos(angle), R * std::sin(angle),
                         2 * pi * R * thickness / count);
    }
  }
}

// Circles turn by G sin(pi t / T) (1 - 8 s^2 + 16 s^4), s = 2 (R - 1), with G = 0.2 and T = 0.1 s, to the farthest.
inline Convergence vortex(const std::string& variant, Filling filling, int per_direction,
                          const std::vector<Real>& spacings, std::vector<std::string> overrides) {
  const Real pi = 3.14159265358979323846;
  const SharedTemporaryFolder folder;
  std::string scene = shipped_scene("manufactured_vortex_2d");
  const std::string circles = folder / "circles.csv", density = "particles_per_cell = 4";
  if (filling == Filling::circles) {
    const auto shape = scene.find("[body.shape]");
    scene.erase(shape, scene.find("[effect.body_force]") - shape);
    scene.replace(scene.find(density), density.size(), "point_cloud = \"" + circles + "\"");
  } else {
    overrides.push_back(fmt::format("body.0.particles_per_cell={}", per_direction * per_direction));
  }
  return converge(
      "manufactured, vortex, " + variant,
      [&](Real h) {
        if (filling == Filling::circles && rank() == 0) write_circles(circles, h / per_direction);
        all_ranks_ok(true);  // it is written
        return scene;
      },
      spacings, overrides, 0.05,
      [=](const Vec<2>& X, Real t) -> Vec<2> {
        const Real s = 2 * (X.norm() - 1), h = 1 - 8 * s * s + 16 * s * s * s * s;
        const Real angle = 0.2 * std::sin(10 * pi * t) * h, c = std::cos(angle), n = std::sin(angle);
        return {c * X[0] - n * X[1], n * X[0] + c * X[1]};
      });
}

}  // namespace mpm::test
