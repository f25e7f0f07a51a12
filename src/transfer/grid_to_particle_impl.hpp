// The G2P kernels; a source file per B-spline instantiates them.
#pragma once

#include "mpm_hpc/math/tensor.hpp"
#include "mpm_hpc/transfer/grid_to_particle.hpp"
#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

namespace to_particle {

template <int Dim, class T>
struct Columns {
  Real* x[Dim];
  T *v[Dim], *C[Dim * Dim];  // C: null where nobody keeps it
  T* modes[product_modes<Dim> * Dim];
  const T* F[Dim * Dim];  // read by the sink

  explicit Columns(const Body<Dim>& body) {
    const FieldSet& fields = body.particles;
    for (int a = 0; a < Dim; ++a) {
      x[a] = fields.template data<Real>(core::position, a);
      v[a] = fields.template data<T>(core::velocity, a);
    }
    for (int c = 0; c < Dim * Dim; ++c) {
      C[c] = fields.has(core::velocity_gradient) ? fields.template data<T>(core::velocity_gradient, c) : nullptr;
      F[c] = fields.has(core::deformation_gradient) ? fields.template data<T>(core::deformation_gradient, c) : nullptr;
    }
    if (body.velocity_modes != no_field)
      for (int c = 0; c < product_modes<Dim> * Dim; ++c) modes[c] = fields.template data<T>(body.velocity_modes, c);
  }

  ColumnsAhead<Dim, T> ahead() const {
    ColumnsAhead<Dim, T> columns;
    for (const T* component : v) columns.add(component);
    for (const T* component : C)
      if (component) columns.add(component);
    for (const T* component : F)
      if (component) columns.add(component);
    return columns;
  }
};

// What a chunk's stages hand on.
template <class Form, int Dim, class T>
struct Chunk {
  std::vector<FormParticle<Form, T>> rows = std::vector<FormParticle<Form, T>>(chunk_particles);
  alignas(64) T centre[Dim][chunk_particles];
  alignas(64) T gradient[Dim * Dim][chunk_particles];  // of the velocity, where no column holds it
};

// The gradient from D_p^-1 and from grad w: which of them this form needs.
template <class Kernel, class Form>
inline constexpr bool wants_slopes = Kernel::has_inertia && (Form::affine || Form::mls);
template <class Form>
inline constexpr bool wants_derivatives = Form::classical;

// What the nodes of a part of the rows add to the sums of one particle; the first part sets them.
template <class Kernel, class Form, int Dim, class Part, class T>
[[gnu::always_inline]] inline void add_part(Part, const T* tile, FormParticle<Form, T>& r) {
  constexpr int side = Tile<Kernel, Dim, T>::side;
  constexpr bool slopes = wants_slopes<Kernel, Form>, derivatives = wants_derivatives<Form>, add = Part::first > 0;
  using R = typename Part::Row;
  const auto spread = [](Quad<T> q) __attribute__((always_inline)) { return R::template spread<Part::first>(q); };
  const R along = spread(Quad<T>{-1, 0, 1, 2});
  const T* first = tile + (r.tile_node + Part::first) * node_values;
  const R w = spread(load_quad(r.w[Dim - 1]));
  R value = R::zero(), slope_x = value, slope_y = value, product_xy = value, bend_x = value, bend_y = value;
  unrolled<Kernel::support>([&](auto i) __attribute__((always_inline)) {
    R plane = R::zero(), tilt = plane, turn = plane;
    if constexpr (Dim == 2) {
      plane = R::load(first + i * side * node_values);
    } else {
      unrolled<Kernel::support>([&](auto j) __attribute__((always_inline)) {
        const R row = R::load(first + (i * side + j) * side * node_values);
        const R weighted = r.w[1][j] * row;
        plane = plane + weighted;
        if constexpr (slopes) tilt = add_multiple<j - 1>(tilt, weighted);
        if constexpr (derivatives) turn = turn + r.g[1][j] * row;
      });
    }
    const R weighted = r.w[0][i] * plane;
    value = value + weighted;
    if constexpr (derivatives) bend_x = bend_x + r.g[0][i] * plane;
    if constexpr (derivatives && Dim == 3) bend_y = bend_y + r.w[0][i] * turn;
    if constexpr (slopes) slope_x = add_multiple<i - 1>(slope_x, weighted);
    if constexpr (slopes && Dim == 3) slope_y = slope_y + r.w[0][i] * tilt;
    if constexpr (Form::modes && Dim == 3) product_xy = add_multiple<i - 1>(product_xy, R(r.w[0][i] * tilt));
  });
  if constexpr (derivatives) {
    const R last = spread(load_quad(r.g[Dim - 1])) * value, mean = w * value;
    if constexpr (Dim == 2) {
      store_sums<add>(w * bend_x, last, mean, mean, r.f[0]);
    } else {
      store_sums<add>(w * bend_x, w * bend_y, last, mean, r.f[0]);
    }
  }
  if constexpr (slopes) {
    value = w * value;
    slope_x = w * slope_x;
    if constexpr (Dim == 2) {
      store_sums<add>(value, slope_x, along * value, Form::modes ? along * slope_x : along, r.q);
    } else {
      slope_y = w * slope_y;
      store_sums<add>(value, slope_x, slope_y, along * value, r.q);
      if constexpr (Form::modes) {
        product_xy = w * product_xy;
        store_sums<add>(product_xy, along * slope_x, along * slope_y, along * product_xy, r.products[0]);
      }
    }
  }
}

// Weighted sums of the node values of one particle's stencil: q = sum w v, a[b] = sum w (n_b - 1) v, products likewise;
// f[b] = sum v dw/dn_b, f[Dim] = sum w v.
template <class Kernel, class Form, int Dim, class T>
void row_stage(FormParticle<Form, T>* particles, const ColumnsAhead<Dim, T>& ahead, Index begin, int count, const T* tile) {
  for (int p = 0; p < count; ++p) {
    ahead.at_row(begin, p);
    for_each_part<T, Kernel::support>([&](auto part) { add_part<Kernel, Form, Dim>(part, tile, particles[p]); });
  }
}

// carried = sum w (v - v_old), from the tile of the changes.
template <class Kernel, class Form, int Dim, class T>
void change_stage(FormParticle<Form, T>* particles, int count, const T* tile) {
  constexpr int side = Tile<Kernel, Dim, T>::side, plane_nodes = Dim == 2 ? side : side * side;
  for (int p = 0; p < count; ++p) {
    FormParticle<Form, T>& r = particles[p];
    const T* first = tile + r.tile_node * node_values;
    Quad<T> sum{};
    for_each_part<T, Kernel::support>([&](auto part) {
      using R = typename decltype(part)::Row;
      R value = R::zero();
      unrolled<Kernel::support>([&](auto i) {
        R plane = R::zero();
        const T* row = first + (i * plane_nodes + part.first) * node_values;
        if constexpr (Dim == 2) {
          plane = R::load(row);
        } else {
          unrolled<Kernel::support>([&](auto j) { plane = plane + r.w[1][j] * R::load(row + j * side * node_values); });
        }
        value = value + r.w[0][i] * plane;
      });
      sum += (R::template spread<part.first>(load_quad(r.w[Dim - 1])) * value).sum();
    });
    std::memcpy(r.carried, &sum, sizeof(sum));
  }
}

// Places and weights of the chunk's particles, for the row stage.
template <class Kernel, class Form, int Dim, class T>
void place_stage(const GridGeometry<Dim>& grid, const Columns<Dim, T>& columns, const ColumnsAhead<Dim, T>& ahead,
                 const IntVec<Dim>& first_node, Index begin, Index end, Chunk<Form, Dim, T>& chunk) {
  Pack<T> outside = Pack<T>::Zero();
  for (Index p = begin; p < end; p += pack_width<T>) {
    const LanePlace<Kernel, Dim, T> place(grid, first_node, columns.x, p);
    outside += place.outside();
    FormParticle<Form, T>* rows = chunk.rows.data() + (p - begin);
    place.write(rows);
    if constexpr (Form::classical) place.write_gradients(rows);
    for (int a = 0; a < Dim; ++a) store(chunk.centre[a] + (p - begin), place.centre[a]);
    prefetch_positions<T>(columns.x, p);
    ahead.at_pack(p);
  }
  require_inside(outside);
}

// The first Dim values of W particles' quads, of which the first particle's lies at `quads`.
template <int Dim, class Particle, class S, class T>
void read_quads(const T* quads, S* values) {
  constexpr int W = pack_width<T>;
  alignas(64) T lanes[4][W];
  quads_to_packs<T, W>(quads, row_stride<Particle, T>, lanes[0], lanes[1], lanes[2], lanes[3]);
  for (int a = 0; a < Dim; ++a) values[a] = load<S>(lanes[a]);
}

// Coefficients of the products: their moments over those of the weights, (D_p / h^2)^2 or its cube (Fu et al. 2017). The
// velocity that a mode makes one spacing away in each of its directions [m/s].
template <class Kernel, int Dim, class T, class S, class Particle>
void store_modes(const Particle* rows, const S* centre, const S* v, const S (*slope)[Dim], Index p,
                 const Columns<Dim, T>& columns) {
  constexpr Real k = Kernel::inverse_inertia;
  const S pair = broadcast<S>(k * k), triple = broadcast<S>(k * k * k);
  if constexpr (Dim == 2) {
    S xy[Dim];
    read_quads<Dim, Particle>(rows[0].a[2], xy);
    for (int a = 0; a < Dim; ++a)
      store(columns.modes[a] + p, S(pair * (xy[a] + centre[0] * slope[1][a] + centre[1] * slope[0][a] +
                                            centre[0] * centre[1] * v[a])));
  } else {
    const S &x = centre[0], &y = centre[1], &z = centre[2];
    S xy[Dim], xz[Dim], yz[Dim], xyz[Dim];
    read_quads<Dim, Particle>(rows[0].products[0], xy);
    read_quads<Dim, Particle>(rows[0].products[1], xz);
    read_quads<Dim, Particle>(rows[0].products[2], yz);
    read_quads<Dim, Particle>(rows[0].products[3], xyz);
    for (int a = 0; a < Dim; ++a) {
      const S &sx = slope[0][a], &sy = slope[1][a], &sz = slope[2][a];
      store(columns.modes[a] + p, S(pair * (xy[a] + x * sy + y * sx + x * y * v[a])));
      store(columns.modes[Dim + a] + p, S(pair * (xz[a] + x * sz + z * sx + x * z * v[a])));
      store(columns.modes[2 * Dim + a] + p, S(pair * (yz[a] + y * sz + z * sy + y * z * v[a])));
      store(columns.modes[3 * Dim + a] + p,
            S(triple * (xyz[a] + x * yz[a] + y * xz[a] + z * xy[a] + x * y * sz + x * z * sy + y * z * sx +
                        x * y * z * v[a])));
    }
  }
}

// New velocity, gradient and position of the chunk's particles. gradient: where the sink reads it.
template <class Kernel, class Form, int Dim, class T>
KinematicLimits update_stage(const TransferGrid<Dim, T>& grid, const Columns<Dim, T>& columns, Index begin, Index end,
                             Real dt, const Chunk<Form, Dim, T>& chunk, T* const* gradient) {
  using S = Pack<T>;
  using Particle = FormParticle<Form, T>;
  using Wide = Eigen::Array<Real, pack_width<T>, 1>;
  constexpr bool slopes = wants_slopes<Kernel, Form>, derivatives = wants_derivatives<Form>;
  const T per_length = static_cast<T>(grid.geometry.inverse_spacing());
  const T own_share = static_cast<T>(grid.flip_blend);
  const S none = S::Zero();
  S speed2 = none, component = none, largest = none, jump2 = none;
  for (Index p = begin; p < end; p += pack_width<T>) {
    const Particle* rows = chunk.rows.data() + (p - begin);
    S v[Dim], slope[Dim][Dim], derivative[Dim][Dim], centre[Dim];
    if constexpr (slopes) {
      read_quads<Dim, Particle>(rows[0].q, v);
      for (int b = 0; b < Dim; ++b) {
        read_quads<Dim, Particle>(rows[0].a[b], slope[b]);
        centre[b] = load<S>(chunk.centre[b] + (p - begin));
      }
    }
    if constexpr (!slopes) read_quads<Dim, Particle>(rows[0].f[Dim], v);
    if constexpr (derivatives)
      for (int b = 0; b < Dim; ++b) read_quads<Dim, Particle>(rows[0].f[b], derivative[b]);
    S change[Dim];
    if constexpr (Form::increments) read_quads<Dim, Particle>(rows[0].carried, change);
    S size2 = none, change2 = none;
    for (int a = 0; a < Dim; ++a) {
      const S old = load<S>(columns.v[a] + p);
      // The particle moves with the grid, whatever velocity it keeps.
      S kept = v[a];
      if constexpr (Form::increments) kept += own_share * (old + change[a] - v[a]);
      const S jump = kept - old;
      store(columns.v[a] + p, kept);
      const Wide x = load<Wide>(columns.x[a] + p) + dt * v[a].template cast<Real>();
      store(columns.x[a] + p, x);
      if constexpr (Form::increments) {
        const S speed = v[a].abs().max(kept.abs());
        size2 += speed * speed;
      } else {
        size2 += v[a] * v[a];
      }
      change2 += jump * jump;
      component = component.max(v[a].abs());
    }
    speed2 = speed2.max(size2);
    jump2 = jump2.max(change2);
    if constexpr (Form::modes) store_modes<Kernel, Dim, T>(rows, centre, v, slope, p, columns);
    for (int a = 0; a < Dim; ++a) {
      S row = none;
      for (int b = 0; b < Dim; ++b) {
        const int c = a * Dim + b;
        S C = none, G = none;
        if constexpr (slopes) {
          const T inverse = static_cast<T>(Kernel::inverse_inertia) * per_length;
          C = inverse * (slope[b][a] + centre[b] * v[a]);
        }
        if constexpr (derivatives) G = per_length * derivative[b][a];
        const S rate = Form::mls ? C : G;
        store(gradient[c] + (p - begin), rate);
        if constexpr (Form::affine && slopes && derivatives) store(columns.C[c] + p, C);
        row += rate.abs();
      }
      largest = largest.max(row);
    }
  }
  return {std::sqrt(static_cast<Real>(speed2.maxCoeff())), static_cast<Real>(component.maxCoeff()),
          static_cast<Real>(largest.maxCoeff()), std::sqrt(static_cast<Real>(jump2.maxCoeff())) / dt};
}

}  // namespace to_particle

template <class Kernel, class Form, int Dim, class T>
void grid_to_particle(const TransferGrid<Dim, T>& grid, Body<Dim>& body, const std::vector<int>& ranges, Real dt,
                      UpdateSink<Dim, T>& sink) {
  static_assert(Kernel::support <= row_nodes);
  static_assert(Kernel::has_inertia || (Form::classical && !Form::modes), "the linear kernel has no D_p^-1");
  using namespace to_particle;
  using BlockTile = Tile<Kernel, Dim, T>;
  BlockTile tile;
  std::conditional_t<Form::increments, BlockTile, Without<0>> changes;
  const auto chunk = std::make_unique<Chunk<Form, Dim, T>>();
  const Columns<Dim, T> columns(body);
  const ColumnsAhead<Dim, T> ahead = columns.ahead();
  // Affine particles of a classical form keep B_p D_p^-1, which isn't the gradient that deforms them.
  const bool in_columns =
      body.particles.has(core::velocity_gradient) && !(Form::affine && Form::classical && Kernel::has_inertia);
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    const IntVec<Dim> first_node = grid.topology.first_node(range.slot);
    tile.gather(grid.topology, range.slot, grid.nodes);
    if constexpr (Form::increments) changes.gather(grid.topology, range.slot, grid.changes);
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      place_stage<Kernel>(grid.geometry, columns, ahead, first_node, begin, end, *chunk);
      row_stage<Kernel, Form, Dim>(chunk->rows.data(), ahead, begin, end - begin, tile.data);
      if constexpr (Form::increments)
        change_stage<Kernel, Form, Dim>(chunk->rows.data(), end - begin, changes.data);
      T* gradient[Dim * Dim];
      for (int c = 0; c < Dim * Dim; ++c) gradient[c] = in_columns ? columns.C[c] + begin : chunk->gradient[c];
      const KinematicLimits limits =
          update_stage<Kernel, Form>(grid, columns, begin, end, dt, *chunk, gradient);
      sink.updated(begin, end, limits, gradient);
    }
  }
}

}  // namespace mpm
