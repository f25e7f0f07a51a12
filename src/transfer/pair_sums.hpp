// The sums of one cell's particles over the pairs of its nodes, kept in registers while the particles pass.
#pragma once

#include "mpm_hpc/fields/body.hpp"
#include "stencil_tile.hpp"

namespace mpm {

// Some particles in the order of their cells: what a sum needs to know of them.
template <class T, int Values>
struct CellParticles {
  const T* centre[3];     // as in LanePlace
  const T* conductivity;  // over the square of the slopes' length
  const T* reaction;
  const T* q[node_values];  // the scattered values
};

// A row of nodes with one value each, as Row is one with four.
template <class T>
struct ScalarLine {
  Quad<T> q;
  friend ScalarLine operator+(ScalarLine x, ScalarLine y) { return {x.q + y.q}; }
  friend ScalarLine operator*(T s, ScalarLine x) { return {s * x.q}; }
};

// A particle's entries are the outer product of factors over the pairs of nodes in each direction: with W = w_n w_m and
// K = (w_n d_n)(w_m d_m) by direction, d_n the distance to node n in spacings,
//   A = W_x (W_y I + K_y k W_z) + K_x W_y k W_z with I = a W_z + k K_z,  in 2D A = W_x I + K_x k W_z.
// The factors are found for a pack of particles at a time and stay in L1 until their cells have come.
template <class Kernel, int Dim, class T, int Values>
class PairSums {
 public:
  using Pairs = PairLanes<Kernel, T>;
  using V = typename Pairs::V;
  using Line = std::conditional_t<Values == 1, ScalarLine<T>, Row<T>>;  // a row of nodes
  static constexpr int pairs = Pairs::pairs, last = Dim - 1;

  // Before the first cell of a batch.
  void begin(const CellParticles<T, Values>& particles) {
    particles_ = particles;
    ready_ = 0;
  }

  // Particles [begin, end) are those of the cell with this first node. Cells come in ascending order.
  void add(int begin, int end, Tile<Kernel, Dim, T, Values>& values, StencilTile<Kernel, Dim, T>& stencil,
           int tile_node) {
    constexpr int side = StencilTile<Kernel, Dim, T>::side;
    for (; begin < end; begin += group_particles) {
      const int group_end = std::min(end, begin + group_particles);
      for (; ready_ < group_end; ready_ += W) find_factors();
      add_values(begin, group_end, values.data + tile_node * Values);
      const int z = tile_node % side, row = tile_node / side;
#ifdef __AVX512F__
      constexpr int at_once = Dim == 2 || pairs % 2 != 0 ? 1 : 2;  // 18 sums of 8 lanes fit the 32 registers
#else
      constexpr int at_once = 1;
#endif
      for (int p = 0; p < (Dim == 2 ? 1 : pairs); p += at_once)
        add_stencil<at_once>(p, begin, group_end, stencil, row, z);
    }
  }

 private:
  static constexpr int W = pack_width<T>;
  static constexpr int kept = 64;                       // particles whose factors are known
  static constexpr int group_particles = kept - 2 * W;  // whatever its place, a group is known as a whole
  // The slopes w_n d_n sum up to 0. So in the first direction K is summed for the pairs without node 1 only, and the sums of
  // the others follow once per cell.
  static constexpr int free_pairs = (Kernel::support - 1) * Kernel::support / 2;
  static constexpr bool is_free(int pair) {
    return Pairs::node(pair) != 1 && Pairs::node(pair) + Pairs::offset(pair) != 1;
  }
  // The pairs before this one that are free.
  static constexpr int free_before(int pair) {
    int count = 0;
    for (int k = 0; k < pair; ++k) count += is_free(k);
    return count;
  }
  struct alignas(64) Factors {
    T w[last][pairs][W], k[last][pairs][W], weight[last][Kernel::support][W];  // of k[0] the first free_pairs
  };
  static int lane(int i) { return i % W; }
  const Factors& factors(int i) const { return factors_[i % kept / W]; }

  void find_factors() {
    using S = Pack<T>;
    constexpr int support = Kernel::support;
    Factors& f = factors_[ready_ % kept / W];
    S w[support], g[support], centre;
    const auto weights = [&](int a) {
      centre = load<S>(particles_.centre[a] + ready_);
      Kernel::weights(S(static_cast<T>(1) - centre), w);
      for (int n = 0; n < support; ++n) g[n] = w[n] * (centre + static_cast<T>(n - 1));
    };
    for (int a = 0; a < last; ++a) {
      weights(a);
      for (int n = 0; n < support; ++n) store(f.weight[a][n], w[n]);
      unrolled<pairs>([&](auto k) {
        constexpr int n = Pairs::node(k), m = n + Pairs::offset(k);
        store(f.w[a][k], S(w[n] * w[m]));
        if (a > 0) {
          store(f.k[a][k], S(g[n] * g[m]));
        } else if constexpr (is_free(k)) {
          store(f.k[0][free_before(k)], S(g[n] * g[m]));
        }
      });
    }
    weights(last);
    alignas(64) T inner[2][Pairs::width][W] = {};
    const S conductivity = load<S>(particles_.conductivity + ready_),
            reaction = load<S>(particles_.reaction + ready_);
    unrolled<pairs>([&](auto k) {
      constexpr int n = Pairs::node(k), m = n + Pairs::offset(k);
      const S product = w[n] * w[m];
      store(inner[0][Pairs::lane(k)], S(reaction * product + conductivity * (g[n] * g[m])));
      store(inner[1][Pairs::lane(k)], S(conductivity * product));
    });
    constexpr int stride = 2 * Pairs::width;
    T* out = reinterpret_cast<T*>(inner_[ready_ % kept]);
    for (int i = 0; i < 2; ++i)
      for (int l = 0; l < Pairs::width; l += 4)
        packs_to_quads<T, W>(inner[i][l], inner[i][l + 1], inner[i][l + 2], inner[i][l + 3],
                             out + i * Pairs::width + l, stride);
    alignas(64) T weight[4][W] = {};
    if constexpr (Values == 1) {
      for (int n = 0; n < support; ++n) store(weight[n], S(load<S>(particles_.q[0] + ready_) * w[n]));
      packs_to_quads<T, W>(weight[0], weight[1], weight[2], weight[3],
                           reinterpret_cast<T*>(row_ + ready_ % kept), 4);
    } else {
      for (int n = 0; n < support; ++n) store(weight[n], w[n]);
      alignas(64) T along[W][4], q[W][4];
      packs_to_quads<T, W>(weight[0], weight[1], weight[2], weight[3], along[0], 4);
      packs_to_quads<T, W>(particles_.q[0] + ready_, particles_.q[1] + ready_, particles_.q[2] + ready_,
                           particles_.q[3] + ready_, q[0], 4);
      for (int l = 0; l < W; ++l)
        row_[ready_ % kept + l] = Row<T>::spread(load_quad(along[l])) * Row<T>::repeat(load_quad(q[l]));
    }
  }

  void add_values(int begin, int end, T* first) {
    constexpr int side = Tile<Kernel, Dim, T>::side, support = Kernel::support,
                  columns = Dim == 2 ? 1 : support;
    Line sum[support * columns];
#pragma GCC unroll 16
    for (int n = 0; n < support * columns; ++n) std::memset(&sum[n], 0, sizeof(Line));
    for (int i = begin; i < end; ++i) {
      const Line values = row_[i % kept];
      const Factors& f = factors(i);
      const int l = lane(i);
#pragma GCC unroll 4
      for (int n = 0; n < support; ++n) {
        const Line plane = f.weight[0][n][l] * values;
#pragma GCC unroll 4
        for (int m = 0; m < columns; ++m) {
          if constexpr (Dim == 2) {
            sum[n] = sum[n] + plane;
          } else {
            sum[n * columns + m] = sum[n * columns + m] + f.weight[1][m][l] * plane;
          }
        }
      }
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

  // In 3D for the pairs [first, first + Count) of the second direction, each with all pairs of the first.
  template <int Count>
  void add_stencil(int first, int begin, int end, StencilTile<Kernel, Dim, T>& stencil, int row, int z) {
    constexpr int side = StencilTile<Kernel, Dim, T>::side, support = Kernel::support;
    V sum[Count * pairs], slope_sum[Count * free_pairs];
#pragma GCC unroll 40
    for (int n = 0; n < Count * pairs; ++n) sum[n] = V{};
#pragma GCC unroll 40
    for (int n = 0; n < Count * free_pairs; ++n) slope_sum[n] = V{};
    for (int i = begin; i < end; ++i) {
      const Factors& f = factors(i);
      const int l = lane(i);
      const V inner = inner_[i % kept][0], conductive = inner_[i % kept][1];
#pragma GCC unroll 4
      for (int c = 0; c < Count; ++c) {
        V a = inner, b = conductive;
        if constexpr (Dim == 3) {
          a = f.w[1][first + c][l] * inner + f.k[1][first + c][l] * conductive;
          b = f.w[1][first + c][l] * conductive;
        }
#pragma GCC unroll 10
        for (int k = 0; k < pairs; ++k) sum[c * pairs + k] += f.w[0][k][l] * a;
#pragma GCC unroll 6
        for (int k = 0; k < free_pairs; ++k) slope_sum[c * free_pairs + k] += f.k[0][k][l] * b;
      }
    }
#pragma GCC unroll 4
    for (int c = 0; c < Count; ++c) {
      const int y = first + c;
      add_slopes(slope_sum + c * free_pairs, sum + c * pairs);
#pragma GCC unroll 10
      for (int k = 0; k < pairs; ++k) {
        T* line = Dim == 2 ? stencil.at(row + Pairs::node(k), Pairs::offset(k), z)
                           : stencil.at(row + Pairs::node(k) * side + Pairs::node(y),
                                        Pairs::offset(k) * support + Pairs::offset(y), z);
        V old;
        std::memcpy(&old, line, sizeof(old));
        old += sum[c * pairs + k];
        std::memcpy(line, &old, sizeof(old));
      }
    }
  }

  // Times that the sum of K of free pair number j counts in that of pair k: a slope at node 1 is the others' sum with the sign
  // changed.
  static constexpr int count_in(int k, int j) {
    const auto share = [](int node, int of) { return node == 1 ? (of == 1 ? 0 : -1) : (node == of ? 1 : 0); };
    int free_pair = 0;
    while (!is_free(free_pair) || free_before(free_pair) != j) ++free_pair;
    const int n = Pairs::node(k), m = n + Pairs::offset(k), a = Pairs::node(free_pair),
              b = a + Pairs::offset(free_pair);
    return share(n, a) * share(m, b) + (a != b ? share(n, b) * share(m, a) : 0);
  }
  static void add_slopes(const V* free, V* sum) {
    unrolled<pairs>([&](auto k) {
      unrolled<free_pairs>([&](auto j) {
        constexpr int count = count_in(k, j);
        if constexpr (count != 0) sum[k] = add_multiple<count>(sum[k], free[j]);
      });
    });
  }

  CellParticles<T, Values> particles_;
  int ready_ = 0;  // particles whose factors have been found
  Factors factors_[kept / W];
  V inner_[kept][2];
  Line row_[kept];
};

}  // namespace mpm
