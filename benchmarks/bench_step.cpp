// The step: particle-steps per second and core against the plain reference step, and bytes per particle.
#include <benchmark/benchmark.h>
#include <mpi.h>

#include <cstdio>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "machine.hpp"
#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/scene/scene.hpp"
#include "mpm_hpc/simulation/diagnostics.hpp"
#include "mpm_hpc/simulation/report.hpp"
#include "mpm_hpc/simulation/setup.hpp"
#include "mpm_hpc/solvers/petsc_session.hpp"
#include "mpm_hpc/time/explicit_integrator.hpp"
#include "reference_step.hpp"

namespace {

using namespace mpm;

enum class Phase { none, mobility, rate_independent };

struct Case {
  bool single = false;
  PlainLaw law = PlainLaw::neo_hookean;
  Phase phase = Phase::none;
  int cells = 20;  // per direction
};

const char* name_of(PlainLaw law) {
  switch (law) {
    case PlainLaw::neo_hookean: return "neo_hookean";
    case PlainLaw::split_neo_hookean: return "split_neo_hookean";
    case PlainLaw::fixed_corotated: return "fixed_corotated";
  }
  return "";
}

// An elastic block in free flight that stretches a little. One cell of drift takes about 15 steps.
constexpr Real spacing = 0.01, density = 1000, youngs_modulus = 1e6, poisson_ratio = 0.3;
constexpr Real stretching = 0.02;  // peak speed of the deformation over the wave speed
constexpr Real flight = 0.2;       // speed of the flight over the wave speed
constexpr Real cfl = 0.4;
constexpr int free_cells = 8;  // around the block
template <int Dim>
constexpr int particles_per_cell = Dim == 3 ? 8 : 4;
constexpr int production_steps = 30, reference_steps = 1, rounds = 7;

struct Elasticity {
  Real mu = youngs_modulus / (2 * (1 + poisson_ratio));
  Real lambda = youngs_modulus * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  Real wave_speed = std::sqrt((lambda + 2 * mu) / density);
};

// The same number in all directions, or the first ones of a list.
template <int Dim>
std::string in_each_direction(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{}, {}]", x, y) : fmt::format("[{}, {}, {}]", x, y, z);
}
template <int Dim>
std::string in_each_direction(Real x) {
  return in_each_direction<Dim>(x, x, x);
}

template <int Dim>
std::string scene_text(const Case& c) {
  const Real wave = Elasticity().wave_speed, speed = flight * wave;
  const Real lower = free_cells * spacing, upper = lower + c.cells * spacing, end = upper + free_cells * spacing;
  std::string text = fmt::format(
      "dimension = {}\nprecision = \"{}\"\n"
      "[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {}\n[time]\nend = 1\n"
      "[material.block]\nmodel = \"{}\"\ndensity = {}\nyoungs_modulus = {}\npoisson_ratio = {}\n",
      Dim, c.single ? "single" : "double", in_each_direction<Dim>(0), in_each_direction<Dim>(end), spacing,
      name_of(c.law), density, youngs_modulus, poisson_ratio);
  // Tough enough that the phase stays near 1.
  if (c.phase != Phase::none) text += fmt::format("fracture_toughness = {}\n", 0.1 * youngs_modulus * spacing);
  text += fmt::format(
      "[[body]]\nname = \"block\"\nmaterial = \"block\"\nparticles_per_cell = {}\njitter = 0.25\n"
      "velocity = {}\n[body.shape]\ntype = \"box\"\nlower = {}\nupper = {}\n",
      particles_per_cell<Dim>, in_each_direction<Dim>(speed, 0.7 * speed, 0.4 * speed), in_each_direction<Dim>(lower),
      in_each_direction<Dim>(upper));
  if (c.phase != Phase::none) text += "[effect.phase_field]\n";
  if (c.phase == Phase::mobility)
    text += fmt::format("mobility = {}\n", 1e-3 * (1 + flight) * wave / (cfl * spacing));
  return text;
}

// The program's own step on a state made from a scene.
template <int Dim>
class Production {
 public:
  Production(const Communicator& communicator, const Case& c) {
    Parameters parameters = Parameters::read_text(scene_text<Dim>(c), "bench_step", {});
    read_dimension(parameters);
    scene_ = read_scene<Dim>(parameters);
    declare_state(communicator, scene_, state_);
    StepHooks<Dim> hooks;
    for (auto& effect : scene_.effects) effect->join(hooks);
    StepSizeOptions options;
    options.cfl = cfl;
    integrator_ = std::make_unique<ExplicitIntegrator<Dim>>(state_, std::move(hooks), options);
    create_particles(scene_, state_);
    with_precision(state_.precision, [&](auto zero) { this->template stretch<decltype(zero)>(c.cells); });
    integrator_->initialise(state_);
    particles_ = count_particles(state_);
  }

  void steps(int count) {
    for (int i = 0; i < count; ++i) {
      state_.dt = integrator_->stable_step(state_);
      state_.observed = i == count - 1;
      integrator_->step(state_);
    }
  }

  // Sends the block back where it came from, so that it stays in its small domain.
  void reverse() {
    with_precision(state_.precision, [&](auto zero) {
      using T = decltype(zero);
      const FieldSet& f = state_.bodies[0].particles;
      for (const FieldId field : {core::velocity, core::velocity_gradient})
        for (int c = 0; c < f.traits(field).components; ++c)
          for (Index p = 0; p < f.size(); ++p) f.template data<T>(field, c)[p] = -f.template data<T>(field, c)[p];
    });
  }

  std::vector<ReferenceParticle<Dim>> reference_particles() const {
    return with_precision(state_.precision, [&](auto zero) { return this->template copy_particles<decltype(zero)>(); });
  }
  // A box of the production grid around this rank's particles, with room for their flight.
  GridGeometry<Dim> reference_geometry(const std::vector<ReferenceParticle<Dim>>& particles) const {
    Vec<Dim> lower = state_.geometry().upper(), upper = state_.geometry().lower();
    for (const ReferenceParticle<Dim>& p : particles) {
      lower = lower.cwiseMin(p.x);
      upper = upper.cwiseMax(p.x);
    }
    return {lower, upper, spacing};
  }

  State<Dim>& state() { return state_; }
  GlobalIndex particles() const { return particles_; }
  Real bytes_per_particle() const {
    return state_.communicator().sum(static_cast<Real>(memory_use(state_, scene_.effects).total())) /
           static_cast<Real>(particles_);
  }
  // Solves and iterations since the start.
  SolverWork solver_work() const {
    SolverWork sum;
    for (const auto& [name, work] : state_.solvers) {
      sum.solves += work.solves;
      sum.iterations += work.iterations;
    }
    return sum;
  }

 private:
  // A velocity that grows linearly from the middle: alternately longer and thinner, shorter and thicker.
  template <class T>
  void stretch(int cells) {
    const FieldSet& f = state_.bodies[0].particles;
    const Real rate = stretching * Elasticity().wave_speed / (cells * spacing / 2),
               middle = (free_cells + cells / 2.0) * spacing;
    const Mat<Dim> gradient = rate * Eigen::Vector3d(1, -0.4, 0.3).template head<Dim>().asDiagonal().toDenseMatrix();
    for (int a = 0; a < Dim; ++a)
      for (Index p = 0; p < f.size(); ++p) {
        f.template data<T>(core::velocity, a)[p] +=
            static_cast<T>(gradient(a, a) * (f.template data<Real>(core::position, a)[p] - middle));
        f.template data<T>(core::velocity_gradient, (Dim + 1) * a)[p] = static_cast<T>(gradient(a, a));
      }
  }

  template <class T>
  std::vector<ReferenceParticle<Dim>> copy_particles() const {
    std::vector<ReferenceParticle<Dim>> particles;
    const Body<Dim>& body = state_.bodies[0];
    const FieldSet& f = body.particles;
    for (Index p = 0; p < f.size(); ++p) {
      if (body.is_padding(p)) continue;
      ReferenceParticle<Dim>& r = particles.emplace_back();
      for (int a = 0; a < Dim; ++a) {
        r.x[a] = f.template data<Real>(core::position, a)[p];
        r.v[a] = f.template data<T>(core::velocity, a)[p];
        for (int b = 0; b < Dim; ++b) {
          r.C(a, b) = f.template data<T>(core::velocity_gradient, Dim * a + b)[p];
          r.F(a, b) = f.template data<T>(core::deformation_gradient, Dim * a + b)[p];
        }
      }
      r.mass = f.template data<T>(core::mass)[p];
      r.volume = f.template data<T>(core::volume)[p];
    }
    return particles;
  }

  Scene<Dim> scene_;
  State<Dim> state_;
  std::unique_ptr<ExplicitIntegrator<Dim>> integrator_;
  GlobalIndex particles_ = 0;
};

// Seconds per step of one short period and the way back; the slowest rank counts.
template <class Simulation, class Steps>
double seconds_per_step(const Communicator& communicator, Simulation& simulation, int count, Steps&& steps) {
  communicator.barrier();
  const double seconds = seconds_of([&] { steps(count); });
  simulation.reverse();
  return communicator.max(seconds) / count;
}

template <int Dim>
void bench_step(benchmark::State& bench, const Communicator& communicator, const Case& c) {
  Production<Dim> production(communicator, c);
  std::unique_ptr<Production<Dim>> elastic;
  if (c.phase != Phase::none) {
    Case plain = c;
    plain.phase = Phase::none;
    elastic = std::make_unique<Production<Dim>>(communicator, plain);
  }
  std::vector<ReferenceParticle<Dim>> particles = production.reference_particles();
  const GridGeometry<Dim> reference_geometry = production.reference_geometry(particles);
  const Elasticity elasticity;
  ReferenceSimulation<QuadraticKernel, Dim> reference(reference_geometry, std::move(particles),
                                                    {elasticity.mu, elasticity.lambda, c.law});
  const Real reference_dt = cfl * spacing / ((1 + flight + stretching) * elasticity.wave_speed);

  std::vector<double> production_times, reference_times, elastic_times, ratios, elastic_ratios;
  SolverWork before;
  for (auto unused : bench) {
    (void)unused;
    // The blocks alternate, because other work on the machine comes and goes; the first round warms up.
    for (int round = 0; round <= rounds; ++round) {
      if (round == 1) before = production.solver_work();
      const double mine = seconds_per_step(communicator, production, production_steps,
                                           [&](int count) { production.steps(count); });
      const double theirs = seconds_per_step(communicator, reference, reference_steps, [&](int count) {
        for (int i = 0; i < count; ++i) reference.step(reference_dt);
      });
      const double without = elastic ? seconds_per_step(communicator, *elastic, production_steps,
                                                        [&](int count) { elastic->steps(count); })
                                     : 0;
      if (round == 0) continue;
      production_times.push_back(mine);
      reference_times.push_back(theirs);
      ratios.push_back(theirs / mine);
      if (elastic) elastic_times.push_back(without), elastic_ratios.push_back(mine / without);
    }
    bench.SetIterationTime(median(production_times));
  }
  const double per_core = static_cast<double>(production.particles()) / communicator.size();
  bench.counters["particles"] = static_cast<double>(production.particles());
  bench.counters["ranks"] = communicator.size();
  bench.counters["production"] = per_core / median(production_times);
  bench.counters["reference"] = per_core / median(reference_times);
  bench.counters["ratio"] = median(ratios);
  bench.counters["bytes_per_particle"] = production.bytes_per_particle();
  bench.counters["steps_per_sort"] =
      static_cast<double>(production.state().step) / (production.state().distribution.sorts() - 1);
  if (elastic) {
    const SolverWork work = production.solver_work();
    bench.counters["elastic"] = per_core / median(elastic_times);
    bench.counters["step_ratio_to_elastic"] = median(elastic_ratios);
    bench.counters["iterations_per_solve"] =
        static_cast<double>(work.iterations - before.iterations) / static_cast<double>(work.solves - before.solves);
  }
}

void bench_machine(benchmark::State& bench, const Communicator& communicator) {
  for (auto unused : bench) {
    (void)unused;
    communicator.barrier();
    const double arithmetic = communicator.sum(fma_gflops()) / communicator.size();
    communicator.barrier();
    const double memory = communicator.sum(triad_gb_per_s()) / communicator.size();
    bench.counters["fma_gflops"] = arithmetic;
    bench.counters["triad_gb_per_s"] = memory;
    bench.counters["ranks"] = communicator.size();
    bench.SetIterationTime(1);
  }
}

void register_benchmarks(const Communicator& communicator, bool large) {
  auto add = [](const std::string& name, auto&& function) {
    benchmark::RegisterBenchmark(name.c_str(), function)
        ->Iterations(1)  // the same on all ranks; repeats are inside
        ->UseManualTime()
        ->Unit(benchmark::kMillisecond);
  };
  add("machine", [&communicator](benchmark::State& bench) { bench_machine(bench, communicator); });
  struct Size {
    const char* name;
    int cells, dimension;
  };
  std::vector<Size> sizes = {{"64k", 20, 3}, {"512k", 40, 3}, {"2d_512k", 360, 2}};
  if (large) sizes.push_back({"4M", 80, 3});
  for (const Size& size : sizes)
    for (const bool single : {false, true})
      for (const PlainLaw law : {PlainLaw::neo_hookean, PlainLaw::fixed_corotated, PlainLaw::split_neo_hookean})
        for (const Phase phase : {Phase::none, Phase::mobility, Phase::rate_independent}) {
          if (phase != Phase::none && law != PlainLaw::split_neo_hookean) continue;
          const Case c{single, law, phase, size.cells};
          add(fmt::format("step/{}/{}/{}/{}", single ? "single" : "double",
                          name_of(law),
                          phase == Phase::none       ? "elastic"
                          : phase == Phase::mobility ? "phase_mobility"
                                                     : "phase_rate_independent",
                          size.name),
              [&communicator, c, size](benchmark::State& bench) {
                if (size.dimension == 2) {
                  bench_step<2>(bench, communicator, c);
                } else {
                  bench_step<3>(bench, communicator, c);
                }
              });
        }
}

// For the ranks that don't speak.
class SilentReporter final : public benchmark::BenchmarkReporter {
 public:
  bool ReportContext(const Context&) override { return true; }
  void ReportRuns(const std::vector<Run>&) override {}
};

int run(int argc, char** argv) {
  const Communicator communicator = Communicator::world();
  // Takes its own options out; the rest is Google Benchmark's.
  bool large = false;
  int kept = 0;
  for (int i = 0; i < argc; ++i) {
    if (std::strcmp(argv[i], "--large") == 0) {
      large = true;
    } else if (std::strcmp(argv[i], "--cpu_time") == 0) {
      clock_of_benchmarks = CLOCK_PROCESS_CPUTIME_ID;
    } else {
      argv[kept++] = argv[i];
    }
  }
  argc = kept;
  argv[argc] = nullptr;
  benchmark::Initialize(&argc, argv);
  if (argc > 1) {
    if (communicator.root()) benchmark::ReportUnrecognizedArguments(argc, argv);
    return static_cast<int>(ExitCode::user_error);
  }
  const PetscSession petsc;
  register_benchmarks(communicator, large);
  if (communicator.root()) {
    benchmark::RunSpecifiedBenchmarks();
  } else {
    SilentReporter silent;
    benchmark::RunSpecifiedBenchmarks(&silent);
  }
  benchmark::Shutdown();
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  MPI_Init(&argc, &argv);
  int code = 1;
  try {
    code = run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_step: %s\n", error.what());
    MPI_Abort(MPI_COMM_WORLD, 1);
  }
  MPI_Finalize();
  return code;
}
