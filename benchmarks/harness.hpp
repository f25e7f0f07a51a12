// What every benchmark program shares: its main, its options, and cases that all ranks run together.
#pragma once

#include <benchmark/benchmark.h>

#include <functional>
#include <string>
#include <vector>

#include "machine.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct BenchOptions {
  bool large = false;     // --large: also the cases that need minutes or gigabytes
  bool small = false;     // --small: only cases of few particles, with one round each, to see that the program works
  std::string directory;  // --directory=DIR: where files are written; empty: the working directory
};

// A case runs once on all ranks, repeats what it measures itself, and reports through counters and SetIterationTime.
void add_case(const std::string& name, std::function<void(benchmark::State&)> run);

// Times `variants` in turns, because other work on the machine comes and goes: one round to warm up, then `rounds`
// that count (one with --small). Returns seconds[variant][round] of the slowest rank. Collective.
std::vector<std::vector<double>> time_in_turns(const Communicator& communicator, int rounds,
                                               const std::vector<std::function<void()>>& variants);

// Median over the rounds of times[over][r] / times[under][r].
double median_ratio(const std::vector<std::vector<double>>& times, std::size_t over, std::size_t under);

// The body of main(): MPI, PETSc, options (--large, --small, --cpu_time, --directory=DIR, and Google Benchmark's), the case
// "machine" with its roofline, and those that `register_cases` adds. Only rank 0 prints.
int run_benchmarks(int argc, char** argv,
                   const std::function<void(const Communicator&, const BenchOptions&)>& register_cases);

}  // namespace mpm
