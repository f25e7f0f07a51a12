#include "mpm_hpc/transfer/operator_stencil.hpp"

#include <algorithm>

#include "mpm_hpc/transfer/cell_order.hpp"
#include "mpm_hpc/transfer/lanes.hpp"

namespace mpm {

namespace {

// Particles handled between two sorts by cell: those of a block, unless it is very full.
constexpr int batch_particles = 2048;
// Particles of a cell whose factors wait in L1 while the sums stay in registers.
constexpr int group_particles = 12;

// In double one cache line, or two with four values: what a cell needs of a particle comes from L2.
template <class T, int Values>
struct alignas(64) CellParticle {
  T centre[3];     // as in LanePlace
  T conductivity;  // behind centre, to be written with it
  T q[Values];     // the scattered values
  T reaction;      // likewise behind a single value
};

// Lane n * support + o of a register belongs to the pair of nodes n and n + o of one direction. That is also their place
// in a line of the tile, whose nodes have `support` offsets each: a cell's sums are added to a line at once.
template <class Kernel, class T>
struct PairLanes {
  static constexpr int support = Kernel::support;
  static_assert(support <= 3, "the unused lanes take the fourth weight, which must be 0");
  static constexpr int pairs = support * (support + 1) / 2;
  static constexpr int width = support == 3 ? 8 : 4;
  using V __attribute__((vector_size(width * sizeof(T)))) = T;

  static constexpr int first(int lane) { return is_pair(lane) ? lane / support : 3; }
  static constexpr int second(int lane) { return is_pair(lane) ? lane / support + lane % support : 3; }
  static constexpr bool is_pair(int lane) { return lane < support * support && lane / support + lane % support < support; }
  // Lane, node and offset of pair k.
  static constexpr int lane(int k) {
    int found = 0;
    for (int l = 0; l < width; ++l)
      if (is_pair(l) && found++ == k) return l;
    return -1;
  }
  static constexpr int node(int k) { return lane(k) / support; }
  static constexpr int offset(int k) { return lane(k) % support; }

  static V products(const Quad<T>& w) { return products(w, std::make_integer_sequence<int, width>()); }

 private:
  template <int... L>
  static V products(const Quad<T>& w, std::integer_sequence<int, L...>) {
    return __builtin_shufflevector(w, w, first(L)...) * __builtin_shufflevector(w, w, second(L)...);
  }
};

// The stencil's tile: by plane of offsets and row of nodes a line along the last direction.
template <class Kernel, int Dim, class T>
class StencilTile {
 public:
  using Stencil = OperatorStencil<Kernel, Dim>;
  static constexpr int side = Tile<Kernel, Dim, T>::side;
  static constexpr int rows = Tile<Kernel, Dim, T>::rows;
  static constexpr int line = (side * Kernel::support + 7) / 8 * 8;
  // Not a multiple of 4 KiB, or the entries of a row would compete for one L1 set.
  static constexpr int plane_stride = rows * line + 56;

  StencilTile() : data_(static_cast<std::size_t>(Stencil::planes) * plane_stride, T(0)) { forget(); }

  // Entries of the first node of `row` (or behind it) with the offsets of `plane`.
  T* at(int row, int plane, int node) { return data_.data() + plane * plane_stride + row * line + node * Kernel::support; }

  void include(const int* first_node) {
    for (int a = 0; a < Dim; ++a) {
      lower_[a] = std::min(lower_[a], first_node[a]);
      upper_[a] = std::max(upper_[a], first_node[a] + Kernel::support);
    }
  }

  // Moves the sums to the grid.
  void scatter_add(const BlockTopology<Dim>& topology, Slot slot, T* stencil, T* diagonal, std::vector<char>& touched) {
    find_rows(topology, slot, stencil, touched);
    for (int plane = 0; plane < Stencil::planes; ++plane) {
      const int o[2] = {Dim == 2 ? plane : plane / Stencil::offsets, plane % Stencil::offsets};
      T* out = stencil + plane * Stencil::offsets * Stencil::nodes;
      for (int n = 0; n < used_rows_; ++n) {
        const UsedRow& r = used_[n];
        bool used = true;  // boxes end inside the nodes that have entries
        for (int a = 0; a < Dim - 1; ++a) used = used && r.t[a] + o[a] < upper_[a];
        if (!used) continue;
        add_part<0>(r, plane, out, diagonal);
        add_part<1>(r, plane, out, diagonal);
        add_part<2>(r, plane, out, diagonal);
        std::fill(at(r.row, plane, 0), at(r.row, plane, 0) + line, T(0));
      }
    }
    forget();
  }

 private:
  // A row of nodes that has entries: its place, and for its parts before the block, in it and behind it the nodes' first
  // number in the grid, or none.
  struct UsedRow {
    int row, t[2];
    std::ptrdiff_t block[3], node;
  };
  void find_rows(const BlockTopology<Dim>& topology, Slot slot, T* stencil, std::vector<char>& touched) {
    const Slot* around = topology.neighbours(slot);
    used_rows_ = 0;
    for (int row = 0; row < rows; ++row) {
      UsedRow r{row, {Dim == 2 ? row : row / side, row % side}, {}, 0};
      int neighbour = 0;
      bool used = true;
      for (int a = 0; a < Dim - 1; ++a) {
        used = used && r.t[a] >= lower_[a] && r.t[a] < upper_[a];
        neighbour = 3 * neighbour + (r.t[a] < 1 ? 0 : r.t[a] < 1 + block_side ? 1 : 2);
        r.node = block_side * r.node + ((r.t[a] - 1) & (block_side - 1));
      }
      if (!used) continue;
      r.node *= block_side;
      for (int part = 0; part < 3; ++part) {
        const bool has = first_of(part) < upper_[Dim - 1] && first_of(part + 1) > lower_[Dim - 1];
        r.block[part] = has ? around[3 * neighbour + part] : no_slot;
        if (!has || touched[static_cast<std::size_t>(r.block[part])]) continue;
        touched[static_cast<std::size_t>(r.block[part])] = 1;
        std::memset(stencil + r.block[part] * Stencil::block_values, 0, Stencil::block_values * sizeof(T));
      }
      used_[used_rows_++] = r;
    }
  }
  // First node of a row's part in the block before, in the block, and behind it.
  static constexpr int first_of(int part) { return part == 0 ? 0 : part == 1 ? 1 : part == 2 ? 1 + block_side : side; }

  template <int Part>
  void add_part(const UsedRow& r, int plane, T* stencil, T* diagonal) {
    if (r.block[Part] == no_slot) return;
    T* out = stencil + r.block[Part] * Stencil::block_values + r.node;
    add_line<Part>(at(r.row, plane, first_of(Part)), out, std::make_integer_sequence<int, Stencil::offsets>());
    // The next plane's, which come from far.
    for (int o = 0; o < Stencil::offsets; ++o) __builtin_prefetch(out + (Stencil::offsets + o) * Stencil::nodes, 1);
    if (plane != 0) return;
    T* d = diagonal + r.block[Part] * Stencil::nodes + r.node;
    for (int n = first_of(Part); n < first_of(Part + 1); ++n) d[(n - 1) & (block_side - 1)] += *at(r.row, 0, n);
  }
  // For each offset o, the line's entries for the block's four nodes; those outside of the part are 0.
  template <int Part, int... O>
  static void add_line(const T* in, T* out, std::integer_sequence<int, O...>) {
    using V = typename PairLanes<Kernel, T>::V;
    V a, b;
    std::memcpy(&a, in, sizeof(a));
    if constexpr (Part == 1) {
      std::memcpy(&b, in + PairLanes<Kernel, T>::width, sizeof(b));
    } else {
      b = V{};
    }
    auto add = [](T* to, const Quad<T>& what) {
      const Quad<T> sum = load_quad(to) + what;
      std::memcpy(to, &sum, sizeof(sum));
    };
    // Behind the block are at most three nodes; the last one has no entry beyond the first register.
    constexpr int N = Stencil::offsets, none = PairLanes<Kernel, T>::width;
    if constexpr (Part == 0) {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, none, none, none, O)), ...);
    } else if constexpr (Part == 1) {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, O, N + O, 2 * N + O, 3 * N + O)), ...);
    } else {
      (add(out + O * Stencil::nodes, __builtin_shufflevector(a, b, O, N + O, 2 * N + O < none ? 2 * N + O : none, none)), ...);
    }
  }
  void forget() {
    std::fill(lower_, lower_ + Dim, side);
    std::fill(upper_, upper_ + Dim, 0);
  }
  std::vector<T> data_;
  UsedRow used_[rows];
  int used_rows_ = 0;
  int lower_[Dim], upper_[Dim];  // of the nodes that have entries
};

// A row of nodes with one value each, as Row is one with four.
template <class T>
struct ScalarLine {
  Quad<T> q;
  friend ScalarLine operator+(ScalarLine x, ScalarLine y) { return {x.q + y.q}; }
  friend ScalarLine operator*(T s, ScalarLine x) { return {s * x.q}; }
};

// Sums of the particles of one cell. A particle's entries are the outer product of factors over the pairs of nodes in the
// last direction with factors over those in the others: with W = w_n w_m and K = (w_n d_n)(w_m d_m) by direction, d_n the
// distance to node n in spacings,
//   A = W_x W_y (a W_z + k K_z) + (K_x W_y + W_x K_y) k W_z,  in 2D without y.
template <class Kernel, int Dim, class T, int Values>
class CellSums {
 public:
  using Pairs = PairLanes<Kernel, T>;
  using V = typename Pairs::V;
  using Line = std::conditional_t<Values == 1, ScalarLine<T>, Row<T>>;  // a row of nodes
  static constexpr int pairs = Pairs::pairs;
  static constexpr int outer = Dim == 2 ? 1 : pairs;  // registers of the factors over all but the last direction

  void add(const CellParticle<T, Values>* particles, const std::uint16_t* of_cell, int count, Tile<Kernel, Dim, T, Values>& values,
           StencilTile<Kernel, Dim, T>& stencil, int tile_node) {
    for (int begin = 0; begin < count; begin += group_particles) {
      const int group = std::min(count - begin, group_particles);
      for (int i = 0; i < group; ++i) factors(particles[of_cell[begin + i]], i);
      add_values(group, values.data + tile_node * Values);
      constexpr int side = StencilTile<Kernel, Dim, T>::side;
      const int z = tile_node % side, row = tile_node / side;
#ifdef __AVX512F__
      constexpr int at_once = Dim == 2 ? 1 : 3;  // 18 sums of 8 lanes fit the 32 registers
#else
      constexpr int at_once = 1;
#endif
      for (int p = 0; p < outer; p += at_once) add_stencil<at_once>(p, group, stencil, row, z);
    }
  }

 private:
  void factors(const CellParticle<T, Values>& p, int i) {
    constexpr int last = Dim - 1;
    Quad<T> w[Dim];
    V W[Dim], K[Dim];
    for (int a = 0; a < Dim; ++a) {
      w[a] = Kernel::weight_quad(1 - p.centre[a]);
      W[a] = Pairs::products(w[a]);
      K[a] = Pairs::products(w[a] * (p.centre[a] + Quad<T>{-1, 0, 1, 2}));
    }
    inner_[i][0] = p.reaction * W[last] + p.conductivity * K[last];
    inner_[i][1] = p.conductivity * W[last];
    if constexpr (Dim == 2) {
      outer_[i][0][0] = W[0];
      outer_[i][1][0] = K[0];
    } else {
#pragma GCC unroll 10
      for (int k = 0; k < pairs; ++k) {
        outer_[i][0][k] = W[0][Pairs::lane(k)] * W[1];
        outer_[i][1][k] = K[0][Pairs::lane(k)] * W[1] + W[0][Pairs::lane(k)] * K[1];
      }
    }
    if constexpr (Values == 1) {
      row_[i] = {p.q[0] * w[last]};
    } else {
      row_[i] = Row<T>::spread(w[last]) * Row<T>::repeat(load_quad(p.q));
    }
    for (int n = 0; n < Kernel::support; ++n) {
      const Quad<T> weights = Dim == 2 ? Quad<T>{w[0][n]} : w[0][n] * w[1];
      std::memcpy(row_weight_[i][n], &weights, sizeof(weights));
    }
  }

  void add_values(int group, T* first) {
    constexpr int side = Tile<Kernel, Dim, T>::side, support = Kernel::support, columns = Dim == 2 ? 1 : support;
    Line sum[support * columns];
#pragma GCC unroll 16
    for (int n = 0; n < support * columns; ++n) std::memset(&sum[n], 0, sizeof(Line));
    for (int i = 0; i < group; ++i) {
      const Line values = row_[i];
#pragma GCC unroll 16
      for (int n = 0; n < support * columns; ++n) sum[n] = sum[n] + row_weight_[i][n / columns][n % columns] * values;
    }
#pragma GCC unroll 16
    for (int n = 0; n < support * columns; ++n) {
      T* row = first + (Dim == 2 ? n : n / columns * side + n % columns) * side * Values;
      Line old;
      std::memcpy(&old, row, sizeof(Line));
      old = old + sum[n];
      std::memcpy(row, &old, sizeof(Line));
    }
  }

  // For the outer factors [begin, begin + Count), each with all pairs of its direction.
  template <int Count>
  void add_stencil(int begin, int group, StencilTile<Kernel, Dim, T>& stencil, int row, int z) {
    constexpr int side = StencilTile<Kernel, Dim, T>::side, support = Kernel::support;
    V sum[Count * pairs];
#pragma GCC unroll 40
    for (int n = 0; n < Count * pairs; ++n) sum[n] = V{};
    for (int i = 0; i < group; ++i) {
      const V a = inner_[i][0], b = inner_[i][1];
#pragma GCC unroll 40
      for (int n = 0; n < Count * pairs; ++n) {
        sum[n] += outer_[i][0][begin + n / pairs][Pairs::lane(n % pairs)] * a;
        sum[n] += outer_[i][1][begin + n / pairs][Pairs::lane(n % pairs)] * b;
      }
    }
#pragma GCC unroll 4
    for (int c = 0; c < Count; ++c) {
      const int x = Dim == 2 ? 0 : begin + c;
#pragma GCC unroll 10
      for (int k = 0; k < pairs; ++k) {
        T* line = Dim == 2 ? stencil.at(row + Pairs::node(k), Pairs::offset(k), z)
                           : stencil.at(row + Pairs::node(x) * side + Pairs::node(k),
                                        Pairs::offset(x) * support + Pairs::offset(k), z);
        V old;
        std::memcpy(&old, line, sizeof(old));
        old += sum[c * pairs + k];
        std::memcpy(line, &old, sizeof(old));
      }
    }
  }

  V outer_[group_particles][2][outer], inner_[group_particles][2];
  Line row_[group_particles];
  T row_weight_[group_particles][Kernel::support][4];
};

}  // namespace

template <class Kernel, int Values, int Dim, class T>
void scatter_values_and_stencil(const ScalarGrid<Dim>& grid, const Body<Dim>& body, const std::vector<int>& ranges,
                                ValueSource<T>& source, T* nodes, T* diagonal, T* stencil, std::vector<char>& touched) {
  using NodeTile = Tile<Kernel, Dim, T, Values>;
  constexpr int W = pack_width<T>;
  NodeTile tile;
  StencilTile<Kernel, Dim, T> stencil_tile;
  CellSums<Kernel, Dim, T, Values> sums;
  CellOrder<NodeTile::nodes> cells;
  using Particle = CellParticle<T, Values>;
  std::vector<Particle> particles(batch_particles);
  std::vector<std::uint16_t> cell_of(batch_particles);
  alignas(64) T storage[node_values + 2][chunk_particles];
  T* q[node_values];
  for (int c = 0; c < node_values; ++c) q[c] = storage[c];
  T *conductivity = storage[node_values], *reaction = storage[node_values + 1];
  const Real* x[Dim];
  for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a);
  const Real scale = Kernel::inverse_inertia / grid.geometry.spacing();
  const T scale2 = static_cast<T>(scale * scale);

  for (int number : ranges) {
    const BlockRange& range = body.ranges[number];
    const IntVec<Dim> first_node = grid.topology.first_node(range.slot);
    tile.zero();
    for (Index batch = range.begin; batch < range.end; batch += batch_particles) {
      const Index batch_end = std::min<Index>(batch + batch_particles, range.end);
      Pack<T> outside = Pack<T>::Zero();
      for (Index begin = batch; begin < batch_end; begin += chunk_particles) {
        const Index end = std::min<Index>(begin + chunk_particles, batch_end);
        source.values(begin, end, q, conductivity, reaction);
        for (Index p = begin; p < end; p += W) {
          const LanePlace<Kernel, Dim, T> lanes(grid.geometry, first_node, x, p);
          outside += lanes.outside();
          Particle* out = particles.data() + (p - batch);
          constexpr int stride = row_stride<Particle, T>;
          alignas(64) T centre[3][W] = {}, cell[W];
          const Index i = p - begin;
          for (int a = 0; a < Dim; ++a) {
            store(centre[a], lanes.centre[a]);
            prefetch_next_chunk(x[a], p);
            if (W > 8) prefetch_next_chunk(x[a] + 8, p);
          }
          for (Index l = i; l < i + W; ++l) conductivity[l] *= scale2;
          packs_to_quads<T, W>(centre[0], centre[1], centre[2], conductivity + i, out->centre, stride);
          if constexpr (Values == 1) {
            packs_to_quads<T, W>(q[0] + i, reaction + i, q[0] + i, q[0] + i, out->q, stride);
          } else {
            packs_to_quads<T, W>(q[0] + i, q[1] + i, q[2] + i, q[3] + i, out->q, stride);
            for (int l = 0; l < W; ++l) out[l].reaction = reaction[i + l];
          }
          store(cell, lanes.tile_node());
          for (int l = 0; l < W; ++l) cell_of[p - batch + l] = static_cast<std::uint16_t>(static_cast<int>(cell[l]));
        }
      }
      require_inside(outside);
      cells.build(static_cast<int>(batch_end - batch), [&cell_of](int p) { return cell_of[p]; });
      cells.for_each_cell([&](int cell, const std::uint16_t* of_cell, int count) {
        constexpr int side = NodeTile::side;
        const int first[3] = {Dim == 2 ? cell / side : cell / (side * side), Dim == 2 ? cell % side : cell / side % side,
                              cell % side};
        stencil_tile.include(first);
        sums.add(particles.data(), of_cell, count, tile, stencil_tile, cell);
      });
    }
    tile.scatter_add(grid.topology, range.slot, nodes);
    stencil_tile.scatter_add(grid.topology, range.slot, stencil, diagonal, touched);
  }
}

#define MPM_INSTANTIATE(Dim, T, Values)                                                                                 \
  template void scatter_values_and_stencil<QuadraticKernel, Values, Dim, T>(const ScalarGrid<Dim>&, const Body<Dim>&,   \
                                                                            const std::vector<int>&, ValueSource<T>&,   \
                                                                            T*, T*, T*, std::vector<char>&);
MPM_INSTANTIATE(2, float, 1)
MPM_INSTANTIATE(2, float, node_values)
MPM_INSTANTIATE(2, double, 1)
MPM_INSTANTIATE(2, double, node_values)
MPM_INSTANTIATE(3, float, 1)
MPM_INSTANTIATE(3, float, node_values)
MPM_INSTANTIATE(3, double, 1)
MPM_INSTANTIATE(3, double, node_values)
#undef MPM_INSTANTIATE

}  // namespace mpm
