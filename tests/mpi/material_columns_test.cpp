// Bodies of laws with columns of their own, and without F, through steps, migration, history, frames and checkpoints.
#include "mpm_hpc/effects/material_columns.hpp"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <memory>

#include "mpm_hpc/simulation/diagnostics.hpp"
#include "mpm_hpc/simulation/run.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

using namespace mpm;

namespace {

// Four bodies that fly into each other: sand, snow and a viscous fluid against rubber and bread that can break.
template <int Dim>
std::string scene_text(const std::string& rest = "") {
  auto list = [](Real x, Real y, Real z) {
    return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
  };
  auto ball = [&](const char* name, Real x, Real y, Real speed) {
    return fmt::format(
        "[[body]]\nname = \"{0}\"\nmaterial = \"{0}\"\nshape = {{type = \"sphere\", center = {1}, radius = "
        "0.3}}\n"
        "velocity = {2}\n",
        name, list(x, y, 0.5), list(speed, 0, 0));
  };
  const std::string elastic = "density = 1000\nyoungs_modulus = 1e5\npoisson_ratio = 0.3\n";
  return fmt::format("dimension = {}\n", Dim) + rest + "[domain]\nlower = " + list(-1, -1, -1) +
         "\nupper = " + list(4, 3, 2) +
         "\n[grid]\nspacing = 0.1\n[time]\nend = 0.1\ndeformation_update = \"exponential\"\n"
         "[material.sand]\nmodel = \"hencky\"\n" +
         elastic +
         "[material.sand.plasticity]\nmodel = \"drucker_prager\"\nfriction_angle = \"30 deg\"\n"
         "[material.water]\nmodel = \"tait_fluid\"\ndensity = 1000\nbulk_modulus = 1e5\nviscosity = 10\n"
         "[material.snow]\nmodel = \"snow\"\n" +
         elastic + "[material.bread]\nmodel = \"split_neo_hookean\"\n" + elastic +
         "[material.bread.plasticity]\nmodel = \"nacc\"\nfriction_angle = \"45 deg\"\ncohesion = 0.5\n"
         "[material.rubber]\nmodel = \"neo_hookean\"\n" +
         elastic + ball("sand", 1.1, 0.5, 2) + ball("water", 1.1, 1.5, 2) + ball("rubber", 1.8, 0.5, -2) +
         ball("bread", 1.8, 1.5, -2) + ball("snow", 0.4, 0.5, 2);
}

template <class D>
class MaterialBodies : public testing::Test {};
using Dimensions = testing::Types<std::integral_constant<int, 2>, std::integral_constant<int, 3>>;
TYPED_TEST_SUITE(MaterialBodies, Dimensions);

// A body pays for what its own law needs and for nothing of the others'.
TYPED_TEST(MaterialBodies, HaveTheColumnsOfTheirLaw) {
  constexpr int Dim = TypeParam::value;
  for (const int width : {8, 4}) {
    test::SceneWorld<Dim> world(scene_text<Dim>(width == 4 ? "precision = \"single\"\n" : ""));
    const int core_bytes = 8 * (1 + Dim) + width * (Dim + 2 * Dim * Dim + 2);
    const auto bytes = [&](const char* name) {
      for (const auto& body : world.state.bodies)
        if (body.name == name) return body.particles.bytes_per_particle();
      return -1;
    };
    EXPECT_EQ(bytes("rubber"), core_bytes);
    EXPECT_EQ(bytes("sand"), core_bytes + width);
    EXPECT_EQ(bytes("snow"), core_bytes + width);
    EXPECT_EQ(bytes("bread"), core_bytes + width);
    EXPECT_EQ(bytes("water"), core_bytes - width * (Dim * Dim - 1));
  }
}

template <int Dim>
Real value_of(const std::vector<HistoryValue>& row, const std::string& name) {
  for (const HistoryValue& v : row)
    if (v.name == name) return v.value;
  ADD_FAILURE() << "no column " << name;
  return 0;
}

// Momentum stays, energy goes where it is counted, particles keep their columns when they change ranks.
TYPED_TEST(MaterialBodies, RunTogether) {
  constexpr int Dim = TypeParam::value;
  test::SceneWorld<Dim> world(scene_text<Dim>());
  State<Dim>& state = world.state;
  ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
  integrator.initialise(state);
  const auto before = history_row(state, world.scene.effects);
  for (int step = 0; step < 60; ++step) {
    state.dt = integrator.stable_step(state);
    integrator.step(state);
  }
  const auto after = history_row(state, world.scene.effects);
  const Real kinetic = value_of<Dim>(before, "kinetic_energy"), work = value_of<Dim>(after, "plastic_work");
  const Real residual = value_of<Dim>(after, "energy_residual");
  const Real momentum = std::sqrt(2 * kinetic * value_of<Dim>(before, "mass"));
  if (test::rank() == 0)
    std::printf(
        "%dD: t = %.4g s, kinetic energy %.6g -> %.6g J, elastic %.6g J, plastic work %.8g J, residual %.3g "
        "J\n",
        Dim, state.time, kinetic, value_of<Dim>(after, "kinetic_energy"),
        value_of<Dim>(after, "elastic_energy"), work, residual);
  EXPECT_EQ(value_of<Dim>(before, "plastic_work"), 0);
  EXPECT_GT(work, 1e-3 * kinetic);
  EXPECT_LT(work, kinetic);
  EXPECT_LT(residual, 0.01 * kinetic);  // below 0: what APIC and the viscosity dissipate
  EXPECT_NEAR(value_of<Dim>(after, "momentum_x"), value_of<Dim>(before, "momentum_x"), 1e-10 * momentum);
  EXPECT_NEAR(value_of<Dim>(after, "momentum_y"), 0, 1e-10 * momentum);
  GlobalIndex wrong = 0;
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    const FieldSet& f = state.bodies[b].particles;
    const std::size_t own = state.material_of(b).own_columns().size();
    for (std::size_t k = 0; k < own; ++k)
      for (Index p = 0; p < f.size(); ++p)
        wrong += !(std::abs(f.template data<Real>(core::count + static_cast<int>(k))[p]) < 2);
  }
  EXPECT_EQ(state.communicator().sum(wrong), 0);
}

// The phase field weakens a plastic body whose law splits its energy, and the returns go on.
TYPED_TEST(MaterialBodies, BreakAndFlowTogether) {
  constexpr int Dim = TypeParam::value;
  const std::string rules[] = {
      "model = \"nacc\"\nfriction_angle = \"45 deg\"\ncohesion = 2\ninitial_plastic_volume = 0.95\n",
      "model = \"von_mises\"\nyield_stress = 5e3\nhardening_modulus = 1e4\n"};
  for (const std::string& rule : rules) {
    std::string text = scene_text<Dim>();
    const std::size_t table = text.find("[material.bread]"), end = text.find("[material.rubber]");
    text.replace(table, end - table,
                 "[material.bread]\nmodel = \"split_neo_hookean\"\ndensity = 1000\nyoungs_modulus = "
                 "1e5\npoisson_ratio = 0.3\n"
                 "fracture_toughness = 20\n[material.bread.plasticity]\n" +
                     rule);
    test::SceneWorld<Dim> world(text + "[effect.phase_field]\nmobility = 1e3\n");
    State<Dim>& state = world.state;
    ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
    integrator.initialise(state);
    for (int step = 0; step < 60; ++step) {
      state.dt = integrator.stable_step(state);
      state.observed = true;
      integrator.step(state);
    }
    const auto row = history_row(state, world.scene.effects);
    const Real phase = value_of<Dim>(row, "min_phase"), work = value_of<Dim>(row, "plastic_work");
    if (test::rank() == 0)
      std::printf("%dD: least c %.6f, fracture energy %.6g J, plastic work %.6g J\n", Dim, phase,
                  value_of<Dim>(row, "fracture_energy"), work);
    EXPECT_LT(phase, 0.9);
    EXPECT_GE(phase, 0);
    EXPECT_GT(work, 0);
  }
}

// Sum over the particles of each body's own columns, weighed by their identities.
template <int Dim>
std::vector<Real> fingerprint(const State<Dim>& state) {
  std::vector<Real> sums;
  for (std::size_t b = 0; b < state.bodies.size(); ++b) {
    const Body<Dim>& body = state.bodies[b];
    Real sum = 0;
    if (!state.material_of(b).own_columns().empty())
      for (Index p = 0; p < body.particles.size(); ++p)
        if (!body.is_padding(p))
          sum += body.particles.template data<Real>(core::count)[p] *
                 (1 + static_cast<Real>(body.particles.template data<GlobalIndex>(core::id)[p] % 97));
    sums.push_back(state.communicator().sum(sum));
  }
  return sums;
}

// Frames hold bodies with and without F side by side; a restart goes on with every column and with the plastic work.
TEST(MaterialBodiesOutput, FramesHistoryAndCheckpointHoldTheirColumns) {
  test::SharedTemporaryFolder folder;
  std::string text = scene_text<2>(
      "[output]\nfields = [\"jacobian\", \"von_mises\", \"deformation_gradient\", \"volume_change\", "
      "\"lost_volume_strain\"]\n");
  text.replace(text.find("end = 0.1"), 9,
               "end = 1\ndt = 5e-4");  // the same steps, whatever is written in between
  const auto run = [&](const std::string& name, int steps, const std::filesystem::path& from) {
    Parameters parameters = Parameters::read_text(text, "scene.toml");
    read_dimension(parameters);
    RunOptions options;
    options.output = folder / name;
    options.steps = steps;
    if (!from.empty()) options.restart = from;
    auto made = std::make_unique<mpm::Run<2>>(Communicator::world(), read_scene<2>(parameters), options);
    made->prepare();
    EXPECT_EQ(made->run(), ExitCode::done);
    return made;
  };
  const auto whole = run("whole", 120, {});
  run("first", 60, {});
  std::filesystem::path checkpoint;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "first"))
    if (entry.path().filename().string().starts_with("checkpoint_")) checkpoint = entry.path();
  ASSERT_FALSE(checkpoint.empty());
  const auto again = run("second", 60, checkpoint);
  EXPECT_EQ(again->state().step, whole->state().step);
  const std::vector<Real> one = fingerprint(whole->state()), two = fingerprint(again->state());
  for (std::size_t b = 0; b < one.size(); ++b) {
    EXPECT_NEAR(two[b], one[b], 1e-9 * std::abs(one[b])) << whole->state().bodies[b].name;
    EXPECT_EQ(one[b] != 0, !whole->state().material_of(b).own_columns().empty());
  }
  const Communicator& c = whole->state().communicator();
  const Real work = c.sum(whole->state().ledger["plastic_work"]),
             resumed = c.sum(again->state().ledger["plastic_work"]);
  EXPECT_GT(work, 0);
  EXPECT_NEAR(resumed, work, 1e-12 * work);
  std::ifstream file(folder / "whole" / "history.csv");
  std::string header;
  std::getline(file, header);
  EXPECT_NE(header.find("plastic_work [J]"), std::string::npos) << header;
}

}  // namespace
