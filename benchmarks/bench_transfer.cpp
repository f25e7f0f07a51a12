// P2G, G2P and the sort by themselves: particles per second and core against the plain twins and the machine's roofline.
#include "roofline.hpp"
#include "transfer_block.hpp"

namespace {

using namespace mpm;

constexpr int rounds = 7;

// The kernels that are measured, with APIC and the forces that each of them has; bench_schemes measures the other transfers.
template <class... K>
struct KernelList {};
using Kernels = KernelList<LinearKernel, QuadraticKernel, CubicKernel>;
template <class Kernel>
using FormOf = TransferForm<Scheme::apic, Kernel::has_inertia ? Forces::mls : Forces::classical>;

// Operations of Kernel::weights.
template <class Kernel>
constexpr int weight_flops = 0;
template <>
constexpr int weight_flops<LinearKernel> = 1;
template <>
constexpr int weight_flops<QuadraticKernel> = 9;
template <>
constexpr int weight_flops<CubicKernel> = 22;

// Operations per particle, counted from the row formulas of particle_to_grid_impl.hpp and grid_to_particle_impl.hpp for MLS
// forces; a multiply-add is two. S nodes of support, V values of a row that matter, N = sum_i |i - 1| additions of whole multiples of a slope over
// the S nodes of a direction. A row is S nodes times d + 1 values (momentum and mass) in P2G, times d (velocity) in G2P.
template <class Kernel, int Dim>
struct Flops {
  static_assert(weight_flops<Kernel> > 0, "count the kernel's operations");
  static constexpr int S = Kernel::support, d = Dim;
  static constexpr int N = S == 2 ? 1 : S == 3 ? 2 : 4;
  // Tile coordinate (3 to node spacings, shift, floor, fraction, distance of the second node) and weights; node number.
  static constexpr int place = d * (7 + weight_flops<Kernel>)+2 * (d - 1);

  // m h, V k dt / h, m v; per entry A = m h C - (V k dt / h) tau (3) and its share of the row's middle value (2). Rows:
  // centre = w (q + (n - 1) a_z) (3 V), w a_x, and in 3D w a_y (V each); per plane centre + (i - 1) w a_x, times w_i;
  // in 3D per row plane + (j - 1) tilt, times w_j onto the tile.
  static constexpr int to_grid() {
    constexpr int V = S * (d + 1), lanes = place + 2 + d + 5 * d * d;
    if (d == 2) return lanes + 3 * V + V + N * V + S * 2 * V + derivatives;
    return lanes + 3 * V + 2 * V + N * V + S * 2 * V + S * (N * V + S * 2 * V) + derivatives;
  }

  // Without MLS the rows take the derivatives (2 per direction and node, times 1 / h) in place of the slopes' own multiples:
  // one multiply-add more per value of a row.
  static constexpr int derivatives = Kernel::has_inertia ? 0 : (d == 2 ? S : S * S) * 2 * S * d + 3 * S * d;

  // Rows mirror P2G; then V d (S - 1) sums over a row's nodes of the d + 1 results. Update: x (2), |v|^2 (2), jump (3) per
  // direction; per entry C (3), row sum (1).
  static constexpr int to_particles() {
    constexpr int V = S * d, sums = (S - 1) * d * (d + 1), update = 7 * d + d * d * 4;
    if (d == 2) return place + S * 2 * V + N * V + 3 * V + sums + update + derivatives;
    return place + S * (S * 2 * V + N * V + 4 * V) + N * V + 4 * V + sums + update + derivatives;
  }
};

enum class Transfer { to_grid, to_particles, both, sort };

const char* name_of(Transfer transfer) {
  switch (transfer) {
    case Transfer::to_grid:
      return "p2g";
    case Transfer::to_particles:
      return "g2p";
    case Transfer::both:
      return "fused";
    case Transfer::sort:
      return "sort";
  }
  return "";
}

// Columns in and out, and the nodes: cleared, read and written by P2G, read by G2P.
template <class Kernel, int Dim, class T>
Work work_of(Transfer transfer, const TransferBlock<Kernel, FormOf<Kernel>, Dim, T>& block) {
  const FieldSet& f = block.columns();
  const double moved = column_bytes(f, {core::position, core::velocity, core::velocity_gradient});
  switch (transfer) {
    case Transfer::to_grid:
      return {
          moved + column_bytes(f, {core::deformation_gradient, core::mass, core::volume}) + node_bytes<T>(block.state(), node_values, 3),
          Flops<Kernel, Dim>::to_grid()};
    case Transfer::to_particles:
      return {2 * moved + node_bytes<T>(block.state(), node_values, 1), Flops<Kernel, Dim>::to_particles()};
    case Transfer::both: {
      const double updated = 2 * (moved + column_bytes(f, {core::deformation_gradient}));
      return {updated + column_bytes(f, {core::mass, core::volume}) + node_bytes<T>(block.state(), node_values, 4),
              Flops<Kernel, Dim>::to_particles() + Flops<Kernel, Dim>::to_grid()};
    }
    case Transfer::sort:
      // Every column to its new place; the drift reads and writes the positions, the cells are found from them.
      return {2.0 * f.bytes_per_particle() + 3 * column_bytes(f, {core::position}), 0};
  }
  return {};
}

template <class Kernel, int Dim, class T>
void bench_transfer(benchmark::State& bench, const Communicator& communicator, Transfer transfer, int cells) {
  TransferBlock<Kernel, FormOf<Kernel>, Dim, T> block(communicator, cells);
  const Work work = work_of(transfer, block);
  const auto in_turns = [&](int repeats, auto production, auto reference) {
    for (auto unused : bench) {
      (void)unused;
      const auto times = time_in_turns(communicator, rounds,
                                       {[&] {
                                          for (int i = 0; i < repeats; ++i) production();
                                        },
                                        reference});
      report_kernel(bench, communicator, times, repeats, block.particles_per_core(), block.precision, work);
    }
  };
  switch (transfer) {
    case Transfer::to_grid:
      in_turns(
          10, [&] { block.to_grid(); }, [&] { block.reference_to_grid(); });
      break;
    case Transfer::to_particles:
      in_turns(
          10, [&] { block.to_particles(); }, [&] { block.reference_to_particles(); });
      break;
    case Transfer::both:
      // Not against plain code, but against one after the other.
      in_turns(
          5, [&] { block.to_particles_and_grid(block.ranges_in_cache()); },
          [&] { block.to_particles_and_grid(block.all_ranges()); });
      break;
    case Transfer::sort:
      in_turns(
          2, [&] { block.drift_and_sort(); }, [&] { block.reference_drift_and_sort(); });
      break;
  }
}

template <class Kernel>
void register_kernel(const Communicator& communicator, const BenchOptions& options) {
  for (const BlockSize& size : block_sizes(options))
    for (const bool single : {false, true})
      for (const Transfer transfer : {Transfer::to_grid, Transfer::to_particles, Transfer::both, Transfer::sort})
        add_case(fmt::format("{}/{}/{}/{}", name_of(transfer), Kernel::name, single ? "single" : "double",
                             size.name),
                 [&communicator, transfer, single, size](benchmark::State& bench) {
                   with_dimension(size.dimension, [&](auto dim) {
                     if (single) {
                       bench_transfer<Kernel, dim, float>(bench, communicator, transfer, size.cells);
                     } else {
                       bench_transfer<Kernel, dim, double>(bench, communicator, transfer, size.cells);
                     }
                   });
                 });
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  [&]<class... K>(KernelList<K...>) { (register_kernel<K>(communicator, options), ...); }(Kernels{});
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
