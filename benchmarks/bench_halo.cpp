// The halo's sum and fill against the same exchange written plainly, and their share of the step.
#include <numeric>

#include "elastic_block.hpp"
#include "harness.hpp"
#include "plain_halo.hpp"

namespace {

using namespace mpm;

constexpr int exchanges = 20, steps = 10, rounds = 9;

// Both exchanges must leave the same numbers on every node that the program uses: bit by bit, because both add the
// neighbours' values in the order of their ranks.
template <class T, int Dim>
void require_same(State<Dim>& state, PlainHalo<Dim>& plain) {
  const std::size_t count = state.fields.nodes() * node_values;
  T* values = state.fields.template data<T>(state.nodes);
  std::vector<T> start(count), sent;
  for (std::size_t i = 0; i < count; ++i) start[i] = static_cast<T>(1 + (i * 2654435761u) % 1000) / 3;
  std::copy(start.begin(), start.end(), values);
  state.halo().sum(state.fields, {state.nodes});
  state.halo().fill(state.fields, {state.nodes});
  sent.assign(values, values + count);
  std::copy(start.begin(), start.end(), values);
  plain.sum(values, node_values, Dim + 1);
  plain.fill(values, node_values, Dim + 1);
  debug_check(std::equal(sent.begin(), sent.end(), values), "the plain exchange differs from the halo");
}

template <class T, int Dim>
void bench_halo(benchmark::State& bench, const Communicator& communicator, int cells) {
  BlockCase c;
  c.single = sizeof(T) == 4;
  c.cells = cells;
  ElasticBlock<Dim> block(communicator, c), moving(communicator, c);
  State<Dim>& state = block.state();
  PlainHalo<Dim> plain(state);
  require_same<T>(state, plain);
  T* values = state.fields.template data<T>(state.nodes);
  state.fields.zero(state.nodes);  // sums of sums stay zero
  const std::vector<FieldId> which = {state.nodes};
  const GlobalIndex messages = state.halo().messages(), bytes = state.halo().bytes(),
                    plain_messages = plain.messages(), plain_bytes = plain.bytes();
  std::vector<std::vector<double>> times;
  for (auto unused : bench) {
    (void)unused;
    times = time_in_turns(communicator, rounds,
                          {[&] {
                             for (int i = 0; i < exchanges; ++i) {
                               state.halo().sum(state.fields, which);
                               state.halo().fill(state.fields, which);
                             }
                           },
                           [&] {
                             for (int i = 0; i < exchanges; ++i) {
                               plain.sum(values, node_values, Dim + 1);
                               plain.fill(values, node_values, Dim + 1);
                             }
                           },
                           [&] {
                             moving.steps(steps);
                             moving.reverse();
                           }});
    bench.SetIterationTime(median(times[0]) / exchanges);
  }
  const double exchanged = static_cast<double>((times[0].size() + 1) * exchanges);
  const double seconds = median(times[0]) / exchanges, plain_seconds = median(times[1]) / exchanges;
  const double sent = static_cast<double>(state.halo().bytes() - bytes) / exchanged;
  debug_check(plain.bytes() - plain_bytes == state.halo().bytes() - bytes,
              "the plain exchange sends other bytes");
  bench.counters["particles"] = static_cast<double>(block.particles());
  bench.counters["ranks"] = communicator.size();
  bench.counters["neighbours"] =
      static_cast<double>(communicator.max(GlobalIndex{state.halo().neighbours()}));
  bench.counters["bytes_per_step"] = communicator.sum(sent);
  bench.counters["messages_per_step"] =
      static_cast<double>(communicator.sum(state.halo().messages() - messages)) / exchanged;
  bench.counters["plain_messages_per_step"] =
      static_cast<double>(communicator.sum(plain.messages() - plain_messages)) / exchanged;
  bench.counters["halo_microseconds"] = 1e6 * seconds;
  bench.counters["plain_microseconds"] = 1e6 * plain_seconds;
  bench.counters["ratio"] = median_ratio(times, 1, 0);
  // Of the rank that sends most.
  bench.counters["gb_per_s"] = 1e-9 * communicator.max(sent) / seconds;
  bench.counters["step_microseconds"] = 1e6 * median(times[2]) / steps;
  bench.counters["share_of_step"] = median_ratio(times, 0, 2) * steps / exchanges;
  // What the step really waits for, after the part that the interior hides; waiting for slower ranks counts too.
  Timers& timers = moving.state().timers;
  const double waited =
      timers.seconds()[timers.stage("halo sum")] + timers.seconds()[timers.stage("halo fill")];
  bench.counters["waited_share"] =
      communicator.sum(waited) /
      communicator.sum(std::accumulate(timers.seconds().begin(), timers.seconds().end(), 0.0));
}

template <class T>
void add_cases(const Communicator& communicator, const std::string& precision, const BenchOptions& options) {
  std::vector<BlockSize> sizes = block_sizes(options);
  if (options.large) sizes.push_back({"4M", 80, 3});
  for (const BlockSize& size : sizes)
    add_case(fmt::format("halo/{}/{}", precision, size.name), [&communicator, size](benchmark::State& bench) {
      with_dimension(size.dimension, [&](auto dim) { bench_halo<T, dim>(bench, communicator, size.cells); });
    });
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  add_cases<double>(communicator, "double", options);
  add_cases<float>(communicator, "single", options);
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
