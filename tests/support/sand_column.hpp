// Collapses of the shipped sand column, as flat or high as asked.
#pragma once

#include "support/stepper.hpp"
#include "support/verification.hpp"

namespace mpm::test {

// Where the heap beyond `foot` gets less than a cell deep: a few grains fly and roll ahead of it.
inline Real heap_front(Stepper<2>& world, Real foot) {
  const Real h = world.state.geometry().spacing(), per_cell = 4;
  std::vector<Real> count(static_cast<std::size_t>(world.state.geometry().upper()[0] / h) + 2, 0.0);
  world.for_particles([&](Body<2>& body, Index p) {
    ++count[static_cast<std::size_t>(body.particles.data<Real>(core::position, 0)[p] / h)];
  });
  world.state.communicator().sum(count);
  auto end = static_cast<std::size_t>(foot / h);
  while (count[end] >= per_cell) ++end;
  return static_cast<Real>(end) * h;
}

// Run-out of columns of height a L0 over L0: 1.2 a up to a = 2.3, 1.9 a^(2/3) above (Lube et al. 2005, Lajeunesse et al.
// 2005), with the friction angle of the scene for all. Each column is so stiff that its foot is strained by half a per cent.
inline void verify_sand_columns(const std::string& curve_name,
                                const std::vector<std::pair<Real, Real>>& columns) {  // a and spacing [m]
  constexpr Real L0 = 0.1, gravity = 9.81, density = 1600;
  Curve curve{curve_name, false, {"a = H0 / L0", "run-out over L0", "reference Lube, Lajeunesse"}, {}};
  for (const auto& [a, h] : columns) {
    const Real height = a * L0, expected = a < 2.3 ? 1.2 * a : 1.9 * std::pow(a, 2.0 / 3);
    Stepper<2> world(
        shipped_scene("sand_column_2d"),
        {fmt::format("grid.spacing={}", h), fmt::format("domain.upper=[0.8, {}]", height + 13 * h),
         fmt::format("body.0.shape.upper=[{}, {}]", L0, height),
         fmt::format("material.sand.youngs_modulus={}", 160 * density * gravity * height)});
    world.advance(std::max(0.35, 4.5 * std::sqrt(height / gravity)), [] {});
    const Real runout = (heap_front(world, L0) - L0) / L0;
    curve.rows.push_back({a, runout, expected});
    verify("5 plasticity", fmt::format("sand column, a = {}, h = {} mm: run-out over L0", a, 1e3 * h), runout,
           within(expected, 0.15));
  }
  curve.write();
}

}  // namespace mpm::test
