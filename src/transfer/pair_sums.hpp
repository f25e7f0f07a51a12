// The sums of one cell's particles over the pairs of its nodes, kept in registers while the particles pass.
#pragma once

#include <array>
#include <cstdint>

#include "mpm_hpc/fields/body.hpp"
#include "stencil_tile.hpp"

namespace mpm {

// Some particles, to be taken in the order of their cells: what a sum needs to know of them.
template <class T, int Values>
struct CellParticles {
  const std::uint16_t* order;  // particle i of the order is number order[i] of the columns; filled up to a whole pack
  const T* centre[3];          // as in LanePlace
  const T* conductivity;       // over the square of the slopes' length
  const T* reaction;
  const T* q[node_values];     // the scattered values
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
      V slopes[columns * free_pairs];
      for (int c = 0; c < columns; c += slopes_at_once) sum_slopes(c, begin, group_end, slopes + c * free_pairs);
      for (int c = 0; c < columns; c += sums_at_once)
        add_stencil(c, begin, group_end, slopes + c * free_pairs, stencil.at(row, 0, z));
    }
  }

 private:
  static constexpr int W = pack_width<T>;
  static constexpr int kept = 64;                       // particles whose factors are known
  static constexpr int group_particles = kept - 2 * W;  // whatever its place, a group is known as a whole

  // The sums are products of matrices: a particle's factors, each in all lanes, times its lines. As many columns (or rows)
  // are taken at once as leave registers for one side of the product and a number of the other.
  static constexpr int most_at_once(int of, int each) {
    int most = 1;
    for (int n = 1; n <= of; ++n)
      if (of % n == 0 && n * each + std::min(n, each) + 1 <= register_count) most = n;
    return most;
  }

  // Of the values: registers of a row of nodes, and rows.
  static constexpr int row_numbers = row_nodes * Values;
  static constexpr int value_lanes = std::min<int>(row_numbers, register_bytes / sizeof(T));
  static constexpr int row_registers = (Kernel::support * Values + value_lanes - 1) / value_lanes;
  static constexpr int value_rows = Dim == 2 ? Kernel::support : Kernel::support * Kernel::support;
  static constexpr int rows_at_once = most_at_once(value_rows, row_registers);
  using ValueLanes __attribute__((vector_size(value_lanes * sizeof(T)))) = T;

  // A register holds the line of a pair of the first two directions, two such lines, or part of one.
  static constexpr int width = Pairs::width;
  static constexpr int lanes = std::min<int>(register_bytes / sizeof(E), Dim == 3 && pairs % 2 == 0 ? 2 * width : width);
  static constexpr int lines = std::max(1, lanes / width), parts = std::max(1, width / lanes);
  static constexpr int columns = parts * (Dim == 2 ? 1 : pairs / lines);  // registers of a pair of the first direction
  using V __attribute__((vector_size(lanes * sizeof(E)))) = E;
  using Half __attribute__((vector_size(lanes * sizeof(E) / 2))) = E;
  // The slopes sum up to 0. So in the first direction K is summed for the pairs without node 1 only, and the sums of
  // the others follow once per cell.
  static constexpr int free_pairs = (Kernel::support - 1) * Kernel::support / 2;
  static constexpr int sums_at_once = most_at_once(columns, pairs),
                       slopes_at_once = most_at_once(columns, free_pairs);
  static constexpr bool is_free(int pair) {
    return Pairs::node(pair) != 1 && Pairs::node(pair) + Pairs::offset(pair) != 1;
  }
  // The pairs before this one that are free.
  static constexpr int free_before(int pair) {
    int count = 0;
    for (int k = 0; k < pair; ++k) count += is_free(k);
    return count;
  }
  // Factors of direction a are the numbers from w_of(a) and k_of(a) on; of k_of(0) there are the free pairs only.
  static constexpr int factors = 2 * last * pairs;
  static constexpr int w_of(int a) { return 2 * a * pairs; }
  static constexpr int k_of(int a) { return w_of(a) + pairs; }
  // Particle i's first number where packs of particles have that many. Number n is n * W further on.
  template <int Numbers>
  static int first_number(int i) {
    static constexpr auto places = [] {
      std::array<int, kept> place{};
      for (int k = 0; k < kept; ++k) place[k] = k / W * Numbers * W + k % W;
      return place;
    }();
    return places[i % kept];
  }
  const E* factors_of(int i) const { return factors_[0][0] + first_number<factors>(i); }

  // The numbers of the pack of particles that `order` begins with, converted to S's.
  template <class S, class From>
  static S gathered(const From* column, const std::uint16_t* order) {
    using To = typename PackTraits<S>::Scalar;
    constexpr int step = detail::register_width<To, W>;
    S out;
    for (int i = 0; i < W; i += step) {
      const auto part = [&]<int... I>(std::integer_sequence<int, I...>) {
        return detail::NativeVector<To, step>{static_cast<To>(column[order[i + I]])...};
      }(std::make_integer_sequence<int, step>());
      std::memcpy(out.data() + i, &part, sizeof(part));
    }
    return out;
  }

  void find_factors() {
    using S = Pack<T>;
    using P = Eigen::Array<E, W, 1>;
    constexpr int support = Kernel::support;
    const int pack = ready_ % kept / W;
    const auto f = factors_[pack];
    S weights[Dim][support];
    P w[support], g[support];
    const std::uint16_t* order = particles_.order + ready_;
    const auto find = [&](int a) {
      const S of_particles = gathered<S>(particles_.centre[a], order);
      Kernel::weights(S(static_cast<T>(1) - of_particles), weights[a]);
      const P centre = load<P>(of_particles.data());
      Kernel::weights(P(static_cast<E>(1) - centre), w);
      ScalarSlopes<Kernel>::template of<E>(centre, w, g);
    };
    const auto keep = [](E* to, const P& factor) { std::memcpy(to, factor.data(), W * sizeof(E)); };
    for (int a = 0; a < last; ++a) {
      find(a);
      unrolled<pairs>([&](auto k) {
        constexpr int n = Pairs::node(k), m = n + Pairs::offset(k);
        keep(f[w_of(a) + k], w[n] * w[m]);
        if (a > 0) {
          keep(f[k_of(a) + k], g[n] * g[m]);
        } else if constexpr (is_free(k)) {
          keep(f[k_of(0) + free_before(k)], g[n] * g[m]);
        }
      });
    }
    find(last);
    for (int n = 0; n < value_rows; ++n)
      store(weights_[pack][n], Dim == 2 ? weights[0][n] : S(weights[0][n / support] * weights[1][n % support]));
    alignas(64) E inner[2][width][W] = {};
    const P conductivity = gathered<P>(particles_.conductivity, order), reaction = gathered<P>(particles_.reaction, order);
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
    if constexpr (Values == node_values) {
      alignas(64) T weight[4][W] = {};
      for (int n = 0; n < support; ++n) store(weight[n], weights[last][n]);
      alignas(64) T along[W][4], q[W][4];
      packs_to_quads<T, W>(weight[0], weight[1], weight[2], weight[3], along[0], 4);
      S values[4];
      for (int n = 0; n < 4; ++n) values[n] = gathered<S>(particles_.q[n], order);
      packs_to_quads<T, W>(values[0].data(), values[1].data(), values[2].data(), values[3].data(), q[0], 4);
      for (int l = 0; l < W; ++l)
        (Row<T>::spread(load_quad(along[l])) * Row<T>::repeat(load_quad(q[l]))).store(row_[ready_ % kept + l]);
    } else {
      alignas(64) T numbers[row_numbers][W] = {};
      S values[Values];
      for (int n = 0; n < Values; ++n) values[n] = gathered<S>(particles_.q[n], order);
      for (int n = 0; n < support * Values; ++n) store(numbers[n], S(values[n % Values] * weights[last][n / Values]));
      for (int n = 0; n < row_numbers; n += 4)
        packs_to_quads<T, W>(numbers[n], numbers[n + 1], numbers[n + 2], numbers[n + 3], row_[ready_ % kept] + n, row_numbers);
    }
  }

  void add_values(int begin, int end, T* first) {
    constexpr int side = Tile<Kernel, Dim, T>::side, support = Kernel::support;
    for (int n = 0; n < value_rows; n += rows_at_once) {
      ValueLanes sum[rows_at_once * row_registers];
      const auto row = [first, n](int m) {
        return first + (Dim == 2 ? n + m : (n + m) / support * side + (n + m) % support) * side * Values;
      };
#pragma GCC unroll 32
      for (int k = 0; k < rows_at_once * row_registers; ++k)
        std::memcpy(&sum[k], row(k / row_registers) + k % row_registers * value_lanes, sizeof(ValueLanes));
      for (int i = begin; i < end; ++i) {
        const T *weight = weights_[0][n] + first_number<value_rows>(i), *values = row_[i % kept];
        ValueLanes line[row_registers];
#pragma GCC unroll 4
        for (int r = 0; r < row_registers; ++r) std::memcpy(&line[r], values + r * value_lanes, sizeof(ValueLanes));
#pragma GCC unroll 16
        for (int m = 0; m < rows_at_once; ++m)
#pragma GCC unroll 4
          for (int r = 0; r < row_registers; ++r) sum[m * row_registers + r] += weight[m * W] * line[r];
      }
#pragma GCC unroll 32
      for (int k = 0; k < rows_at_once * row_registers; ++k)
        std::memcpy(row(k / row_registers) + k % row_registers * value_lanes, &sum[k], sizeof(ValueLanes));
    }
  }

  // A particle's line, in all lines of the register, or the part of it.
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
  // a in the lanes of the register's first line, b in those of the second. Written out, so that GCC takes both from memory: it
  // would add the zero of V{} + a.
  static V in_lines(E a, E b) {
    return [&]<int... L>(std::integer_sequence<int, L...>) {
      const V of_a{(static_cast<void>(L), a)...}, of_b{(static_cast<void>(L), b)...};
      return __builtin_shufflevector(of_a, of_b, (L < width ? L : lanes + L)...);
    }(std::make_integer_sequence<int, lanes>());
  }
  // A line times a particle's factor of pair y of the second direction (and of the next one, in the next line).
  static V times(const E* of_pairs, const V& line) {
    if constexpr (lines == 2) {
      return in_lines(of_pairs[0], of_pairs[W]) * line;
    } else {
      return of_pairs[0] * line;
    }
  }
  static constexpr int pair_of(int column) { return column / parts * lines; }
  // Where the line of a pair of the second direction stands behind that of the first one, in the tile.
  static constexpr auto places = [] {
    std::array<int, pairs> place{};
    if constexpr (Dim == 3)
      for (int y = 0; y < pairs; ++y)
        place[y] = StencilTile<Kernel, Dim, E>::place(Pairs::node(y), Pairs::offset(y), 0);
    return place;
  }();

  // By column and free pair of the first direction the sums of K_x W_y k W_z.
  void sum_slopes(int first, int begin, int end, V* sums) const {
    V sum[slopes_at_once * free_pairs];
#pragma GCC unroll 40
    for (int n = 0; n < slopes_at_once * free_pairs; ++n) sum[n] = V{};
    for (int i = begin; i < end; ++i) {
      const E *f = factors_of(i), *k = f + k_of(0) * W, *w = f + w_of(last - 1) * W;
#pragma GCC unroll 16
      for (int c = 0; c < slopes_at_once; ++c) {
        V b = line_of(inner_[i % kept][1], (first + c) % parts);
        if constexpr (Dim == 3) b = times(w + pair_of(first + c) * W, b);
#pragma GCC unroll 6
        for (int n = 0; n < free_pairs; ++n) sum[c * free_pairs + n] += k[n * W] * b;
      }
    }
#pragma GCC unroll 40
    for (int n = 0; n < slopes_at_once * free_pairs; ++n) sums[n] = sum[n];
  }

  // Adds the sums of some columns, those of the slopes included, to the entries of the cell's first node and behind it.
  void add_stencil(int first, int begin, int end, const V* slopes, E* entries) const {
    using Tile = StencilTile<Kernel, Dim, E>;
    constexpr int rows = Dim == 2 ? 1 : Tile::side, planes = Dim == 2 ? 1 : Kernel::support;  // to the next of the first direction
    V sum[sums_at_once * pairs];
#pragma GCC unroll 16
    for (int c = 0; c < sums_at_once; ++c) combine_slopes(slopes + c * free_pairs, sum + c * pairs);
    for (int i = begin; i < end; ++i) {
      const E *f = factors_of(i), *x = f + w_of(0) * W, *w = f + w_of(last - 1) * W, *k = f + k_of(last - 1) * W;
      V a[sums_at_once];
#pragma GCC unroll 16
      for (int c = 0; c < sums_at_once; ++c) {
        a[c] = line_of(inner_[i % kept][0], (first + c) % parts);
        if constexpr (Dim == 3) a[c] = times(w + pair_of(first + c) * W, a[c]);
      }
      if constexpr (Dim == 3) {
#pragma GCC unroll 16
        for (int c = 0; c < sums_at_once; ++c)
          a[c] += times(k + pair_of(first + c) * W, line_of(inner_[i % kept][1], (first + c) % parts));
      }
#pragma GCC unroll 10
      for (int n = 0; n < pairs; ++n)
#pragma GCC unroll 16
        for (int c = 0; c < sums_at_once; ++c) sum[c * pairs + n] += x[n * W] * a[c];
    }
    for (int c = 0; c < sums_at_once; ++c)
      for (int n = 0; n < lines; ++n) {
        E* line = entries + places[pair_of(first + c) + n] + (first + c) % parts * lanes;
#pragma GCC unroll 10
        for (int k = 0; k < pairs; ++k)
          add_to(line + Tile::place(rows * Pairs::node(k), planes * Pairs::offset(k), 0), sum[c * pairs + k], n);
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
  static void combine_slopes(const V* free, V* sum) {
    unrolled<pairs>([&](auto k) {
      sum[k] = V{};
      unrolled<free_pairs>([&](auto j) {
        constexpr int count = count_in(k, j);
        if constexpr (count != 0) sum[k] = add_multiple<count>(sum[k], free[j]);
      });
    });
  }

  CellParticles<T, Values> particles_;
  int ready_ = 0;  // particles whose factors have been found
  alignas(64) E factors_[kept / W][factors][W];
  alignas(64) T weights_[kept / W][value_rows][W];
  alignas(64) E inner_[kept][2][width];
  alignas(64) T row_[kept][row_numbers];
};

}  // namespace mpm
