// The step: particle-steps per second and core against the plain reference step, and bytes per particle.
#include "elastic_block.hpp"
#include "harness.hpp"

namespace {

using namespace mpm;

constexpr int production_steps = 30, reference_steps = 1, rounds = 7;

template <int Dim>
void bench_step(benchmark::State& bench, const Communicator& communicator, const BlockCase& c) {
  ElasticBlock<Dim> production(communicator, c);
  std::unique_ptr<ElasticBlock<Dim>> elastic;
  if (c.phase != Phase::none) {
    BlockCase plain = c;
    plain.phase = Phase::none;
    elastic = std::make_unique<ElasticBlock<Dim>>(communicator, plain);
  }
  std::vector<ReferenceParticle<Dim>> particles = reference_particles(production.state());
  const GridGeometry<Dim> geometry = reference_geometry(production.state(), particles);
  const Elasticity elasticity;
  ReferenceSimulation<QuadraticKernel, Dim> reference(geometry, std::move(particles),
                                                    {elasticity.mu, elasticity.lambda, c.law});
  const Real reference_dt = cfl * spacing / ((1 + flight + stretching) * elasticity.wave_speed);

  // Each variant goes a short way and back.
  std::vector<std::function<void()>> variants = {
      [&] {
        production.steps(production_steps);
        production.reverse();
      },
      [&] {
        for (int i = 0; i < reference_steps; ++i) reference.step(reference_dt);
        reference.reverse();
      }};
  if (elastic)
    variants.push_back([&] {
      elastic->steps(production_steps);
      elastic->reverse();
    });
  std::vector<std::vector<double>> times;
  SolverWork before;
  for (auto unused : bench) {
    (void)unused;
    variants.front()();
    before = production.solver_work();
    times = time_in_turns(communicator, rounds, variants);
    bench.SetIterationTime(median(times[0]) / production_steps);
  }
  const double per_core = static_cast<double>(production.particles()) / communicator.size();
  bench.counters["particles"] = static_cast<double>(production.particles());
  bench.counters["ranks"] = communicator.size();
  bench.counters["production"] = per_core * production_steps / median(times[0]);
  bench.counters["reference"] = per_core * reference_steps / median(times[1]);
  bench.counters["ratio"] = median_ratio(times, 1, 0) * production_steps / reference_steps;
  bench.counters["bytes_per_particle"] = production.bytes_per_particle();
  bench.counters["steps_per_sort"] =
      static_cast<double>(production.state().step) / (production.state().distribution.sorts() - 1);
  if (elastic) {
    const SolverWork work = production.solver_work();
    bench.counters["elastic"] = per_core * production_steps / median(times[2]);
    bench.counters["step_ratio_to_elastic"] = median_ratio(times, 0, 2);
    bench.counters["iterations_per_solve"] =
        static_cast<double>(work.iterations - before.iterations) / static_cast<double>(work.solves - before.solves);
  }
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  std::vector<BlockSize> sizes = block_sizes(options);
  std::erase_if(sizes, [](const BlockSize& size) { return std::string_view(size.name) == "2d_64k"; });
  if (options.large) sizes.push_back({"4M", 80, 3});
  for (const BlockSize& size : sizes)
    for (const bool single : {false, true})
      for (const PlainLaw law : {PlainLaw::neo_hookean, PlainLaw::fixed_corotated, PlainLaw::split_neo_hookean})
        for (const Phase phase : {Phase::none, Phase::mobility, Phase::rate_independent}) {
          if (phase != Phase::none && law != PlainLaw::split_neo_hookean) continue;
          const BlockCase c{single, law, phase, size.cells};
          add_case(fmt::format("step/{}/{}/{}/{}", single ? "single" : "double", name_of(law), name_of(phase),
                               size.name),
                   [&communicator, c, size](benchmark::State& bench) {
                     with_dimension(size.dimension, [&](auto dim) { bench_step<dim>(bench, communicator, c); });
                   });
        }
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
