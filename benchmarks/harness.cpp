#include "harness.hpp"

#include <mpi.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/memory.hpp"
#include "mpm_hpc/solvers/petsc_session.hpp"
#include "roofline.hpp"

namespace mpm {

namespace {

int most_rounds = std::numeric_limits<int>::max();

void bench_machine(benchmark::State& bench, const Communicator& communicator) {
  for (auto unused : bench) {
    (void)unused;
    const MachineLimits& limits = machine_limits(communicator);
    bench.counters["fma_gflops"] = limits.fma_double;
    bench.counters["fma_single_gflops"] = limits.fma_single;
    bench.counters["triad_gb_per_s"] = limits.triad;
    bench.counters["ranks"] = communicator.size();
    bench.SetIterationTime(1);
  }
}

// For the ranks that don't speak.
class SilentReporter final : public benchmark::BenchmarkReporter {
 public:
  bool ReportContext(const Context&) override { return true; }
  void ReportRuns(const std::vector<Run>&) override {}
};

int run(int argc, char** argv,
        const std::function<void(const Communicator&, const BenchOptions&)>& register_cases) {
  const Communicator communicator = Communicator::world();
  // Takes the options of its own out; the rest is Google Benchmark's.
  BenchOptions options;
  constexpr std::string_view directory = "--directory=";
  int kept = 0;
  for (int i = 0; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument == "--large") {
      options.large = true;
    } else if (argument == "--small") {
      options.small = true;
      most_rounds = 1;
      triad_length = std::size_t{1} << 20;
    } else if (argument == "--cpu_time") {
      clock_of_benchmarks = CLOCK_PROCESS_CPUTIME_ID;
    } else if (argument.substr(0, directory.size()) == directory) {
      options.directory = argument.substr(directory.size());
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
  add_case("machine", [&communicator](benchmark::State& bench) { bench_machine(bench, communicator); });
  register_cases(communicator, options);
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

void add_case(const std::string& name, std::function<void(benchmark::State&)> run) {
  benchmark::RegisterBenchmark(name.c_str(), std::move(run))
      ->Iterations(1)  // the same on all ranks
      ->UseManualTime()
      ->Unit(benchmark::kMillisecond);
}

std::vector<std::vector<double>> time_in_turns(const Communicator& communicator, int rounds,
                                               const std::vector<std::function<void()>>& variants) {
  rounds = std::min(rounds, most_rounds);
  std::vector<std::vector<double>> times(variants.size());
  for (int round = 0; round <= rounds; ++round)
    for (std::size_t i = 0; i < variants.size(); ++i) {
      communicator.barrier();
      const double seconds = communicator.max(seconds_of(variants[i]));
      if (round > 0) times[i].push_back(seconds);
    }
  return times;
}

double median_ratio(const std::vector<std::vector<double>>& times, std::size_t over, std::size_t under) {
  std::vector<double> ratios;
  for (std::size_t round = 0; round < times[over].size(); ++round)
    ratios.push_back(times[over][round] / times[under][round]);
  return median(std::move(ratios));
}

int run_benchmarks(int argc, char** argv,
                   const std::function<void(const Communicator&, const BenchOptions&)>& register_cases) {
  return_freed_memory();
  MPI_Init(&argc, &argv);
  int code = 1;
  try {
    code = run(argc, argv, register_cases);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", argv[0], error.what());
    MPI_Abort(MPI_COMM_WORLD, 1);
  }
  MPI_Finalize();
  return code;
}

}  // namespace mpm
