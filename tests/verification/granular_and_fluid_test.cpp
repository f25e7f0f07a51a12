// Dam break and water at rest (verification.md section 4).
#include <cmath>

#include "support/stepper.hpp"
#include "support/verification.hpp"

using namespace mpm;
using test::Stepper;

namespace {

constexpr Real gravity = 9.81;

// The largest x of all particles [m].
Real front(Stepper<2>& world) {
  Real largest = 0;
  world.for_particles([&](Body<2>& body, Index p) {
    largest = std::max(largest, body.particles.data<Real>(core::position, 0)[p]);
  });
  return world.state.communicator().max(largest);
}

// Place of the front over time, against Martin and Moyce (1952): T = t sqrt(2 g / a), Z = x / a, aligned where Z = 1.44
// because the gate of the experiment takes its time.
TEST(Fluids, DamBreak) {
  constexpr Real a = 0.05715;
  const std::vector<std::pair<Real, Real>> measured = {{0.41, 1.11}, {0.84, 1.22}, {1.19, 1.44}, {1.43, 1.67},
                                                       {1.63, 1.89}, {1.83, 2.11}, {1.98, 2.33}, {2.20, 2.56},
                                                       {2.32, 2.78}, {2.51, 3.00}, {2.65, 3.22}, {2.83, 3.44},
                                                       {2.98, 3.67}, {3.11, 3.89}, {3.33, 4.11}};
  Stepper<2> world(test::shipped_scene("dam_break_2d"));
  std::vector<std::pair<Real, Real>> path = {{0, 1}};
  const Real scale = std::sqrt(2 * gravity / a);
  world.advance(0.18, [&] {
    if (world.state.step % 10 == 0) path.emplace_back(world.state.time * scale, front(world) / a);
  });
  const auto time_of = [&](Real Z) {
    for (std::size_t i = 1; i < path.size(); ++i)
      if (path[i].second >= Z)
        return path[i - 1].first + (path[i].first - path[i - 1].first) * (Z - path[i - 1].second) /
                                       (path[i].second - path[i - 1].second);
    return path.back().first;
  };
  const auto place_at = [&](Real T) {
    for (std::size_t i = 1; i < path.size(); ++i)
      if (path[i].first >= T)
        return path[i - 1].second + (path[i].second - path[i - 1].second) *
                                        std::max(0.0, T - path[i - 1].first) /
                                        (path[i].first - path[i - 1].first);
    return path.back().second;
  };
  const Real shift = time_of(1.44) - 1.19;
  Real worst = 0;
  test::Curve curve{"dam_break", false, {"T = t sqrt(2 g / a)", "Z", "reference Martin and Moyce"}, {}};
  for (const auto& [T, Z] : measured) {
    const Real simulated = place_at(T + shift);
    worst = std::max(worst, std::abs(simulated / Z - 1));
    curve.rows.push_back({T, simulated, Z});
  }
  curve.write();
  test::verify("4 fluids", "dam break: largest distance of the front from the measured one", worst,
               test::at_most(0.1));
}

// A column of water that is let go without its pressure swings about the hydrostatic one; means over the last ten periods
// 4 H / c.
TEST(Fluids, Hydrostatic) {
  constexpr Real H = 1, K = 1e6, density = 1000, h = 0.025;
  constexpr std::size_t bins = 40;
  const Real period = 4 * H / std::sqrt(K / density);
  Stepper<2> world(fmt::format(
      "dimension = 2\n[domain]\nlower = [0, 0]\nupper = [0.2, 1.2]\n[grid]\nspacing = "
      "{}\n[time]\nend "
      "= 10\n[material.water]\nmodel = \"linear_fluid\"\nbulk_modulus = {}\ndensity = {}\n"
      "[[body]]\nmaterial = \"water\"\nshape = {{type = \"box\", lower = [0, 0], upper = [0.2, 1]}}\n"
      "[effect.gravity]\nacceleration = [0, -9.81]\n"
      "[effect.walls]\nx_min = \"slip\"\nx_max = \"slip\"\ny_min = \"slip\"\n",
      h, K, density));
  Real squares = 0, expected_squares = 0, heights = 0, samples = 0, early = 0, late = 0;
  std::vector<Real> pressure(bins, 0.0), hydrostatic(bins, 0.0), count(bins, 0.0);
  world.advance(20 * period, [&] {
    if (world.state.step % 5 != 0) return;
    const Real t = world.state.time / period;
    if (t < 10) {
      if (t > 1) early = std::max(early, world.value("kinetic_energy"));
      return;
    }
    if (t > 11) late = std::max(late, world.value("kinetic_energy"));
    world.for_particles([&](Body<2>& body, Index p) {
      const Real y = body.particles.data<Real>(core::position, 1)[p];
      const Real J = 1 + body.particles.data<Real>(body.particles.find("volume_change"), 0)[p];
      const auto bin = static_cast<std::size_t>(std::clamp(y / h, 0.0, bins - 1.0));
      pressure[bin] += K * (1 - J);
      hydrostatic[bin] += density * gravity * (H - y);
      count[bin] += 1;
      heights += y;
      samples += 1;
    });
  });
  world.state.communicator().sum(pressure);
  world.state.communicator().sum(hydrostatic);
  world.state.communicator().sum(count);
  test::Curve curve{"hydrostatic", false, {"height [m]", "pressure [Pa]", "reference rho g (H - y)"}, {}};
  for (std::size_t bin = 0; bin < pressure.size(); ++bin) {
    if (count[bin] == 0) continue;
    const Real p = pressure[bin] / count[bin], want = hydrostatic[bin] / count[bin];
    squares += (p - want) * (p - want);
    expected_squares += want * want;
    curve.rows.push_back({(static_cast<Real>(bin) + 0.5) * h, p, want});
  }
  curve.write();
  test::verify("4 fluids", "water at rest: error of the mean pressure in L2", std::sqrt(squares / expected_squares),
               test::at_most(0.02));
  // The displacement rho g (H y - y^2 / 2) / K has the mean rho g H^2 / 3 K.
  const Real mean = world.state.communicator().sum(heights) / world.state.communicator().sum(samples);
  test::verify("4 fluids", "water at rest: settlement over rho g H^2 / 2 K",
               1.5 * (H / 2 - mean) / (density * gravity * H * H / (2 * K)), test::within(1, 0.02));
  test::verify("4 fluids", "water at rest: swing of periods 11 to 20 over that of 1 to 10", late / early,
               test::at_most(1));
}

}  // namespace
