// The phase field solved on its active blocks against the solve everywhere, and the unknowns that it takes against a count
// from the particles' places alone.
#include "mpm_hpc/effects/phase_field/active_set.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <functional>
#include <set>

#include "mpm_hpc/transfer/reference_transfer.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

constexpr Real spacing = 0.5, modulus = 1000, toughness = 30, residual = 0.02, tolerance = 1e-6, dt = 1;

struct Setting {
  Real length;       // l0 [m]
  Real mobility_dt;  // M_c dt; 0: rate-independent
  const char* more = "";
  KernelKind kernel = KernelKind::quadratic;
};

template <int Dim>
constexpr int bar_cells = Dim == 2 ? 160 : 96;

template <int Dim>
std::string scene_text(const Setting& setting, Real active_tolerance) {
  const Real length = bar_cells<Dim> * spacing;
  const std::string upper = Dim == 2 ? fmt::format("[{}, 3]", length) : fmt::format("[{}, 2, 1]", length),
                    zero = Dim == 2 ? "[0, 0]" : "[0, 0, 0]";
  return fmt::format(
             "dimension = {}\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {}\nkernel = \"{}\"\n[time]\nend = 1\n"
             "[transfer]\nforces = \"{}\"\n"
             "[material.brittle]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = {}\npoisson_ratio = "
             "0\ndensity = 1000\n"
             "fracture_toughness = {}\n"
             "[[body]]\nmaterial = \"brittle\"\nshape = {{type = \"box\", lower = {}, upper = {}}}\njitter = "
             "0.3\n"
             "particles_per_cell = {}\n"
             "[effect.phase_field]\nlength_scale = {}\nresidual = {}\ntolerance = 1e-13\ncorrected_toughness "
             "= false\n"
             "active_tolerance = {}\n{}\n",
             Dim, zero, upper, spacing, kernel_names[static_cast<int>(setting.kernel)],
             setting.kernel == KernelKind::linear ? "classical" : "mls", modulus, toughness, zero, upper, Dim == 2 ? 4 : 8, setting.length,
             residual, active_tolerance, setting.more) +
         (setting.mobility_dt > 0 ? fmt::format("mobility = {}\n", setting.mobility_dt / dt) : "");
}

// Stretch along the bar behind a driven end: a tail that crosses the threshold on its way to nothing, or at once, all over,
// what drives c nearly as much as may be left out.
Real stretch(Real x, const Setting& setting, bool tail) {
  if (tail) return 0.3 * std::exp(-x / 2);
  const Real energy = 0.95 * tolerance / 2 * toughness / (4 * setting.length * (1 - residual));
  return x < 5 ? 0.3 : std::sqrt(2 * energy / modulus);
}

struct Known {
  Real x[3] = {}, phase = 1;
};

template <int Dim>
std::map<GlobalIndex, Known> gather_all(test::SceneWorld<Dim>& world) {
  struct Record {
    GlobalIndex id;
    Known known;
  };
  std::vector<Record> mine;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    Record r{f.template data<GlobalIndex>(core::id)[p], {}};
    for (int a = 0; a < Dim; ++a) r.known.x[a] = f.template data<Real>(core::position, a)[p];
    r.known.phase = f.template data<Real>(f.find("phase"))[p];
    mine.push_back(r);
  });
  std::map<GlobalIndex, Known> result;
  for (const Record& r : test::gather_all(mine)) result.emplace(r.id, r.known);
  return result;
}

template <int Dim>
struct Solution {
  std::map<GlobalIndex, Known> particles;
  GlobalIndex unknowns = 0;
};

template <int Dim>
Solution<Dim> solve_once(
    const Setting& setting, Real active_tolerance, const std::function<Real(Real)>& stretch_at,
    const std::function<Real(Real)>& phase_at = [](Real) { return 1.0; }) {
  test::SceneWorld<Dim> world(scene_text<Dim>(setting, active_tolerance));
  world.state.dt = dt;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    f.template data<Real>(core::deformation_gradient, 0)[p] +=
        stretch_at(f.template data<Real>(core::position, 0)[p]);
    f.template data<Real>(f.find("phase"))[p] = phase_at(f.template data<Real>(core::position, 0)[p]);
  });
  world.run_effects();
  return {gather_all(world), world.state.solvers.at("phase_field").unknowns};
}

// Nodes that the particles of the active blocks reach: blocks with a driving force above half of the tolerance, and the
// given number of rings of blocks with particles around them.
template <int Dim>
GlobalIndex count_nodes(const std::map<GlobalIndex, Known>& particles, const Setting& setting, bool tail,
                        int rings) {
  // A particle belongs to the block of its stencil's first node.
  const Real shift = with_kernel(setting.kernel, [](auto kernel) { return decltype(kernel)::shift; });
  auto block_of = [shift](const Known& p) {
    std::array<int, 3> b = {};
    for (int a = 0; a < Dim; ++a) b[a] = static_cast<int>(std::floor((p.x[a] / spacing - shift) / 4));
    return b;
  };
  std::set<std::array<int, 3>> occupied, active;
  for (const auto& [id, p] : particles) {
    occupied.insert(block_of(p));
    const Real f = 1 + stretch(p.x[0], setting, tail), J = f, kappa = modulus / Dim, mu = modulus / 2;
    const Real energy = mu / 2 * (std::pow(J, -2.0 / Dim) * (f * f + Dim - 1) - Dim) +
                        kappa / 2 * ((J * J - 1) / 2 - std::log(J));
    if (4 * setting.length * (1 - residual) * energy / toughness > tolerance / 2) active.insert(block_of(p));
  }
  for (int ring = 0; ring < rings; ++ring) {
    std::set<std::array<int, 3>> wider = active;
    for (const auto& b : occupied)
      for (const auto& other : active) {
        bool near = true;
        for (int a = 0; a < Dim; ++a) near = near && std::abs(b[a] - other[a]) <= 1;
        if (near) wider.insert(b);
      }
    active = wider;
  }
  std::set<std::array<int, 3>> nodes;
  const Vec<Dim> corner = Vec<Dim>::Zero();
  const GridGeometry<Dim> geometry(corner, Vec<Dim>::Constant(1000 * spacing), spacing);
  for (const auto& [id, p] : particles) {
    if (!active.count(block_of(p))) continue;
    with_kernel(setting.kernel, [&](auto kernel) {
      for_each_node<decltype(kernel)>(geometry, Vec<Dim>(Eigen::Map<const Vec<Dim>>(p.x)),
                                      [&](const IntVec<Dim>& node, Real, const Vec<Dim>&) {
                                        std::array<int, 3> n = {};
                                        for (int a = 0; a < Dim; ++a) n[a] = node[a];
                                        nodes.insert(n);
                                      });
    });
  }
  return static_cast<GlobalIndex>(nodes.size());
}

template <class D>
class ActivePhaseField : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(ActivePhaseField, Dimensions);

TYPED_TEST(ActivePhaseField, EqualsTheSolveEverywhere) {
  constexpr int Dim = TypeParam::value;
  for (const Setting& setting : {Setting{spacing / 2, 0}, Setting{spacing, 0}, Setting{2 * spacing, 0},
                                 Setting{spacing / 2, 0, "reaction = \"lumped\"\n"},
                                 Setting{spacing, 0, "operator = \"matrix_free\"\n"},
                                 Setting{spacing, 0, "operator = \"assembled\"\n"}, Setting{spacing, 1e-3},
                                 Setting{spacing, 0.1}, Setting{2 * spacing, 10},
                                 Setting{spacing, 0, "", KernelKind::linear}, Setting{spacing, 0, "", KernelKind::cubic},
                                 Setting{spacing / 2, 0, "", KernelKind::cubic}}) {
    for (const bool tail : {true, false}) {
      auto load = [&](Real x) { return stretch(x, setting, tail); };
      const Solution<Dim> full = solve_once<Dim>(setting, 0, load),
                          active = solve_once<Dim>(setting, tolerance, load);
      Real worst = 0, least = 1;
      ASSERT_EQ(full.particles.size(), active.particles.size());
      for (const auto& [id, p] : full.particles) {
        worst = std::max(worst, std::abs(p.phase - active.particles.at(id).phase));
        least = std::min(least, p.phase);
      }
      // The decay on the grid: c_{i-1} - (2 + (h / L_s)^2) c_i + c_{i+1} = 0.
      const Real M = setting.mobility_dt,
                 L = 2 * setting.length * (M > 0 ? std::sqrt(M / (1 + M)) : 1) / spacing, s = 1 / (L * L);
      const Real factor = 1 + s / 2 - std::sqrt(s + s * s / 4);
      const int kernel_reach = setting.kernel == KernelKind::linear ? 1 : setting.kernel == KernelKind::quadratic ? 2 : 3;
      const int reach = kernel_reach + static_cast<int>(std::ceil(std::log(tolerance / 2) / std::log(factor)));
      const GlobalIndex expected = count_nodes<Dim>(full.particles, setting, tail, (reach + 3) / 4);
      if (test::rank() == 0)
        std::printf(
            "%dD, l0 = %g h, M_c dt = %g, %s %.*s: c >= %.2f, differs by %.1e, expected at most %.0e; %lld "
            "unknowns, expected %lld, of %lld\n",
            Dim, setting.length / spacing, M, tail ? "tail" : "step",
            static_cast<int>(std::strcspn(setting.more, "\n")), setting.more, least, worst, tolerance,
            static_cast<long long>(active.unknowns), static_cast<long long>(expected),
            static_cast<long long>(full.unknowns));
      EXPECT_LE(worst, tolerance);
      EXPECT_EQ(active.unknowns, expected);
      if (setting.length < 2 * spacing) {
        EXPECT_LT(active.unknowns, full.unknowns);
      }
      EXPECT_LT(least, 0.9999);
    }
  }
}

// The rate-independent equation doesn't know of c^n, so that a crack without load needs no solve; with a mobility, c^n
// spreads.
TYPED_TEST(ActivePhaseField, KeepsAnUnloadedCrack) {
  constexpr int Dim = TypeParam::value;
  auto no_load = [](Real) { return 0.0; };
  auto crack = [](Real x) { return x < 5 ? 0.0 : 1.0; };
  for (const Setting& setting :
       {Setting{spacing, 0}, Setting{spacing, 0.1}, Setting{spacing, 0, "update = \"increment\"\n"}}) {
    const Solution<Dim> full = solve_once<Dim>(setting, 0, no_load, crack),
                        active = solve_once<Dim>(setting, tolerance, no_load, crack);
    Real worst = 0;
    for (const auto& [id, p] : full.particles)
      worst = std::max(worst, std::abs(p.phase - active.particles.at(id).phase));
    EXPECT_LE(worst, tolerance) << "M_c dt = " << setting.mobility_dt << " " << setting.more;
    const bool knows_phase = setting.mobility_dt > 0 || *setting.more;
    EXPECT_EQ(active.unknowns > 0, knows_phase) << active.unknowns << " unknowns";
    EXPECT_LT(active.unknowns, full.unknowns);
  }
}

TYPED_TEST(ActivePhaseField, HasNothingToSolveInABodyAtRest) {
  constexpr int Dim = TypeParam::value;
  for (const char* form : {"stencil", "matrix_free", "assembled"}) {
    const std::string more = fmt::format("operator = \"{}\"\n", form);
    const Solution<Dim> active =
        solve_once<Dim>({spacing, 0, more.c_str()}, tolerance, [](Real) { return 0.0; });
    EXPECT_EQ(active.unknowns, 0);
    for (const auto& [id, p] : active.particles) EXPECT_EQ(p.phase, 1);
  }
}

}  // namespace
