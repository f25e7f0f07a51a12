// The loops over particle columns: packs against plain doubles, both precisions; what becomes of broken
// particles.
#include "mpm_hpc/materials/material_loops.hpp"

#include <gtest/gtest.h>

#include "unit/materials/law_samples.hpp"
#include "unit/materials/test_columns.hpp"

namespace mpm::test {
namespace {

template <class Law_, class T_>
struct Case {
  using Law = Law_;
  using T = T_;
};

template <class C>
struct MaterialLoopsTest : testing::Test {
  using Law = typename C::Law;
  using T = typename C::T;
  static constexpr int dim = Traits<Law>::dim;
  static constexpr int begin = 2 * pack_width<T>, end = 6 * pack_width<T>;
  static constexpr bool splits = SplitsEnergy<Law, dim>;

  Law law = Traits<Law>::law();
  MaterialLoops<Law, dim> material{{.name = "plate", .density = 1000}, law};
  Columns<T> F{dim * dim, end}, phase{1, end}, tau{SymTensor<T, dim>::size, end - begin}, out{1, end - begin};

  MaterialLoopsTest() {
    std::mt19937 generator(11);
    std::uniform_real_distribution<double> uniform(0, 1);
    const auto samples = sample_deformations<dim>(end);
    for (int p = 0; p < end; ++p) {
      phase[0][p] = static_cast<T>(uniform(generator));
      for (int k = 0; k < dim * dim; ++k) F[k][p] = static_cast<T>(samples[p].F(k / dim, k % dim));
    }
  }
  Tensor<double, dim> deformation(int p) const {
    Tensor<double, dim> a;
    for (int k = 0; k < dim * dim; ++k) a.m[k] = F[k][p];
    return a;
  }
  MaterialColumns<dim, T> columns(bool damaged = false, double residual = 0) const {
    MaterialColumns<dim, T> c;
    for (int k = 0; k < dim * dim; ++k) c.F[k] = F[k];
    if (damaged) c.phase = phase[0];
    c.residual = residual;
    return c;
  }
  // A few ulp of the largest terms that the formulas add up.
  double tolerance(int p) const {
    const auto a = deformation(p);
    const double size = (test_mu + test_lambda) *
                        (1 + inner(a, a) / std::pow(determinant(a), 2.0 / dim) + std::pow(determinant(a), 2));
    return 8 * std::numeric_limits<T>::epsilon() * size;
  }
};

using Cases = testing::Types<Case<NeoHookean<2>, double>, Case<NeoHookean<3>, double>,
                             Case<NeoHookean<2>, float>, Case<NeoHookean<3>, float>,
                             Case<SplitNeoHookean<2>, double>, Case<SplitNeoHookean<3>, double>,
                             Case<SplitNeoHookean<2>, float>, Case<SplitNeoHookean<3>, float>,
                             Case<Hencky<2>, double>, Case<Hencky<3>, double>, Case<Hencky<2>, float>,
                             Case<Hencky<3>, float>>;
TYPED_TEST_SUITE(MaterialLoopsTest, Cases);

TYPED_TEST(MaterialLoopsTest, StressEqualsPlainDoubles) {
  const auto check = [this](const auto& expected_of, const char* name) {
    for (int p = this->begin; p < this->end; ++p) {
      const auto expected = expected_of(p);
      for (int k = 0; k < expected.size; ++k)
        EXPECT_NEAR(this->tau[k][p - this->begin], expected.m[k], this->tolerance(p))
            << name << " " << p << " " << k;
    }
  };
  this->material.stress(this->columns(), this->begin, this->end, this->tau.data());
  check([this](int p) { return this->law.kirchhoff_stress(this->deformation(p)); }, "undamaged");
  if constexpr (TestFixture::splits) {
    const double residual = 0.01;
    this->material.stress(this->columns(true, residual), this->begin, this->end, this->tau.data());
    check(
        [&, this](int p) {
          const double c = this->phase[0][p];
          return this->law.kirchhoff_stress_degraded(this->deformation(p), (1 - residual) * c * c + residual);
        },
        "damaged");
  } else {
    EXPECT_THROW(
        this->material.stress(this->columns(true), this->begin, this->end, this->tau.data()),
        LogicError);
  }
}

// In double whatever the columns are, so that only the result is rounded.
TYPED_TEST(MaterialLoopsTest, EnergyEqualsPlainDoubles) {
  using T = typename TestFixture::T;
  const auto check = [this](const auto& expected_of, const char* name) {
    for (int p = this->begin; p < this->end; ++p) {
      const double expected = expected_of(p);
      const double rounding = std::numeric_limits<T>::epsilon() * expected;
      EXPECT_NEAR(this->out[0][p - this->begin], expected, rounding + 1e-14 * test_mu) << name << " " << p;
    }
  };
  this->material.energy_density(this->columns(), this->begin, this->end, this->out[0]);
  check([this](int p) { return this->law.energy_density(this->deformation(p)); }, "all");
  if constexpr (TestFixture::splits) {
    const double residual = 0.01;
    this->material.energy_plus(this->columns(), this->begin, this->end, this->out[0]);
    check([this](int p) { return this->law.energy_plus(this->deformation(p)); }, "plus");
    this->material.energy_density(this->columns(true, residual), this->begin, this->end, this->out[0]);
    check(
        [&, this](int p) {
          const double c = this->phase[0][p];
          return this->law.energy_degraded(this->deformation(p), (1 - residual) * c * c + residual);
        },
        "damaged");
  } else {
    EXPECT_THROW(this->material.energy_plus(this->columns(), this->begin, this->end, this->out[0]),
                 LogicError);
    EXPECT_THROW(this->material.energy_density(this->columns(true), this->begin, this->end, this->out[0]),
                 LogicError);
  }
}

// A strain of 1e-4 leaves 1e-8 of energy, below the roundoff of floats near 1.
TYPED_TEST(MaterialLoopsTest, SmallEnergiesKeepTheirDigits) {
  using T = typename TestFixture::T;
  constexpr int dim = TestFixture::dim;
  for (int p = 0; p < this->end; ++p)
    for (int k = 0; k < dim * dim; ++k) this->F[k][p] = k % (dim + 1) == 0 ? 1 : 0;
  for (int p = 0; p < this->end; ++p) this->F[1][p] = static_cast<T>(1e-4);
  this->material.energy_density(this->columns(), this->begin, this->end, this->out[0]);
  const double shear = this->F[1][0];  // J = 1 and tr b - d = shear^2 in simple shear
  for (int p = 0; p < this->end - this->begin; ++p)
    EXPECT_NEAR(this->out[0][p], 0.5 * test_mu * shear * shear, 1e-6 * 0.5 * test_mu * shear * shear);
}

// all becomes the extremes of both.
void include(MaterialLimits& all, const MaterialLimits& one) {
  all.stiffness = std::max(all.stiffness, one.stiffness);
  all.wave_modulus = std::max(all.wave_modulus, one.wave_modulus);
  all.min_jacobian = std::min(all.min_jacobian, one.min_jacobian);
}

TYPED_TEST(MaterialLoopsTest, LimitsAreTheExtremesOfTheParticles) {
  using T = typename TestFixture::T;
  const MaterialLimits limits = this->material.limits(this->columns(), this->begin, this->end);
  MaterialLimits expected;
  for (int p = this->begin; p < this->end; ++p) {
    const auto a = this->deformation(p);
    include(expected, {this->law.stiffness_bound(a), this->law.wave_modulus(a), determinant(a)});
  }
  const double tolerance = 10 * std::numeric_limits<T>::epsilon();
  EXPECT_NEAR(limits.stiffness, expected.stiffness, tolerance * expected.stiffness);
  EXPECT_NEAR(limits.wave_modulus, expected.wave_modulus, tolerance * expected.wave_modulus);
  EXPECT_NEAR(limits.min_jacobian, expected.min_jacobian, tolerance);
  if constexpr (TestFixture::splits) {
    const double residual = 0.01;
    const MaterialLimits weakened = this->material.limits(this->columns(true, residual), this->begin, this->end);
    MaterialLimits of_weakened;
    for (int p = this->begin; p < this->end; ++p) {
      const auto a = this->deformation(p);
      const double c = this->phase[0][p], g = (1 - residual) * c * c + residual;
      include(of_weakened,
              {this->law.stiffness_bound_degraded(a, g), this->law.wave_modulus_degraded(a, g), determinant(a)});
    }
    EXPECT_NEAR(weakened.stiffness, of_weakened.stiffness, tolerance * expected.stiffness);
    EXPECT_NEAR(weakened.wave_modulus, of_weakened.wave_modulus, tolerance * expected.wave_modulus);
    EXPECT_NEAR(weakened.min_jacobian, expected.min_jacobian, tolerance);
    EXPECT_LT(weakened.stiffness, limits.stiffness);
    this->phase[0][this->begin + 1] = std::numeric_limits<T>::quiet_NaN();
    const MaterialLimits lost = this->material.limits(this->columns(true, residual), this->begin, this->end);
    EXPECT_EQ(lost.stiffness, std::numeric_limits<Real>::infinity());
    EXPECT_EQ(lost.wave_modulus, std::numeric_limits<Real>::infinity());
  }
}

// F <- (I + dt grad v) F and the limits of the result.
TYPED_TEST(MaterialLoopsTest, AdvanceDeformsByTheGradient) {
  using T = typename TestFixture::T;
  constexpr int dim = TestFixture::dim;
  const double dt = 0.01, epsilon = std::numeric_limits<T>::epsilon();
  Columns<T> gradient{dim * dim, TestFixture::end - TestFixture::begin};
  std::mt19937 generator(5);
  std::uniform_real_distribution<double> both(-5, 5);
  for (int p = 0; p < gradient.count(); ++p)
    for (int k = 0; k < dim * dim; ++k) gradient[k][p] = static_cast<T>(both(generator));
  std::vector<Eigen::Matrix<double, dim, dim>> expected;
  for (int p = this->begin; p < this->end; ++p) {
    Eigen::Matrix<double, dim, dim> F, G;
    for (int k = 0; k < dim * dim; ++k) {
      F(k / dim, k % dim) = this->F[k][p];
      G(k / dim, k % dim) = gradient[k][p - this->begin];
    }
    expected.push_back(F + dt * G * F);
  }
  const MaterialLimits limits =
      this->material.advance(this->columns(), gradient.data(), {.dt = dt}, this->begin, this->end).limits;
  for (int p = this->begin; p < this->end; ++p)
    for (int k = 0; k < dim * dim; ++k)
      EXPECT_NEAR(this->F[k][p], expected[p - this->begin](k / dim, k % dim),
                  8 * epsilon * expected[p - this->begin].norm());
  const MaterialLimits measured = this->material.limits(this->columns(), this->begin, this->end);
  // The compiler may contract products and sums in one loop and not in the other.
  EXPECT_NEAR(limits.stiffness, measured.stiffness, 4 * epsilon * measured.stiffness);
  EXPECT_NEAR(limits.wave_modulus, measured.wave_modulus, 4 * epsilon * measured.wave_modulus);
  EXPECT_NEAR(limits.min_jacobian, measured.min_jacobian, 4 * epsilon);
}

// Ten turns of a rigid rotation in steps of |A| <= 0.2: det F grows by 1 + w^2, 1 + w^4/4 and not at all.
TYPED_TEST(MaterialLoopsTest, RotationsKeepTheVolumeAsWellAsTheUpdateCan) {
  using T = typename TestFixture::T;
  constexpr int dim = TestFixture::dim, steps = 400, W = pack_width<T>;
  const double angle = 20 * 3.14159265358979323846 / steps;
  Columns<T> gradient{dim * dim, W}, J{1, W};
  std::fill_n(gradient[1], W, T(-1));
  std::fill_n(gradient[dim], W, T(1));
  const std::pair<DeformationUpdate, double> cases[] = {
      {DeformationUpdate::first_order, 1 + angle * angle},
      {DeformationUpdate::second_order, 1 + std::pow(angle, 4) / 4},
      {DeformationUpdate::exponential, 1}};
  for (const auto& [update, factor] : cases) {
    for (int k = 0; k < dim * dim; ++k) std::fill_n(this->F[k], W, T(k % (dim + 1) == 0));
    for (int i = 0; i < steps; ++i)
      this->material.advance(this->columns(), gradient.data(), {.dt = angle, .update = update}, 0, W);
    this->material.jacobian(this->columns(), 0, W, J[0]);
    const double expected = std::pow(factor, steps), rounding = steps * std::numeric_limits<T>::epsilon();
    for (int p = 0; p < W; ++p) EXPECT_NEAR(J[0][p], expected, rounding * expected);
    // The angle itself is right to the order of the update: whole turns bring F back to I.
    if (update != DeformationUpdate::exponential) continue;
    for (int k = 0; k < dim * dim; ++k) EXPECT_NEAR(this->F[k][0], k % (dim + 1) == 0 ? 1 : 0, 4 * rounding);
  }
}

// In whatever lane and component it hides, before or after sound particles.
TYPED_TEST(MaterialLoopsTest, LimitsFindEveryBrokenParticle) {
  using T = typename TestFixture::T;
  constexpr int dim = TestFixture::dim;
  constexpr double infinity = std::numeric_limits<double>::infinity();
  for (int p = this->begin; p < this->end; ++p) {
    for (int k = 0; k < dim * dim; ++k) {
      const T sound = this->F[k][p];
      this->F[k][p] = std::numeric_limits<T>::quiet_NaN();
      const MaterialLimits limits = this->material.limits(this->columns(), this->begin, this->end);
      this->F[k][p] = sound;
      EXPECT_EQ(limits.stiffness, infinity);
      EXPECT_EQ(limits.wave_modulus, infinity);
      EXPECT_EQ(limits.min_jacobian, -infinity);
    }
    for (int i = 0; i < dim; ++i) this->F[i][p] *= -1;  // the first row: det F < 0
    EXPECT_LT(this->material.limits(this->columns(), this->begin, this->end).min_jacobian, 0);
    for (int i = 0; i < dim; ++i) this->F[i][p] *= -1;
  }
  EXPECT_LT(this->material.limits(this->columns(), this->begin, this->end).stiffness, infinity);
  EXPECT_GT(this->material.limits(this->columns(), this->begin, this->end).min_jacobian, 0);
}

// A NaN in F reaches the stress, and doesn't leave its lane.
TYPED_TEST(MaterialLoopsTest, StressPassesNaNOn) {
  using T = typename TestFixture::T;
  const int bad = this->begin + 3;
  this->F[0][bad] = std::numeric_limits<T>::quiet_NaN();
  this->material.stress(this->columns(), this->begin, this->end, this->tau.data());
  for (int p = this->begin; p < this->end; ++p)
    EXPECT_EQ(std::isnan(this->tau[0][p - this->begin]), p == bad) << p;
}

TEST(MaterialLimitsTest, OfNoParticlesRestrictNothing) {
  const MaterialLoops<NeoHookean<3>, 3> material({.name = "plate", .density = 1000}, {1, 1});
  const MaterialLimits limits = material.limits(MaterialColumns<3, double>(), 8, 8);
  EXPECT_EQ(limits.stiffness, 0);
  EXPECT_EQ(limits.wave_modulus, 0);
  EXPECT_EQ(limits.min_jacobian, std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace mpm::test
