// A clamped strip with a crack from its left end (Rivlin and Thomas 1953), loaded at once and then followed at rest, a turn of
// displacements and c per step: whether the crack runs.
#pragma once

#include "support/cracked_column.hpp"
#include "support/stepper.hpp"
#include "support/verification.hpp"

namespace mpm::test {

struct ClampedStrip {
  KernelKind kernel = KernelKind::quadratic;
  Real length_scale = 0.5;  // l0 over the grid's spacing, which is 1 m
  bool lumped = false;
  Real shift =
      0;  // of the particles' lattice across the crack, which lies midway between nodes without it [cells]
  Real residual = 1e-4;
  int height = 32;  // between the grips [cells]
};

// The crack's length gained in `steps` at W(u) = load times the toughness, once `settling` steps have opened the crack [cells]: of
// the undeformed strip, in whole rows of particles.
inline Real run_of_crack(const ClampedStrip& strip, Real load, int steps, int settling = 10) {
  // Grips hold more than the kernel reaches. Strains near 1e-3.
  constexpr int grip = 4, ahead = 2;
  constexpr Real row_length = 0.5;
  constexpr Real modulus = 1e9, poisson = 0.25, toughness_per_height = 500;
  const int N = strip.height, L = 3 * N;
  const Real constrained = modulus * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson));
  // W(u) = (lambda + 2 mu) (u/N)^2 N / 2
  const Real strain = std::sqrt(2 * load * toughness_per_height / constrained), tip = 1.2 * N;
  const int outer = N / 2 + grip;
  Stepper<2> world(fmt::format(
      "dimension = 2\n[domain]\nlower = [-4, {lower}]\nupper = [{right}, {upper}]\n"
      "[grid]\nspacing = 1\nkernel = \"{kernel}\"\n[transfer]\nforces = \"{forces}\"\n"
      "[time]\nend = 1000\nintegrator = \"quasi_static\"\nmax_dt = 1\n"
      "[material.m]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = {modulus}\npoisson_ratio = "
      "{poisson}\ndensity = 1000\n"
      "fracture_toughness = {toughness}\n"
      "[[body]]\nmaterial = \"m\"\nshape = {{type = \"box\", lower = [0, {bottom}], upper = [{length}, "
      "{top}]}}\n"
      "particles_per_cell = 4\ndeformation_gradient = [[1, 0], [0, \"1 + {strain} * (abs(y) < {half})\"]]\n"
      "[effect.phase_field]\nlength_scale = {scale}\nresidual = {residual}\nreaction = "
      "\"{reaction}\"\ncorrected_toughness = false\n"
      "[[effect.phase_field.crack]]\nshape = {{type = \"box\", lower = [-1, 0], upper = [{tip}, 1]}}\n"
      "[[effect.grip]]\nname = \"bottom\"\nshape = {{type = \"plane\", point = [0, -{edge}], normal = [0, "
      "1]}}\n"
      "[[effect.grip]]\nname = \"top\"\nshape = {{type = \"plane\", point = [0, {edge}], normal = [0, "
      "-1]}}\n",
      fmt::arg("lower", -outer - 4), fmt::arg("upper", outer + 4), fmt::arg("right", L + 4),
      fmt::arg("kernel", kernel_names[static_cast<int>(strip.kernel)]),
      fmt::arg("forces", strip.kernel == KernelKind::linear ? "classical" : "mls"),
      fmt::arg("modulus", modulus), fmt::arg("poisson", poisson),
      fmt::arg("toughness", toughness_per_height * N), fmt::arg("bottom", -outer), fmt::arg("top", outer),
      fmt::arg("length", L), fmt::arg("strain", strain), fmt::arg("half", N / 2),
      fmt::arg("scale", strip.length_scale), fmt::arg("residual", strip.residual),
      fmt::arg("reaction", strip.lumped ? "lumped" : "consistent"), fmt::arg("tip", tip),
      fmt::arg("edge", N / 2 - 1e-6)));
  world.for_particles([&](Body<2>& body, Index p) {
    body.particles.template data<Real>(core::position, 1)[p] += strip.shift;
  });
  const auto reach = [&world] {
    Real farthest = 0;
    world.for_particles([&](Body<2>& body, Index p) {
      const FieldSet& f = body.particles;
      if (f.data<Real>(f.find("phase"))[p] < 0.3)
        farthest = std::max(farthest, f.data<Real>(core::position)[p]);
    });
    return world.state.communicator().max(farthest);
  };
  Real start = 0, end = 0;
  world.advance(settling, [] {});
  start = end = reach();
  for (int step = 0; step < steps && end < L - ahead * N / 2; ++step) {
    world.advance(world.state.time + 1, [] {});
    end = reach();
  }
  return std::round((end - start) / row_length) * row_length + 0.0;  // no -0
}

// A crack may gain a cell where it stays, while its tip takes the shape that belongs to the load.
inline void check_load_of_running(const std::string& section, const ClampedStrip& strip) {
  const StripThreshold expected = with_kernel(strip.kernel, [&](auto kernel) {
    return CrackedColumn<decltype(kernel)>(strip.height, strip.length_scale, strip.lumped, 2,
                                           0.5 + 2 * strip.shift, strip.residual)
        .threshold();
  });
  const std::string which = fmt::format(
      "{} kernel, {}, l0/h = {}, particles shifted by {} h", kernel_names[static_cast<int>(strip.kernel)],
      strip.lumped ? "lumped" : "consistent", strip.length_scale, strip.shift);
  constexpr int steps = 40;
  for (const auto& [share, band] : {std::pair(0.93, at_most(1.01)), std::pair(1.14, at_least(2.5))})
    verify(section,
           fmt::format("clamped strip at {} times the load that pays ({:.3f} G_c), {}: cells run in {} steps",
                       share, expected.load, which, steps),
           run_of_crack(strip, share * expected.load, steps), band);
}

}  // namespace mpm::test
