#include "mpm_hpc/transfer/grid_to_particle.hpp"

#include "mpm_hpc/math/tensor.hpp"
#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

namespace {

// Weighted sums of the node values of one particle's stencil: q = sum w v, a[b] = sum w (n_b - 1) v.
template <class Kernel, int Dim, class T>
void row_stage(RowParticle<T>* particles, int count, const T* tile) {
  constexpr int side = Tile<Kernel, Dim, T>::side;
  const Row<T> along = Row<T>::spread(Quad<T>{-1, 0, 1, 2});
  for (int p = 0; p < count; ++p) {
    RowParticle<T>& r = particles[p];
    const T* first = tile + r.tile_node * node_values;
    const Row<T> w = Row<T>::spread(load_quad(r.w[Dim - 1]));
    Row<T> value = Row<T>::zero(), slope_x = Row<T>::zero();
    if constexpr (Dim == 2) {
      unrolled<Kernel::support>([&](auto i) {
        const Row<T> weighted = r.w[0][i] * Row<T>::load(first + i * side * node_values);
        value = value + weighted;
        slope_x = add_multiple<i - 1>(slope_x, weighted);
      });
    } else {
      Row<T> slope_y = Row<T>::zero();
      unrolled<Kernel::support>([&](auto i) {
        Row<T> plane = Row<T>::zero(), tilt = Row<T>::zero();
        unrolled<Kernel::support>([&](auto j) {
          const Row<T> weighted = r.w[1][j] * Row<T>::load(first + (i * side + j) * side * node_values);
          plane = plane + weighted;
          tilt = add_multiple<j - 1>(tilt, weighted);
        });
        const Row<T> weighted = r.w[0][i] * plane;
        value = value + weighted;
        slope_x = add_multiple<i - 1>(slope_x, weighted);
        slope_y = slope_y + r.w[0][i] * tilt;
      });
      value = w * value;
      store_sums(value, w * slope_x, w * slope_y, along * value, r.q);  // and the slopes, which are behind
    }
    if constexpr (Dim == 2) {
      value = w * value;
      store_sums(value, w * slope_x, along * value, along, r.q);
    }
  }
}

template <int Dim, class T>
struct Columns {
  Real* x[Dim];
  T *v[Dim], *C[Dim * Dim];
  const T* F[Dim * Dim];  // read by the sink

  explicit Columns(const FieldSet& fields) {
    for (int a = 0; a < Dim; ++a) {
      x[a] = fields.template data<Real>(core::position, a);
      v[a] = fields.template data<T>(core::velocity, a);
    }
    for (int a = 0; a < Dim * Dim; ++a) {
      C[a] = fields.template data<T>(core::velocity_gradient, a);
      F[a] = fields.template data<T>(core::deformation_gradient, a);
    }
  }
};

// Places and weights of the chunk's particles, for the row stage.
template <class Kernel, int Dim, class T>
void place_stage(const GridGeometry<Dim>& grid, const Columns<Dim, T>& columns, const IntVec<Dim>& first_node,
                 Index begin, Index end, RowParticle<T>* out) {
  constexpr int W = pack_width<T>;
  Pack<T> outside = Pack<T>::Zero();
  for (Index p = begin; p < end; p += W) {
    const LanePlace<Kernel, Dim, T> place(grid, first_node, columns.x, p);
    outside += place.outside();
    place.write(out + (p - begin));
    for (int a = 0; a < Dim; ++a) {
      prefetch_next_chunk(columns.x[a], p);
      if (pack_width<T> > 8) prefetch_next_chunk(columns.x[a] + 8, p);
      prefetch_next_chunk(columns.v[a], p);
    }
    for (int a = 0; a < Dim * Dim; ++a) {
      prefetch_next_chunk(columns.C[a], p);
      prefetch_next_chunk(columns.F[a], p);
    }
  }
  require_inside(outside);
}

// New velocity, gradient and position of the chunk's particles.
template <class Kernel, int Dim, class T>
KinematicLimits update_stage(const GridGeometry<Dim>& grid, const Columns<Dim, T>& columns,
                             const IntVec<Dim>& first_node, Index begin, Index end, Real dt,
                             const RowParticle<T>* in) {
  using S = Pack<T>;
  constexpr int W = pack_width<T>;
  using Wide = Eigen::Array<Real, W, 1>;
  const T per_length = static_cast<T>(Kernel::inverse_inertia / grid.spacing());
  const S none = S::Zero();
  S speed2 = none, component = none, gradient = none, jump2 = none;
  for (Index p = begin; p < end; p += W) {
    const LanePlace<Kernel, Dim, T> place(grid, first_node, columns.x, p);
    const RowParticle<T>* rows = in + (p - begin);
    alignas(64) T q[4][W], slope[Dim][4][W];
    constexpr int stride = row_stride<RowParticle<T>, T>;
    quads_to_packs<T, W>(rows[0].q, stride, q[0], q[1], q[2], q[3]);
    for (int b = 0; b < Dim; ++b)
      quads_to_packs<T, W>(rows[0].a[b], stride, slope[b][0], slope[b][1], slope[b][2], slope[b][3]);
    S v[Dim], size2 = none, change2 = none;
    for (int a = 0; a < Dim; ++a) {
      v[a] = load<S>(q[a]);
      const S change = v[a] - load<S>(columns.v[a] + p);
      store(columns.v[a] + p, v[a]);
      const Wide x = load<Wide>(columns.x[a] + p) + dt * v[a].template cast<Real>();
      store(columns.x[a] + p, x);
      size2 += v[a] * v[a];
      change2 += change * change;
      component = component.max(v[a].abs());
    }
    speed2 = speed2.max(size2);
    jump2 = jump2.max(change2);
    for (int a = 0; a < Dim; ++a) {
      S row = none;
      for (int b = 0; b < Dim; ++b) {
        const S C = per_length * (load<S>(slope[b][a]) + place.centre[b] * v[a]);
        store(columns.C[a * Dim + b] + p, C);
        row += C.abs();
      }
      gradient = gradient.max(row);
    }
  }
  return {std::sqrt(static_cast<Real>(speed2.maxCoeff())), static_cast<Real>(component.maxCoeff()),
          static_cast<Real>(gradient.maxCoeff()), std::sqrt(static_cast<Real>(jump2.maxCoeff())) / dt};
}

}  // namespace

template <class Kernel, int Dim, class T>
void grid_to_particle(const TransferGrid<Dim, T>& grid, Body<Dim>& body, const std::vector<int>& ranges, Real dt,
                      UpdateSink<Dim, T>& sink) {
  static_assert(Kernel::has_inertia && Kernel::support <= row_nodes);
  Tile<Kernel, Dim, T> tile;
  std::vector<RowParticle<T>> rows(chunk_particles);
  const Columns<Dim, T> columns(body.particles);
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    const IntVec<Dim> first_node = grid.topology.first_node(range.slot);
    tile.gather(grid.topology, range.slot, grid.nodes);
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      place_stage<Kernel>(grid.geometry, columns, first_node, begin, end, rows.data());
      row_stage<Kernel, Dim>(rows.data(), end - begin, tile.data);
      const KinematicLimits limits =
          update_stage<Kernel>(grid.geometry, columns, first_node, begin, end, dt, rows.data());
      const T* gradient[Dim * Dim];
      for (int c = 0; c < Dim * Dim; ++c) gradient[c] = columns.C[c] + begin;
      sink.updated(begin, end, limits, gradient);
    }
  }
}

#define MPM_INSTANTIATE(Dim, T)                                                                                  \
  template void grid_to_particle<QuadraticKernel, Dim, T>(const TransferGrid<Dim, T>&, Body<Dim>&,               \
                                                          const std::vector<int>&, Real, UpdateSink<Dim, T>&);
MPM_INSTANTIATE(2, float)
MPM_INSTANTIATE(2, double)
MPM_INSTANTIATE(3, float)
MPM_INSTANTIATE(3, double)
#undef MPM_INSTANTIATE

}  // namespace mpm
