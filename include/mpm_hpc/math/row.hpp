// A row of a tile: four nodes times four values, in as few registers as the machine has. GCC's and Clang's vector types keep
// this portable.
#pragma once

#include <cstring>
#include <type_traits>
#include <utility>

namespace mpm {

inline constexpr int row_nodes = 4;   // nodes per row
inline constexpr int row_values = 4; // values per node

// Four values of one node, or the four weights of a row.
template <class T>
using Quad __attribute__((vector_size(4 * sizeof(T)))) = T;

template <class T>
inline Quad<T> load_quad(const T* p) {
  Quad<T> q;
  std::memcpy(&q, p, sizeof(q));
  return q;
}

// Bytes and number of the machine's widest registers.
#if defined(__AVX512F__)
inline constexpr int register_bytes = 64, register_count = 32;
#elif defined(__AVX__)
inline constexpr int register_bytes = 32, register_count = 16;
#else
inline constexpr int register_bytes = 16, register_count = 16;
#endif

// Neighbouring nodes of a row: in one register if they fit, or else in two halves, because the compiler takes a shuffle of a
// vector that is wider than its registers apart number by number.
template <class T, int Nodes, bool InOne = Nodes == 1 || Nodes * row_values * static_cast<int>(sizeof(T)) <= register_bytes>
struct RowPart;

template <class T, int Nodes>
struct RowPart<T, Nodes, true> {
  using V __attribute__((vector_size(Nodes * row_values * sizeof(T)))) = T;
  V a;

  static RowPart load(const T* p) {
    RowPart r;
    std::memcpy(&r.a, p, sizeof(V));
    return r;
  }
  void store(T* p) const { std::memcpy(p, &a, sizeof(V)); }
  // The same four values at each node. By doubling: GCC 12 sends a shuffle of four numbers into sixteen through memory.
  static RowPart repeat(Quad<T> q) {
    if constexpr (Nodes == 1) {
      return {q};
    } else {
      const auto two = __builtin_shufflevector(q, q, 0, 1, 2, 3, 0, 1, 2, 3);
      if constexpr (Nodes == 2) {
        return {two};
      } else {
        return {__builtin_shufflevector(two, two, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7)};
      }
    }
  }
  // Value First + n of q in all values of node n.
  template <int First = 0>
  static RowPart spread(Quad<T> q) {
    if constexpr (Nodes == 1) {
      return {__builtin_shufflevector(q, q, First, First, First, First)};
    } else if constexpr (Nodes == 2 && sizeof(T) == 8) {
      return {__builtin_shufflevector(q, q, First, First, First, First, First + 1, First + 1, First + 1, First + 1)};
    } else {
      const V v = repeat(q).a;
      if constexpr (Nodes == 2) {
        return {__builtin_shufflevector(v, v, First, First, First, First, First + 5, First + 5, First + 5, First + 5)};
      } else {
        return {__builtin_shufflevector(v, v, 0, 0, 0, 0, 5, 5, 5, 5, 10, 10, 10, 10, 15, 15, 15, 15)};
      }
    }
  }
  static RowPart zero() { return {V{}}; }
  // Sum over the nodes.
  Quad<T> sum() const {
    if constexpr (Nodes == 1) {
      return a;
    } else if constexpr (Nodes == 2) {
      return __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7);
    } else {
      return __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7) +
             __builtin_shufflevector(a, a, 8, 9, 10, 11) + __builtin_shufflevector(a, a, 12, 13, 14, 15);
    }
  }
  friend RowPart operator+(RowPart x, RowPart y) { return {x.a + y.a}; }
  friend RowPart operator-(RowPart x, RowPart y) { return {x.a - y.a}; }
  friend RowPart operator*(RowPart x, RowPart y) { return {x.a * y.a}; }
  friend RowPart operator*(T s, RowPart x) { return {s * x.a}; }
};

template <class T, int Nodes>
struct RowPart<T, Nodes, false> {
  using Half = RowPart<T, Nodes / 2>;
  Half a, b;

  static RowPart load(const T* p) { return {Half::load(p), Half::load(p + Nodes / 2 * row_values)}; }
  void store(T* p) const {
    a.store(p);
    b.store(p + Nodes / 2 * row_values);
  }
  static RowPart repeat(Quad<T> q) {
    const Half half = Half::repeat(q);
    return {half, half};
  }
  template <int First = 0>
  static RowPart spread(Quad<T> q) {
    return {Half::template spread<First>(q), Half::template spread<First + Nodes / 2>(q)};
  }
  static RowPart zero() { return {Half::zero(), Half::zero()}; }
  Quad<T> sum() const { return (a + b).sum(); }
  friend RowPart operator+(const RowPart& x, const RowPart& y) { return {x.a + y.a, x.b + y.b}; }
  friend RowPart operator-(const RowPart& x, const RowPart& y) { return {x.a - y.a, x.b - y.b}; }
  friend RowPart operator*(const RowPart& x, const RowPart& y) { return {x.a * y.a, x.b * y.b}; }
  friend RowPart operator*(T s, const RowPart& x) { return {s * x.a, s * x.b}; }
};

template <class T>
using Row = RowPart<T, row_nodes>;

// out = the sums over the nodes of four rows, one quad behind the other, or with Add out += these. The rows are folded into
// each other, which takes half the shuffles of four sums by themselves.
template <bool Add = false, class T, int Nodes, bool InOne>
inline void store_sums(const RowPart<T, Nodes, InOne>& r0, const RowPart<T, Nodes, InOne>& r1,
                       const RowPart<T, Nodes, InOne>& r2, const RowPart<T, Nodes, InOne>& r3, T* out) {
  const auto put = [](auto sum, T* to) {
    decltype(sum) before;
    if constexpr (Add) {
      std::memcpy(&before, to, sizeof(before));
      sum = sum + before;
    }
    std::memcpy(to, &sum, sizeof(sum));
  };
  if constexpr (!InOne) {
    store_sums<Add>(r0.a + r0.b, r1.a + r1.b, r2.a + r2.b, r3.a + r3.b, out);
  } else if constexpr (Nodes == 1) {
    put(r0.a, out);
    put(r1.a, out + 4);
    put(r2.a, out + 8);
    put(r3.a, out + 12);
  } else if constexpr (Nodes == 2) {
    const auto pair = [](const auto& x, const auto& y) {
      return __builtin_shufflevector(x, y, 0, 1, 2, 3, 8, 9, 10, 11) +
             __builtin_shufflevector(x, y, 4, 5, 6, 7, 12, 13, 14, 15);
    };
    put(pair(r0.a, r1.a), out);
    put(pair(r2.a, r3.a), out + 8);
  } else {
    const auto halves = [](const auto& x, const auto& y) {  // x0 + x2, x1 + x3, y0 + y2, y1 + y3 by quads
      return __builtin_shufflevector(x, y, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23) +
             __builtin_shufflevector(x, y, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
    };
    const auto x = halves(r0.a, r1.a), y = halves(r2.a, r3.a);
    put(__builtin_shufflevector(x, y, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27) +
            __builtin_shufflevector(x, y, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31),
        out);
  }
}

// f(integral_constant<0>) ... f(integral_constant<N - 1>), written out: what depends on the number is decided when compiled.
template <int N, class F>
inline void unrolled(F&& f) {
  [&f]<int... I>(std::integer_sequence<int, I...>) {
    (f(std::integral_constant<int, I>()), ...);
  }(std::make_integer_sequence<int, N>());
}

// Calls f(part) for the parts in which a row stage should go through the nodes of a stencil: two nodes (and the last one).
// Four nodes of four numbers in double and five sums of them are more than sixteen registers hold. And in tiles, where a
// stencil may begin at any node, the wider an access the more often it lies across two cache lines, or overlaps with a part of
// what was just stored, which the machine can't load before it has reached the cache.
// part: first, the number of its first node, and Row, its type.
template <class T, int First, int Nodes>
struct StencilPart {
  static constexpr int first = First;
  using Row = RowPart<T, Nodes>;
};
template <class T, int Support, int First = 0, class F>
inline void for_each_part(F&& f) {
  if constexpr (First < Support) {
    constexpr int nodes = Support - First < 2 ? 1 : 2;
    f(StencilPart<T, First, nodes>());
    for_each_part<T, Support, First + nodes>(f);
  }
}

// sum + factor x for the small whole factors of a stencil, of which most are 0 or 1: the compiler may not leave out 0 x.
template <int Factor, class V>
inline V add_multiple(const V& sum, const V& x) {
  if constexpr (Factor == 0) return sum;
  if constexpr (Factor == 1) return sum + x;
  if constexpr (Factor == -1) return sum - x;
  static_assert(Factor >= -1 && Factor <= 2);
  if constexpr (Factor == 2) return sum + x + x;
}

namespace detail {

// Lanes of W, taken in pairs of Step from two packs: the shuffles of the two halves of a transpose.
template <int Step, int Half, int W, int... I, class V>
inline V interleave(const V& a, const V& b, std::integer_sequence<int, I...>) {
  return __builtin_shufflevector(a, b,
                                 (Half * W / 2 + I / (2 * Step) * Step + I % Step + (I / Step % 2 == 1 ? W : 0))...);
}

// W / 4 quads, one behind the other.
template <class T, int W>
inline auto join_quads(const T* quads, int stride) {
  const Quad<T> a = load_quad(quads), b = load_quad(quads + stride);
  const auto two = __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
  if constexpr (W == 8) {
    return two;
  } else {
    static_assert(W == 16);
    const Quad<T> c = load_quad(quads + 2 * stride), d = load_quad(quads + 3 * stride);
    const auto more = __builtin_shufflevector(c, d, 0, 1, 2, 3, 4, 5, 6, 7);
    return __builtin_shufflevector(two, more, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
  }
}

// Numbers First and First + 1 of each four of two packs; and each second number, from First on, of two packs: the shuffles
// of a transpose the other way.
template <int First, int W, int... I, class V>
inline V pairs_of_fours(const V& a, const V& b, std::integer_sequence<int, I...>) {
  return __builtin_shufflevector(a, b, (I % (W / 2) / 2 * 4 + I % 2 + First + (I < W / 2 ? 0 : W))...);
}
template <int First, int W, int... I, class V>
inline V each_second(const V& a, const V& b, std::integer_sequence<int, I...>) {
  return __builtin_shufflevector(a, b, (I % (W / 2) * 2 + First + (I < W / 2 ? 0 : W))...);
}

// Transposes four registers of 32 bytes: four by four numbers in double, in single those of each half by themselves.
template <class T>
using HalfLine __attribute__((vector_size(32))) = T;
inline void transpose(HalfLine<double>* v) {
  const auto ab = __builtin_shufflevector(v[0], v[1], 0, 4, 2, 6), ab1 = __builtin_shufflevector(v[0], v[1], 1, 5, 3, 7),
             cd = __builtin_shufflevector(v[2], v[3], 0, 4, 2, 6), cd1 = __builtin_shufflevector(v[2], v[3], 1, 5, 3, 7);
  v[0] = __builtin_shufflevector(ab, cd, 0, 1, 4, 5);
  v[1] = __builtin_shufflevector(ab1, cd1, 0, 1, 4, 5);
  v[2] = __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
  v[3] = __builtin_shufflevector(ab1, cd1, 2, 3, 6, 7);
}
inline void transpose(HalfLine<float>* v) {
  const auto low = [](const auto& x, const auto& y) { return __builtin_shufflevector(x, y, 0, 8, 1, 9, 4, 12, 5, 13); };
  const auto high = [](const auto& x, const auto& y) { return __builtin_shufflevector(x, y, 2, 10, 3, 11, 6, 14, 7, 15); };
  const auto even = [](const auto& x, const auto& y) { return __builtin_shufflevector(x, y, 0, 1, 8, 9, 4, 5, 12, 13); };
  const auto odd = [](const auto& x, const auto& y) { return __builtin_shufflevector(x, y, 2, 3, 10, 11, 6, 7, 14, 15); };
  const HalfLine<float> ab = low(v[0], v[1]), ab2 = high(v[0], v[1]), cd = low(v[2], v[3]), cd2 = high(v[2], v[3]);
  v[0] = even(ab, cd);
  v[1] = odd(ab, cd);
  v[2] = even(ab2, cd2);
  v[3] = odd(ab2, cd2);
}

}  // namespace detail

// Four packs of W numbers become W quads, quad l made of the lanes l, the one after the other `stride` numbers apart: from
// the lane stage's order to the row stage's. The packs are arrays of W numbers.
template <class T, int W>
inline void packs_to_quads(const T* a, const T* b, const T* c, const T* d, T* quads, int stride) {
#ifdef __AVX512F__
  using V __attribute__((vector_size(W * sizeof(T)))) = T;
  constexpr auto lanes = std::make_integer_sequence<int, W>();
  V p[4], ab[2], cd[2];
  std::memcpy(&p[0], a, sizeof(V));
  std::memcpy(&p[1], b, sizeof(V));
  std::memcpy(&p[2], c, sizeof(V));
  std::memcpy(&p[3], d, sizeof(V));
  ab[0] = detail::interleave<1, 0, W>(p[0], p[1], lanes);
  ab[1] = detail::interleave<1, 1, W>(p[0], p[1], lanes);
  cd[0] = detail::interleave<1, 0, W>(p[2], p[3], lanes);
  cd[1] = detail::interleave<1, 1, W>(p[2], p[3], lanes);
  V q[4] = {detail::interleave<2, 0, W>(ab[0], cd[0], lanes), detail::interleave<2, 1, W>(ab[0], cd[0], lanes),
            detail::interleave<2, 0, W>(ab[1], cd[1], lanes), detail::interleave<2, 1, W>(ab[1], cd[1], lanes)};
  for (int n = 0; n < 4; ++n)
    for (int l = 0; l < W / 4; ++l)
      std::memcpy(quads + (n * (W / 4) + l) * stride, reinterpret_cast<const T*>(&q[n]) + 4 * l, 4 * sizeof(T));
#elif defined(__AVX__)
  constexpr int wide = 32 / sizeof(T);
  for (int first = 0; first < W; first += wide) {
    detail::HalfLine<T> v[4];
    std::memcpy(&v[0], a + first, 32);
    std::memcpy(&v[1], b + first, 32);
    std::memcpy(&v[2], c + first, 32);
    std::memcpy(&v[3], d + first, 32);
    detail::transpose(v);
    for (int l = 0; l < 4; ++l) {
      if constexpr (wide == 4) {
        std::memcpy(quads + (first + l) * stride, &v[l], 32);
      } else {
        const Quad<T> low = __builtin_shufflevector(v[l], v[l], 0, 1, 2, 3),
                      high = __builtin_shufflevector(v[l], v[l], 4, 5, 6, 7);
        std::memcpy(quads + (first + l) * stride, &low, 16);
        std::memcpy(quads + (first + 4 + l) * stride, &high, 16);
      }
    }
  }
#else
  for (int l = 0; l < W; ++l) {
    const Quad<T> q{a[l], b[l], c[l], d[l]};
    std::memcpy(quads + l * stride, &q, sizeof(q));
  }
#endif
}

// The other way: W quads, `stride` numbers apart, become four packs.
template <class T, int W>
inline void quads_to_packs(const T* quads, int stride, T* a, T* b, T* c, T* d) {
#ifdef __AVX512F__
  using V __attribute__((vector_size(W * sizeof(T)))) = T;
  constexpr auto lanes = std::make_integer_sequence<int, W>();
  V q[4], ab[2], cd[2];
  // In registers: numbers written to memory in parts can't be read back at once without waiting.
  for (int n = 0; n < 4; ++n) q[n] = detail::join_quads<T, W>(quads + n * (W / 4) * stride, stride);
  for (int h = 0; h < 2; ++h) {
    ab[h] = detail::pairs_of_fours<0, W>(q[2 * h], q[2 * h + 1], lanes);
    cd[h] = detail::pairs_of_fours<2, W>(q[2 * h], q[2 * h + 1], lanes);
  }
  const V packs[4] = {detail::each_second<0, W>(ab[0], ab[1], lanes), detail::each_second<1, W>(ab[0], ab[1], lanes),
                      detail::each_second<0, W>(cd[0], cd[1], lanes), detail::each_second<1, W>(cd[0], cd[1], lanes)};
  std::memcpy(a, &packs[0], sizeof(V));
  std::memcpy(b, &packs[1], sizeof(V));
  std::memcpy(c, &packs[2], sizeof(V));
  std::memcpy(d, &packs[3], sizeof(V));
#elif defined(__AVX__)
  constexpr int wide = 32 / sizeof(T);
  for (int first = 0; first < W; first += wide) {
    detail::HalfLine<T> v[4];
    for (int l = 0; l < 4; ++l) {
      const T* q = quads + (first + l) * stride;
      if constexpr (wide == 4) {
        v[l] = load_quad(q);
      } else {
        v[l] = __builtin_shufflevector(load_quad(q), load_quad(q + 4 * stride), 0, 1, 2, 3, 4, 5, 6, 7);
      }
    }
    detail::transpose(v);
    std::memcpy(a + first, &v[0], 32);
    std::memcpy(b + first, &v[1], 32);
    std::memcpy(c + first, &v[2], 32);
    std::memcpy(d + first, &v[3], 32);
  }
#else
  for (int l = 0; l < W; ++l) {
    a[l] = quads[l * stride];
    b[l] = quads[l * stride + 1];
    c[l] = quads[l * stride + 2];
    d[l] = quads[l * stride + 3];
  }
#endif
}

}  // namespace mpm
