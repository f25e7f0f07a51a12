// The P2G kernels; a source file per B-spline instantiates them.
#pragma once

#include "mpm_hpc/transfer/lanes.hpp"
#include "mpm_hpc/transfer/particle_to_grid.hpp"

namespace mpm {

namespace to_grid {

template <int Dim, class T>
struct Columns {
  const Real* x[Dim];
  const T *v[Dim], *C[Dim * Dim], *F[Dim * Dim];  // F is read by the stress of the next chunk
  const T* modes[product_modes<Dim> * Dim];
  const T *mass, *volume;

  template <class Form>
  Columns(const Body<Dim>& body, Form) {
    const FieldSet& fields = body.particles;
    for (int a = 0; a < Dim; ++a) {
      x[a] = fields.template data<Real>(core::position, a);
      v[a] = fields.template data<T>(core::velocity, a);
    }
    for (int c = 0; c < Dim * Dim; ++c) {
      if (Form::affine) C[c] = fields.template data<T>(core::velocity_gradient, c);
      F[c] = fields.has(core::deformation_gradient) ? fields.template data<T>(core::deformation_gradient, c) : nullptr;
    }
    if constexpr (Form::modes)
      for (int c = 0; c < product_modes<Dim> * Dim; ++c) modes[c] = fields.template data<T>(body.velocity_modes, c);
    mass = fields.template data<T>(core::mass);
    volume = fields.template data<T>(core::volume);
  }

  template <class Form>
  ColumnsAhead<Dim, T> ahead(Form) const {
    ColumnsAhead<Dim, T> columns;
    for (const T* component : v) columns.add(component);
    if constexpr (Form::affine)
      for (const T* component : C) columns.add(component);
    for (const T* component : F)
      if (component) columns.add(component);
    if constexpr (Form::modes)
      for (const T* component : modes) columns.add(component);
    columns.add(mass);
    columns.add(volume);
    return columns;
  }
};

// Momentum around W particles as a polynomial of z = (x_i - x_p) / h: value + slope[b] z_b + products.
template <int Dim, class S>
struct Polynomial {
  S value[Dim], slope[Dim][Dim], products[product_modes<Dim>][Dim];  // slope[b][a] of component a in direction b

  // The same in n - 1, the node's number in the stencil less one: z_b = n_b - 1 + centre_b.
  void shift(const S* centre, bool with_products) {
    for (int a = 0; a < Dim; ++a) {
      if (with_products) {
        if constexpr (Dim == 2) {
          const S xy = products[0][a];
          value[a] -= centre[0] * centre[1] * xy;  // c_x c_y xy, which the shift of the slopes below adds twice
          slope[0][a] += centre[1] * xy;
          slope[1][a] += centre[0] * xy;
        } else {
          S &xy = products[0][a], &xz = products[1][a], &yz = products[2][a], &xyz = products[3][a];
          const S &x = centre[0], &y = centre[1], &z = centre[2];
          value[a] += x * y * xy + x * z * xz + y * z * yz + x * y * z * xyz;
          const S along_x = y * xy + z * xz + y * z * xyz, along_y = x * xy + z * yz + x * z * xyz,
                  along_z = x * xz + y * yz + x * y * xyz;
          slope[0][a] += along_x;
          slope[1][a] += along_y;
          slope[2][a] += along_z;
          value[a] -= x * along_x + y * along_y + z * along_z;
          xy += z * xyz;
          xz += y * xyz;
          yz += x * xyz;
        }
      }
      for (int b = 0; b < Dim; ++b) value[a] += slope[b][a] * centre[b];
    }
  }
};

// Hands Dim values per lane (and a last one) to the quad that `first` is of the first lane's particle.
template <int Dim, class T, class S, class Particle>
void write_quads(const S* values, const S* last, T* first) {
  constexpr int W = pack_width<T>;
  alignas(64) T q[4][W] = {};
  for (int a = 0; a < Dim; ++a) store(q[a], values[a]);
  if (last) store(q[Dim], *last);
  packs_to_quads<T, W>(q[0], q[1], q[2], q[3], first, row_stride<Particle, T>);
}

// Fills one FormParticle per particle of the chunk [begin, end).
template <class Kernel, class Form, int Dim, class T>
void lane_stage(const GridGeometry<Dim>& grid, const Columns<Dim, T>& columns, const ColumnsAhead<Dim, T>& ahead,
                const IntVec<Dim>& first_node, Index begin, Index end, T* const* tau, Real dt, FormParticle<Form, T>* out) {
  using S = Pack<T>;
  using Particle = FormParticle<Form, T>;
  constexpr bool sloped = Form::affine || Form::mls;
  const Real h = grid.spacing();
  // Slopes are per node, hence one factor h: h A = h m C - (dt k / h) V0 tau, with D^-1 = k / h^2.
  const T spacing = static_cast<T>(h);
  T stress_factor = static_cast<T>(dt / h);
  if constexpr (Form::mls) stress_factor = static_cast<T>(dt * Kernel::inverse_inertia / h);

  S outside = S::Zero();
  for (Index p = begin; p < end; p += pack_width<T>) {
    const LanePlace<Kernel, Dim, T> place(grid, first_node, columns.x, p);
    outside += place.outside();
    prefetch_positions<T>(columns.x, p);
    ahead.at_pack(p);
    Particle* rows = out + (p - begin);
    place.write(rows);
    const S m = load<S>(columns.mass + p);
    const S moment = m * spacing, force = load<S>(columns.volume + p) * stress_factor;
    const auto stress = [&](int a, int b) { return load<S>(tau[SymTensor<S, Dim>::index(a, b)] + (p - begin)); };

    Polynomial<Dim, S> field;  // of the momentum that nodes get; of the forces' alone where they are apart
    S momentum[Dim];
    for (int a = 0; a < Dim; ++a) {
      momentum[a] = m * load<S>(columns.v[a] + p);
      field.value[a] = Form::increments ? S(S::Zero()) : momentum[a];
      for (int b = 0; b < Dim; ++b) {
        S A = S::Zero();
        if constexpr (Form::scheme == Scheme::rpic) {
          A = static_cast<T>(0.5) * moment * (load<S>(columns.C[a * Dim + b] + p) - load<S>(columns.C[b * Dim + a] + p));
        } else if constexpr (Form::affine) {
          A = moment * load<S>(columns.C[a * Dim + b] + p);
        }
        if constexpr (Form::mls) A -= force * stress(a, b);
        field.slope[b][a] = A;
      }
    }
    if constexpr (Form::modes)
      for (int k = 0; k < product_modes<Dim>; ++k)
        for (int a = 0; a < Dim; ++a) field.products[k][a] = m * load<S>(columns.modes[k * Dim + a] + p);
    if constexpr (sloped) field.shift(place.centre, Form::modes);

    write_quads<Dim, T, S, Particle>(field.value, Form::increments ? nullptr : &m, rows[0].q);
    if constexpr (sloped)
      for (int b = 0; b < Dim; ++b) write_quads<Dim, T, S, Particle>(field.slope[b], nullptr, rows[0].a[b]);
    if constexpr (Form::modes)
      for (int k = 0; k < product_modes<Dim>; ++k)
        write_quads<Dim, T, S, Particle>(field.products[k], nullptr, rows[0].products[k]);
    if constexpr (Form::increments) write_quads<Dim, T, S, Particle>(momentum, &m, rows[0].carried);
    if constexpr (Form::classical) {
      place.write_gradients(rows);
      for (int b = 0; b < Dim; ++b) {
        S f[Dim];
        for (int a = 0; a < Dim; ++a) f[a] = -force * stress(a, b);
        write_quads<Dim, T, S, Particle>(f, nullptr, rows[0].f[b]);
      }
    }
  }
  require_inside(outside);
}

// tile[row] += a part of the rows of one particle's stencil: weights (x) (values + slopes), plus derivatives (x) f.
template <class Kernel, class Form, int Dim, class Part, class T>
[[gnu::always_inline]] inline void add_part(Part, const FormParticle<Form, T>& r, T* tile) {
  constexpr int side = Tile<Kernel, Dim, T>::side;
  constexpr bool sloped = Form::affine || Form::mls;
  using R = typename Part::Row;
  const auto spread = [](Quad<T> q) __attribute__((always_inline)) { return R::template spread<Part::first>(q); };
  const auto repeat = [](const T* quad) __attribute__((always_inline)) { return R::repeat(load_quad(quad)); };
  const R along = spread(Quad<T>{-1, 0, 1, 2}), w = spread(load_quad(r.w[Dim - 1]));
  R centre = repeat(r.q), slope_x = R::zero(), slope_y = slope_x, twist = slope_x;
  if constexpr (sloped) {
    centre = centre + along * repeat(r.a[Dim - 1]);
    slope_x = repeat(r.a[0]);
    if constexpr (Dim == 3) slope_y = repeat(r.a[1]);
  }
  if constexpr (Form::modes) {
    slope_x = slope_x + along * repeat(r.products[Dim == 2 ? 0 : 1]);
    if constexpr (Dim == 3) {
      slope_y = slope_y + along * repeat(r.products[2]);
      twist = w * (repeat(r.products[0]) + along * repeat(r.products[3]));
    }
  }
  centre = w * centre;
  slope_x = w * slope_x;
  slope_y = w * slope_y;
  R bend_x = R::zero(), bend_y = bend_x;
  if constexpr (Form::classical) {
    centre = centre + spread(load_quad(r.g[Dim - 1])) * repeat(r.f[Dim - 1]);
    bend_x = w * repeat(r.f[0]);
    if constexpr (Dim == 3) bend_y = w * repeat(r.f[1]);
  }
  T* first = tile + (r.tile_node + Part::first) * node_values;
  unrolled<Kernel::support>([&](auto i) __attribute__((always_inline)) {
    R plane = centre;
    if constexpr (sloped) plane = add_multiple<i - 1>(plane, slope_x);
    if constexpr (Dim == 2) {
      T* row = first + i * side * node_values;
      R sum = R::load(row) + r.w[0][i] * plane;
      if constexpr (Form::classical) sum = sum + r.g[0][i] * bend_x;
      sum.store(row);
    } else {
      plane = r.w[0][i] * plane;
      R tilt = slope_y, turn = bend_y;
      if constexpr (Form::modes) tilt = add_multiple<i - 1>(tilt, twist);
      if constexpr (sloped) tilt = r.w[0][i] * tilt;
      if constexpr (Form::classical) {
        plane = plane + r.g[0][i] * bend_x;
        turn = r.w[0][i] * bend_y;
      }
      unrolled<Kernel::support>([&](auto j) __attribute__((always_inline)) {
        T* row = first + (i * side + j) * side * node_values;
        R values = plane;
        if constexpr (sloped) values = add_multiple<j - 1>(plane, tilt);
        R sum = R::load(row) + r.w[1][j] * values;
        if constexpr (Form::classical) sum = sum + r.g[1][j] * turn;
        sum.store(row);
      });
    }
  });
}

template <class Kernel, class Form, int Dim, class T>
void row_stage(const FormParticle<Form, T>* particles, const ColumnsAhead<Dim, T>& ahead, Index begin, int count, T* tile) {
  for (int k = 0; k < count; ++k) {
    // In 2D the few rows of a particle are those of the one before, which would have to wait until they are stored: two
    // streams, half a chunk apart.
    const int p = Dim == 2 ? k % 2 * (count / 2) + k / 2 : k;
    ahead.at_row(begin, k);
    for_each_part<T, Kernel::support>([&](auto part) { add_part<Kernel, Form, Dim>(part, particles[p], tile); });
  }
}

// tile[row] += weights (x) carried.
template <class Kernel, class Form, int Dim, class T>
void carried_stage(const FormParticle<Form, T>* particles, int count, T* tile) {
  constexpr int side = Tile<Kernel, Dim, T>::side, plane_nodes = Dim == 2 ? side : side * side;
  for (int p = 0; p < count; ++p) {
    const FormParticle<Form, T>& r = particles[p];
    for_each_part<T, Kernel::support>([&](auto part) {
      using R = typename decltype(part)::Row;
      const R values = R::template spread<part.first>(load_quad(r.w[Dim - 1])) * R::repeat(load_quad(r.carried));
      T* first = tile + (r.tile_node + part.first) * node_values;
      unrolled<Kernel::support>([&](auto i) {
        const R plane = r.w[0][i] * values;
        T* row = first + i * plane_nodes * node_values;
        if constexpr (Dim == 2) {
          (R::load(row) + plane).store(row);
        } else {
          unrolled<Kernel::support>([&](auto j) {
            T* line = row + j * side * node_values;
            (R::load(line) + r.w[1][j] * plane).store(line);
          });
        }
      });
    });
  }
}

}  // namespace to_grid

template <class Kernel, class Form, int Dim, class T>
void particle_to_grid(const TransferGrid<Dim, T>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                      const StressSource<Dim, T>& stress, Real dt) {
  static_assert(Kernel::support <= row_nodes);
  static_assert(Kernel::has_inertia || (Form::classical && !Form::modes), "the linear kernel has no D_p^-1");
  using BlockTile = Tile<Kernel, Dim, T>;
  BlockTile tile;
  std::conditional_t<Form::increments, BlockTile, Without<0>> carried;
  constexpr int components = SymTensor<T, Dim>::size;
  alignas(64) T tau_storage[components][chunk_particles];
  T* tau[components];
  for (int c = 0; c < components; ++c) tau[c] = tau_storage[c];
  std::vector<FormParticle<Form, T>> rows(chunk_particles);  // zeroed: unused weights and values stay 0
  const to_grid::Columns<Dim, T> columns(body, Form());
  const ColumnsAhead<Dim, T> ahead = columns.ahead(Form());
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    const IntVec<Dim> first_node = grid.topology.first_node(range.slot);
    tile.zero();
    if constexpr (Form::increments) carried.zero();
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      stress.kirchhoff_stress(begin, end, tau);
      to_grid::lane_stage<Kernel, Form>(grid.geometry, columns, ahead, first_node, begin, end, tau, dt, rows.data());
      to_grid::row_stage<Kernel, Form, Dim>(rows.data(), ahead, begin, end - begin, tile.data);
      if constexpr (Form::increments)
        to_grid::carried_stage<Kernel, Form, Dim>(rows.data(), end - begin, carried.data);
    }
    if constexpr (Form::increments) {
      carried.scatter_add(grid.topology, range.slot, grid.nodes);
      tile.scatter_add(grid.topology, range.slot, grid.changes);
    } else {
      tile.scatter_add(grid.topology, range.slot, grid.nodes);
    }
  }
}

}  // namespace mpm
