// The shipped Taylor bar (verification.md section 5), against a wall and against its own mirror image.
#pragma once

#include "support/stepper.hpp"
#include "support/verification.hpp"

namespace mpm::test {

struct TaylorBar {
  Real length = 0, radius = 0;                 // [m]
  std::vector<std::pair<Real, Real>> profile;  // distance from the wall, radius [m]
};

// Places of all particles by their numbers, on every rank.
template <int Dim>
std::vector<Vec<Dim>> places(SceneWorld<Dim>& world) {
  const auto count = static_cast<std::size_t>(count_particles(world.state));
  std::vector<Real> numbers(Dim * count, 0.0);
  world.for_particles([&](Body<Dim>& body, Index p) {
    const auto id = static_cast<std::size_t>(body.particles.template data<GlobalIndex>(core::id)[p]);
    for (int a = 0; a < Dim; ++a)
      numbers[Dim * id + static_cast<std::size_t>(a)] =
          body.particles.template data<Real>(core::position, a)[p];
  });
  world.state.communicator().sum(numbers);
  std::vector<Vec<Dim>> all(count);
  for (std::size_t n = 0; n < count; ++n) all[n] = Eigen::Map<const Vec<Dim>>(&numbers[Dim * n]);
  return all;
}

// Runs the scene with the overrides. A sector of the cross section that measures `sector` [rad] is there, of `bars` bars that
// start on both sides of z = 0.
inline TaylorBar taylor_bar(const std::vector<std::string>& overrides, Real sector, int bars) {
  constexpr Real R0 = 3.2e-3;
  Stepper<3> world(shipped_scene("taylor_bar_3d"), overrides);
  const std::vector<Vec<3>> start = places(world);
  world.advance(80e-6, [] {});
  const std::vector<Vec<3>> end = places(world);
  const Real h = world.state.geometry().spacing();
  Real first = h;
  for (const Vec<3>& X : start) first = std::min(first, std::abs(X[2]));
  const Real lattice = 2 * first, volume = lattice * lattice * lattice;
  TaylorBar bar;
  // The free end stays elastic. The foot's rim is half a stretched particle beyond the last one: r over R of the layer next to
  // the wall, fitted to a line over the outer half and taken at R0.
  Real n = 0, x = 0, y = 0, xx = 0, xy = 0;
  std::vector<Real> volumes;
  for (std::size_t p = 0; p < start.size(); ++p) {
    const Real z = std::abs(end[p][2]), R = start[p].head<2>().norm(), r = end[p].head<2>().norm();
    bar.length = std::max(bar.length, z + lattice / 2);
    const auto slice = static_cast<std::size_t>(z / h);
    if (slice >= volumes.size()) volumes.resize(slice + 1, 0.0);
    volumes[slice] += volume;
    if (std::abs(start[p][2]) > 1.5 * first || R < R0 / 2) continue;
    n += 1;
    x += R;
    y += r;
    xx += R * R;
    xy += R * r;
  }
  const Real slope = (n * xy - x * y) / (n * xx - x * x);
  bar.radius = y / n + slope * (R0 - x / n);
  for (std::size_t slice = 0; slice + 1 < volumes.size(); ++slice)
    bar.profile.emplace_back((static_cast<Real>(slice) + 0.5) * h,
                             std::sqrt(2 * volumes[slice] / (sector * bars * h)));
  return bar;
}

// Two bars that meet head-on: nothing slides along a wall at the foot.
inline std::vector<std::string> mirrored_bar(const std::string& spacing) {
  return {"grid.spacing=" + spacing, "domain.lower=[0, 0, -0.034]",
          "body.0.velocity=[0, 0, \"z > 0 ? -227 : 227\"]", "body.0.shape.of.0.a=[0, 0, -0.0324]",
          "body.0.shape.of.1.lower=[0, 0, -0.033]"};
}

// Published: 21.4 to 21.7 mm and 6.9 to 7.24 mm; 2 % more on both sides.
inline void verify_taylor_bar(const std::string& name, const std::string& curve_name, const TaylorBar& bar) {
  const std::string section = "5 plasticity", at = "Taylor bar, " + name;
  verify(section, at + ": final length", 1e3 * bar.length, between(0.98 * 21.4, 1.02 * 21.7), "mm");
  verify(section, at + ": final radius", 1e3 * bar.radius, between(0.98 * 6.9, 1.02 * 7.24), "mm");
  Curve curve{"taylor_bar_" + curve_name,
              false,
              {"distance from the wall [mm]", "mean radius [mm]", "reference published radius of the foot"},
              {}};
  const Real none = std::numeric_limits<Real>::quiet_NaN();
  for (const auto& [z, r] : bar.profile) curve.rows.push_back({1e3 * z, 1e3 * r, z < 2e-3 ? 7.07 : none});
  curve.write();
}

}  // namespace mpm::test
