// The shipped single-edge notch test: load at the peak and path of the crack (Miehe et al. 2010; verification.md section 6).
#include <cmath>
#include <map>

#include "support/stepper.hpp"
#include "support/verification.hpp"

using namespace mpm;

namespace {

TEST(SingleEdgeNotch, Tension) {
  const std::string section = "6 fracture";
  test::Stepper<2> world(test::shipped_scene("single_edge_notch_2d"));
  constexpr Real speed = 6.5e-6;  // of the upper grip [m/s]
  const Real spacing = world.state.geometry().spacing();
  test::Curve curve{"single_edge_notch", false, {"displacement [mm]", "force [kN]"}, {}};
  // The farthest that the crack has come, and the farthest off the slit's middle line that it has been.
  Real reach = 0, off = 0;
  const auto look_at_crack = [&] {
    world.for_particles([&](Body<2>& body, Index p) {
      if (body.particles.data<Real>(body.particles.find("phase"))[p] > 0.1) return;
      reach = std::max(reach, body.particles.data<Real>(core::position)[p]);
      const Real middle = 0.5 * speed * world.state.time;
      off = std::max(off, std::abs(body.particles.data<Real>(core::position, 1)[p] - middle));
    });
    reach = world.state.communicator().max(reach);
    off = world.state.communicator().max(off);
  };
  Real peak = 0, at_peak = 0, first_reach = 0, first_energy = 0, energy = 0;
  world.advance(1, [&] {
    // The means since the last row, which is the last step.
    std::map<std::string, Real> row;
    for (const HistoryValue& v : history_row(world.state, world.scene.effects)) row[v.name] = v.value;
    // N per metre of depth; kN of a plate 1 mm deep.
    const Real force = std::abs(row.at("reaction_top_y")) * 1e-6,
               displacement = 1e3 * speed * world.state.time;
    curve.rows.push_back({displacement, force});
    if (force > peak) {
      peak = force;
      at_peak = displacement;
    }
    energy = row.at("fracture_energy");
    look_at_crack();
    if (first_reach == 0 && reach > 0.03e-3) {
      first_reach = reach;
      first_energy = energy;
    }
  });
  curve.write();
  test::verify(section, "single-edge notch: largest force [kN]", peak, test::within(0.70, 0.05));
  test::verify(section, "single-edge notch: displacement then [mm]", at_peak, test::within(5.8e-3, 0.05));
  test::verify(section, "single-edge notch: length of the crack [mm]", 1e3 * reach, test::at_least(0.06));
  test::verify(section, "single-edge notch: farthest off its line, cells", off / spacing, test::at_most(3));
  test::verify_short(section, "single-edge notch: energy per length of the crack over the toughness",
                     (energy - first_energy) / (reach - first_reach) / 2700, test::within(1, 0.1),
                     test::between(1, 1.8),
                     "at l0 = h/2 a crack that runs breaks a band of two rows of particles, more than the "
                     "smooth profile that the "
                     "toughness is corrected for");
}

}  // namespace
