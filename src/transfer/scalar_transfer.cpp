#include "mpm_hpc/transfer/scalar_transfer.hpp"

#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

namespace {

// One particle of the row stages: w and slopes by direction (see RowParticle), one value per node.
template <class T>
struct alignas(64) ScalarRow {
  T w[3][4];
  T slope[3];  // per node, of what is scattered or gathered
  T value;     // at the stencil's second node
  int tile_node;
};

template <class T>
constexpr Quad<T> along() {
  return Quad<T>{-1, 0, 1, 2};
}

template <class T>
void add_quad(T* to, Quad<T> what) {
  what += load_quad(to);
  std::memcpy(to, &what, sizeof(what));
}

template <class T>
T sum_of(Quad<T> q) {
  return (q[0] + q[1]) + (q[2] + q[3]);
}

template <class Kernel, int Dim, class T>
void place(const GridGeometry<Dim>& geometry, const IntVec<Dim>& first_node, const Real* const (&x)[Dim], Index begin,
           Index end, ScalarRow<T>* rows, T (*centre)[chunk_particles]) {
  constexpr int W = pack_width<T>;
  Pack<T> outside = Pack<T>::Zero();
  for (Index p = begin; p < end; p += W) {
    const LanePlace<Kernel, Dim, T> lanes(geometry, first_node, x, p);
    outside += lanes.outside();
    prefetch_positions<T>(x, p);
    for (int a = 0; a < Dim; ++a) store(centre[a] + (p - begin), lanes.centre[a]);
    lanes.write(rows + (p - begin));
  }
  require_inside(outside);
}

// From a tile's node to row (i, j) behind it.
template <int Dim>
constexpr int row_offset(int i, int j, int side) {
  return Dim == 2 ? i * side : (i * side + j) * side;
}

// The slopes of a kernel without inertia, which are the same everywhere in a cell.
template <class Kernel, class T>
Quad<T> constant_slopes() {
  static_assert(Kernel::support == 2 && !Kernel::has_inertia);
  T g[4] = {};
  Kernel::gradients(T(0), g);
  return load_quad(g);
}

// value = sum w x, slope[b] = sum g_b x with the slopes times the weights of the other directions.
template <class Kernel, int Dim, class T>
void gather_rows_by_slopes(ScalarRow<T>* rows, int count, const T* tile) {
  constexpr int side = Tile<Kernel, Dim, T, 1>::side, columns = Dim == 2 ? 1 : Kernel::support;
  const Quad<T> g = constant_slopes<Kernel, T>();
  for (int p = 0; p < count; ++p) {
    ScalarRow<T>& r = rows[p];
    const Quad<T> w = load_quad(r.w[Dim - 1]);
    Quad<T> value{}, slope[2] = {};
    for (int i = 0; i < Kernel::support; ++i)
      for (int j = 0; j < columns; ++j) {
        const Quad<T> row = load_quad(tile + r.tile_node + row_offset<Dim>(i, j, side));
        const T other = Dim == 2 ? T(1) : r.w[1][j];
        value += r.w[0][i] * other * row;
        slope[0] += g[i] * other * row;
        if (Dim == 3) slope[1] += r.w[0][i] * g[j] * row;
      }
    r.value = sum_of<T>(w * value);
    for (int a = 0; a < Dim - 1; ++a) r.slope[a] = sum_of<T>(w * slope[a]);
    r.slope[Dim - 1] = sum_of<T>(g * value);
  }
}

// value = sum w x, slope[b] = sum w (n_b - 1) x.
template <class Kernel, int Dim, class T>
void gather_rows(ScalarRow<T>* rows, int count, const T* tile) {
  constexpr int side = Tile<Kernel, Dim, T, 1>::side;
  for (int p = 0; p < count; ++p) {
    ScalarRow<T>& r = rows[p];
    const T* first = tile + r.tile_node;
    const Quad<T> w = load_quad(r.w[Dim - 1]);
    Quad<T> value{}, slope_x{};
    if constexpr (Dim == 2) {
      unrolled<Kernel::support>([&](auto i) {
        const Quad<T> weighted = r.w[0][i] * load_quad(first + i * side);
        value += weighted;
        slope_x = add_multiple<i - 1>(slope_x, weighted);
      });
    } else {
      Quad<T> slope_y{};
      unrolled<Kernel::support>([&](auto i) {
        Quad<T> plane{}, tilt{};
        unrolled<Kernel::support>([&](auto j) {
          const Quad<T> weighted = r.w[1][j] * load_quad(first + (i * side + j) * side);
          plane += weighted;
          tilt = add_multiple<j - 1>(tilt, weighted);
        });
        const Quad<T> weighted = r.w[0][i] * plane;
        value += weighted;
        slope_x = add_multiple<i - 1>(slope_x, weighted);
        slope_y += r.w[0][i] * tilt;
      });
      r.slope[1] = sum_of<T>(w * slope_y);
    }
    value *= w;
    r.value = sum_of<T>(value);
    r.slope[0] = sum_of<T>(w * slope_x);
    r.slope[Dim - 1] = sum_of<T>(along<T>() * value);
  }
}

// value = sum w x alone.
template <class Kernel, int Dim, class T>
void gather_value_rows(ScalarRow<T>* rows, int count, const T* tile) {
  constexpr int side = Tile<Kernel, Dim, T, 1>::side;
  for (int p = 0; p < count; ++p) {
    ScalarRow<T>& r = rows[p];
    const T* first = tile + r.tile_node;
    Quad<T> value{};
    unrolled<Kernel::support>([&](auto i) {
      if constexpr (Dim == 2) {
        value += r.w[0][i] * load_quad(first + i * side);
      } else {
        Quad<T> plane{};
        unrolled<Kernel::support>([&](auto j) { plane += r.w[1][j] * load_quad(first + (i * side + j) * side); });
        value += r.w[0][i] * plane;
      }
    });
    r.value = sum_of<T>(value * load_quad(r.w[Dim - 1]));
  }
}

// tile += w value + sum_b g_b slope[b], the slopes times the weights of the other directions.
template <class Kernel, int Dim, class T>
void scatter_rows_by_slopes(const ScalarRow<T>* rows, int count, T* tile) {
  constexpr int side = Tile<Kernel, Dim, T, 1>::side, columns = Dim == 2 ? 1 : Kernel::support;
  const Quad<T> g = constant_slopes<Kernel, T>();
  for (int p = 0; p < count; ++p) {
    const ScalarRow<T>& r = rows[p];
    const Quad<T> w = load_quad(r.w[Dim - 1]), centre = r.value * w + r.slope[Dim - 1] * g;
    for (int i = 0; i < Kernel::support; ++i)
      for (int j = 0; j < columns; ++j) {
        T* row = tile + r.tile_node + row_offset<Dim>(i, j, side);
        const T other = Dim == 2 ? T(1) : r.w[1][j];
        Quad<T> sum = r.w[0][i] * other * centre + g[i] * other * r.slope[0] * w;
        if (Dim == 3) sum += r.w[0][i] * g[j] * r.slope[1] * w;
        add_quad<T>(row, sum);
      }
  }
}

// tile += w (value + sum_b (n_b - 1) slope[b]).
template <class Kernel, int Dim, class T>
void scatter_rows(const ScalarRow<T>* rows, int count, T* tile) {
  constexpr int side = Tile<Kernel, Dim, T, 1>::side;
  for (int p = 0; p < count; ++p) {
    const ScalarRow<T>& r = rows[p];
    const Quad<T> w = load_quad(r.w[Dim - 1]);
    const Quad<T> centre = w * (r.value + along<T>() * r.slope[Dim - 1]), slope_x = w * r.slope[0];
    T* first = tile + r.tile_node;
    unrolled<Kernel::support>([&](auto i) {
      const Quad<T> plane = r.w[0][i] * add_multiple<i - 1>(centre, slope_x);
      if constexpr (Dim == 2) {
        add_quad<T>(first + i * side, plane);
      } else {
        const Quad<T> tilt = r.w[0][i] * (w * r.slope[1]);
        unrolled<Kernel::support>([&](auto j) {
          add_quad<T>(first + (i * side + j) * side, r.w[1][j] * add_multiple<j - 1>(plane, tilt));
        });
      }
    });
  }
}

// Values of the nodes and the diagonal of the operator, which is separable: with W_n = w_n^2 and K_n = g_n^2,
// g_n the slopes, A_ii = (k scale^2 h^-2) (K_x W_y W_z + W_x K_y W_z + W_x W_y K_z) + a W_x W_y W_z.
template <class Kernel, int Values, int Dim, class T>
void scatter_value_rows(const ScalarRow<T>* rows, int count, const T* const* q, const T (*centre)[chunk_particles],
                        const T* conductivity, const T* reaction, T* tile, T* diagonal_tile) {
  constexpr int side = Tile<Kernel, Dim, T>::side;
  for (int p = 0; p < count; ++p) {
    const ScalarRow<T>& r = rows[p];
    T W[Dim][4] = {}, K[Dim][4] = {};
    for (int a = 0; a < Dim; ++a) {
      T g[Kernel::support];
      ScalarSlopes<Kernel>::template of<T>(centre[a][p], r.w[a], g);
      for (int n = 0; n < Kernel::support; ++n) {
        W[a][n] = r.w[a][n] * r.w[a][n];
        K[a][n] = g[n] * g[n];
      }
    }
    Quad<T> values[Values];  // of the row's nodes, one behind the other
    unrolled<row_nodes * Values>([&](auto k) { values[k / 4][k % 4] = r.w[Dim - 1][k / Values] * q[k % Values][p]; });
    const Quad<T> square = conductivity[p] * load_quad(W[Dim - 1]), moment = conductivity[p] * load_quad(K[Dim - 1]) + reaction[p] * load_quad(W[Dim - 1]);
    for (int i = 0; i < Kernel::support; ++i)
      for (int j = 0; j < (Dim == 2 ? 1 : Kernel::support); ++j) {
        const int node = r.tile_node + row_offset<Dim>(i, j, side);
        T weight = r.w[0][i], squares = W[0][i], moments = K[0][i];
        if constexpr (Dim == 3) {
          moments = moments * W[1][j] + squares * K[1][j];
          squares *= W[1][j];
          weight *= r.w[1][j];
        }
        for (int k = 0; k < Values; ++k) add_quad<T>(tile + node * Values + 4 * k, weight * values[k]);
        add_quad<T>(diagonal_tile + node, moments * square + squares * moment);
      }
  }
}

template <int Dim>
struct Positions {
  const Real* x[Dim];
  explicit Positions(const Body<Dim>& body) {
    for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a);
  }
};

template <class Kernel, int Dim>
Real gradient_scale(const GridGeometry<Dim>& geometry) {
  return ScalarSlopes<Kernel>::scale / geometry.spacing();
}

// value = sum w x; the slopes want finish_slopes.
template <class Kernel, int Dim, class T>
void gather_slopes(ScalarRow<T>* rows, int count, const T* tile) {
  if constexpr (Kernel::has_inertia) {
    gather_rows<Kernel, Dim>(rows, count, tile);
  } else {
    gather_rows_by_slopes<Kernel, Dim>(rows, count, tile);
  }
}
// slope[a] = sum of slopes times x.
template <class Kernel, int Dim, class T>
void finish_slopes(ScalarRow<T>& r, const T (*centre)[chunk_particles], Index p) {
  if constexpr (Kernel::has_inertia)
    for (int a = 0; a < Dim; ++a) r.slope[a] += centre[a][p] * r.value;
}

// Before scatter_slopes, which adds w value and the slopes times slope[a] to the nodes.
template <class Kernel, int Dim, class T>
void prepare_slopes(ScalarRow<T>& r, const T (*centre)[chunk_particles], Index p) {
  if constexpr (Kernel::has_inertia)
    for (int a = 0; a < Dim; ++a) r.value += r.slope[a] * centre[a][p];
}
template <class Kernel, int Dim, class T>
void scatter_slopes(const ScalarRow<T>* rows, int count, T* tile) {
  if constexpr (Kernel::has_inertia) {
    scatter_rows<Kernel, Dim>(rows, count, tile);
  } else {
    scatter_rows_by_slopes<Kernel, Dim>(rows, count, tile);
  }
}

}  // namespace

template <class Kernel, int Values, int Dim, class T>
void scatter_values(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                    ValueSource<T>& source, T* nodes, T* diagonal) {
  Tile<Kernel, Dim, T, Values> tile;
  Tile<Kernel, Dim, T, 1> diagonal_tile;
  std::vector<ScalarRow<T>> rows(chunk_particles);
  alignas(64) T centre[Dim][chunk_particles], storage[node_values + 2][chunk_particles];
  T* q[node_values];
  for (int c = 0; c < node_values; ++c) q[c] = storage[c];
  T *conductivity = storage[node_values], *reaction = storage[node_values + 1];
  const Positions<Dim> positions(body);
  const Real scale = gradient_scale<Kernel>(grid.geometry);
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    tile.zero();
    diagonal_tile.zero();
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      source.values(begin, end, q, conductivity, reaction);
      place<Kernel, Dim>(grid.geometry, grid.topology.first_node(range.slot), positions.x, begin, end, rows.data(),
                         centre);
      for (Index p = 0; p < end - begin; ++p) conductivity[p] *= static_cast<T>(scale * scale);
      scatter_value_rows<Kernel, Values, Dim>(rows.data(), end - begin, q, centre, conductivity, reaction, tile.data,
                                      diagonal_tile.data);
    }
    tile.scatter_add(grid.topology, range.slot, nodes);
    diagonal_tile.scatter_add(grid.topology, range.slot, diagonal);
  }
}

template <class Kernel, int Dim, class T>
void apply_operator(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                    const OperatorColumns<T>& columns, const T* x, T* y) {
  Tile<Kernel, Dim, T, 1> in, out;
  std::vector<ScalarRow<T>> rows(chunk_particles);
  alignas(64) T centre[Dim][chunk_particles];
  const Positions<Dim> positions(body);
  const Real scale = gradient_scale<Kernel>(grid.geometry);
  const T scale2 = static_cast<T>(scale * scale);
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    in.gather(grid.topology, range.slot, x);
    out.zero();
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end), count = end - begin;
      place<Kernel, Dim>(grid.geometry, grid.topology.first_node(range.slot), positions.x, begin, end, rows.data(),
                         centre);
      gather_slopes<Kernel, Dim>(rows.data(), count, in.data);
      // The flux k grad x of each particle becomes the slopes of what it scatters, a x its value.
      for (Index p = 0; p < count; ++p) {
        ScalarRow<T>& r = rows[p];
        finish_slopes<Kernel, Dim>(r, centre, p);
        r.value = columns.reaction ? columns.reaction[begin + p] * r.value : T(0);
        for (int a = 0; a < Dim; ++a) r.slope[a] *= scale2 * columns.conductivity[begin + p];
        prepare_slopes<Kernel, Dim>(r, centre, p);
      }
      scatter_slopes<Kernel, Dim>(rows.data(), count, out.data);
    }
    out.scatter_add(grid.topology, range.slot, y);
  }
}

namespace {

template <class Kernel, bool WithGradient, int Dim, class T>
void gather(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges, const T* x,
            ValueSink<T>& sink) {
  Tile<Kernel, Dim, T, 1> tile;
  std::vector<ScalarRow<T>> rows(chunk_particles);
  alignas(64) T centre[Dim][chunk_particles], value[chunk_particles];
  alignas(64) T gradient_storage[Dim][chunk_particles];
  const T* gradient[Dim];
  for (int a = 0; a < Dim; ++a) gradient[a] = gradient_storage[a];
  const Positions<Dim> positions(body);
  const T scale = static_cast<T>(gradient_scale<Kernel>(grid.geometry));
  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    tile.gather(grid.topology, range.slot, x);
    for (Index begin = range.begin; begin < range.end; begin += chunk_particles) {
      const Index end = std::min<Index>(begin + chunk_particles, range.end);
      place<Kernel, Dim>(grid.geometry, grid.topology.first_node(range.slot), positions.x, begin, end, rows.data(),
                         centre);
      if constexpr (WithGradient) {
        gather_slopes<Kernel, Dim>(rows.data(), end - begin, tile.data);
        for (Index p = 0; p < end - begin; ++p) {
          finish_slopes<Kernel, Dim>(rows[p], centre, p);
          for (int a = 0; a < Dim; ++a) gradient_storage[a][p] = scale * rows[p].slope[a];
        }
      } else {
        gather_value_rows<Kernel, Dim>(rows.data(), end - begin, tile.data);
      }
      for (Index p = 0; p < end - begin; ++p) value[p] = rows[p].value;
      sink.values(begin, end, value, WithGradient ? gradient : nullptr);
    }
  }
}

}  // namespace

template <class Kernel, int Dim, class T>
void gather_scalar(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges, const T* x,
                   ValueSink<T>& sink) {
  gather<Kernel, true>(grid, body, ranges, x, sink);
}

template <class Kernel, int Dim, class T>
void gather_value(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges, const T* x,
                  ValueSink<T>& sink) {
  gather<Kernel, false>(grid, body, ranges, x, sink);
}

#define MPM_INSTANTIATE_VALUES(Kernel, Dim, T, Values)                                                                       \
  template void scatter_values<Kernel, Values, Dim, T>(const ScalarGrid<Dim>&, const Body<Dim>&, const std::vector<int>&,    \
                                                       ValueSource<T>&, T*, T*);
#define MPM_INSTANTIATE(Kernel, Dim, T)                                                                                      \
  MPM_INSTANTIATE_VALUES(Kernel, Dim, T, 2)                                                                                  \
  MPM_INSTANTIATE_VALUES(Kernel, Dim, T, node_values)                                                                        \
  template void apply_operator<Kernel, Dim, T>(const ScalarGrid<Dim>&, const Body<Dim>&, const std::vector<int>&,            \
                                               const OperatorColumns<T>&, const T*, T*);                                     \
  template void gather_scalar<Kernel, Dim, T>(const ScalarGrid<Dim>&, const Body<Dim>&, const std::vector<int>&, const T*,   \
                                              ValueSink<T>&);                                                                \
  template void gather_value<Kernel, Dim, T>(const ScalarGrid<Dim>&, const Body<Dim>&, const std::vector<int>&, const T*,    \
                                             ValueSink<T>&);
MPM_FOR_SCALAR_TRANSFERS(MPM_INSTANTIATE)
#undef MPM_INSTANTIATE
#undef MPM_INSTANTIATE_VALUES

}  // namespace mpm
