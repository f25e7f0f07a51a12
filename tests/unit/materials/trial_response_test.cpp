// Stress and tangent of a trial step against central differences of its energy and stress, through the loops over columns.
#include <gtest/gtest.h>

#include "mpm_hpc/materials/material_loops.hpp"
#include "mpm_hpc/materials/plasticity_list.hpp"
#include "unit/materials/law_samples.hpp"

namespace mpm::test {
namespace {

// A pack of particles with their columns; F^n and grad v differ from particle to particle.
template <int Dim>
struct Particles {
  static constexpr int count = pack_width<double>;
  alignas(64) double F[Dim * Dim][count], L[Dim * Dim][count], volume[count], phase[count];
  alignas(64) double own[max_own_columns][count];
  alignas(64) double stress[Dim * Dim][count], tangent[TrialColumns<Dim>::tangent_size][count];
  MaterialColumns<Dim, double> columns;
  TrialColumns<Dim> out;

  explicit Particles(bool cracked) {
    std::mt19937 generator(7);
    std::uniform_real_distribution<double> small(-0.15, 0.15);
    for (int p = 0; p < count; ++p) {
      for (int k = 0; k < Dim * Dim; ++k) {
        F[k][p] = small(generator) + (k % (Dim + 1) == 0 ? 1 : 0);
        L[k][p] = small(generator);
      }
      volume[p] = 1 + 0.1 * p;
      phase[p] = 0.1 * p + 0.05;
      for (auto& column : own) column[p] = 1.1;
    }
    for (int k = 0; k < Dim * Dim; ++k) columns.F[k] = F[k];
    for (int k = 0; k < max_own_columns; ++k) columns.own[k] = own[k];
    columns.volume = volume;
    columns.phase = cracked ? phase : nullptr;
    columns.residual = 1e-3;
    for (int k = 0; k < Dim * Dim; ++k) out.stress[k] = stress[k];
    for (int k = 0; k < out.tangent_size; ++k) out.tangent[k] = tangent[k];
    out.project = false;
  }
  TrialSums evaluate(const Material<Dim>& material) {
    const double* gradient[Dim * Dim];
    for (int k = 0; k < Dim * Dim; ++k) gradient[k] = L[k];
    return material.trial(columns, gradient, 1.0, 0, count, out);
  }
};

template <int Dim>
void check_derivatives(const Material<Dim>& material, bool cracked = false) {
  Particles<Dim> at(cracked);
  at.evaluate(material);
  const double step = 1e-5;
  double stress_size = 0, tangent_size = 0, stress_error = 0, tangent_error = 0;
  for (int k = 0; k < Dim * Dim; ++k)
    for (int p = 0; p < at.count; ++p) {
      Particles<Dim> up(cracked), down(cracked);
      up.L[k][p] += step;
      down.L[k][p] -= step;
      const double slope = (up.evaluate(material).energy - down.evaluate(material).energy) / (2 * step);
      stress_size = std::max(stress_size, std::abs(at.stress[k][p]));
      stress_error = std::max(stress_error, std::abs(slope - at.stress[k][p]));
      for (int n = 0; n < Dim * Dim; ++n) {
        const double entry = at.tangent[SymTensor<double, Dim * Dim>::index(n, k)][p];
        tangent_size = std::max(tangent_size, std::abs(entry));
        tangent_error =
            std::max(tangent_error, std::abs((up.stress[n][p] - down.stress[n][p]) / (2 * step) - entry));
      }
    }
  EXPECT_LE(stress_error, 1e-8 * tangent_size) << material.model();
  EXPECT_LE(tangent_error, 1e-7 * tangent_size) << material.model();
  EXPECT_GT(stress_size, 0);
}

template <class C>
struct TrialResponseTest : testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(TrialResponseTest, Dimensions);

TYPED_TEST(TrialResponseTest, StressAndTangentAreDerivativesOfTheEnergy) {
  constexpr int dim = TypeParam::value;
  const typename Material<dim>::Common common{.name = "m", .density = 1};
  check_derivatives<dim>(MaterialLoops<NeoHookean<dim>, dim>(common, Traits<NeoHookean<dim>>::law()));
  check_derivatives<dim>(MaterialLoops<FixedCorotated<dim>, dim>(common, Traits<FixedCorotated<dim>>::law()));
  check_derivatives<dim>(MaterialLoops<Hencky<dim>, dim>(common, Traits<Hencky<dim>>::law()));
  check_derivatives<dim>(
      MaterialLoops<SplitNeoHookean<dim>, dim>(common, Traits<SplitNeoHookean<dim>>::law()));
  check_derivatives<dim>(
      MaterialLoops<LinearElastic<dim>, dim>(common, LinearElastic<dim>{test_mu, test_lambda}));
}

TYPED_TEST(TrialResponseTest, AreTakenWithTheCracksAndTheHardeningAsTheyAre) {
  constexpr int dim = TypeParam::value;
  const typename Material<dim>::Common common{.name = "m", .density = 1};
  check_derivatives<dim>(
      MaterialLoops<SplitNeoHookean<dim>, dim>(common, Traits<SplitNeoHookean<dim>>::law()), true);
  ClampedStretches<dim> rule;
  rule.hardening = 10;
  Snow<dim> snow;
  snow.mu = test_mu;
  snow.lambda = test_lambda;
  check_derivatives<dim>(MaterialLoops<Snow<dim>, dim, ClampedStretches<dim>>(common, snow, rule));
}

}  // namespace
}  // namespace mpm::test
