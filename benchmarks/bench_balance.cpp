// A body that flies through a long domain, out of the half of space that each rank owned at the start: the program's own
// step with re-balancing, by each partitioner, against the step without.
#include <algorithm>
#include <numeric>

#include "elastic_block.hpp"
#include "harness.hpp"

namespace {

using namespace mpm;

constexpr int rounds = 12;
constexpr Real speed = 0.5;  // over the wave speed

// A bar of 2 n x n (x n) cells that flies by its own length.
template <int Dim>
std::string flight_text(int n, Real threshold, const std::string& partitioner) {
  const Real start = free_cells * spacing, width = start + n * spacing, front = start + 2 * n * spacing,
             end = front + (2 * n + free_cells) * spacing, side = width + free_cells * spacing;
  return fmt::format(
      "dimension = {}\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {}\n[time]\nend = 1\n"
      "[parallel]\nrebalance_threshold = {}\npartitioner = \"{}\"\n"
      "[material.block]\nmodel = \"neo_hookean\"\ndensity = {}\nyoungs_modulus = {}\npoisson_ratio = {}\n"
      "[[body]]\nname = \"bar\"\nmaterial = \"block\"\nparticles_per_cell = {}\njitter = 0.25\nvelocity = "
      "{}\n"
      "[body.shape]\ntype = \"box\"\nlower = {}\nupper = {}\n",
      Dim, in_each_direction<Dim>(0), in_each_direction<Dim>(end, side, side), spacing, threshold,
      partitioner, density, youngs_modulus, poisson_ratio, particles_per_cell<Dim>,
      in_each_direction<Dim>(speed * Elasticity().wave_speed, 0, 0), in_each_direction<Dim>(start),
      in_each_direction<Dim>(front, width, width));
}

// One way to fly, with the imbalance after each redistribution.
template <int Dim>
class Flight {
 public:
  Flight(const Communicator& communicator, const std::string& name, const std::string& text)
      : name(name), block(communicator, text), imbalances_{block.state().distribution.imbalance()} {}

  void steps(int count) {
    const Distribution<Dim>& distribution = block.state().distribution;
    for (int i = 0; i < count; ++i) {
      const int sorts = distribution.sorts();
      block.steps(1);
      if (distribution.sorts() != sorts) imbalances_.push_back(distribution.imbalance());
    }
  }

  void report(benchmark::State& bench, double seconds, int steps_timed) {
    const Distribution<Dim>& distribution = block.state().distribution;
    const double particles = static_cast<double>(block.particles());
    bench.counters[name + "_rate"] = particles * steps_timed / seconds / block.state().communicator().size();
    bench.counters[name + "_imbalance_max"] = *std::max_element(imbalances_.begin(), imbalances_.end());
    bench.counters[name + "_imbalance_mean"] = std::accumulate(imbalances_.begin(), imbalances_.end(), 0.0) /
                                               static_cast<double>(imbalances_.size());
    bench.counters[name + "_rebalances"] = distribution.rebalances();
    bench.counters[name + "_migrated_share"] =
        static_cast<double>(block.state().communicator().sum(distribution.migrated())) / particles;
  }

  std::string name;
  ElasticBlock<Dim> block;

 private:
  std::vector<Real> imbalances_;
};

template <int Dim>
void bench_balance(benchmark::State& bench, const Communicator& communicator, int n) {
  // Stepping with dt = cfl h / (c + v), the whole way takes this many steps.
  const int steps = static_cast<int>(2 * n / (cfl * speed / (1 + speed))) / (rounds + 1);
  Flight<Dim> on(communicator, "on", flight_text<Dim>(n, 1.1, "auto")),
      metis(communicator, "metis", flight_text<Dim>(n, 1.1, "metis")),
      curve(communicator, "curve", flight_text<Dim>(n, 1.1, "curve")),
      off(communicator, "off", flight_text<Dim>(n, 1e9, "auto"));
  std::vector<std::vector<double>> times;
  for (auto unused : bench) {
    (void)unused;
    times = time_in_turns(communicator, rounds,
                          {[&] { on.steps(steps); }, [&] { metis.steps(steps); }, [&] { off.steps(steps); },
                           [&] { curve.steps(steps); }});
    bench.SetIterationTime(median(times[0]) / steps);
  }
  std::vector<double> seconds;
  for (const auto& t : times) seconds.push_back(std::accumulate(t.begin(), t.end(), 0.0));
  on.report(bench, seconds[0], static_cast<int>(times[0].size()) * steps);
  metis.report(bench, seconds[1], static_cast<int>(times[0].size()) * steps);
  off.report(bench, seconds[2], static_cast<int>(times[0].size()) * steps);
  curve.report(bench, seconds[3], static_cast<int>(times[0].size()) * steps);
  bench.counters["particles"] = static_cast<double>(off.block.particles());
  bench.counters["ranks"] = communicator.size();
  bench.counters["ratio"] = seconds[2] / seconds[0];
  bench.counters["metis_ratio"] = seconds[2] / seconds[1];
  bench.counters["curve_ratio"] = seconds[2] / seconds[3];
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  std::vector<int> sizes = {12, 16, 24}, plane_sizes = {64, 160};
  if (options.large) sizes.push_back(40);
  if (options.small) {
    sizes = {6};
    plane_sizes = {16};
  }
  for (const int n : sizes)
    add_case(fmt::format("balance/3d/{}", n),
             [&communicator, n](benchmark::State& bench) { bench_balance<3>(bench, communicator, n); });
  for (const int n : plane_sizes)
    add_case(fmt::format("balance/2d/{}", n),
             [&communicator, n](benchmark::State& bench) { bench_balance<2>(bench, communicator, n); });
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
