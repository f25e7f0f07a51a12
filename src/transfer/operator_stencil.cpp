#include "mpm_hpc/transfer/operator_stencil.hpp"

#include <algorithm>
#include <memory>

#include "mpm_hpc/transfer/cell_order.hpp"
#include "mpm_hpc/transfer/lanes.hpp"
#include "pair_sums.hpp"

namespace mpm {

namespace {

// Particles handled between two sorts by cell: those of a block, unless it is very full.
constexpr int batch_particles = 1024;

}  // namespace

template <class Kernel, int Values, int Dim, class T, class E>
void scatter_values_and_stencil(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                                ValueSource<T>& source, T* nodes, T* diagonal, E* stencil, std::vector<char>& touched) {
  using NodeTile = Tile<Kernel, Dim, T, Values>;
  constexpr int W = pack_width<T>;
  NodeTile tile;
  StencilTile<Kernel, Dim, E> stencil_tile;
  PairSums<Kernel, Dim, T, Values, E> sums;
  CellOrder<NodeTile::cells> cells;
  // Where the particles are, their coefficients and values.
  constexpr int coefficients = Dim + 2, used = coefficients + Values;
  struct alignas(64) Columns {
    T column[used][batch_particles + 64 / sizeof(T)];  // not a multiple of 4 KiB, or all would share an L1 set
  };
  const auto scratch = std::make_unique_for_overwrite<Columns>();
  auto& column = scratch->column;
  CellParticles<T, Values> particles{};
  for (int a = 0; a < Dim; ++a) particles.centre[a] = column[a];
  particles.conductivity = column[Dim];
  particles.reaction = column[Dim + 1];
  for (int c = 0; c < Values; ++c) particles.q[c] = column[coefficients + c];

  std::vector<int> cell_of(batch_particles);
  alignas(64) T unused[node_values][chunk_particles];
  T* q[node_values];
  for (int c = 0; c < node_values; ++c) q[c] = unused[c];
  const Real* x[Dim];
  for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a);
  const Real scale = ScalarSlopes<Kernel>::scale / grid.geometry.spacing();
  const T scale2 = static_cast<T>(scale * scale);

  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    const IntVec<Dim> first_node = grid.topology.first_node(range.slot);
    tile.zero();
    for (Index batch = range.begin; batch < range.end; batch += batch_particles) {
      const int count = std::min<Index>(range.end - batch, batch_particles);
      Pack<T> outside = Pack<T>::Zero();
      for (int begin = 0; begin < count; begin += chunk_particles) {
        const int end = std::min(begin + chunk_particles, count);
        for (int c = 0; c < Values; ++c) q[c] = column[coefficients + c] + begin;
        T* conductivity = column[Dim];
        source.values(batch + begin, batch + end, q, conductivity + begin, column[Dim + 1] + begin);
        for (int p = begin; p < end; p += W) {
          const LanePlace<Kernel, Dim, T> lanes(grid.geometry, first_node, x, batch + p);
          outside += lanes.outside();
          for (int a = 0; a < Dim; ++a) store(column[a] + p, lanes.centre[a]);
          prefetch_positions<T>(x, batch + p);
          store(conductivity + p, Pack<T>(scale2 * load<Pack<T>>(conductivity + p)));
          const Pack<T> cell = lanes.cell();
          detail::convert<W>(cell.data(), cell_of.data() + p);
        }
      }
      require_inside(outside);
      cells.build(count, [&cell_of](int p) { return cell_of[p]; });
      particles.order = cells.order();
      sums.begin(particles);
      cells.for_each_cell([&](int cell, int begin, int end) {
        const auto first = NodeTile::first_node_of_cell(cell);
        stencil_tile.include(first.data());
        sums.add(begin, end, tile, stencil_tile, NodeTile::node(first));
      });
    }
    tile.scatter_add(grid.topology, range.slot, nodes);
    stencil_tile.scatter_add(grid.topology, range.slot, stencil, diagonal, touched);
  }
}

#define MPM_INSTANTIATE_VALUES(Kernel, Dim, T, E, Values)                                                                      \
  template void scatter_values_and_stencil<Kernel, Values, Dim, T, E>(const ScalarGrid<Dim>&, const Body<Dim>&,                \
                                                                      const std::vector<int>&, ValueSource<T>&, T*, T*, E*,    \
                                                                      std::vector<char>&);
#define MPM_INSTANTIATE(Kernel, Dim, T, E)    \
  MPM_INSTANTIATE_VALUES(Kernel, Dim, T, E, 1) \
  MPM_INSTANTIATE_VALUES(Kernel, Dim, T, E, 2) \
  MPM_INSTANTIATE_VALUES(Kernel, Dim, T, E, node_values)
MPM_FOR_OPERATOR_STENCILS(MPM_INSTANTIATE)
#undef MPM_INSTANTIATE
#undef MPM_INSTANTIATE_VALUES

}  // namespace mpm
