// What every pair of law and rule owes: the columns' returns are those of the principal stretches, one particle at a time; the
// work is that of the returned stress; where nothing yields nothing changes.
#include <gtest/gtest.h>

#include <Eigen/SVD>

#include "mpm_hpc/materials/material_loops.hpp"
#include "unit/materials/law_samples.hpp"
#include "unit/materials/rule_samples.hpp"
#include "unit/materials/test_columns.hpp"

namespace mpm::test {
namespace {

template <class Law_, class Rule_, class T_>
struct Case {
  using Law = Law_;
  using Rule = Rule_;
  using T = T_;
};
template <class C>
struct ReturnMappingTest : testing::Test {};
using Cases = testing::Types<
    Case<FixedCorotated<2>, ClampedStretches<2>, double>, Case<FixedCorotated<3>, ClampedStretches<3>, float>,
    Case<FixedCorotated<3>, ClampedStretches<3>, double>, Case<Hencky<2>, Tresca<2>, double>,
    Case<Hencky<3>, Tresca<3>, double>, Case<SplitNeoHookean<3>, Tresca<3>, float>,
    Case<Hencky<2>, VonMises<2>, double>, Case<Hencky<3>, VonMises<3>, float>,
    Case<SplitNeoHookean<2>, VonMises<2>, double>, Case<SplitNeoHookean<3>, VonMises<3>, double>,
    Case<SplitNeoHookean<3>, VonMises<3>, float>, Case<Hencky<2>, DruckerPrager<2>, double>,
    Case<Hencky<3>, DruckerPrager<3>, double>, Case<Hencky<3>, DruckerPrager<3>, float>,
    Case<Hencky<2>, ModifiedCamClay<2>, double>, Case<Hencky<3>, ModifiedCamClay<3>, double>,
    Case<Hencky<3>, ModifiedCamClay<3>, float>, Case<SplitNeoHookean<2>, Nacc<2>, double>,
    Case<SplitNeoHookean<3>, Nacc<3>, double>, Case<SplitNeoHookean<3>, Nacc<3>, float>>;
TYPED_TEST_SUITE(ReturnMappingTest, Cases);

TYPED_TEST(ReturnMappingTest, ColumnsReturnLikePrincipalStretches) {
  using Law = typename TypeParam::Law;
  using Rule = typename TypeParam::Rule;
  using T = typename TypeParam::T;
  constexpr int dim = Traits<Law>::dim;
  const Law law = Traits<Law>::law();
  const Rule rule = rule_sample<Rule>(test_mu);
  const MaterialLoops<Law, dim, Rule> material({.name = "sample", .density = 1000}, law, rule);
  EXPECT_STREQ(material.plasticity(), Rule::name);
  const std::vector<OwnColumn> own = material.own_columns();
  const int count = 4 * pack_width<T>;
  Columns<T> F{dim * dim, count}, gradient{dim * dim, count}, kept{2, count}, volume{1, count, T(0.5)};
  MaterialColumns<dim, T> columns;
  for (int k = 0; k < dim * dim; ++k) columns.F[k] = F[k];
  for (std::size_t k = 0; k < own.size(); ++k) {
    columns.own[k] = kept[static_cast<int>(k)];
    std::fill_n(columns.own[k], count, static_cast<T>(own[k].initial));
  }
  columns.volume = volume[0];
  // Strains of some yield strains, near-repeated stretches among them, and one particle at rest.
  std::mt19937 generator(17);
  std::uniform_real_distribution<double> strain(-0.03, 0.03);
  std::uniform_int_distribution<int> sixty_fourths(-128, 128);  // which floats hold exactly
  std::vector<Mat<dim>> trials;
  const double dt = 0.01;
  for (int p = 0; p < count; ++p) {
    Vec<dim> e = Vec<dim>::NullaryExpr([&] { return strain(generator); });
    if (p % 4 == 1) e[1] = e[0];
    if (p % 4 == 2) e[1] = e[0] + 1e-8;
    if (p == 0) e.setZero();
    const Mat<dim> Q = random_rotation<dim>(generator);
    const Mat<dim> start =
        Q * e.array().exp().matrix().asDiagonal() * random_rotation<dim>(generator).transpose();
    Mat<dim> G = Mat<dim>::NullaryExpr([&] { return sixty_fourths(generator) / 64.0; });
    if (p == 0) G.setZero();
    Mat<dim> rounded, slope;
    for (int k = 0; k < dim * dim; ++k) {
      F[k][p] = static_cast<T>(p == 0 ? k % (dim + 1) == 0 : start(k / dim, k % dim));
      gradient[k][p] = static_cast<T>(G(k / dim, k % dim));
      rounded(k / dim, k % dim) = F[k][p];
      slope(k / dim, k % dim) = gradient[k][p];
    }
    trials.push_back(rounded + dt * slope * rounded);
  }

  const MaterialUpdate update = material.advance(columns, gradient.data(), {.dt = dt}, 0, count);
  double work = 0, most_work = 0;
  int yielded = 0, elastic = 0;
  const double epsilon = std::numeric_limits<T>::epsilon();
  for (int p = 0; p < count; ++p) {
    const Eigen::JacobiSVD<Mat<dim>> svd(trials[p], Eigen::ComputeFullU | Eigen::ComputeFullV);
    double s[dim], numbers[2] = {0, 0}, guards[max_material_guards] = {};
    for (int a = 0; a < dim; ++a) s[a] = svd.singularValues()[a];
    for (std::size_t k = 0; k < own.size(); ++k) numbers[k] = static_cast<T>(own[k].initial);
    double returned[dim], numbers_after[2] = {numbers[0], numbers[1]};
    std::copy(s, s + dim, returned);
    const bool yields = rule.return_stretches(law, returned, numbers_after, guards) > 0;
    (yields ? yielded : elastic)++;
    Mat<dim> expected = trials[p];
    if (yields) {
      expected =
          svd.matrixU() * Eigen::Map<const Vec<dim>>(returned).asDiagonal() * svd.matrixV().transpose();
      const double one = 0.5 * work_of_return(law, rule, numbers_after, s, returned);
      work += one;
      most_work += std::abs(one);
      for (std::size_t k = 0; k < own.size(); ++k)
        EXPECT_NEAR(columns.own[k][p], numbers_after[k], epsilon + 1e-11) << p;
    } else {
      for (std::size_t k = 0; k < own.size(); ++k)
        EXPECT_EQ(columns.own[k][p], static_cast<T>(own[k].initial)) << p;
    }
    for (int k = 0; k < dim * dim; ++k)
      EXPECT_NEAR(F[k][p], expected(k / dim, k % dim), 2 * epsilon + 1e-13) << p;
  }
  EXPECT_GT(yielded, count / 4);
  EXPECT_GT(elastic, 0);
  EXPECT_NEAR(update.plastic_work, work, 1e-10 * most_work);
  EXPECT_GT(update.plastic_work, 0);
  for (const GlobalIndex acted : update.guards) EXPECT_EQ(acted, 0);

  // The limits and the stress are those of the returned particles, the rule's factor included.
  const MaterialLimits limits = material.limits(columns, 0, count);
  EXPECT_NEAR(update.limits.wave_modulus, limits.wave_modulus, 8 * epsilon * limits.wave_modulus);
  EXPECT_NEAR(update.limits.min_jacobian, limits.min_jacobian, 8 * epsilon);
  Columns<T> tau{SymTensor<T, dim>::size, count};
  material.stress(columns, 0, count, tau.data());
  for (int p = 0; p < count; ++p) {
    Tensor<double, dim> at;
    for (int k = 0; k < dim * dim; ++k) at.m[k] = F[k][p];
    double numbers[2] = {columns.own[0] ? columns.own[0][p] : 0, 0};
    const SymTensor<double, dim> expected = law.kirchhoff_stress(at);
    for (int k = 0; k < expected.size; ++k)
      EXPECT_NEAR(tau[k][p], factor_of(rule, numbers) * expected.m[k], 100 * epsilon * test_mu) << p;
  }
}

// What has been returned stays where it is, to rounding.
TYPED_TEST(ReturnMappingTest, ReturningTwiceChangesNothing) {
  using Law = typename TypeParam::Law;
  using Rule = typename TypeParam::Rule;
  constexpr int dim = Traits<Law>::dim;
  const Law law = Traits<Law>::law();
  const Rule rule = without_hardening(rule_sample<Rule>(test_mu));
  std::mt19937 generator(23);
  std::uniform_real_distribution<double> strain(-0.2, 0.2);
  const std::vector<OwnColumn> own = rule.own_columns();
  for (int n = 0; n < 500; ++n) {
    double s[dim], once[dim], twice[dim], numbers[2] = {own.empty() ? 0 : own[0].initial, 0};
    double guards[max_material_guards] = {};
    for (double& x : s) x = std::exp(strain(generator));
    std::copy(s, s + dim, once);
    if (!(rule.return_stretches(law, once, numbers, guards) > 0)) continue;
    std::copy(once, once + dim, twice);
    double kept[2] = {numbers[0], numbers[1]};
    if (!(rule.return_stretches(law, twice, kept, guards) > 0)) continue;
    for (int a = 0; a < dim; ++a) EXPECT_NEAR(twice[a], once[a], 1e-13);
    EXPECT_NEAR(kept[0], numbers[0], 1e-13);
  }
}

// A NaN is not returned to anything and stays in its lane.
TYPED_TEST(ReturnMappingTest, ABrokenParticleIsLeftToBeFound) {
  using Law = typename TypeParam::Law;
  using Rule = typename TypeParam::Rule;
  using T = typename TypeParam::T;
  constexpr int dim = Traits<Law>::dim, W = pack_width<T>;
  const MaterialLoops<Law, dim, Rule> material({.name = "sample", .density = 1000}, Traits<Law>::law(),
                                               rule_sample<Rule>(test_mu));
  Columns<T> F{dim * dim, W}, gradient{dim * dim, W}, kept{1, W}, volume{1, W, T(1)};
  MaterialColumns<dim, T> columns;
  for (int k = 0; k < dim * dim; ++k) {
    columns.F[k] = F[k];
    std::fill_n(F[k], W, T(k % (dim + 1) == 0));
  }
  const auto own = material.own_columns();
  if (!own.empty()) std::fill_n(columns.own[0] = kept[0], W, static_cast<T>(own[0].initial));
  columns.volume = volume[0];
  F[1][3] = std::numeric_limits<T>::quiet_NaN();
  F[1][2] = T(0.1);
  const MaterialUpdate update = material.advance(columns, gradient.data(), {.dt = 1}, 0, W);
  EXPECT_EQ(update.limits.min_jacobian, -std::numeric_limits<double>::infinity());
  EXPECT_TRUE(std::isfinite(update.plastic_work));
  EXPECT_TRUE(std::isnan(F[1][3]));
  for (int p = 0; p < W; ++p)
    for (int k = 0; k < dim * dim; ++k) EXPECT_TRUE(p == 3 || std::isfinite(F[k][p])) << p;
}

}  // namespace
}  // namespace mpm::test
