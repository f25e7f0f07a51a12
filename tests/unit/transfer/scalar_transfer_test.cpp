// Scalar transfers and the diffusion-reaction operator in its three forms (matrix-free, diagonal, stencil) against plain sums.
#include <gtest/gtest.h>

#include "../../support/serial_grid.hpp"
#include "mpm_hpc/transfer/operator_stencil.hpp"

using namespace mpm;
using namespace mpm::test;

namespace {

template <class T>
struct Given : ValueSource<T> {
  const T *mass, *conductivity, *reaction;
  void values(Index begin, Index end, T* const* q, T* k, T* a) override {
    for (Index p = begin; p < end; ++p) {
      for (int c = 0; c < 4; ++c) q[c][p - begin] = static_cast<T>(c + 1) * mass[p];
      k[p - begin] = conductivity[p];
      a[p - begin] = reaction[p];
    }
  }
};

template <class T, int Dim>
struct Collected : ValueSink<T> {
  std::vector<Real> value;
  std::vector<Vec<Dim>> gradient;
  void values(Index begin, Index end, const T* v, const T* const* g) override {
    for (Index p = begin; p < end; ++p) {
      value[p] = v[p - begin];
      for (int a = 0; g && a < Dim; ++a) gradient[p][a] = g[a][p - begin];
    }
  }
};

template <class K, int D, class Number, class OfStencil = Number>
struct Case {
  using Kernel = K;
  static constexpr int Dim = D;
  using T = Number;
  using Entry = OfStencil;
};

template <class C>
class Scalar : public testing::Test {};
using Cases = testing::Types<
    Case<LinearKernel, 2, double>, Case<LinearKernel, 2, float>, Case<LinearKernel, 2, double, float>,
    Case<LinearKernel, 3, double>, Case<LinearKernel, 3, float>, Case<LinearKernel, 3, double, float>,
    Case<QuadraticKernel, 2, double>, Case<QuadraticKernel, 2, float>,
    Case<QuadraticKernel, 2, double, float>, Case<QuadraticKernel, 3, double>,
    Case<QuadraticKernel, 3, float>, Case<QuadraticKernel, 3, double, float>, Case<CubicKernel, 2, double>,
    Case<CubicKernel, 2, float>, Case<CubicKernel, 2, double, float>, Case<CubicKernel, 3, double>,
    Case<CubicKernel, 3, float>, Case<CubicKernel, 3, double, float>>;
TYPED_TEST_SUITE(Scalar, Cases);

TYPED_TEST(Scalar, EqualsPlainSums) {
  constexpr int Dim = TypeParam::Dim;
  using Kernel = typename TypeParam::Kernel;
  using T = typename TypeParam::T;
  using Entry = typename TypeParam::Entry;
  const bool single = std::is_same_v<T, float>;
  const Precision precision = single ? Precision::single_precision : Precision::double_precision;
  constexpr Real of_single = 2e-5, of_double = 1e-13;
  const Real tolerance = single ? of_single : of_double,
             stencil_tolerance = std::is_same_v<Entry, float> ? of_single : of_double;
  const GridGeometry<Dim> geometry(Vec<Dim>::Constant(-0.3), Vec<Dim>::Constant(0.9), 0.1);
  auto particles = random_particles(geometry, 400, 21);
  Body<Dim> body = make_body<Dim, T>(particles, precision);
  const BlockTopology<Dim> topology = order_and_activate(body, geometry, precision, Kernel::shift);
  const GlobalIndex* id = body.particles.template data<GlobalIndex>(core::id);
  std::mt19937 random(4);
  std::uniform_real_distribution<Real> drift(-0.09, 0.09), both(-1, 1);
  for (Index p = 0; p < body.particles.size(); ++p)
    if (id[p] >= 0)
      for (int a = 0; a < Dim; ++a)
        particles[id[p]].x[a] = (body.particles.template data<Real>(core::position, a)[p] += drift(random));

  using Stencil = OperatorStencil<Kernel, Dim>;
  GridFields fields(precision);
  const FieldId nodes = fields.add({.name = "values", .units = "1", .components = 4});
  const FieldId diagonal = fields.add({.name = "diagonal", .units = "1"}), x = fields.add({.name = "x", .units = "1"}), y = fields.add({.name = "y", .units = "1"});
  // What the sweep with the stencil gives, and its product.
  const FieldId nodes2 = fields.add({.name = "values again", .units = "1", .components = 4});
  const FieldId diagonal2 = fields.add({.name = "diagonal again", .units = "1"}), y2 = fields.add({.name = "product by stencil", .units = "1"});
  const FieldId first = fields.add({.name = "first value", .units = "1"});
  const FieldId diagonal1 = fields.add({.name = "diagonal with it", .units = "1"});
  // The first two values, from both sweeps.
  const FieldId two = fields.add({.name = "two values", .units = "1", .components = 2}), two2 = fields.add({.name = "two values again", .units = "1", .components = 2});
  const FieldId unused = fields.add({.name = "diagonals with them", .units = "1"});
  fields.resize(static_cast<std::size_t>(topology.size()) * nodes_per_block<Dim>);
  for (FieldId f : {nodes, diagonal, x, y, nodes2, diagonal2, y2, first, diagonal1, two, two2, unused}) fields.zero(f);
  // The particles' volume serves as conductivity (0 for padding), their mass as the scattered value and, scaled up so
  // that it is seen beside k / h^2, as reaction.
  const T* conductivity = body.particles.template data<T>(core::volume);
  Given<T> source;
  source.mass = body.particles.template data<T>(core::mass);
  source.conductivity = conductivity;
  std::vector<T, Eigen::aligned_allocator<T>> reaction(body.particles.size());
  for (Index p = 0; p < body.particles.size(); ++p) reaction[p] = 300 * source.mass[p];
  source.reaction = reaction.data();
  const OperatorColumns<T> columns{conductivity, reaction.data()};
  const ScalarGrid<Dim> grid{geometry, topology};
  ReferenceGrid<Dim> reference(geometry);
  std::vector<Real> in(reference.mass.size());
  for (Slot s = 0; s < topology.size(); ++s)
    for (int n = 0; n < nodes_per_block<Dim>; ++n)
      fields.template data<T>(x)[s * nodes_per_block<Dim> + n] = static_cast<T>(
          in[reference.index(topology.first_node(s) + node_in_block<Dim>(n))] = both(random));

  scatter_values<Kernel>(grid, body, all_ranges(body), source, fields.template data<T>(nodes),
                                  fields.template data<T>(diagonal));
  apply_operator<Kernel>(grid, body, all_ranges(body), columns, fields.template data<T>(x),
                                  fields.template data<T>(y));
  std::vector<char> touched(topology.size(), 0);
  std::vector<Entry> stencil(static_cast<std::size_t>(topology.size()) * Stencil::block_values);
  scatter_values_and_stencil<Kernel, 4>(grid, body, all_ranges(body), source, fields.template data<T>(nodes2),
                                                 fields.template data<T>(diagonal2), stencil.data(), touched);
  // With the first value only, everything else is the same.
  std::vector<Entry> stencil1(stencil.size());
  std::vector<char> touched1(topology.size(), 0);
  scatter_values_and_stencil<Kernel, 1>(grid, body, all_ranges(body), source, fields.template data<T>(first),
                                                 fields.template data<T>(diagonal1), stencil1.data(), touched1);
  scatter_values<Kernel, 2>(grid, body, all_ranges(body), source, fields.template data<T>(two), fields.template data<T>(unused));
  std::vector<Entry> stencil2(stencil.size());
  std::vector<char> touched2(topology.size(), 0);
  scatter_values_and_stencil<Kernel, 2>(grid, body, all_ranges(body), source, fields.template data<T>(two2),
                                        fields.template data<T>(unused), stencil2.data(), touched2);
  EXPECT_EQ(stencil2, stencil);
  EXPECT_EQ(touched1, touched);
  for (std::size_t i = 0; i < stencil1.size(); ++i) ASSERT_EQ(stencil1[i], stencil[i]);
  std::vector<Slot> blocks;
  for (Slot s = 0; s < topology.size(); ++s)
    if (touched[s]) blocks.push_back(s);
  apply_stencil<Kernel>(topology, blocks, stencil.data(), fields.template data<T>(x),
                                 fields.template data<T>(y2));
  Collected<T, Dim> sink;
  sink.value.resize(body.particles.size());
  sink.gradient.resize(body.particles.size());
  Collected<T, Dim> value_sink = sink;
  gather_scalar<Kernel>(grid, body, all_ranges(body), fields.template data<T>(x), sink);

  gather_value<Kernel>(grid, body, all_ranges(body), fields.template data<T>(x), value_sink);

  // The plain way: D^-1 w (x_i - x_p) of each stencil node, grad w where D is singular, and every pair of nodes.
  std::vector<Real> values(in.size()), diag(in.size()), out(in.size());
  std::vector<std::array<Real, Stencil::size>> entries(in.size());  // A_ij by i and j - i >= 0
  const auto gradient_of = [](Real w, const Vec<Dim>& distance, const Vec<Dim>& grad_w) -> Vec<Dim> {
    if constexpr (Kernel::has_inertia) return Kernel::inverse_inertia / (0.1 * 0.1) * w * distance;
    return grad_w;
  };
  std::vector<Real> value(particles.size());
  std::vector<Vec<Dim>> gradient(particles.size());
  for (std::size_t n = 0; n < particles.size(); ++n) {
    const auto& p = particles[n];
    struct Term {
      IntVec<Dim> node;
      Real w;
      Vec<Dim> g;
    };
    std::vector<Term> terms;
    gradient[n].setZero();
    for_each_node_with_gradient<Kernel>(geometry, p.x, [&](const IntVec<Dim>& node, Real w, const Vec<Dim>& distance,
                                                           const Vec<Dim>& grad_w) {
      terms.push_back({node, w, gradient_of(w, distance, grad_w)});
      value[n] += w * in[reference.index(node)];
      gradient[n] += terms.back().g * in[reference.index(node)];
      values[reference.index(node)] += w * p.mass;
    });
    for (const Term& i : terms)
      for (const Term& j : terms) {
        const Real h = p.volume * i.g.dot(j.g) + 300 * p.mass * i.w * j.w;
        out[reference.index(i.node)] += h * in[reference.index(j.node)];
        if (i.node == j.node) diag[reference.index(i.node)] += h;
        const IntVec<Dim> offset = j.node - i.node;
        if (offset.minCoeff() < 0) continue;
        entries[reference.index(i.node)][Stencil::number(offset)] += h;
      }
  }
  Real scale = 0;
  for (Real d : diag) scale = std::max(scale, d);
  for (Slot s = 0; s < topology.size(); ++s)
    for (int n = 0; n < nodes_per_block<Dim>; ++n) {
      const std::size_t k = static_cast<std::size_t>(s) * nodes_per_block<Dim> + n;
      const std::size_t i = reference.index(topology.first_node(s) + node_in_block<Dim>(n));
      for (int c = 0; c < 4; ++c)
        for (const FieldId f : {nodes, nodes2})
          EXPECT_NEAR(fields.template data<T>(f)[4 * k + c], (c + 1) * values[i], 100 * tolerance);
      for (int c = 0; c < 2; ++c)
        for (const FieldId f : {two, two2})
          EXPECT_NEAR(fields.template data<T>(f)[2 * k + c], (c + 1) * values[i], 100 * tolerance);
      EXPECT_NEAR(fields.template data<T>(first)[k], values[i], 100 * tolerance);
      EXPECT_NEAR(fields.template data<T>(diagonal)[k], diag[i], tolerance * scale * 10);
      for (const FieldId f : {diagonal1, diagonal2})
        EXPECT_NEAR(fields.template data<T>(f)[k], diag[i], stencil_tolerance * scale * 10);
      EXPECT_NEAR(fields.template data<T>(y)[k], out[i], tolerance * scale * 30);
      EXPECT_NEAR(fields.template data<T>(y2)[k], out[i], stencil_tolerance * scale * 30);
      for (int e = 0; e < Stencil::size; ++e)
        EXPECT_NEAR(stencil[Stencil::index(s, n, Stencil::offset(e))], entries[i][e], stencil_tolerance * scale * 10);
    }
  for (Index p = 0; p < body.particles.size(); ++p) {
    if (id[p] < 0) continue;
    for (const auto& s : {sink, value_sink}) EXPECT_NEAR(s.value[p], value[id[p]], tolerance * 10);
    EXPECT_LT((sink.gradient[p] - gradient[id[p]]).norm(), tolerance * 1000);
  }
}

}  // namespace
