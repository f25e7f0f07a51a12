// A box of particles over all ranks, and effects made from scene text; tests set node values by hand.
#pragma once

#include "mpm_hpc/effects/effect.hpp"
#include "support/mpi_test.hpp"
#include "support/typed_cases.hpp"

namespace mpm::test {

// Names of EffectsWorld in the body of a typed test.
#define IN_EFFECTS_WORLD                              \
  constexpr int Dim = TestFixture::Dim;               \
  using T [[maybe_unused]] = typename TestFixture::T; \
  using V [[maybe_unused]] = Vec<Dim>;                \
  [[maybe_unused]] auto& state = this->state;         \
  [[maybe_unused]] const Real tolerance = this->tolerance

template <class C>
class EffectsWorld : public testing::Test {
 public:
  static constexpr int Dim = C::Dim;
  using T = typename C::T;
  static constexpr Precision precision =
      std::is_same_v<T, float> ? Precision::single_precision : Precision::double_precision;
  static constexpr Real tolerance = std::is_same_v<T, float> ? 2e-6 : 1e-12;
  static constexpr Real h = 0.125, density = 3;
  using V = Vec<Dim>;

  // Two bodies fill the unit box, left and right of x = 1/2, with 2^Dim particles per cell.
  void SetUp() override {
    DistributionOptions options;
    options.precision = precision;
    state.precision = precision;
    state.fields = GridFields(precision);
    state.distribution = Distribution<Dim>(Communicator::world(), {V::Zero(), V::Ones(), h}, options);
    state.nodes = state.fields.add(
        {.name = "nodes", .units = "", .components = node_values, .halo_components = Dim + 1});
    state.bodies.emplace_back("left", 0, precision);
    state.bodies.emplace_back("right", 0, precision);
    state.dt = 0.01;
  }

  // After the effects have declared their columns.
  void fill_bodies() {
    const int side = static_cast<int>(2 / h), count = Dim == 2 ? side * side : side * side * side;
    for (int b = 0; b < 2; ++b) {
      std::vector<int> mine;
      for (int id = test::rank(); id < count; id += test::size())
        if (2 * (id % side) / side == b) mine.push_back(id);
      FieldSet& particles = state.bodies[b].particles;
      particles.resize(static_cast<Index>(mine.size()));
      const Real volume = std::pow(h / 2, Dim);
      for (std::size_t p = 0; p < mine.size(); ++p) {
        particles.template data<GlobalIndex>(core::id)[p] = mine[p];
        for (int a = 0, rest = mine[p]; a < Dim; ++a, rest /= side) {
          particles.template data<Real>(core::position, a)[p] = h / 2 * (rest % side + 0.5);
          particles.template data<T>(core::velocity, a)[p] = T(0.25 * (a + 1));
        }
        for (int c = 0; c < Dim * Dim; ++c) {
          particles.template data<T>(core::velocity_gradient, c)[p] = 0;
          particles.template data<T>(core::deformation_gradient, c)[p] = c % (Dim + 1) == 0;
        }
        particles.template data<T>(core::mass)[p] = T(density * volume);
        particles.template data<T>(core::volume)[p] = T(volume);
      }
    }
  }
  void distribute() {
    state.distribution.redistribute(state.bodies, state.fields, OrderWithinCell::canonical);
  }

  // f(position, values) for all owned nodes, massive or not.
  template <class F>
  void for_nodes(F&& f) {
    for (Slot s = 0; s < state.topology().owned(); ++s)
      for (int n = 0; n < nodes_per_block<Dim>; ++n)
        f(state.geometry().node_position(state.topology().first_node(s) + node_in_block<Dim>(n)),
          state.template node_values_of<T>(s) + n * node_values);
  }
  static V velocity_of(const T* values) {
    V v;
    for (int a = 0; a < Dim; ++a) v[a] = values[a];
    return v;
  }
  // Masses and velocities that differ from node to node; without mass where x + y > 1.4.
  void set_nodes() {
    for_nodes([&](const V& x, T* values) {
      for (int a = 0; a < Dim; ++a) values[a] = T(0.3 * (a + 1) - x[a] * x[0]);
      values[Dim] = x[0] + x[1] > 1.4 ? T(0) : T(1 + x.squaredNorm());
    });
  }
  // Velocity `v` and mass m on nodes that satisfy the predicate; no mass elsewhere.
  template <class Predicate>
  void set_nodes_where(Predicate&& holds, const V& v, Real mass) {
    for_nodes([&](const V& x, T* values) {
      for (int a = 0; a < Dim; ++a) values[a] = T(v[a]);
      values[Dim] = T(holds(x) ? mass : 0);
    });
  }

  struct Totals {
    Real mass = 0, energy = 0;
    V momentum = V::Zero();
  };
  Totals totals() {
    std::vector<Real> sums(Dim + 2, 0.0);
    for_nodes([&](const V&, const T* values) {
      const V v = velocity_of(values);
      for (int a = 0; a < Dim; ++a) sums[a] += values[Dim] * v[a];
      sums[Dim] += values[Dim];
      sums[Dim + 1] += 0.5 * values[Dim] * v.squaredNorm();
    });
    state.communicator().sum(sums);
    return {sums[Dim], sums[Dim + 1], Eigen::Map<const V>(sums.data())};
  }
  std::vector<V> velocities() {
    std::vector<V> of_nodes;
    for_nodes([&](const V&, const T* values) { of_nodes.push_back(velocity_of(values)); });
    return of_nodes;
  }
  // Force times way of all that acted on the nodes since then: their impulses times the velocity that they have now.
  Real work_since(const std::vector<V>& before) {
    Real work = 0;
    std::size_t n = 0;
    for_nodes([&](const V&, const T* values) {
      const V now = velocity_of(values);
      work += values[Dim] * (now - before[n++]).dot(now);
    });
    return state.communicator().sum(work);
  }
  Real external_work() { return state.communicator().sum(state.ledger["external_work"]); }
  V reaction(Effect<Dim>& effect, const std::string& name) {
    std::vector<HistoryValue> row;
    effect.history(state, row);
    V force;
    for (int a = 0; a < Dim; ++a) {
      EXPECT_EQ(row.at(a).name, "reaction_" + name + "_" + "xyz"[a]);
      force[a] = state.communicator().sum(row.at(a).value);
    }
    return force;
  }

  // The effect of [[effect.kind]] with this table, joined to the hooks.
  template <class E>
  std::unique_ptr<E> make(const std::string& kind, const std::string& table) {
    Parameters root = Parameters::read_text("[[effect." + kind + "]]\n" + table, "scene.toml");
    std::unique_ptr<E> effect;
    root.section("effect", [&](Parameters& effects) {
      effects.section_list(kind, {}, [&](Parameters& p, int) { effect = std::make_unique<E>(p); });
    });
    effect->declare_fields(state);
    effect->join(hooks);
    return effect;
  }
  static std::string list(Real x, Real y, Real z) {
    return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
  }
  static V vec(Real x, Real y, Real z) {
    V v;
    for (int a = 0; a < Dim; ++a) v[a] = a == 0 ? x : a == 1 ? y : z;
    return v;
  }
  void run(const std::vector<typename StepHooks<Dim>::Hook>& stage) {
    for (const auto& hook : stage) hook(state);
  }
  void run_grid() {
    run(hooks.on_grid);
    run(hooks.end_of_grid);
    run(hooks.after_grid);
  }

  State<Dim> state;
  StepHooks<Dim> hooks;
};

}  // namespace mpm::test
