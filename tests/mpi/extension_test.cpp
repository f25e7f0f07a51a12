// An effect that the program doesn't know is added through its list and the field registry alone, and a scene without
// effects carries nothing of any.
#include <gtest/gtest.h>
#include <hdf5.h>

#include <cstdio>
#include <fstream>
#include <set>

#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/simulation/run.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "mpm_hpc/transfer/scalar_transfer.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

// Dye that the particles carry, mixed over the grid: a column and two grid fields of its own.
template <int Dim>
class Dye final : public Effect<Dim> {
 public:
  explicit Dye(Parameters& p) {
    p.real("strength", strength_, {.unit = "m", .min = 0, .doc = "Dye of each particle over its number."});
  }
  std::string explain() const override { return fmt::format("dye of strength {}", strength_); }
  void declare_fields(State<Dim>& state) override {
    for (auto& body : state.bodies) {
      const ScalarType real = real_type(state.precision);
      dye_ = body.particles.add({.name = "dye", .units = "m", .type = real, .in_output = true});
      mixed_ = body.particles.add(
          {.name = "mixed_dye", .units = "m", .type = real, .components = Dim, .in_output = true});
    }
    sums_ = state.fields.add(
        {.name = "dye_sums", .units = "m", .components = 4, .halo_components = 2, .sums_ghosts = true});
    unused_ = state.fields.add({.name = "dye_unused", .units = "1"});
    mean_ = state.fields.add({.name = "dye_mean", .units = "m", .fills_ghosts = true});
  }
  void initialise(State<Dim>& state) override {
    with_precision(state.precision, [&](auto zero) {
      using T = decltype(zero);
      for (auto& body : state.bodies)
        for (Index p = 0; p < body.particles.size(); ++p)
          body.particles.template data<T>(dye_)[p] = static_cast<T>(
              strength_ * static_cast<Real>(body.particles.template data<GlobalIndex>(core::id)[p]));
    });
  }
  void join(StepHooks<Dim>& hooks) override {
    hooks.before_p2g.push_back([this](State<Dim>&) { ++calls[0]; });
    hooks.on_p2g.push_back(
        [this](State<Dim>& s, std::size_t b, const std::vector<int>& r) { scatter(s, b, r); });
    hooks.on_grid.push_back([this](State<Dim>& s) { divide(s); });
    hooks.on_g2p.push_back(
        [this](State<Dim>& s, std::size_t b, const std::vector<int>& r) { gather(s, b, r); });
    hooks.after_g2p.push_back([this](State<Dim>&) { ++calls[3]; });
  }
  void history(State<Dim>& state, std::vector<HistoryValue>& row) override {
    Real sum = 0;
    with_precision(state.precision, [&](auto zero) {
      for (const auto& body : state.bodies)
        for (Index p = 0; p < body.particles.size(); ++p)
          if (!body.is_padding(p)) sum += body.particles.template data<decltype(zero)>(dye_)[p];
    });
    row.push_back({"dye", "m", sum});
  }

  int calls[4] = {};
  Real weight = 0;  // of this rank's nodes in the last step: as many as there are particles, in sum
  FieldId dye_ = no_field, mixed_ = no_field, sums_ = no_field, unused_ = no_field, mean_ = no_field;

 private:
  template <class T>
  struct Source final : ValueSource<T> {
    const T *mass, *dye;
    void values(Index begin, Index end, T* const* q, T* conductivity, T* reaction) override {
      for (Index p = begin; p < end; ++p) {
        const T present = mass[p] > 0 ? T(1) : T(0);
        q[0][p - begin] = present;
        q[1][p - begin] = present * dye[p];
        q[2][p - begin] = q[3][p - begin] = conductivity[p - begin] = reaction[p - begin] = 0;
      }
    }
  };
  template <class T>
  struct Sink final : ValueSink<T> {
    T* mixed;
    void values(Index begin, Index end, const T* value, const T* const*) override {
      std::copy(value, value + (end - begin), mixed + begin);
    }
  };
  void scatter(State<Dim>& state, std::size_t b, const std::vector<int>& ranges) {
    calls[1] += static_cast<int>(ranges.size());
    with_precision(state.precision, [&](auto zero) {
      using T = decltype(zero);
      const FieldSet& f = state.bodies[b].particles;
      Source<T> source;
      source.mass = f.template data<T>(core::mass);
      source.dye = f.template data<T>(dye_);
      scatter_values<QuadraticKernel>({state.geometry(), state.topology()}, state.bodies[b], ranges, source,
                                      state.fields.template data<T>(sums_),
                                      state.fields.template data<T>(unused_));
    });
  }
  void divide(State<Dim>& state) {
    ++calls[2];
    weight = 0;
    with_precision(state.precision, [&](auto zero) {
      using T = decltype(zero);
      const T* sums = state.fields.template data<T>(sums_);
      T* mean = state.fields.template data<T>(mean_);
      const std::size_t owned = static_cast<std::size_t>(state.topology().owned()) * nodes_per_block<Dim>;
      std::fill_n(mean, state.fields.nodes(), T(1e30));  // what a ghost would keep without the fill
      for (std::size_t i = 0; i < owned; ++i) {
        weight += sums[4 * i];
        mean[i] = sums[4 * i] > 0 ? sums[4 * i + 1] / sums[4 * i] : T(0);
      }
    });
  }
  void gather(State<Dim>& state, std::size_t b, const std::vector<int>& ranges) {
    with_precision(state.precision, [&](auto zero) {
      using T = decltype(zero);
      Sink<T> sink;
      sink.mixed = state.bodies[b].particles.template data<T>(mixed_);
      gather_scalar<QuadraticKernel>({state.geometry(), state.topology()}, state.bodies[b], ranges,
                                     state.fields.template data<T>(mean_), sink);
    });
  }

  Real strength_ = 1;
};

template <int Dim>
std::vector<EffectEntry<Dim>> list_with_dye() {
  std::vector<EffectEntry<Dim>> list = effect_list<Dim>();
  list.push_back({"dye", "Dye that is carried along.", false,
                  [](Parameters& p) { return std::make_unique<Dye<Dim>>(p); }});
  return list;
}

// Two discs that fly across the domain and turn, so that particles and cuts move; at rest without `speed`. One is larger,
// so that two ranks share it.
template <int Dim>
std::string scene_text(Real speed, const std::string& rest = "") {
  auto list = [](Real x, Real y, Real z) {
    return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
  };
  auto disc = [&](const char* name, Real x, Real y, Real radius, Real direction) {
    return fmt::format(
        "[[body]]\nname = \"{}\"\nmaterial = \"rubber\"\n"
        "shape = {{type = \"sphere\", center = {}, radius = {}}}\n"
        "velocity = {}\nangular_velocity = {}\n",
        name, list(x, y, 1), radius, list(direction * speed, 0, 0),
        Dim == 2 ? fmt::format("{}", speed) : fmt::format("[0, 0, {}]", speed));
  };
  return fmt::format("dimension = {}\n", Dim) + rest + "[domain]\nlower = " + list(0, 0, 0) +
         "\nupper = " + list(6, 3, 2) +
         "\n[grid]\nspacing = 0.1\n[time]\nend = 1.5\n"
         "[material.rubber]\nmodel = \"neo_hookean\"\nyoungs_modulus = 1e4\npoisson_ratio = 0.3\n"
         "density = 1000\n" +
         disc("left", 1, 0.8, 0.6, 1) + disc("right", 5, 2.2, 0.45, -1);
}

template <class D>
class Extension : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(Extension, Dimensions);

TYPED_TEST(Extension, AnEffectOfItsOwnRunsAndMigrates) {
  constexpr int Dim = TypeParam::value;
  test::SceneWorld<Dim> world(scene_text<Dim>(1, "[effect.dye]\nstrength = 0.25\n"), list_with_dye<Dim>());
  State<Dim>& state = world.state;
  ASSERT_EQ(world.scene.effects.size(), 1u);
  auto& dye = dynamic_cast<Dye<Dim>&>(*world.scene.effects[0]);
  ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
  integrator.initialise(state);
  const GlobalIndex migrated = state.distribution.migrated();
  const int steps = Dim == 2 ? 100 : 40;
  state.dt = 0.9 * integrator.stable_step(state);
  for (int step = 0; step < steps; ++step) integrator.step(state);
  GlobalIndex count = 0, wrong = 0, unmixed = 0;
  world.for_particles([&](Body<Dim>& body, Index p) {
    const FieldSet& f = body.particles;
    const Real expected = 0.25 * static_cast<Real>(f.template data<GlobalIndex>(core::id)[p]);
    wrong += f.template data<Real>(dye.dye_)[p] != expected;
    // A mean of the neighbours' dye lies between the extremes; a ghost that wasn't filled gives 1e30.
    const Real mixed = f.template data<Real>(dye.mixed_)[p];
    unmixed += !(mixed >= -1e-9 && mixed < 1e9);
    ++count;
  });
  const Communicator& c = state.communicator();
  count = c.sum(count);
  wrong = c.sum(wrong);
  const Real weight = c.sum(dye.weight);
  if (test::rank() == 0)
    std::printf("%dD: %lld particles, dye wrong on %lld (expected 0), weight on the nodes %.10f\n", Dim,
                static_cast<long long>(count), static_cast<long long>(wrong), weight);
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(unmixed, 0);
  EXPECT_NEAR(weight, static_cast<Real>(count), 1e-9 * static_cast<Real>(count));
  for (const int stage : {0, 2, 3}) EXPECT_EQ(dye.calls[stage], steps) << stage;
  if (test::size() > 1) {
    EXPECT_GT(c.sum(state.distribution.migrated() - migrated), 0)
        << "the scene must move particles between ranks";
  }
}

std::vector<double> read_points(const std::filesystem::path& file, const std::string& name) {
  const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  EXPECT_GE(id, 0) << file;
  const hid_t dataset = H5Dopen2(id, ("VTKHDF/PointData/" + name).c_str(), H5P_DEFAULT);
  EXPECT_GE(dataset, 0) << name;
  const hid_t space = H5Dget_space(dataset);
  std::vector<double> values(H5Sget_simple_extent_npoints(space));
  H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data());
  H5Sclose(space);
  H5Dclose(dataset);
  H5Fclose(id);
  return values;
}

TEST(ExtensionOutput, ItsColumnsReachFramesHistoryAndCheckpoint) {
  test::SharedTemporaryFolder folder;
  RunOptions options;
  options.output = folder.path() / "run";
  options.steps = 20;
  const std::string text =
      scene_text<2>(1, "[output]\nprecision = \"double\"\n[effect.dye]\nstrength = 0.25\n");
  auto read = [&] {
    Parameters parameters = Parameters::read_text(text, "scene.toml");
    read_dimension(parameters);
    return read_scene<2>(parameters, list_with_dye<2>());
  };
  {
    mpm::Run<2> run(Communicator::world(), read(), options);
    run.prepare();
    EXPECT_NE(run.explanation().find("dye of strength 0.25"), std::string::npos);
    EXPECT_EQ(run.run(), ExitCode::done);
  }
  std::filesystem::path frame, checkpoint;
  for (const auto& entry : std::filesystem::directory_iterator(*options.output)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("frame_") && entry.path() > frame) frame = entry.path();
    if (name.starts_with("checkpoint_") && entry.path() > checkpoint) checkpoint = entry.path();
  }
  if (test::rank() == 0) {
    const std::vector<double> id = read_points(frame, "id"), dye = read_points(frame, "dye");
    ASSERT_EQ(id.size(), dye.size());
    ASSERT_GT(id.size(), 100u);
    for (std::size_t p = 0; p < id.size(); ++p) ASSERT_EQ(dye[p], 0.25 * id[p]);
    EXPECT_EQ(read_points(frame, "mixed_dye").size(), 3 * id.size());
    std::ifstream file(*options.output / "history.csv");
    std::string header;
    std::getline(file, header);
    EXPECT_NE(header.find("dye [m]"), std::string::npos) << header;
  }

  // The checkpoint carries the column: initialise() isn't called again, and the particles keep their dye.
  options.restart = checkpoint;
  options.output = folder.path() / "again";
  mpm::Run<2> again(Communicator::world(), read(), options);
  again.prepare();
  GlobalIndex wrong = 0, count = 0;
  for (const auto& body : again.state().bodies) {
    const FieldSet& f = body.particles;
    for (Index p = 0; p < f.size(); ++p) {
      if (body.is_padding(p)) continue;
      ++count;
      wrong += f.data<Real>(f.find("dye"))[p] != 0.25 * static_cast<Real>(f.data<GlobalIndex>(core::id)[p]);
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(Communicator::world().sum(count), 100);
}

TEST(ExtensionOutput, AnEffectThatIsNotInTheListIsAUserError) {
  try {
    test::SceneWorld<2> world(scene_text<2>(1, "[effect.dye]\nstrength = 0.25\n"));
    FAIL() << "the scene was read";
  } catch (const UserError& error) {
    EXPECT_NE(std::string(error.what()).find("dye"), std::string::npos) << error.what();
  }
}

// (Dim + 1) values per ghost node in a sum and per shared node in a fill, and no more.
TYPED_TEST(Extension, ASceneWithoutEffectsCarriesTheCoreAlone) {
  constexpr int Dim = TypeParam::value;
  for (const int bytes_per_value : {8, 4}) {
    test::SceneWorld<Dim> world(scene_text<Dim>(0, bytes_per_value == 4 ? "precision = \"single\"\n" : ""));
    State<Dim>& state = world.state;
    EXPECT_TRUE(world.scene.effects.empty());
    const char* names[] = {"id",   "position", "velocity", "velocity_gradient", "deformation_gradient",
                           "mass", "volume"};
    for (const auto& body : state.bodies) {
      ASSERT_EQ(body.particles.count(), core::count);
      for (FieldId f = 0; f < core::count; ++f) EXPECT_EQ(body.particles.traits(f).name, names[f]);
      EXPECT_EQ(body.particles.bytes_per_particle(),
                8 * (1 + Dim) + bytes_per_value * (Dim + 2 * Dim * Dim + 2));
    }
    EXPECT_EQ(state.fields.count(), 1);
    for (const auto* hooks : {&world.hooks.before_p2g, &world.hooks.on_grid, &world.hooks.after_g2p})
      EXPECT_TRUE(hooks->empty());
    EXPECT_TRUE(world.hooks.on_p2g.empty() && world.hooks.on_g2p.empty());

    ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
    integrator.initialise(state);
    state.dt = integrator.stable_step(state);
    const int sorts = state.distribution.sorts();
    const GlobalIndex bytes = state.halo().bytes(), messages = state.halo().messages();
    const GlobalIndex other_bytes = state.communicator().bytes();
    constexpr int steps = 5;
    for (int step = 0; step < steps; ++step) integrator.step(state);
    ASSERT_EQ(state.distribution.sorts(), sorts) << "the discs are at rest";
    const GlobalIndex sent = state.halo().bytes() - bytes;
    const GlobalIndex expected =
        steps * (Dim + 1) * bytes_per_value * (state.halo().ghost_nodes() + state.halo().shared_nodes());
    const Communicator& c = state.communicator();
    const GlobalIndex all_sent = c.sum(sent), all_expected = c.sum(expected);
    if (test::rank() == 0)
      std::printf("%dD, %d bytes per value: %lld bytes in %d steps, expected %lld\n", Dim, bytes_per_value,
                  static_cast<long long>(all_sent), steps, static_cast<long long>(all_expected));
    EXPECT_EQ(sent, expected);
    EXPECT_EQ(c.bytes(), other_bytes);
    EXPECT_LE(state.halo().messages() - messages, 2 * steps * state.halo().neighbours());
    EXPECT_EQ(all_sent > 0, test::size() > 1);
  }
}

}  // namespace
