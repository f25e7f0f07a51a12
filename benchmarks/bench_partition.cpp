// Partitions of weighted coarse blocks: METIS, bisection and Hilbert's curve as Decomposition uses them against Zoltan's
// recursive coordinate bisection, by cut, neighbours, imbalance, weight that moves with a body, and seconds; and how they grow
// with blocks and parts.
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <numeric>
#include <string>
#include <unordered_set>

#include "harness.hpp"
#include "mpm_hpc/parallel/decomposition.hpp"
#include "zoltan_rcb.hpp"

namespace {

using namespace mpm;

constexpr int Dim = 3;
using Counts = IntVec<Dim>;

// 1..100, the same in every run.
Real random_weight(GlobalIndex block) {
  std::uint64_t h = static_cast<std::uint64_t>(block) * 0x9E3779B97F4A7C15ull;
  h ^= h >> 29;
  h *= 0xBF58476D1CE4E5B9ull;
  return static_cast<Real>((h >> 40) % 100 + 1);
}

BlockWeights full_table(const Counts& counts) {
  BlockWeights weights;
  for (GlobalIndex block = 0; block < counts.cast<GlobalIndex>().prod(); ++block)
    weights.push_back({block, random_weight(block)});
  return weights;
}

// A ball whose density varies from 1 to 100 per block, sampled at 4^3 points of each block [in blocks].
BlockWeights ball(const Counts& counts, const Eigen::Vector3d& middle, Real radius) {
  constexpr int samples = 4;
  BlockWeights weights;
  for (GlobalIndex block = 0; block < counts.cast<GlobalIndex>().prod(); ++block) {
    const Counts c = coarse_coordinates<Dim>(block, counts);
    Real weight = 0;
    for (int s = 0; s < samples * samples * samples; ++s) {
      const Eigen::Vector3d corner(s / samples / samples, s / samples % samples, s % samples);
      const Eigen::Vector3d x = c.cast<Real>() + (corner.array() + 0.5).matrix() / samples - middle;
      if (x.squaredNorm() < radius * radius)
        weight += 50.5 + 49.5 * std::sin(x[0] / 3) * std::sin(x[1] / 4) * std::cos(x[2] / 5);
    }
    if (weight > 0) weights.push_back({block, weight / (samples * samples * samples)});
  }
  return weights;
}

// Faces between blocks of different parts.
GlobalIndex edge_cut(const Counts& counts, const BlockWeights& weights, const std::vector<int>& parts) {
  std::vector<int> part(counts.cast<GlobalIndex>().prod(), -1);
  for (std::size_t i = 0; i < weights.size(); ++i) part[weights[i].first] = parts[i];
  GlobalIndex cut = 0;
  for (const auto& [block, weight] : weights)
    for_face_neighbours<Dim>(block, counts, [&](GlobalIndex other) {
      cut += other > block && part[other] >= 0 && part[other] != part[block];
    });
  return cut;
}

// Parts that a part has blocks beside, corners included: mean over the parts.
Real neighbours(const Counts& counts, const BlockWeights& weights, const std::vector<int>& parts, int count) {
  std::vector<int> part(counts.cast<GlobalIndex>().prod(), -1);
  for (std::size_t i = 0; i < weights.size(); ++i) part[weights[i].first] = parts[i];
  std::unordered_set<GlobalIndex> pairs;
  for (const auto& [block, weight] : weights) {
    const Counts centre = coarse_coordinates<Dim>(block, counts);
    for (int n = 0; n < block_neighbours<Dim>; ++n) {
      Counts c = centre;
      for (int a = 0, rest = n; a < Dim; ++a, rest /= 3) c[a] += rest % 3 - 1;
      if ((c.array() < 0).any() || (c.array() >= counts.array()).any()) continue;
      const int other = part[(GlobalIndex{c[0]} * counts[1] + c[1]) * counts[2] + c[2]];
      if (other >= 0 && other != part[block]) pairs.insert(GlobalIndex{part[block]} * count + other);
    }
  }
  return static_cast<Real>(pairs.size()) / count;
}

// Share of the weight in blocks that the table gives to another rank.
Real moved_share(const BlockWeights& weights, const std::vector<int>& parts,
                 const std::vector<std::int32_t>& owners) {
  Real moved = 0, total = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    total += weights[i].second;
    if (owners[weights[i].first] != parts[i]) moved += weights[i].second;
  }
  return moved / total;
}

// Parts of blocks that are dealt to the ranks in equal runs; on rank 0 in the order of `weights`, elsewhere empty.
std::vector<int> bisect(const Communicator& communicator, ZoltanRcb& zoltan, const Counts& counts,
                        const BlockWeights& weights) {
  const std::size_t begin = weights.size() * communicator.rank() / communicator.size(),
                    end = weights.size() * (communicator.rank() + 1) / communicator.size();
  std::vector<WeightedPoint> points;
  for (std::size_t i = begin; i < end; ++i) {
    const Counts c = coarse_coordinates<Dim>(weights[i].first, counts);
    points.push_back({{c[0] + 0.5, c[1] + 0.5, c[2] + 0.5},
                      static_cast<float>(weights[i].second),
                      static_cast<unsigned>(i)});
  }
  const std::vector<int> mine = zoltan.partition(points);
  Communicator::Bytes bytes(mine.size() * sizeof(int));
  if (!mine.empty()) std::memcpy(bytes.data(), mine.data(), bytes.size());
  std::vector<int> all;
  for (const auto& part : communicator.gather(bytes)) {
    const std::size_t before = all.size();
    all.resize(before + part.size() / sizeof(int));
    if (!part.empty()) std::memcpy(&all[before], part.data(), part.size());
  }
  return all;
}

// The blocks in the order of Hilbert's curve: their numbers in `weights`, and their places and weights.
std::pair<std::vector<std::size_t>, BlockWeights> along_curve(const Counts& counts, const BlockWeights& weights) {
  const int levels = curve_levels<Dim>(counts);
  std::vector<GlobalIndex> places;
  for (const auto& [block, weight] : weights)
    places.push_back(curve_place<Dim>(coarse_coordinates<Dim>(block, counts), levels));
  std::vector<std::size_t> order(weights.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return places[a] < places[b]; });
  BlockWeights sorted;
  for (const std::size_t i : order) sorted.push_back({places[i], weights[i].second});
  return {order, sorted};
}

// Pieces of the curve, all blocks of which rank 0 holds. Collective.
std::vector<int> curve_partition(const Communicator& communicator, const Counts& counts, const BlockWeights& weights,
                                 int parts) {
  const auto [order, sorted] = communicator.root() ? along_curve(counts, weights) : decltype(along_curve(counts, weights)){};
  const CurveCuts cuts = cut_curve(communicator, sorted, parts);
  std::vector<int> result(sorted.size());
  for (std::size_t i = 0; i < sorted.size(); ++i) result[order[i]] = piece_of(cuts, sorted[i].first);
  return result;
}

// A way to divide the blocks; called on all ranks, the parts are on rank 0.
struct Partitioner {
  std::string name;
  std::function<std::vector<int>(const Counts&, const BlockWeights&)> divide;
};

std::vector<Partitioner> partitioners(const Communicator& communicator, int count) {
  auto on_root = [&communicator, count](auto* divide) {
    return [&communicator, count, divide](const Counts& counts, const BlockWeights& weights) {
      return communicator.root() ? divide(counts, weights, count) : std::vector<int>();
    };
  };
  std::vector<Partitioner> list = {{"metis", on_root(graph_partition<Dim>)},
                                   {"bisection", on_root(bisection_partition<Dim>)},
                                   {"curve", [&communicator, count](const Counts& counts, const BlockWeights& weights) {
                                      return curve_partition(communicator, counts, weights, count);
                                    }}};
  if (ZoltanRcb::available())
    for (const bool reuse : {false, true}) {
      const auto zoltan = std::make_shared<ZoltanRcb>(communicator, count, reuse);
      list.push_back({reuse ? "zoltan_reuse" : "zoltan",
                      [&communicator, zoltan](const Counts& counts, const BlockWeights& weights) {
                        return bisect(communicator, *zoltan, counts, weights);
                      }});
    }
  return list;
}

void report(benchmark::State& bench, const std::string& name, const Counts& counts,
            const BlockWeights& weights, const std::vector<int>& parts, int count) {
  bench.counters[name + "_cut"] = static_cast<double>(edge_cut(counts, weights, parts));
  bench.counters[name + "_imbalance"] = max_over_mean(weights, parts, count);
  bench.counters[name + "_neighbours"] = neighbours(counts, weights, parts, count);
}

void bench_table(benchmark::State& bench, const Communicator& communicator, const Counts& counts, int count) {
  const BlockWeights weights = full_table(counts);
  const std::vector<Partitioner> list = partitioners(communicator, count);
  std::vector<std::vector<int>> parts(list.size());
  std::vector<std::function<void()>> variants;
  for (std::size_t i = 0; i < list.size(); ++i)
    variants.push_back([&, i] { parts[i] = list[i].divide(counts, weights); });
  for (auto unused : bench) {
    (void)unused;
    const std::vector<std::vector<double>> times = time_in_turns(communicator, 3, variants);
    for (std::size_t i = 0; i < list.size(); ++i)
      bench.counters[list[i].name + "_seconds"] = median(times[i]);
    bench.SetIterationTime(median(times[0]));
  }
  bench.counters["ranks"] = communicator.size();
  if (!communicator.root()) return;
  bench.counters["blocks"] = static_cast<double>(weights.size());
  for (std::size_t i = 0; i < list.size(); ++i) report(bench, list[i].name, counts, weights, parts[i], count);
}

// A ball that moves by 1.5 blocks along x: each partitioner divides it before and after, and the parts after take the names
// under which least moves (`moved_unnamed`: they keep those of the partitioner). `kept_imbalance`: what the owners of before
// leave.
void bench_moved(benchmark::State& bench, const Communicator& communicator, int radius, int count) {
  const Counts counts(2 * radius + 10, 2 * radius + 4, 2 * radius + 4);
  const Eigen::Vector3d start(radius + 3, radius + 2, radius + 2);
  const BlockWeights before = ball(counts, start, radius),
                     after = ball(counts, start + Eigen::Vector3d(1.5, 0, 0), radius);
  for (auto unused : bench) {
    (void)unused;
    bench.SetIterationTime(1);
    for (const Partitioner& p : partitioners(communicator, count)) {
      const std::vector<int> first = p.divide(counts, before);
      std::vector<int> second;
      bench.counters[p.name + "_seconds"] = seconds_of([&] { second = p.divide(counts, after); });
      if (!communicator.root()) continue;
      const std::vector<std::int32_t> owners = owners_of_all<Dim>(counts, before, first);
      // Pieces of the curve keep their order, and nobody names them.
      const std::vector<int> named = p.name == "curve" ? second : renamed_parts(after, second, owners, count);
      report(bench, p.name, counts, after, named, count);
      bench.counters[p.name + "_moved_unnamed"] = moved_share(after, second, owners);
      bench.counters[p.name + "_moved"] = moved_share(after, named, owners);
      std::vector<int> kept;
      for (const auto& w : after) kept.push_back(owners[w.first]);
      bench.counters[p.name + "_kept_imbalance"] = max_over_mean(after, kept, count);
    }
    bench.counters["blocks"] = static_cast<double>(after.size());
    bench.counters["ranks"] = communicator.size();
  }
}

// A number of /proc/self/status [MB]; 0 where there is none.
double status_megabytes(const std::string& key) {
  std::ifstream file("/proc/self/status");
  for (std::string line; std::getline(file, line);)
    if (line.starts_with(key + ":")) return std::stod(line.substr(key.size() + 1)) / 1024;
  return 0;
}

// What rank 0 does for a domain whose blocks are all occupied, and each rank with the answer (`table_seconds`). Of the curve:
// what the cuts take if one rank holds all blocks, and what a rank needs for its own share of the blocks (`curve_own_seconds`).
void bench_growth(benchmark::State& bench, const Communicator& communicator, int side, int count) {
  const Counts counts = Counts::Constant(side);
  for (auto unused : bench) {
    (void)unused;
    bench.SetIterationTime(1);
    bench.counters["ranks"] = communicator.size();
    const BlockWeights weights = full_table(counts);
    const auto [order, sorted] = communicator.root() ? along_curve(counts, weights) : decltype(along_curve(counts, weights)){};
    const BlockWeights own(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size()) / count);
    CurveCuts cuts;
    bench.counters["curve_seconds"] = seconds_of([&] { cuts = cut_curve(communicator, sorted, count); });
    bench.counters["curve_own_seconds"] = seconds_of([&] {
      const CurveCuts same = cut_curve(communicator, own, count);
      max_over_mean(communicator, own, cuts);
      max_over_mean(communicator, own, same);
    });
    if (!communicator.root()) continue;
    std::vector<int> parts(weights.size());
    for (std::size_t i = 0; i < sorted.size(); ++i) parts[order[i]] = piece_of(cuts, sorted[i].first);
    report(bench, "curve", counts, weights, parts, count);
    using Divide = std::vector<int> (*)(const Counts&, const BlockWeights&, int);
    const std::pair<std::string, Divide> ways[] = {{"bisection", bisection_partition<Dim>},
                                                   {"metis", graph_partition<Dim>}};
    for (const auto& [name, divide] : ways) {
      malloc_trim(0);
      std::ofstream("/proc/self/clear_refs") << 5;  // the peak starts anew
      const double held = status_megabytes("VmRSS");
      bench.counters[name + "_seconds"] = seconds_of([&] { parts = divide(counts, weights, count); });
      bench.counters[name + "_megabytes"] = status_megabytes("VmHWM") - held;
      report(bench, name, counts, weights, parts, count);
    }
    std::vector<std::int32_t> owners;
    bench.counters["table_seconds"] =
        seconds_of([&] { owners = owners_of_all<Dim>(counts, weights, parts); });
    bench.counters["naming_seconds"] = seconds_of([&] { renamed_parts(weights, parts, owners, count); });
    bench.counters["blocks"] = static_cast<double>(weights.size());
    bench.counters["parts"] = count;
  }
}

// Decomposition::partition as a whole for a domain whose blocks are all occupied: with a table (weights to rank 0, division,
// owners back, table on every rank), and with the curve where the ranks hold pieces of it already (`curve_seconds`) and where
// they hold slabs (`first_cut_seconds`).
void bench_whole(benchmark::State& bench, const Communicator& communicator, int side) {
  const GridGeometry<Dim> grid(Vec<Dim>::Zero(), Vec<Dim>::Constant((side - 5) * block_side), 1);
  Decomposition<Dim> decomposition(grid), curve(grid, mpm::Partitioner::curve);
  BlockWeights mine, on_curve;
  for (GlobalIndex block = communicator.rank() * decomposition.entries() / communicator.size();
       block < (communicator.rank() + 1) * decomposition.entries() / communicator.size(); ++block)
    mine.push_back({block, random_weight(block)});
  const int levels = curve_levels<Dim>(grid.blocks());
  for (const auto& [block, weight] : mine)
    on_curve.push_back({curve_place<Dim>(coarse_coordinates<Dim>(block, grid.blocks()), levels), weight});
  std::sort(on_curve.begin(), on_curve.end());
  curve.partition(communicator, on_curve, 0);
  BlockWeights piece;
  for (GlobalIndex block = 0; block < decomposition.entries(); ++block)
    if (const GlobalIndex place = curve_place<Dim>(coarse_coordinates<Dim>(block, grid.blocks()), levels);
        piece_of(curve.cuts(), place) == communicator.rank())
      piece.push_back({place, random_weight(block)});
  std::sort(piece.begin(), piece.end());
  for (auto unused : bench) {
    (void)unused;
    const std::vector<std::vector<double>> times =
        time_in_turns(communicator, 3,
                      {[&] { decomposition.partition(communicator, mine, -1e9); },
                       [&] { curve.partition(communicator, piece, -1e9); },
                       [&] { curve.partition(communicator, on_curve, -1e9); }});
    bench.SetIterationTime(median(times[0]));
    bench.counters["seconds"] = median(times[0]);
    bench.counters["curve_seconds"] = median(times[1]);
    bench.counters["first_cut_seconds"] = median(times[2]);
  }
  bench.counters["blocks"] = static_cast<double>(decomposition.entries());
  bench.counters["ranks"] = communicator.size();
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  if (!ZoltanRcb::available() && communicator.root())
    std::printf("Zoltan was not found when this program was built: METIS alone\n");
  const Counts counts = options.small ? Counts(10, 10, 8) : Counts(50, 50, 40);
  const int radius = options.small ? 6 : 29;
  for (int parts = 2; parts <= (options.small ? 2 : 64); parts *= 2) {
    add_case(fmt::format("table/{}", parts), [&communicator, counts, parts](benchmark::State& bench) {
      bench_table(bench, communicator, counts, parts);
    });
    add_case(fmt::format("moved/{}", parts), [&communicator, radius, parts](benchmark::State& bench) {
      bench_moved(bench, communicator, radius, parts);
    });
  }
  std::vector<int> sides = {22, 46};                         // 10^4, 10^5 blocks
  if (options.large) sides.insert(sides.end(), {100, 126});  // 10^6, 2 * 10^6
  if (options.small) sides = {10};
  for (const int side : sides)
    add_case(fmt::format("whole/{}", side * side * side),
             [&communicator, side](benchmark::State& bench) { bench_whole(bench, communicator, side); });
  for (const int side : sides)
    for (const int parts : {2, 16, 64, 512, 4096, 16384, 100000})
      if (parts * 4 <= side * side * side)
        add_case(fmt::format("growth/{}/{}", side * side * side, parts),
                 [&communicator, side, parts](benchmark::State& bench) {
                   bench_growth(bench, communicator, side, parts);
                 });
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
