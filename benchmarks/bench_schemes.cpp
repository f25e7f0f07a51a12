// What each kernel, scheme and form of the forces, and each material and plasticity rule costs: whole steps, in turns with
// those of the quadratic kernel, APIC, MLS and neo-Hookean.
#include "elastic_block.hpp"
#include "harness.hpp"
#include "material_keys.hpp"

namespace {

using namespace mpm;

constexpr int steps = 30, rounds = 7;

template <int Dim>
void bench_whole_step(benchmark::State& bench, const Communicator& communicator, const BlockCase& c) {
  BlockCase usual_case = c;
  usual_case.transfer = {};
  usual_case.material.clear();
  ElasticBlock<Dim> block(communicator, c), usual(communicator, usual_case);
  const auto there_and_back = [](ElasticBlock<Dim>& b) {
    return [&b] {
      b.steps(steps);
      b.reverse();
    };
  };
  for (auto unused : bench) {
    (void)unused;
    const auto times = time_in_turns(communicator, rounds, {there_and_back(block), there_and_back(usual)});
    const double per_core = static_cast<double>(block.particles()) / communicator.size();
    bench.SetIterationTime(median(times[0]) / steps);
    bench.counters["particles"] = static_cast<double>(block.particles());
    bench.counters["ranks"] = communicator.size();
    bench.counters["production"] = per_core * steps / median(times[0]);
    bench.counters["usual"] = per_core * steps / median(times[1]);
    bench.counters["ratio"] = median_ratio(times, 1, 0);
    bench.counters["bytes_per_particle"] = block.bytes_per_particle();
  }
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  for (const BlockSize& size : block_sizes(options)) {
    if (!options.large && !options.small &&
        std::string_view(size.name).find("512k") != std::string_view::npos)
      continue;
    for (const bool single : {false, true})
      for (const KernelKind kernel : {KernelKind::linear, KernelKind::quadratic, KernelKind::cubic})
        for (const Forces forces : {Forces::mls, Forces::classical})
          for (const Scheme scheme :
               {Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic, Scheme::polypic}) {
            BlockCase c{.single = single, .cells = size.cells};
            c.transfer = {.kernel = kernel, .scheme = scheme, .forces = forces};
            // Forces of the linear kernel have no bound next to a node, and the stiff block would not stay together.
            c.slack = kernel == KernelKind::linear;
            if (!why_undefined(c.transfer).empty()) continue;
            add_case(fmt::format("{}/{}/{}/{}/{}", c.transfer.kernel_name(), c.transfer.scheme_name(),
                                 c.transfer.forces_name(), single ? "single" : "double", size.name),
                     [&communicator, c, size](benchmark::State& bench) {
                       with_dimension(size.dimension,
                                      [&](auto dim) { bench_whole_step<dim>(bench, communicator, c); });
                     });
          }
    for (const bool single : {false, true})
      for (const auto& [name, keys] : material_keys()) {
        BlockCase c{.single = single, .cells = size.cells};
        c.material = keys;
        add_case(fmt::format("material/{}/{}/{}", name, single ? "single" : "double", size.name),
                 [&communicator, c, size](benchmark::State& bench) {
                   with_dimension(size.dimension,
                                  [&](auto dim) { bench_whole_step<dim>(bench, communicator, c); });
                 });
      }
  }
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
