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
// K = g_n g_m by direction, g_n the slopes of ScalarSlopes,
//   A = W_x (W_y I + K_y k W_z) + K_x W_y k W_z with I = a W_z + k K_z,  in 2D A = W_x I + K_x k W_z.
// The factors are found for a pack of particles at a time and stay in L1 until their cells have come. Values are of type T,
// entries of type E.
template <class Kernel, int Dim, class T, int Values, class E>
class PairSums {
 public:
  using Pairs = PairLanes<Kernel, E>;
  using Line = std::conditional_t<Values == 1, ScalarLine<T>, Row<T>>;  // a row of nodes
  static constexpr int pairs = Pairs::pairs, last = Dim - 1;

  // Before the first cell of a batch.
  void begin(const CellParticles<T, Values>& particles) {
    particles_ = particles;
    ready_ = 0;
  }

  // Particles [begin, end) are those of the cell with this first node. Cells come in ascending order.
  void add(int begin, int end, Tile<Kernel, Dim, T, Values>& values, StencilTile<Kernel, Dim, E>& stencil,
           int tile_node) {
    constexpr int side = StencilTile<Kernel, Dim, E>::side;
    for (; begin < end; begin += group_particles) {
      const int group_end = std::min(end, begin + group_particles);
      for (; ready_ < group_end; ready_ += W) find_factors();
      add_values(begin, group_end, values.data + tile_node * Values);
      const int z = tile_node % side, row = tile_node / side;
      for (int p = 0; p < (Dim == 2 ? 1 : pairs); p += lines * at_once)
        for (int part = 0; part < parts; ++part) add_stencil(p, part, begin, group_end, stencil, row, z);
    }
  }

 private:
  static constexpr int W = pack_width<T>;
  static constexpr int kept = 64;                       // particles whose factors are known
  static constexpr int group_particles = kept - 2 * W;  // whatever its place, a group is known as a whole
  // A register holds the line of a pair of the first two directions, two such lines, or part of one.
  static constexpr int width = Pairs::width;
  static constexpr int lanes = std::min<int>(widest_register / sizeof(E), Dim == 3 && pairs % 2 == 0 ? 2 * width : width);
  static constexpr int lines = std::max(1, lanes / width), parts = std::max(1, width / lanes);
  using V __attribute__((vector_size(lanes * sizeof(E)))) = E;
  using Half __attribute__((vector_size(lanes * sizeof(E) / 2))) = E;
  // The slopes sum up to 0. So in the first direction K is summed for the pairs without node 1 only, and the sums of
  // the others follow once per cell.
  static constexpr int free_pairs = (Kernel::support - 1) * Kernel::support / 2;
  // Registers of lines that are summed at once, so that the sums fit the registers that there are.
  static constexpr int at_once = Dim == 2 || pairs % (2 * lines) != 0 || 2 * (pairs + free_pairs) > registers ? 1 : 2;
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
    E w[last][pairs][W], k[last][pairs][W];  // of k[0] the first free_pairs
    alignas(64) T weight[last][Kernel::support][W];
  };
  static int lane(int i) { return i % W; }
  const Factors& factors(int i) const { return factors_[i % kept / W]; }

  void find_factors() {
    using S = Pack<T>;
    using P = Eigen::Array<E, W, 1>;
    constexpr int support = Kernel::support;
    Factors& f = factors_[ready_ % kept / W];
    S weights[support];
    P w[support], g[support];
    const auto find = [&](int a) {
      Kernel::weights(S(static_cast<T>(1) - load<S>(particles_.centre[a] + ready_)), weights);
      const P centre = load<P>(particles_.centre[a] + ready_);
      Kernel::weights(P(static_cast<E>(1) - centre), w);
      ScalarSlopes<Kernel>::template of<E>(centre, w, g);
    };
    const auto keep = [](E* to, const P& factor) { std::memcpy(to, factor.data(), W * sizeof(E)); };
    for (int a = 0; a < last; ++a) {
      find(a);
      for (int n = 0; n < support; ++n) store(f.weight[a][n], weights[n]);
      unrolled<pairs>([&](auto k) {
        constexpr int n = Pairs::node(k), m = n + Pairs::offset(k);
        keep(f.w[a][k], w[n] * w[m]);
        if (a > 0) {
          keep(f.k[a][k], g[n] * g[m]);
        } else if constexpr (is_free(k)) {
          keep(f.k[0][free_before(k)], g[n] * g[m]);
        }
      });
    }
    find(last);
    alignas(64) E inner[2][width][W] = {};
    const P conductivity = load<P>(particles_.conductivity + ready_), reaction = load<P>(particles_.reaction + ready_);
    unrolled<pairs>([&](auto k) {
      constexpr int n = Pairs::node(k), m = n + Pairs::offset(k);
      const P product = w[n] * w[m];
      keep(inner[0][Pairs::lane(k)], multiply_add(reaction, product, P(conductivity * (g[n] * g[m]))));
      keep(inner[1][Pairs::lane(k)], conductivity * product);
    });
    for (int i = 0; i < 2; ++i)
      for (int l = 0; l < width; l += 4)
        packs_to_quads<E, W>(inner[i][l], inner[i][l + 1], inner[i][l + 2], inner[i][l + 3],
                             inner_[ready_ % kept][i] + l, 2 * width);
    alignas(64) T weight[4][W] = {};
    if constexpr (Values == 1) {
      for (int n = 0; n < support; ++n) store(weight[n], S(load<S>(particles_.q[0] + ready_) * weights[n]));
      packs_to_quads<T, W>(weight[0], weight[1], weight[2], weight[3],
                           reinterpret_cast<T*>(row_ + ready_ % kept), 4);
    } else {
      for (int n = 0; n < support; ++n) store(weight[n], weights[n]);
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

  // The particle's line, in all lines of the register, or the part of it.
  static V line_of(const E* line, int part) {
    V v;
    if constexpr (lines == 2) {
      Half half;
      std::memcpy(&half, line, sizeof(half));
      v = join(half, half);
    } else {
      std::memcpy(&v, line + part * lanes, sizeof(v));
    }
    return v;
  }
  static V join(Half a, Half b) {
    return [&]<int... L>(std::integer_sequence<int, L...>) {
      return __builtin_shufflevector(a, b, L...);
    }(std::make_integer_sequence<int, lanes>());
  }
  // A particle's factor of pair y of the second direction (and of the next one) in all lanes of its line.
  static V factor_of(const E (*of_pairs)[W], int y, int l) {
    if constexpr (lines == 2) {
      return join(Half{} + of_pairs[y][l], Half{} + of_pairs[y + 1][l]);
    } else {
      return V{} + of_pairs[y][l];
    }
  }
  // Adds line n of the register, or the part that it holds.
  static void add_to(E* line, const V& sum, int n) {
    const auto add = [line](auto what) {
      auto old = what;
      std::memcpy(&old, line, sizeof(old));
      old += what;
      std::memcpy(line, &old, sizeof(old));
    };
    if constexpr (lines == 2) {
      Half half;
      std::memcpy(&half, reinterpret_cast<const E*>(&sum) + n * width, sizeof(half));
      add(half);
    } else {
      add(sum);
    }
  }

  // In 3D for the pairs from `first` of the second direction, each with all pairs of the first.
  void add_stencil(int first, int part, int begin, int end, StencilTile<Kernel, Dim, E>& stencil, int row, int z) {
    constexpr int side = StencilTile<Kernel, Dim, E>::side, support = Kernel::support;
    V sum[at_once * pairs], slope_sum[at_once * free_pairs];
#pragma GCC unroll 40
    for (int n = 0; n < at_once * pairs; ++n) sum[n] = V{};
#pragma GCC unroll 40
    for (int n = 0; n < at_once * free_pairs; ++n) slope_sum[n] = V{};
    for (int i = begin; i < end; ++i) {
      const Factors& f = factors(i);
      const int l = lane(i);
      const V inner = line_of(inner_[i % kept][0], part), conductive = line_of(inner_[i % kept][1], part);
#pragma GCC unroll 4
      for (int c = 0; c < at_once; ++c) {
        V a = inner, b = conductive;
        if constexpr (Dim == 3) {
          const V w = factor_of(f.w[1], first + c * lines, l);
          a = w * inner + factor_of(f.k[1], first + c * lines, l) * conductive;
          b = w * conductive;
        }
#pragma GCC unroll 10
        for (int k = 0; k < pairs; ++k) sum[c * pairs + k] += f.w[0][k][l] * a;
#pragma GCC unroll 6
        for (int k = 0; k < free_pairs; ++k) slope_sum[c * free_pairs + k] += f.k[0][k][l] * b;
      }
    }
#pragma GCC unroll 4
    for (int c = 0; c < at_once; ++c) {
      add_slopes(slope_sum + c * free_pairs, sum + c * pairs);
#pragma GCC unroll 2
      for (int n = 0; n < lines; ++n) {
        const int y = first + c * lines + n;
#pragma GCC unroll 10
        for (int k = 0; k < pairs; ++k)
          add_to(part * lanes + (Dim == 2 ? stencil.at(row + Pairs::node(k), Pairs::offset(k), z)
                                          : stencil.at(row + Pairs::node(k) * side + Pairs::node(y),
                                                       Pairs::offset(k) * support + Pairs::offset(y), z)),
                 sum[c * pairs + k], n);
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
  alignas(64) E inner_[kept][2][width];
  Line row_[kept];
};

}  // namespace mpm
