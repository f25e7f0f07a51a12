// What a run takes memory for: the account against the heap, the share of each rank, and the peaks of all that happens
// between steps.
#include <gtest/gtest.h>

#include "mpm_hpc/io/checkpoint.hpp"
#include "mpm_hpc/simulation/diagnostics.hpp"
#include "mpm_hpc/simulation/report.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/heap_counter.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"

namespace mpm::test {
namespace {

constexpr int cells = 24;  // per direction and rank: 110592 particles per rank

// Two blocks side by side, together `cells` x ranks long, in free flight.
std::string block_scene(bool fracture) {
  const int length = cells * size() / 2;
  std::string text = fmt::format(
      "dimension = 3\n[domain]\nlower = [0, 0, 0]\nupper = [{}, {}, {}]\n[grid]\nspacing = 1\n[time]\nend = "
      "1\n"
      "[material.m]\nmodel = \"{}\"\ndensity = 1\nyoungs_modulus = 1\npoisson_ratio = 0.3\n{}",
      2 * length + 8, cells + 8, cells + 8, fracture ? "split_neo_hookean" : "neo_hookean",
      fracture ? "fracture_toughness = 1\n" : "");
  for (const int number : {0, 1})
    text += fmt::format(
        "[[body]]\nname = \"block {0}\"\nmaterial = \"m\"\nvelocity = [0.1, 0.1, 0]\n[body.shape]\ntype = "
        "\"box\"\n"
        "lower = [{1}, 4, 4]\nupper = [{2}, {3}, {3}]\n",
        number, 4 + number * length, 4 + (number + 1) * length, cells + 4);
  return text + (fracture ? "[effect.phase_field]\n" : "");
}

// Live bytes of this process's heap over those at the start, and the largest since then.
class Heap {
 public:
  Heap() : start_(HeapCounter::live()) { HeapCounter::restart_peak(); }
  double live() const { return static_cast<double>(HeapCounter::live()) - static_cast<double>(start_); }
  double peak() const { return static_cast<double>(HeapCounter::peak()) - static_cast<double>(start_); }

 private:
  std::size_t start_;
};

template <int Dim>
class MovingWorld : public SceneWorld<Dim> {
 public:
  explicit MovingWorld(const std::string& text)
      : SceneWorld<Dim>(text), integrator_(this->state, std::move(this->hooks), {}) {
    integrator_.initialise(this->state);
  }
  void steps(int count) {
    for (int i = 0; i < count; ++i) {
      this->state.dt = integrator_.stable_step(this->state);
      integrator_.step(this->state);
    }
  }
  double account() const {
    return static_cast<double>(total_bytes(memory_account(this->state, this->scene.effects)));
  }

 private:
  ExplicitIntegrator<Dim> integrator_;
};

class Memory : public ::testing::TestWithParam<bool> {
 protected:
  void SetUp() override {
    if (!HeapCounter::works) GTEST_SKIP() << "the address sanitizer has its own heap";
    // What MPI, PETSc and METIS keep after their first use is theirs.
    MovingWorld<3>(block_scene(GetParam())).steps(1);
  }
  Communicator world_ = Communicator::world();
};

TEST_P(Memory, AccountIsTheHeap) {
  const Heap heap;
  MovingWorld<3> world(block_scene(GetParam()));
  world.steps(1);
  EXPECT_NEAR(world.account() / heap.live(), 1, 0.02);
}

// The columns by walking them, and the particles' share of a rank by formula: each rank holds at most 1 / N of them, but
// for the imbalance allowed, padding to whole packs and what a buffer takes more than it is asked for.
TEST_P(Memory, FallsWithTheNumberOfRanks) {
  MovingWorld<3> world(block_scene(GetParam()));
  const State<3>& state = world.state;
  std::map<std::string, std::size_t> account;
  for (const auto& [holder, bytes] : memory_account(state, world.scene.effects)) account[holder] = bytes;
  const double all = 8.0 * cells * cells * cells * size();
  double columns = 0, per_particle = 0;
  for (const Body<3>& body : state.bodies)
    for (FieldId f = 0; f < body.particles.count(); ++f) {
      const FieldTraits& traits = body.particles.traits(f);
      const double width = bytes_of(traits.type) * traits.components,
                   bytes = static_cast<double>(account.at("particles/" + body.name + "/" + traits.name));
      EXPECT_GE(bytes, width * body.particles.size()) << traits.name;
      columns += bytes;
      if (&body == &state.bodies[0]) per_particle += width;
    }
  const double share = per_particle * all / size();
  EXPECT_LE(columns, 1.25 * share);
  EXPECT_GE(world_.sum(columns), per_particle * all);
  // Nodes: those of the blocks at hand, and there are not many more of them than if the blocks had no neighbours' nodes.
  double node = 0;
  for (FieldId f = 0; f < state.fields.count(); ++f) node += 8.0 * state.fields.traits(f).components;
  const double nodes = 64.0 * state.topology().size();
  EXPECT_LE(nodes, 3.0 * (cells + 8) * (cells + 8) * (cells + 8));
  for (FieldId f = 0; f < state.fields.count(); ++f) {
    const double bytes = static_cast<double>(account.at("grid/" + state.fields.traits(f).name));
    EXPECT_GE(bytes, 8.0 * state.fields.traits(f).components * nodes);
    EXPECT_LE(bytes, 1.25 * 8.0 * state.fields.traits(f).components * nodes + 3e5);
  }
}

// No phase takes more than 1.3 times what the arrays take between steps.
TEST_P(Memory, NoPhasePeaks) {
  constexpr double most = 1.3;
  const SharedTemporaryFolder folder;
  const Heap heap;
  std::unique_ptr<MovingWorld<3>> world;
  double steady = 0;
  std::map<std::string, double> peaks;
  const auto watch = [&](const char* phase, auto&& action) {
    HeapCounter::restart_peak();
    action();
    peaks[phase] = heap.peak();
    steady = std::max(steady, heap.live());
  };
  watch("start", [&] { world = std::make_unique<MovingWorld<3>>(block_scene(GetParam())); });
  State<3>& state = world->state;
  watch("steps", [&] { world->steps(2); });
  watch("sort", [&] { sort_particles(state, OrderWithinCell::canonical); });
  watch("all particles to other ranks", [&] {
    std::vector<std::int32_t> owners = state.distribution.decomposition().owners();
    for (std::int32_t& owner : owners) owner = (owner + 1) % size();
    state.distribution.decomposition().set_owners(owners);
    sort_particles(state, OrderWithinCell::stable);
  });
  watch("steps after that", [&] { world->steps(1); });
  watch("frame",
        [&] { FrameWriter<3>(world_, folder.path(), {}).write(0, 0, state.bodies, derived_fields(state)); });
  std::filesystem::path file;
  watch("checkpoint",
        [&] { file = write_checkpoint(world_, folder.path(), {}, state.bodies, state.precision); });
  for (Body<3>& body : state.bodies) {
    Body<3> empty(body.name, body.material, state.precision);
    for (FieldId f = core::count; f < body.particles.count(); ++f)
      empty.particles.add(body.particles.traits(f));
    body = std::move(empty);
  }
  watch("restart", [&] {
    read_checkpoint(world_, file, state.bodies, state.precision);
    sort_particles(state, OrderWithinCell::canonical);
  });
  for (const auto& [phase, peak] : peaks) EXPECT_LE(peak / steady, most) << phase;
  EXPECT_LE(heap.live() / steady, 1.01);
}

INSTANTIATE_TEST_SUITE_P(Scenes, Memory, ::testing::Bool(),
                         [](const auto& scene) { return scene.param ? "PhaseField" : "Elastic"; });

}  // namespace
}  // namespace mpm::test
