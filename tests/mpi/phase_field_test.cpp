// The distributed phase-field system against a dense solve of all particles in one place, its two operators against each
// other, and the bounds of c while a bar breaks. What equals the dense solve on any number of ranks is the same on all.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cstdio>
#include <cstring>
#include <random>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "mpm_hpc/transfer/reference_transfer.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

constexpr Real modulus = 1000, residual = 0.02;
// So that the driving term is the same for every length.
constexpr Real toughness_for(Real length) { return 50 * length; }

template <int Dim>
std::string list(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
}

// A box of jittered particles with h = 0.5, and an initial crack in its middle.
template <int Dim, class Kernel = QuadraticKernel>
std::string scene_text(const std::string& phase_field, Real tolerance = 1e-13, Real length = 0.6) {
  const std::string lower = list<Dim>(0, 0, 0),
                    upper = Dim == 2 ? list<Dim>(7, 4.5, 0) : list<Dim>(4.5, 2.5, 2);
  return fmt::format(
      "dimension = {0}\n[domain]\nlower = {1}\nupper = {2}\n[grid]\nspacing = 0.5\nkernel = \"{10}\"\n[time]\nend = 1\n"
      "[transfer]\nforces = \"{11}\"\n"
      "[material.brittle]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = {3}\npoisson_ratio = 0\ndensity = "
      "1000\n"
      "fracture_toughness = {4}\n"
      "[[body]]\nmaterial = \"brittle\"\nshape = {{type = \"box\", lower = {1}, upper = {2}}}\njitter = 0.3\n"
      "particles_per_cell = {5}\n"
      "[effect.phase_field]\nlength_scale = {13}\nresidual = {6}\ntolerance = {12}\ncorrected_toughness = "
      "false\n{7}\n"
      "[[effect.phase_field.crack]]\nshape = {{type = \"box\", lower = {8}, upper = {9}}}\n",
      Dim, lower, upper, modulus, toughness_for(length), Dim == 2 ? 4 : 8, residual, phase_field, list<Dim>(2, 0.7, 0),
      list<Dim>(2.3, 2.1, 1.2), Kernel::name, Kernel::has_inertia ? "mls" : "classical", tolerance, length);
}

template <int Dim>
Mat<Dim> random_deformation(GlobalIndex id) {
  std::mt19937 random(static_cast<unsigned>(id));
  std::uniform_real_distribution<Real> both(-0.15, 0.15);
  return Mat<Dim>::Identity() + Mat<Dim>::NullaryExpr([&] { return both(random); });
}

template <int Dim>
void deform(test::SceneWorld<Dim>& world) {
  world.for_particles([](Body<Dim>& body, Index p) {
    const Mat<Dim> F = random_deformation<Dim>(body.particles.template data<GlobalIndex>(core::id)[p]);
    for (int c = 0; c < Dim * Dim; ++c)
      body.particles.template data<Real>(core::deformation_gradient, c)[p] = F(c / Dim, c % Dim);
  });
}

// What all ranks know of every particle, by identity.
template <int Dim>
struct Known {
  Real x[Dim], volume, phase, history;
};

template <int Dim>
std::map<GlobalIndex, Known<Dim>> gather_all(test::SceneWorld<Dim>& world) {
  struct Record {
    GlobalIndex id;
    Known<Dim> known;
  };
  std::vector<Record> mine;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    Record r{f.template data<GlobalIndex>(core::id)[p], {}};
    for (int a = 0; a < Dim; ++a) r.known.x[a] = f.template data<Real>(core::position, a)[p];
    r.known.volume = f.template data<Real>(core::volume)[p];
    r.known.phase = f.template data<Real>(f.find("phase"))[p];
    if (const FieldId h = f.find("phase_history"); h != no_field)
      r.known.history = f.template data<Real>(h)[p];
    mine.push_back(r);
  });
  std::map<GlobalIndex, Known<Dim>> result;
  for (const Record& r : test::gather_all(mine))
    EXPECT_TRUE(result.emplace(r.id, r.known).second) << "particle " << r.id << " is there twice";
  return result;
}

struct Setting {
  bool lumped;
  Real mobility_dt;  // 0: infinite
  Real length = 0.6;
};

// One step of physics.md section 5 from dense matrices, divided by M_c, with c^n on the nodes as the mean by volume; returns the
// particles' new c.
template <class Kernel, int Dim>
std::map<GlobalIndex, Real> dense_step(const GridGeometry<Dim>& geometry,
                                       const std::map<GlobalIndex, Known<Dim>>& all, const Setting& setting) {
  const Real length = setting.length, m = setting.mobility_dt > 0 ? 1 / setting.mobility_dt : 0;
  const ReferenceGrid<Dim> grid(geometry);
  std::map<std::size_t, int> rows;
  struct Term {
    int row;
    Real w;
    Vec<Dim> g;
  };
  std::map<GlobalIndex, std::vector<Term>> stencils;
  for (const auto& [id, p] : all)
    for_each_node_with_gradient<Kernel>(
        geometry, Vec<Dim>(Eigen::Map<const Vec<Dim>>(p.x)),
        [&](const IntVec<Dim>& node, Real w, const Vec<Dim>& distance, const Vec<Dim>& grad_w) {
          const int row = rows.emplace(grid.index(node), static_cast<int>(rows.size())).first->second;
          Vec<Dim> g = grad_w;
          if constexpr (Kernel::has_inertia) g = Kernel::inverse_inertia / (0.5 * 0.5) * w * distance;
          stencils[id].push_back({row, w, g});
        });
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(rows.size(), rows.size());
  Eigen::VectorXd b = Eigen::VectorXd::Zero(rows.size()), volume = b, weighted = b;
  for (const auto& [id, p] : all) {
    const Mat<Dim> F = random_deformation<Dim>(id);
    const Real J = F.determinant(), kappa = modulus / Dim, mu = modulus / 2, V = J * p.volume;
    Real energy = mu / 2 * (std::pow(J, -2.0 / Dim) * F.squaredNorm() - Dim);
    if (J >= 1) energy += kappa / 2 * ((J * J - 1) / 2 - std::log(J));
    const Real drive = 4 * length * (1 - residual) * std::max(energy, p.history) / toughness_for(length);
    for (const Term& i : stencils[id]) {
      A(i.row, i.row) += V * i.w * (1 + m + (setting.lumped ? drive : 0));
      b[i.row] += V * i.w * (1 + m * p.phase);
      volume[i.row] += V * i.w;
      weighted[i.row] += V * i.w * p.phase;
      for (const Term& j : stencils[id])
        A(i.row, j.row) +=
            V * (4 * length * length * i.g.dot(j.g) + (setting.lumped ? 0 : drive * i.w * j.w));
    }
  }
  Eigen::VectorXd result = A.ldlt().solve(b);
  if (setting.mobility_dt > 0) result -= weighted.cwiseQuotient(volume);
  std::map<GlobalIndex, Real> phase;
  for (const auto& [id, p] : all) {
    Real value = setting.mobility_dt > 0 ? p.phase : 0;
    for (const Term& i : stencils[id]) value += i.w * result[i.row];
    phase[id] = std::max(0.0, std::min(p.phase, value));
  }
  return phase;
}

template <class D>
class PhaseField : public testing::Test {};
template <int D, class K>
struct Case {
  static constexpr int value = D;
  using Kernel = K;
};
using Dimensions = testing::Types<Case<2, LinearKernel>, Case<2, QuadraticKernel>, Case<2, CubicKernel>, Case<3, LinearKernel>,
                                  Case<3, QuadraticKernel>, Case<3, CubicKernel>>;
TYPED_TEST_SUITE(PhaseField, Dimensions);

TYPED_TEST(PhaseField, AllOperatorsEqualADenseSolve) {
  constexpr int Dim = TypeParam::value;
  using Kernel = typename TypeParam::Kernel;
  for (const Setting& setting :
       {Setting{false, 0}, Setting{true, 0}, Setting{false, 0.3}, Setting{true, 0.02}, Setting{false, 0, 16}}) {
    constexpr const char* forms[] = {"assembled", "matrix_free", "stencil", "stencil"};
    std::map<GlobalIndex, Real> phases[4];
    for (const int form : {0, 1, 2, 3}) {
      // The last one in single precision where tolerance and length allow it: then both errors stay below ten times the tolerance.
      const Real tolerance = form == 3 ? 1.5e-6 : 1e-13, bound = form == 3 ? 1.5e-5 : 1e-10;
      const std::string text =
          fmt::format("operator = \"{}\"\nreaction = \"{}\"\n", forms[form],
                      setting.lumped ? "lumped" : "consistent") +
          (setting.mobility_dt > 0 ? fmt::format("mobility = {}\n", setting.mobility_dt) : "");
      test::SceneWorld<Dim> world(scene_text<Dim, Kernel>(text, tolerance, setting.length));
      deform(world);
      world.state.dt = 1;
      Real worst = 0;
      for (int step = 0; step < 2; ++step) {
        const auto before = gather_all(world);
        world.run_effects();
        const auto after = gather_all(world);
        const auto expected = dense_step<Kernel>(world.state.geometry(), before, setting);
        ASSERT_EQ(after.size(), expected.size());
        int changed = 0;
        for (const auto& [id, p] : after) {
          worst = std::max(worst, std::abs(p.phase - expected.at(id)));
          changed += p.phase != before.at(id).phase;
          phases[form][id] = p.phase;
        }
        if (step == 0) {
          EXPECT_GT(changed, static_cast<int>(after.size() / 2));
        }
      }
      if (test::rank() == 0)
        std::printf("%dD, %s, %s, %s, M_c dt %g, l0 %g h: c differs from the dense solve by %.1e, expected below %.1e\n",
                    Dim, Kernel::name, forms[form], setting.lumped ? "lumped" : "consistent",
                    setting.mobility_dt, setting.length / 0.5, worst, bound);
      EXPECT_LT(worst, bound);
    }
    Real difference = 0;
    for (const int form : {1, 2})
      for (const auto& [id, c] : phases[0]) difference = std::max(difference, std::abs(c - phases[form].at(id)));
    if (test::rank() == 0) std::printf("  the forms differ by %.1e, expected below 1e-10\n", difference);
    EXPECT_LT(difference, 1e-10);
  }
}

// With a mobility c changes at a finite rate, however short the step: also where volumes differ from particle to particle, which
// makes means of c with other weights than those of the equation differ.
TYPED_TEST(PhaseField, ChangesInProportionToTime) {
  constexpr int Dim = TypeParam::value;
  using Kernel = typename TypeParam::Kernel;
  for (const char* reaction : {"consistent", "lumped"}) {
    Real change[2] = {};
    for (const int k : {0, 1}) {
      test::SceneWorld<Dim> world(
          scene_text<Dim, Kernel>(fmt::format("mobility = {}\nreaction = \"{}\"\n", k == 0 ? 1e-6 : 1e-9, reaction)));
      deform(world);
      world.for_particles([](Body<Dim>& body, Index p) {
        FieldSet& f = body.particles;
        std::mt19937 random(static_cast<unsigned>(f.template data<GlobalIndex>(core::id)[p]) + 7);
        f.template data<Real>(f.find("phase"))[p] = std::uniform_real_distribution<Real>(0.5, 1)(random);
      });
      world.state.dt = 1;
      const auto before = gather_all(world);
      world.run_effects();
      for (const auto& [id, p] : gather_all(world))
        change[k] = std::max(change[k], std::abs(p.phase - before.at(id).phase));
    }
    const Real ratio = change[1] / change[0];
    if (test::rank() == 0)
      std::printf("%dD, %s, %s: c changes by %.3e in M_c dt = 1e-6, and by %.6f times that in 1e-9, expected 0.001 +- 1 %%\n", Dim,
                  Kernel::name, reaction, change[0], ratio);
    EXPECT_NEAR(ratio, 1e-3, 1e-5);
  }
}

// The particles are spread anew between two solves, and many of them change their rank.
TYPED_TEST(PhaseField, SurvivesMigration) {
  constexpr int Dim = TypeParam::value;
  using Kernel = typename TypeParam::Kernel;
  for (const auto& [form, mobility] : {std::pair("assembled", 0.5), {"stencil", 0.5}, {"stencil", 0.0}}) {
    test::SceneWorld<Dim> world(scene_text<Dim, Kernel>(
        fmt::format("operator = \"{}\"\n", form) + (mobility > 0 ? fmt::format("mobility = {}\n", mobility) : "")));
    deform(world);
    world.state.dt = 1;
    world.run_effects();
    const Real middle = Dim == 2 ? 7 : 4.5;
    world.for_particles([&](Body<Dim>& body, Index p) {  // mirrored in x
      Real& x = body.particles.template data<Real>(core::position, 0)[p];
      x = middle - x;
    });
    sort_particles(world.state, OrderWithinCell::canonical);
    const auto before = gather_all(world);
    world.run_effects();
    const auto after = gather_all(world);
    const auto expected = dense_step<Kernel>(world.state.geometry(), before, {false, mobility});
    Real worst = 0;
    for (const auto& [id, p] : after) worst = std::max(worst, std::abs(p.phase - expected.at(id)));
    EXPECT_LT(worst, 1e-10);
    if (test::size() > 1) {
      EXPECT_GT(world.state.communicator().sum(world.state.distribution.migrated()), 0);
    }
  }
}

template <int Dim>
Real fracture_energy(test::SceneWorld<Dim>& world) {
  std::vector<HistoryValue> row;
  for (auto& effect : world.scene.effects) effect->history(world.state, row);
  for (const HistoryValue& v : row)
    if (v.name == "fracture_energy") return world.state.communicator().sum(v.value);
  return -1;
}

// Two grips tear a notched bar apart, in its middle.
TEST(PhaseFieldRun, NeverHealsAndStaysInBounds) {
  struct Run {
    const char *kernel, *evolution;
  };
  for (const auto& [kernel, evolution] : {Run{"quadratic", ""}, Run{"quadratic", "mobility = 200\n"},
                                          Run{"quadratic", "history = \"maximum\"\n"},
                                          Run{"quadratic", "reaction = \"lumped\"\n"}, Run{"linear", ""}, Run{"cubic", ""},
                                          Run{"cubic", "mobility = 200\n"}}) {
    test::SceneWorld<2> world(fmt::format(
        "dimension = 2\n[domain]\nlower = [-4, -2]\nupper = [16, 6]\n[grid]\nspacing = 0.5\nkernel = \"{}\"\n[time]\nend = 2\n"
        "[transfer]\nforces = \"{}\"\n"
        "[material.brittle]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = 1e5\npoisson_ratio = "
        "0.2\ndensity = 1000\n"
        "fracture_toughness = 100\n"
        "[[body]]\nmaterial = \"brittle\"\nshape = {{type = \"box\", lower = [0, 0], upper = [12, 3]}}\n"
        "[effect.phase_field]\nlength_scale = 0.5\n{}"
        "[[effect.phase_field.crack]]\nshape = {{type = \"box\", lower = [5.8, -1], upper = [6.2, 0.8]}}\n"
        "[[effect.grip]]\nname = \"left\"\nshape = {{type = \"plane\", point = [1, 0], normal = [1, 0]}}\n"
        "velocity = [-0.1, 0]\nramp = 0.3\n"
        "[[effect.grip]]\nname = \"right\"\nshape = {{type = \"plane\", point = [11, 0], normal = [-1, 0]}}\n"
        "velocity = [0.1, 0]\nramp = 0.3\n",
        kernel, std::string(kernel) == "linear" ? "classical" : "mls", evolution));
    ExplicitIntegrator<2> integrator(world.state, std::move(world.hooks), {});
    integrator.initialise(world.state);
    auto before = gather_all(world);
    std::size_t broken_at_start = 0, broken = 0, broken_off = 0;
    for (const auto& [id, p] : before) broken_at_start += p.phase < 0.1;
    GlobalIndex healed = 0, outside = 0;
    while (world.state.time < 1.6) {
      world.state.dt = integrator.stable_step(world.state);
      integrator.step(world.state);
      auto after = gather_all(world);
      broken = broken_off = 0;
      for (const auto& [id, p] : after) {
        healed += p.phase > before.at(id).phase;
        outside += !(p.phase >= 0 && p.phase <= 1);
        broken += p.phase < 0.1;
        broken_off += p.phase < 0.1 && std::abs(p.x[0] - 6) > 2;
      }
      before = std::move(after);
    }
    if (test::rank() == 0)
      std::printf(
          "torn bar (%s, %s): %zu of %zu particles broken at the start, %zu after %lld steps; healed %lld, "
          "outside of "
          "[0, 1] %lld, expected 0 and 0\n",
          kernel, *evolution ? std::string(evolution, std::strlen(evolution) - 1).c_str() : "defaults",
          broken_at_start, before.size(), broken, static_cast<long long>(world.state.step),
          static_cast<long long>(healed), static_cast<long long>(outside));
    EXPECT_EQ(healed, 0);
    EXPECT_EQ(outside, 0);
    EXPECT_GT(broken, 2 * broken_at_start);
    EXPECT_EQ(broken_off, 0u) << "far from the notch";
    // A row that nobody planned has the energy of c smoothed once more.
    const Real planned = fracture_energy(world);
    world.state.dt = 1e-3 * integrator.stable_step(world.state);
    world.state.observed = false;
    integrator.step(world.state);
    const Real unplanned = fracture_energy(world);
    if (test::rank() == 0)
      std::printf("  fracture energy %.4g, in an unplanned row %.4g, expected at most 15 %% less or 2 %% more\n", planned, unplanned);
    EXPECT_GT(planned, 0);
    EXPECT_LT(unplanned, 1.02 * planned);  // the crack may have grown a little
    EXPECT_GT(unplanned, 0.85 * planned);
  }
}

}  // namespace
