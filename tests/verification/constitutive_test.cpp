// Laws and return mappings at single points (verification.md section 2): the worst errors that the unit tests hold down too.
#include "support/verification.hpp"
#include "unit/materials/law_samples.hpp"
#include "unit/materials/rule_checks.hpp"

using namespace mpm;
using namespace mpm::test;

namespace {

const std::string section = "2 constitutive";

// Derivatives, frame indifference and isotropy of one law in one dimension.
template <class Law>
void verify_law() {
  constexpr int dim = Traits<Law>::dim;
  const LawProbe<Law> probe;
  std::mt19937 generator(7);
  Real gradient = 0, tangent = 0, symmetry = 0, turned = 0;
  const auto raise = [](Real& most, Real value) { most = std::max(most, value); };
  for (const auto& [name, F] : sample_deformations<dim>()) {
    Mat<dim> dF = random_matrix<dim>(generator);
    dF.normalize();
    const Real length = 1 / F.inverse().norm();
    raise(gradient, best_difference([&, &F = F](Real h) { return probe.gradient_error(F, h); }, length));
    raise(tangent, best_difference([&, &F = F](Real h) { return probe.tangent_error(F, dF, h); }, length));
    const auto C =
        matrix_of<dim>([&, &F = F](const Mat<dim>& change) { return probe.differential(F, change); });
    raise(symmetry, (C - C.transpose()).norm() / C.norm());
    const Mat<dim> Q = random_rotation<dim>(generator), P = probe.piola(F);
    const Real energy = probe.energy(F);
    raise(turned, std::abs(probe.energy(Q * F) / energy - 1));
    raise(turned, std::abs(probe.energy(F * Q) / energy - 1));
    raise(turned, (probe.piola(Q * F) - Q * P).norm() / P.norm());
  }
  const std::string at = fmt::format("{}, {}D: ", Law::name, dim);
  verify(section, at + "P against differences of Psi", gradient, at_most(1e-8));
  verify(section, at + "dP against differences of P", tangent, at_most(1e-8));
  verify(section, at + "major symmetry of dP", symmetry, at_most(1e-12));
  verify(section, at + "Psi and P of turned F", turned, at_most(1e-12));
}

TEST(Constitutive, Derivatives) {
  verify_law<NeoHookean<2>>();
  verify_law<NeoHookean<3>>();
  verify_law<SplitNeoHookean<2>>();
  verify_law<SplitNeoHookean<3>>();
  verify_law<FixedCorotated<2>>();
  verify_law<FixedCorotated<3>>();
  verify_law<Hencky<2>>();
  verify_law<Hencky<3>>();
}

template <class Law>
void verify_von_mises() {
  const VonMisesErrors worst = von_mises_errors<Law>();
  const std::string at = fmt::format("von Mises on {}, {}D: ", Law::name, Traits<Law>::dim);
  verify(section, at + "q - sigma_y over mu after a return", worst.surface, at_most(1e-12));
  verify(section, at + "change of J", worst.volume, at_most(1e-13));
}

TEST(Constitutive, VonMises) {
  verify_von_mises<Hencky<2>>();
  verify_von_mises<Hencky<3>>();
  verify_von_mises<SplitNeoHookean<2>>();
  verify_von_mises<SplitNeoHookean<3>>();
}

template <int Dim>
void verify_drucker_prager(bool plane_strain) {
  const DruckerPragerErrors worst = drucker_prager_errors<Dim>(plane_strain);
  const std::string at =
      fmt::format("Drucker-Prager, {}, {}D: ", plane_strain ? "plane strain" : "triaxial compression", Dim);
  verify(section, at + "distance from the tip over mu after expansion", worst.tip, at_most(1e-12));
  verify(section, at + "distance from the cone over mu", worst.cone, at_most(1e-12));
  verify(section, at + "change of what lies inside", worst.inside, at_most(0));
}

TEST(Constitutive, DruckerPrager) {
  for (const bool plane_strain : {false, true}) {
    verify_drucker_prager<2>(plane_strain);
    verify_drucker_prager<3>(plane_strain);
  }
}

TEST(Constitutive, NaccSinglePoints) {
  const SplitNeoHookean<3> law = soft_law();
  Nacc<3> rule = published_points();
  const Real initial = rule.state.initial_alpha;
  Real capped;
  verify(section, "NACC: M", rule.state.slope, within(1.85034377, 3e-9));
  verify(section, "NACC: p0", law.kappa * rule.state.hardening_pressure(initial, capped),
         within(250.12083502, 3e-11), "Pa");
  for (const NaccPoint& point : nacc_points) {
    rule.published = point.published;
    const auto out = returned(law, rule, point.trial, initial);
    const std::string at = fmt::format("NACC at ({}), ", fmt::join(point.trial, ", "));
    verify(section, at + "first stretch", out.s[0], within(point.stretches[0], 1e-10));
    verify(section, at + "last stretch", out.s[2], within(point.stretches[2], 1e-10));
    verify(section, at + "alpha", out.own, within(point.alpha, 1e-6));
    verify(section, at + "trial pressure", law.pressure(volume(point.trial)),
           within(point.trial_pressure, 1e-8), "Pa");
  }
}

// The form that keeps J, on and within the ellipse; it doesn't matter how often it is applied.
TEST(Constitutive, NaccStaysOnTheEllipse) {
  const SplitNeoHookean<3> law = soft_law();
  Nacc<3> rule = published_points();
  rule.state.hardens = false;
  const Real p0 = law.kappa * (1e-5 + std::sinh(rule.state.hardening * 0.01));
  Real surface = 0, twice = 0;
  for (const Real strain : {0.01, 0.1, 0.7})
    for_trials<3>(strain, [&](const Numbers<3>& trial) {
      const auto out = returned(law, rule, trial, -0.01), again = returned(law, rule, out.s, -0.01);
      if (!(out.yields > 0)) return;
      surface = std::max(surface, std::abs(nacc_yield<3>(law, rule, p0, out.s)));
      for (std::size_t a = 0; a < 3; ++a) twice = std::max(twice, std::abs(again.s[a] - out.s[a]));
    });
  verify(section, "NACC keeping J: |y| over (M p0)^2 after a return", surface, at_most(1e-8));
  verify(section, "NACC keeping J: change by a second return", twice, at_most(1e-12));
}

}  // namespace
