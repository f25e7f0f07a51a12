// The phase field's part of the step, stage by stage, against the elastic step and a plain solve with PETSc.
#include "elastic_block.hpp"
#include "mpm_hpc/effects/material_columns.hpp"
#include "harness.hpp"
#include "reference_phase.hpp"
#include "stage_shares.hpp"

namespace {

using namespace mpm;

constexpr int production_steps = 10;

// The block's particles with what the phase field keeps on them.
template <int Dim>
ReferencePhaseParticles<Dim> phase_particles(const State<Dim>& state) {
  ReferencePhaseParticles<Dim> what;
  what.particles = reference_particles(state);
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for_particles(state, [&what](const FieldSet& f, Index p) {
      what.phase.push_back(f.template data<T>(f.find("phase"))[p]);
      const FieldId energy = f.find("phase_history");
      what.least_energy.push_back(energy == no_field ? 0 : f.template data<T>(energy)[p]);
    });
  });
  return what;
}

// The energy that drives the cracks, of all particles: what a phase field must find out before anything else.
template <int Dim>
void find_driving_energy(const State<Dim>& state) {
  with_precision(state.precision, [&state](auto zero) {
    using T = decltype(zero);
    const FieldSet& f = state.bodies[0].particles;
    const MaterialColumns<Dim, T> columns = material_columns<T>(state, 0);
    alignas(64) T energy[chunk_particles];
    for (Index begin = 0; begin < f.size(); begin += chunk_particles) {
      state.material_of(0).energy_plus(columns, begin, std::min<Index>(begin + chunk_particles, f.size()), energy);
      asm volatile("" : : "r"(energy) : "memory");
    }
  });
}

// The largest difference of the last step's result on this rank's nodes from the plain one.
template <int Dim>
Real difference_from(const ReferencePhase<QuadraticKernel, Dim>& reference, const State<Dim>& state) {
  FieldId result = 0;
  while (state.fields.traits(result).name != "phase_result") ++result;
  return with_precision(state.precision, [&](auto zero) {
    Real most = 0;
    const auto* value = state.fields.template data<decltype(zero)>(result);
    for (Slot s = 0; s < state.topology().owned(); ++s)
      for (int n = 0; n < nodes_per_block<Dim>; ++n, ++value)
        most = std::max(most, std::abs(*value - reference.result(state.topology().first_node(s) +
                                                                 node_in_block<Dim>(n))));
    return most;
  });
}

template <int Dim>
void bench_phase_field(benchmark::State& bench, const Communicator& communicator, const BlockCase& c,
                       int rounds) {
  ElasticBlock<Dim> production(communicator, c);
  BlockCase plain = c;
  plain.phase = Phase::none;
  plain.damage = Damage::intact;
  ElasticBlock<Dim> elastic(communicator, plain);
  State<Dim>& state = production.state();

  // The plain solve of a step in the middle of the way, whose result the program's own must agree with.
  production.steps(production_steps);
  sort_particles(state, OrderWithinCell::stable);
  const Elasticity elasticity;
  ReferencePhase<QuadraticKernel, Dim> reference(communicator, state.geometry(), phase_particles(state),
                                                 {elasticity.mu, elasticity.lambda, c.law},
                                                 phase_law(c.phase, c.at_rest));
  production.steps(1);
  const Real dt = state.dt;
  int reference_iterations = reference.solve(dt);
  const Real difference = communicator.max(difference_from(reference, state));
  if (!c.at_rest) production.reverse();

  StageShares shares;
  const auto steps = [&c](ElasticBlock<Dim>& block) {
    block.steps(production_steps);
    if (!c.at_rest) block.reverse();
  };
  const std::vector<std::function<void()>> variants = {
      [&] { shares.measure(state.timers, [&] { steps(production); }); },
      [&] { reference_iterations = reference.solve(dt); }, [&] { steps(elastic); },
      [&] { find_driving_energy(state); }};
  for (auto unused : bench) {
    (void)unused;
    const SolverWork before = production.solver_work();
    const auto times = time_in_turns(communicator, rounds, variants);
    const SolverWork work = production.solver_work();

    const double per_core = static_cast<double>(production.particles()) / communicator.size();
    const auto share = [&](const std::vector<std::string>& stages) {
      return shares.of(communicator, stages);
    };
    const double step_ratio = median_ratio(times, 0, 2), phase_share = share({"effects"});
    bench.SetIterationTime(median(times[0]) / production_steps);
    bench.counters["particles"] = static_cast<double>(production.particles());
    bench.counters["ranks"] = communicator.size();
    bench.counters["production"] = per_core * production_steps / median(times[0]);
    bench.counters["step_ratio_to_elastic"] = step_ratio;
    bench.counters["phase_share"] = phase_share;
    bench.counters["solve_share"] = share({"phase sweep", "phase solve"});
    bench.counters["linear_share"] = share({"phase solve"});
    // In elastic steps.
    bench.counters["driving_energy"] = production_steps * median_ratio(times, 3, 2);
    for (const std::string stage : {"sweep", "assembly", "Krylov", "products", "gather"})
      bench.counters[stage] = step_ratio * share({"phase " + stage});
    bench.counters["iterations_per_solve"] = static_cast<double>(work.iterations - before.iterations) /
                                             static_cast<double>(work.solves - before.solves);
    bench.counters["reference"] = per_core / median(times[1]);
    bench.counters["reference_iterations"] = reference_iterations;
    bench.counters["ratio"] = median_ratio(times, 1, 0) * production_steps / phase_share;
    bench.counters["difference"] = difference;
  }
}

constexpr struct {
  const char* name;
  Damage damage;
  bool at_rest;
} states[] = {{"intact", Damage::intact, false},
              {"cracked", Damage::cracked, true},
              {"cracked_flying", Damage::cracked, false},
              {"half_broken", Damage::half_broken, false}};

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  for (const BlockSize& size : block_sizes(options))
    for (const bool single : {false, true})
      for (const Phase phase : {Phase::mobility, Phase::rate_independent})
        for (const char* form : {"matrix_free", "stencil", "assembled"})
          for (const auto& [state, damage, at_rest] : states) {
            // The plain solve of many particles takes long: there only what the program chooses itself.
            const bool many = size.cells > (size.dimension == 3 ? 20 : 128);
            const bool chosen = std::string_view(form) == "stencil";
            if (!options.large && (single || (many && !chosen))) continue;
            BlockCase c{single, PlainLaw::split_neo_hookean, phase, size.cells, form, damage};
            c.at_rest = at_rest;
            add_case(
                fmt::format("{}/{}/{}/{}/{}", name_of(phase), form, state,
                            single ? "single" : "double", size.name),
                [&communicator, c, size, many, chosen](benchmark::State& bench) {
                  with_dimension(size.dimension, [&](auto dim) {
                    bench_phase_field<dim>(bench, communicator, c, many ? 2 : chosen ? 5 : 3);
                  });
                });
          }
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
