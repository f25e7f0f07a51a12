// The production kernels against their plain twins.
#include <gtest/gtest.h>

#include "../../support/serial_grid.hpp"
#include "mpm_hpc/transfer/transfer_kernels.hpp"

using namespace mpm;
using namespace mpm::test;

namespace {

// Stresses of the reference particles, looked up by identity.
template <int Dim, class T>
struct GivenStress : StressSource<Dim, T> {
  const Body<Dim>& body;
  const std::vector<ModalParticle<Dim>>& particles;
  GivenStress(const Body<Dim>& b, const std::vector<ModalParticle<Dim>>& p) : body(b), particles(p) {}
  void kirchhoff_stress(Index begin, Index end, T* const* tau) const override {
    const GlobalIndex* id = body.particles.template data<GlobalIndex>(core::id);
    for (Index p = begin; p < end; ++p)
      for (int a = 0; a < Dim; ++a)
        for (int b = a; b < Dim; ++b)
          tau[SymTensor<T, Dim>::index(a, b)][p - begin] =
              id[p] < 0 ? T(0) : static_cast<T>(particles[id[p]].tau(a, b));
  }
};

// Keeps the limits and deforms the particles as a material does.
template <int Dim, class T>
struct Recorder : UpdateSink<Dim, T> {
  Body<Dim>& body;
  Real dt;
  KinematicLimits all;
  Recorder(Body<Dim>& b, Real step) : body(b), dt(step) {}
  void updated(Index begin, Index end, const KinematicLimits& limits, const T* const* gradient) override {
    all.include(limits);
    for (Index p = begin; p < end; ++p) {
      Mat<Dim> G;
      for (int c = 0; c < Dim * Dim; ++c) G(c / Dim, c % Dim) = gradient[c][p - begin];
      const Mat<Dim> F = read_particle<Dim, T>(body, p).F, updated = F + dt * G * F;
      for (int c = 0; c < Dim * Dim; ++c)
        body.particles.template data<T>(core::deformation_gradient, c)[p] = static_cast<T>(updated(c / Dim, c % Dim));
    }
  }
};

template <class Kernel, class Form_, int D, class Number>
struct Case {
  static constexpr int Dim = D;
  using T = Number;
  using KernelType = Kernel;
  using Form = Form_;
};

template <class C>
class Transfer : public testing::Test {
 public:
  static constexpr int Dim = C::Dim;
  using T = typename C::T;
  static constexpr Precision precision =
      std::is_same_v<T, float> ? Precision::single_precision : Precision::double_precision;
  static constexpr Real tolerance = std::is_same_v<T, float> ? 3e-5 : 1e-13;

  GridGeometry<Dim> geometry{Vec<Dim>::Constant(-0.3), Vec<Dim>::Constant(0.9), 0.1};
  std::vector<ModalParticle<Dim>> particles = random_particles(geometry, 700, 7);
};

// Every transfer that exists, with all dimensions and precisions.
template <class... T>
struct List {};
template <class... A, class... B>
List<A..., B...> operator+(List<A...>, List<B...>);
template <class Kernel, class Form>
using InAll = List<Case<Kernel, Form, 2, double>, Case<Kernel, Form, 2, float>, Case<Kernel, Form, 3, double>,
                   Case<Kernel, Form, 3, float>>;
template <class Kernel, Forces forces, Scheme... schemes>
using Of = decltype((InAll<Kernel, TransferForm<schemes, forces>>() + ...));
using LinearCases = Of<LinearKernel, Forces::classical, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic>;
template <class Kernel, Forces forces>
using All = Of<Kernel, forces, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic, Scheme::polypic>;

template <class>
struct AsTypes;
template <class... C>
struct AsTypes<List<C...>> {
  using Types = testing::Types<C...>;
};
TYPED_TEST_SUITE_P(Transfer);

TYPED_TEST_P(Transfer, EqualsTheReferenceAfterADriftOfAlmostOneCell) {
  constexpr int Dim = TestFixture::Dim;
  using T = typename TestFixture::T;
  using Kernel = typename TypeParam::KernelType;
  using Form = typename TypeParam::Form;
  const auto& geometry = this->geometry;
  Body<Dim> body = make_body<Dim, T>(this->particles, this->precision, Form::scheme);
  const BlockTopology<Dim> topology = order_and_activate(body, geometry, this->precision, Kernel::shift);
  // Move every particle by up to 0.99 cells after the sort: the tile must still hold its stencil.
  std::mt19937 random(3);
  std::uniform_real_distribution<Real> both(-0.099, 0.099);
  const GlobalIndex* id = body.particles.template data<GlobalIndex>(core::id);
  auto particles = this->particles;
  for (Index p = 0; p < body.particles.size(); ++p)
    for (int a = 0; a < Dim; ++a) {
      Real* x = body.particles.template data<Real>(core::position, a);
      if (id[p] >= 0) {
        particles[id[p]].x[a] = (x[p] += both(random));
      } else {
        x[p] = x[p - 1];  // padding goes where its particle goes
      }
    }

  const Real dt = 0.01;
  GridFields fields(this->precision);
  const FieldId nodes = fields.add({.name = "node", .units = "1", .components = 4, .halo_components = Dim + 1});
  const FieldId changes = fields.add({.name = "change", .units = "1", .components = 4, .halo_components = Dim});
  fields.resize(static_cast<std::size_t>(topology.size()) * nodes_per_block<Dim>);
  fields.zero(nodes);
  fields.zero(changes);
  const Real blend = 0.7;
  const TransferGrid<Dim, T> grid{geometry, topology, fields.template data<T>(nodes), fields.template data<T>(changes),
                                  blend};
  const GivenStress<Dim, T> stress(body, particles);
  particle_to_grid<Kernel, Form>(grid, body, all_ranges(body), stress, dt);

  ReferenceGrid<Dim> reference(geometry, true);
  reference_form_to_grid<Kernel, Form>(geometry, particles, dt, reference);
  Real largest = 0;
  for (const auto& m : reference.momentum) largest = std::max(largest, m.template lpNorm<Eigen::Infinity>());
  std::size_t seen = 0;
  for (Slot s = 0; s < topology.size(); ++s)
    for (int n = 0; n < nodes_per_block<Dim>; ++n) {
      const IntVec<Dim> node = topology.first_node(s) + node_in_block<Dim>(n);
      if ((node.array() >= reference.size.array()).any()) continue;
      const std::size_t place = (static_cast<std::size_t>(s) * nodes_per_block<Dim> + n) * node_values;
      T *value = grid.nodes + place, *change = grid.changes + place;
      const std::size_t i = reference.index(node);
      seen += reference.mass[i] > 0;
      EXPECT_NEAR(value[Dim], reference.mass[i], TestFixture::tolerance * 10);
      for (int a = 0; a < Dim; ++a)
        EXPECT_NEAR(value[a], reference.momentum[i][a], TestFixture::tolerance * largest * 10);
      for (int a = 0; a < Dim; ++a)
        EXPECT_NEAR(change[a], reference.changes[i][a], TestFixture::tolerance * largest * 10);
      // Some smooth velocity for the way back, the same on both sides.
      for (int a = 0; a < Dim; ++a) {
        const Vec<Dim> x = geometry.node_position(node);
        reference.momentum[i][a] = std::sin(3 * x[a] + x[(a + 1) % Dim]) + a;
        value[a] = static_cast<T>(reference.momentum[i][a]);
        reference.changes[i][a] = std::cos(2 * x[a]) - x[(a + 1) % Dim];
        change[a] = static_cast<T>(reference.changes[i][a]);
      }
    }
  EXPECT_EQ(seen, static_cast<std::size_t>(std::count_if(reference.mass.begin(), reference.mass.end(),
                                                         [](Real m) { return m > 0; })));

  Recorder<Dim, T> sink(body, dt);
  grid_to_particle<Kernel, Form>(grid, body, all_ranges(body), dt, sink);
  const auto before = particles;
  reference_form_to_particle<Kernel, Form>(geometry, reference, dt, particles, blend);
  Real speed = 0, component = 0, gradient = 0, acceleration = 0;
  for (Index p = 0; p < body.particles.size(); ++p) {
    if (id[p] < 0) continue;
    const auto got = read_particle<Dim, T>(body, p);
    const auto& want = particles[id[p]];
    EXPECT_LT((got.x - want.x).norm(), TestFixture::tolerance);
    EXPECT_LT((got.v - want.v).norm(), TestFixture::tolerance * 10);
    if (Form::affine) {
      EXPECT_LT((got.C - want.C).norm(), TestFixture::tolerance * 1000);
    }
    for (int k = 0; Form::modes && k < product_modes<Dim>; ++k)
      EXPECT_LT((got.modes[product_sets<Dim>[k]] - want.modes[product_sets<Dim>[k]]).norm(), TestFixture::tolerance * 1000);
    EXPECT_LT((got.F - want.F).norm(), TestFixture::tolerance * 30);
    const Vec<Dim> way = (want.x - before[id[p]].x) / dt;
    const Mat<Dim> rate = (want.F * before[id[p]].F.inverse() - Mat<Dim>::Identity()) / dt;
    speed = std::max(speed, Form::increments ? way.cwiseAbs().cwiseMax(want.v.cwiseAbs()).norm() : want.v.norm());
    component = std::max(component, way.template lpNorm<Eigen::Infinity>());
    gradient = std::max(gradient, rate.cwiseAbs().rowwise().sum().maxCoeff());
    acceleration = std::max(acceleration, (want.v - before[id[p]].v).norm() / dt);
  }
  EXPECT_NEAR(sink.all.speed, speed, 1e-4 * speed);
  EXPECT_NEAR(sink.all.speed_component, component, 1e-4 * component);
  EXPECT_NEAR(sink.all.gradient, gradient, 1e-4 * gradient);
  EXPECT_NEAR(sink.all.acceleration, acceleration, 1e-4 * acceleration);
}

// On either side in each direction, and nowhere; in one lane of a pack.
TYPED_TEST_P(Transfer, RefusesAParticleThatDriftedTooFar) {
  constexpr int Dim = TestFixture::Dim;
  using T = typename TestFixture::T;
  using Kernel = typename TypeParam::KernelType;
  using Form = typename TypeParam::Form;
  // In the middle of the places whose stencil starts at a block's first node: 1.5 cells from the tile's lower end and, with
  // the block's three other nodes and one to drift, 4.5 from its upper.
  ModalParticle<Dim> particle = this->particles[0];
  particle.x = this->geometry.node_position(IntVec<Dim>::Constant(12)) +
               Vec<Dim>::Constant((Kernel::shift + 0.5) * this->geometry.spacing());
  Body<Dim> body = make_body<Dim, T>({particle}, this->precision, Form::scheme);
  const BlockTopology<Dim> topology = order_and_activate(body, this->geometry, this->precision, Kernel::shift);
  GridFields fields(this->precision);
  const FieldId nodes = fields.add({.name = "node", .units = "1", .components = 4, .halo_components = Dim + 1});
  const FieldId changes = fields.add({.name = "change", .units = "1", .components = 4, .halo_components = Dim});
  fields.resize(static_cast<std::size_t>(topology.size()) * nodes_per_block<Dim>);
  fields.zero(nodes);
  fields.zero(changes);
  const TransferGrid<Dim, T> grid{this->geometry, topology, fields.template data<T>(nodes),
                                  fields.template data<T>(changes)};
  const GivenStress<Dim, T> stress(body, this->particles);
  const std::vector<int> ranges = all_ranges(body);
  Recorder<Dim, T> sink(body, 0.0);
  const Index p = static_cast<Index>(
      std::find(body.particles.template data<GlobalIndex>(core::id),
                body.particles.template data<GlobalIndex>(core::id) + body.particles.size(), 0) -
      body.particles.template data<GlobalIndex>(core::id));
  ASSERT_LT(p, body.particles.size());
  for (int a = 0; a < Dim; ++a) {
    Real& x = body.particles.template data<Real>(core::position, a)[p];
    const Real at = x;
    for (const Real way : {-0.149, 0.449}) {
      x = at + way;
      EXPECT_NO_THROW((particle_to_grid<Kernel, Form>(grid, body, ranges, stress, 0.0))) << a << " " << way;
      EXPECT_NO_THROW((grid_to_particle<Kernel, Form>(grid, body, ranges, 0.0, sink))) << a << " " << way;
    }
    for (const Real way : {-0.151, 0.451, std::numeric_limits<Real>::quiet_NaN(), std::numeric_limits<Real>::infinity()}) {
      x = at + way;
      EXPECT_THROW((particle_to_grid<Kernel, Form>(grid, body, ranges, stress, 0.0)), LogicError) << a << " " << way;
      EXPECT_THROW((grid_to_particle<Kernel, Form>(grid, body, ranges, 0.0, sink)), LogicError) << a << " " << way;
    }
    x = at;
  }
}

REGISTER_TYPED_TEST_SUITE_P(Transfer, EqualsTheReferenceAfterADriftOfAlmostOneCell, RefusesAParticleThatDriftedTooFar);
INSTANTIATE_TYPED_TEST_SUITE_P(Linear, Transfer, AsTypes<LinearCases>::Types);
using QuadraticMls = All<QuadraticKernel, Forces::mls>;
using QuadraticClassical = All<QuadraticKernel, Forces::classical>;
using CubicMls = All<CubicKernel, Forces::mls>;
using CubicClassical = All<CubicKernel, Forces::classical>;
INSTANTIATE_TYPED_TEST_SUITE_P(QuadraticMls, Transfer, AsTypes<QuadraticMls>::Types);
INSTANTIATE_TYPED_TEST_SUITE_P(QuadraticClassical, Transfer, AsTypes<QuadraticClassical>::Types);
INSTANTIATE_TYPED_TEST_SUITE_P(CubicMls, Transfer, AsTypes<CubicMls>::Types);
INSTANTIATE_TYPED_TEST_SUITE_P(CubicClassical, Transfer, AsTypes<CubicClassical>::Types);

TEST(TransferOptions, RefusesWhatTheLinearKernelLacks) {
  EXPECT_NE(why_undefined({KernelKind::linear, Scheme::apic, Forces::mls}), "");
  EXPECT_NE(why_undefined({KernelKind::linear, Scheme::polypic, Forces::classical}), "");
  EXPECT_EQ(why_undefined({KernelKind::linear, Scheme::apic, Forces::classical}), "");
  EXPECT_THROW((transfer_kernels<2, double>({KernelKind::linear, Scheme::apic, Forces::mls})), LogicError);
}

}  // namespace
