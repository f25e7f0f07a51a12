#include "mpm_hpc/transfer/particle_to_grid.hpp"

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

void throw_drifted_out() {
  throw LogicError("a particle drifted out of its block's tile: the particles were not sorted in time");
}

namespace {

// Fills one RowParticle per particle of the chunk [begin, end).
template <class Kernel, int Dim, class T>
void lane_stage(const TransferGrid<Dim, T>& grid, const Body<Dim>& body, const IntVec<Dim>& first_node, Index begin,
                Index end, T* const* tau, Real dt, RowParticle<T>* out) {
  using S = Pack<T>;
  constexpr int W = pack_width<T>;
  const FieldSet& fields = body.particles;
  const Real h = grid.geometry.spacing();
  const Real* x[Dim];
  const T *v[Dim], *C[Dim * Dim];
  for (int a = 0; a < Dim; ++a) {
    x[a] = fields.template data<Real>(core::position, a);
    v[a] = fields.template data<T>(core::velocity, a);
  }
  for (int a = 0; a < Dim * Dim; ++a) C[a] = fields.template data<T>(core::velocity_gradient, a);
  const T* F[Dim * Dim];  // read by the stress of the next chunk
  for (int a = 0; a < Dim * Dim; ++a) F[a] = fields.template data<T>(core::deformation_gradient, a);
  const T* mass = fields.template data<T>(core::mass);
  const T* volume = fields.template data<T>(core::volume);
  // Slopes are per node, hence one factor h: h A = h m C - (dt k / h) V0 tau, with D^-1 = k / h^2.
  const T spacing = static_cast<T>(h), stress_factor = static_cast<T>(dt * Kernel::inverse_inertia / h);

  Pack<T> outside = Pack<T>::Zero();
  for (Index p = begin; p < end; p += W) {
    const LanePlace<Kernel, Dim, T> place(grid.geometry, first_node, x, p);
    outside += place.outside();
    for (int a = 0; a < Dim; ++a) {
      prefetch_next_chunk(x[a], p);
      if (pack_width<T> > 8) prefetch_next_chunk(x[a] + 8, p);
      prefetch_next_chunk(v[a], p);
    }
    for (int a = 0; a < Dim * Dim; ++a) {
      prefetch_next_chunk(C[a], p);
      prefetch_next_chunk(F[a], p);
    }
    prefetch_next_chunk(mass, p);
    prefetch_next_chunk(volume, p);
    const S m = load<S>(mass + p);
    const S moment = m * spacing, force = load<S>(volume + p) * stress_factor;
    alignas(64) T q[4][W] = {}, slope[Dim][4][W] = {};
    S momentum[Dim];
    for (int a = 0; a < Dim; ++a) momentum[a] = m * load<S>(v[a] + p);
    for (int a = 0; a < Dim; ++a)
      for (int b = 0; b < Dim; ++b) {
        const S stress = load<S>(tau[SymTensor<S, Dim>::index(a, b)] + (p - begin));
        const S A = moment * load<S>(C[a * Dim + b] + p) - force * stress;
        momentum[a] += A * place.centre[b];
        store(slope[b][a], A);
      }
    for (int a = 0; a < Dim; ++a) store(q[a], momentum[a]);
    store(q[Dim], m);

    RowParticle<T>* rows = out + (p - begin);
    place.write(rows);
    constexpr int stride = row_stride<RowParticle<T>, T>;
    packs_to_quads<T, W>(q[0], q[1], q[2], q[3], rows[0].q, stride);
    for (int b = 0; b < Dim; ++b)
      packs_to_quads<T, W>(slope[b][0], slope[b][1], slope[b][2], slope[b][3], rows[0].a[b], stride);
  }
  require_inside(outside);
}

// tile[row] += w_outer * (w_row (x) values) for the rows of one particle's stencil.
template <class Kernel, int Dim, class T>
void row_stage(const RowParticle<T>* particles, int count, T* tile) {
  constexpr int side = Tile<Kernel, Dim, T>::side;
  const Row<T> along = Row<T>::spread(Quad<T>{-1, 0, 1, 2});
  for (int p = 0; p < count; ++p) {
    const RowParticle<T>& r = particles[p];
    const Row<T> w = Row<T>::spread(load_quad(r.w[Dim - 1]));
    const Row<T> centre =
        w * (Row<T>::repeat(load_quad(r.q)) + along * Row<T>::repeat(load_quad(r.a[Dim - 1])));
    const Row<T> slope_x = w * Row<T>::repeat(load_quad(r.a[0]));
    T* first = tile + r.tile_node * node_values;
    if constexpr (Dim == 2) {
      unrolled<Kernel::support>([&](auto i) {
        T* row = first + i * side * node_values;
        (Row<T>::load(row) + r.w[0][i] * add_multiple<i - 1>(centre, slope_x)).store(row);
      });
    } else {
      const Row<T> slope_y = w * Row<T>::repeat(load_quad(r.a[1]));
      unrolled<Kernel::support>([&](auto i) {
        const Row<T> plane = r.w[0][i] * add_multiple<i - 1>(centre, slope_x), tilt = r.w[0][i] * slope_y;
        unrolled<Kernel::support>([&](auto j) {
          T* row = first + (i * side + j) * side * node_values;
          (Row<T>::load(row) + r.w[1][j] * add_multiple<j - 1>(plane, tilt)).store(row);
        });
      });
    }
  }
}

}  // namespace

template <class Kernel, int Dim, class T>
void particle_to_grid(const TransferGrid<Dim, T>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                      const StressSource<Dim, T>& stress, Real dt) {
  static_assert(Kernel::has_inertia && Kernel::support <= row_nodes);
  Tile<Kernel, Dim, T> tile;
  constexpr int components = SymTensor<T, Dim>::size;
  alignas(64) T tau_storage[components][chunk_particles];
  T* tau[components];
  for (int c = 0; c < components; ++c) tau[c] = tau_storage[c];
  std::vector<RowParticle<T>> rows(chunk_particles);  // zeroed: the fourth weight and unused values stay 0
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    const IntVec<Dim> first_node = grid.topology.first_node(range.slot);
    tile.zero();
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      stress.kirchhoff_stress(begin, end, tau);
      lane_stage<Kernel>(grid, body, first_node, begin, end, tau, dt, rows.data());
      row_stage<Kernel, Dim>(rows.data(), end - begin, tile.data);
    }
    tile.scatter_add(grid.topology, range.slot, grid.nodes);
  }
}

#define MPM_INSTANTIATE(Dim, T)                                                                                   \
  template void particle_to_grid<QuadraticKernel, Dim, T>(const TransferGrid<Dim, T>&, const Body<Dim>&,          \
                                                          const std::vector<int>&, const StressSource<Dim, T>&, Real);
MPM_INSTANTIATE(2, float)
MPM_INSTANTIATE(2, double)
MPM_INSTANTIATE(3, float)
MPM_INSTANTIATE(3, double)
#undef MPM_INSTANTIATE

}  // namespace mpm
