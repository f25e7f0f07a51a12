// Messages and bytes of a step against what follows from the owners of space and the places of the particles alone, and
// against what MPI was really given to send.
#include <gtest/gtest.h>
#include <mpi.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "mpm_hpc/simulation/run.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/all_ranks.hpp"
#include "support/mpi_test.hpp"
#include "support/scene_world.hpp"
#include "support/typed_cases.hpp"

namespace {

struct Sent {
  int to, tag;
  std::int64_t bytes;
};
std::vector<Sent> sent_messages;
bool recording = false;

}  // namespace

// Takes the place of MPI's own function in this program, as MPI provides for.
extern "C" int MPI_Isend(const void* data, int count, MPI_Datatype type, int to, int tag, MPI_Comm comm,
                         MPI_Request* request) {
  if (recording && comm == MPI_COMM_WORLD) {
    int size = 0;
    MPI_Type_size(type, &size);
    sent_messages.push_back({to, tag, std::int64_t{count} * size});
  }
  return PMPI_Isend(data, count, type, to, tag, comm, request);
}

using namespace mpm;

namespace {

constexpr int sum_tag = 1, fill_tag = 2;  // of the halo's messages

template <int Dim>
std::string list(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
}

// Two boxes, at rest or on the way to each other.
template <int Dim>
std::string scene_text(bool single, Real speed, const std::string& effect = "", const std::string& partitioner = "auto") {
  auto box = [&](const char* name, Real x0, Real y0, Real x1, Real y1, Real v) {
    return fmt::format(
        "[[body]]\nname = \"{}\"\nmaterial = \"glass\"\nvelocity = {}\nangular_velocity = {}\n"
        "shape = {{type = \"box\", lower = {}, upper = {}}}\n",
        name, list<Dim>(v, v / 2, 0), Dim == 2 ? fmt::format("{}", v) : fmt::format("[0, 0, {}]", v),
        list<Dim>(x0, y0, 0.3), list<Dim>(x1, y1, 1.2));
  };
  return fmt::format("dimension = {}\nprecision = \"{}\"\n", Dim, single ? "single" : "double") +
         "[domain]\nlower = " + list<Dim>(0, 0, 0) + "\nupper = " + list<Dim>(6, 3, 2) +
         "\n[grid]\nspacing = 0.1\n[time]\nend = 2\n[output]\nframes = false\ncheckpoint = false\n[parallel]\npartitioner = \"" + partitioner + "\"\n"
         "[material.glass]\nmodel = \"split_neo_hookean\"\nyoungs_modulus = 1e4\npoisson_ratio = 0.3\n"
         "density = 1000\n" + (effect.empty() ? "" : "fracture_toughness = 100\n") +
         box("left", 0.5, 0.5, 2.1, 1.6, speed) + box("right", 3.4, 0.8, 4.7, 1.7, -speed) + effect;
}

template <int Dim>
std::vector<Vec<Dim>> places_of_all(test::SceneWorld<Dim>& world) {
  std::vector<Vec<Dim>> mine;
  world.for_particles([&](Body<Dim>& body, Index p) {
    mine.emplace_back();
    for (int a = 0; a < Dim; ++a) mine.back()[a] = body.particles.template data<Real>(core::position, a)[p];
  });
  return test::gather_all(mine);
}

// Nodes of the blocks' common grid, counted from the first node of a block, that the quadratic spline of a particle of
// that block can touch: the spline is positive less than 1.5 h from its particle; particles lie 0.5 h to 4.5 h behind the
// block's first node when they are sorted in, and may then drift by less than h. In halves of h.
std::vector<int> touched_positions() {
  constexpr int first = 1, last = 9, drift = 2, radius = 3;
  std::vector<int> nodes;
  for (int node = -20; node <= 20; ++node)
    if (2 * node > first - drift - radius && 2 * node < last + drift + radius) nodes.push_back(node);
  return nodes;
}

// ghosts[r][o]: nodes owned by rank o that particles of rank r can touch.
using GhostCounts = std::vector<std::vector<std::int64_t>>;

template <int Dim>
GhostCounts count_ghosts(State<Dim>& state, const std::vector<Vec<Dim>>& places) {
  const GridGeometry<Dim>& grid = state.geometry();
  std::set<std::array<int, Dim>> blocks;
  for (const Vec<Dim>& x : places) {
    std::array<int, Dim> block;
    for (int a = 0; a < Dim; ++a)
      block[a] = static_cast<int>(std::floor(((x[a] - grid.origin()[a]) / grid.spacing() - 0.5) / 4));
    blocks.insert(block);
  }
  auto owner = [&](const std::array<int, Dim>& block) {
    IntVec<Dim> b;
    for (int a = 0; a < Dim; ++a) b[a] = block[a];
    return state.distribution.decomposition().owner(b);
  };
  const std::vector<int> touched = touched_positions();
  std::vector<std::set<std::array<int, Dim>>> nodes(test::size());
  for (const auto& block : blocks) {
    std::array<std::size_t, Dim> n{};
    for (bool more = true; more;) {
      std::array<int, Dim> node;
      for (int a = 0; a < Dim; ++a) node[a] = 4 * block[a] + touched[n[a]];
      nodes[owner(block)].insert(node);
      int a = 0;
      while (a < Dim && ++n[a] == touched.size()) n[a++] = 0;
      more = a < Dim;
    }
  }
  GhostCounts ghosts(test::size(), std::vector<std::int64_t>(test::size(), 0));
  for (int rank = 0; rank < test::size(); ++rank)
    for (std::array<int, Dim> node : nodes[rank]) {
      for (int& c : node) c = c >> 2;
      ++ghosts[rank][owner(node)];
    }
  for (int rank = 0; rank < test::size(); ++rank) ghosts[rank][rank] = 0;
  return ghosts;
}

// What a rank sends in sums and fills of so many values per node each.
struct Expected {
  std::map<std::tuple<int, int, std::int64_t>, int> messages;  // (to, tag, bytes) -> how many
  std::int64_t count = 0, bytes = 0;

  void add(int to, int tag, std::int64_t size, int times) {
    if (size == 0 || times == 0) return;
    messages[{to, tag, size}] += times;
    count += times;
    bytes += times * size;
  }
  void sum(const GhostCounts& ghosts, int rank, int width, int times = 1) {
    for (int to = 0; to < test::size(); ++to) add(to, sum_tag, ghosts[rank][to] * width, times);
  }
  void fill(const GhostCounts& ghosts, int rank, int width, int times = 1) {
    for (int to = 0; to < test::size(); ++to) add(to, fill_tag, ghosts[to][rank] * width, times);
  }
};

void expect_sent(const Expected& expected, GlobalIndex messages, GlobalIndex bytes) {
  EXPECT_EQ(messages, expected.count);
  EXPECT_EQ(bytes, expected.bytes);
  std::map<std::tuple<int, int, std::int64_t>, int> real;
  for (const Sent& s : sent_messages)
    if (s.tag == sum_tag || s.tag == fill_tag) ++real[{s.to, s.tag, s.bytes}];
  EXPECT_EQ(real, expected.messages) << "what MPI sent differs";
}

template <class C>
class Traffic : public testing::Test {
 public:
  static constexpr int bytes = sizeof(typename C::T);
  static constexpr bool single = std::is_same_v<typename C::T, float>;
};
TYPED_TEST_SUITE(Traffic, test::EveryCase);

TYPED_TEST(Traffic, OfAnElasticStepFollowsFromThePartition) {
  constexpr int Dim = TypeParam::Dim;
  for (const std::string partitioner : {"auto", "curve"}) {
    test::SceneWorld<Dim> world(scene_text<Dim>(TestFixture::single, 2.5, "", partitioner));
    State<Dim>& state = world.state;
    ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
    integrator.initialise(state);
    std::vector<Vec<Dim>> places = places_of_all(world);
    GhostCounts ghosts = count_ghosts(state, places);
    const int first_sorts = state.distribution.sorts();
    std::int64_t all_bytes = 0, all_messages = 0;
    for (int step = 0; step < 60; ++step) {
      places = places_of_all(world);
      const int sorts = state.distribution.sorts();
      const GlobalIndex messages = state.halo().messages(), bytes = state.halo().bytes();
      state.dt = integrator.stable_step(state);
      sent_messages.clear();
      recording = true;
      integrator.step(state);
      recording = false;
      if (state.distribution.sorts() != sorts) ghosts = count_ghosts(state, places);
      Expected expected;
      expected.sum(ghosts, test::rank(), (Dim + 1) * TestFixture::bytes);
      expected.fill(ghosts, test::rank(), (Dim + 1) * TestFixture::bytes);
      expect_sent(expected, state.halo().messages() - messages, state.halo().bytes() - bytes);
      all_bytes = expected.bytes;
      all_messages = expected.count;
      if (!test::all_ranks_ok(!this->HasFailure())) break;
    }
    const Communicator& c = state.communicator();
    EXPECT_GE(state.distribution.sorts() - first_sorts, 3) << "the boxes must cross cells";
    const GlobalIndex migrated = c.sum(state.distribution.migrated());
    all_bytes = c.sum(all_bytes);
    all_messages = c.sum(all_messages);
    if (test::rank() == 0)
      std::printf("%dD on %d ranks, %s: %lld messages, %lld bytes in the last of 60 steps, %d sorts\n", Dim,
                  test::size(), partitioner.c_str(), static_cast<long long>(all_messages),
                  static_cast<long long>(all_bytes), state.distribution.sorts() - first_sorts);
    if (test::size() > 1) {
      EXPECT_GT(migrated, 0);
    }
    EXPECT_EQ(all_bytes > 0, test::size() > 1);
    EXPECT_EQ(state.distribution.decomposition().on_curve(), partitioner == "curve");
  }
}

// A CG solve applies the operator once for its first residual and once per iteration; each time the argument is filled and
// the product summed. With a mobility, two sums and the diagonal join the halo sum; without, it is one sum and the
// diagonal, and two sums follow where a solve has nothing to start from, after a sort. One result joins the fill.
TYPED_TEST(Traffic, OfAPhaseFieldStepFollowsFromThePartition) {
  constexpr int Dim = TypeParam::Dim;
  for (const bool mobility : {true, false}) {
    const std::string effect = std::string("[effect.phase_field]\nactive_tolerance = 0\n") + (mobility ? "mobility = 0.1\n" : "") +
                               (TestFixture::single ? "tolerance = 1e-5\n" : "");
    test::SceneWorld<Dim> world(scene_text<Dim>(TestFixture::single, 2, effect));
    State<Dim>& state = world.state;
    ExplicitIntegrator<Dim> integrator(state, std::move(world.hooks), {});
    integrator.initialise(state);
    std::vector<Vec<Dim>> places = places_of_all(world);
    GhostCounts ghosts = count_ghosts(state, places);
    GlobalIndex iterations_in_all = 0;
    int sorts_in_all = 0;
    state.observed = false;
    for (int step = 0; step < 25; ++step) {
      places = places_of_all(world);
      const int sorts = state.distribution.sorts();
      const GlobalIndex messages = state.halo().messages(), bytes = state.halo().bytes();
      const GlobalIndex iterations_before = state.solvers["phase_field"].iterations;
      state.dt = integrator.stable_step(state);
      sent_messages.clear();
      recording = true;
      integrator.step(state);
      recording = false;
      const bool sorted = state.distribution.sorts() != sorts;
      if (sorted) ghosts = count_ghosts(state, places);
      const int iterations = static_cast<int>(state.solvers["phase_field"].iterations - iterations_before);
      Expected expected;
      expected.sum(ghosts, test::rank(), (Dim + 1 + (mobility ? 3 : 2)) * TestFixture::bytes);
      if (!mobility && (sorted || step == 0)) expected.sum(ghosts, test::rank(), 2 * TestFixture::bytes);
      expected.fill(ghosts, test::rank(), TestFixture::bytes, iterations + 1);
      expected.sum(ghosts, test::rank(), TestFixture::bytes, iterations + 1);
      expected.fill(ghosts, test::rank(), (Dim + 1 + 1) * TestFixture::bytes);
      expect_sent(expected, state.halo().messages() - messages, state.halo().bytes() - bytes);
      iterations_in_all += iterations;
      sorts_in_all += sorted;
      if (!test::all_ranks_ok(!this->HasFailure())) break;
    }
    EXPECT_GT(iterations_in_all, 0);
    EXPECT_GT(sorts_in_all, 0);
    if (test::rank() == 0)
      std::printf("%dD, %s: %d iterations and %d sorts in 25 steps\n", Dim,
                  mobility ? "with a mobility" : "rate-independent", static_cast<int>(iterations_in_all), sorts_in_all);
  }
}

// run.json tells what the steps sent, neither set-up nor output.
TYPED_TEST(Traffic, OfARunIsThatOfItsSteps) {
  constexpr int Dim = TypeParam::Dim;
  const std::string text = scene_text<Dim>(TestFixture::single, 0);
  test::SceneWorld<Dim> world(text);
  const GhostCounts ghosts = count_ghosts(world.state, places_of_all(world));
  Expected expected;
  for (int rank = 0; rank < test::size(); ++rank) {
    expected.sum(ghosts, rank, (Dim + 1) * TestFixture::bytes);
    expected.fill(ghosts, rank, (Dim + 1) * TestFixture::bytes);
  }
  test::SharedTemporaryFolder folder;
  Parameters parameters = Parameters::read_text(text, "scene.toml");
  read_dimension(parameters);
  RunOptions options;
  options.output = folder / "run";
  options.steps = 4;
  mpm::Run<Dim> run(Communicator::world(), read_scene<Dim>(parameters), options);
  run.prepare();
  EXPECT_EQ(run.run(), ExitCode::done);
  std::ifstream file(*options.output / "run.json");
  const nlohmann::json json = nlohmann::json::parse(file);
  for (const char* key : {"messages_per_step", "halo_messages_per_step"})
    EXPECT_EQ(json[key], static_cast<Real>(expected.count)) << key;
  for (const char* key : {"bytes_per_step", "halo_bytes_per_step"})
    EXPECT_EQ(json[key], static_cast<Real>(expected.bytes)) << key;
  if (test::rank() == 0)
    std::printf("%dD: run.json has %.17g bytes per step, expected %lld\n", Dim,
                json["bytes_per_step"].get<Real>(), static_cast<long long>(expected.bytes));
}

}  // namespace
