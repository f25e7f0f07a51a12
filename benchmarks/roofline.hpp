// How fast this machine could run a kernel at most: the slower of moving its bytes and doing its operations.
#pragma once

#include <benchmark/benchmark.h>

#include <algorithm>
#include <initializer_list>
#include <vector>

#include "harness.hpp"
#include "mpm_hpc/effects/state.hpp"

namespace mpm {

// Per core with all ranks busy, the mean over the ranks.
struct MachineLimits {
  double triad = 0;                       // [GB/s]
  double fma_double = 0, fma_single = 0;  // [Gflop/s]
};

// Measured by the first call. Collective.
inline const MachineLimits& machine_limits(const Communicator& communicator) {
  static const MachineLimits limits = [&communicator] {
    const auto mean = [&communicator](auto measure) {
      communicator.barrier();
      return communicator.sum(measure()) / communicator.size();
    };
    return MachineLimits{mean(triad_gb_per_s), mean(fma_gflops<double>), mean(fma_gflops<float>)};
  }();
  return limits;
}

// What a kernel has to do for each particle at least. Bytes: each column that it reads or writes once over the bus, in
// each direction, and the nodes of the active blocks shared out over the particles; what stays in L1 is free.
struct Work {
  double bytes = 0, flops = 0;
};

inline double column_bytes(const FieldSet& fields, std::initializer_list<FieldId> columns) {
  double bytes = 0;
  for (const FieldId f : columns) bytes += fields.traits(f).components * bytes_of(fields.traits(f).type);
  return bytes;
}
// A grid field of `components` numbers per node that is passed over `passes` times.
template <class T, int Dim>
double node_bytes(const State<Dim>& state, int components, int passes) {
  Real particles = 0;
  for (const Body<Dim>& body : state.bodies) particles += body.real_particles();
  return static_cast<double>(sizeof(T)) * components * passes * state.topology().size() *
         nodes_per_block<Dim> / particles;
}

// The counters of a kernel; times[0] is production's, which goes over the particles `repeats` times per call, times[1] the
// plain reference's, which does so once. Collective.
inline void report_kernel(benchmark::State& bench, const Communicator& communicator,
                          const std::vector<std::vector<double>>& times, int repeats,
                          double particles_per_core, Precision precision, const Work& work) {
  const MachineLimits& machine = machine_limits(communicator);
  const double seconds = median(times[0]) / repeats / particles_per_core;  // of one particle
  const double in_memory = work.bytes / (1e9 * machine.triad),
               in_registers =
                   work.flops / (1e9 * (precision == Precision::double_precision ? machine.fma_double
                                                                                 : machine.fma_single));
  bench.SetIterationTime(median(times[0]) / repeats);
  bench.counters["particles"] = particles_per_core * communicator.size();
  bench.counters["ranks"] = communicator.size();
  bench.counters["production"] = 1 / seconds;
  bench.counters["reference"] = particles_per_core / median(times[1]);
  bench.counters["ratio"] = repeats * median_ratio(times, 1, 0);
  bench.counters["ns_per_particle"] = 1e9 * seconds;
  bench.counters["bytes_moved"] = work.bytes;
  bench.counters["flops"] = work.flops;
  bench.counters["memory_ns"] = 1e9 * in_memory;
  bench.counters["arithmetic_ns"] = 1e9 * in_registers;
  bench.counters["roofline_fraction"] = std::max(in_memory, in_registers) / seconds;
}

}  // namespace mpm
