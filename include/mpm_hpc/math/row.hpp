// A row of a tile: four nodes times four values, held in one or two registers of 64 bytes, or in four quads where there are
// none. GCC's and Clang's vector types keep this portable.
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

#ifdef __AVX512F__
template <class T>
struct Row;

template <>
struct Row<double> {
  using V __attribute__((vector_size(64))) = double;
  V a, b;

  static Row load(const double* p) {
    Row r;
    std::memcpy(&r.a, p, 64);
    std::memcpy(&r.b, p + 8, 64);
    return r;
  }
  void store(double* p) const {
    std::memcpy(p, &a, 64);
    std::memcpy(p + 8, &b, 64);
  }
  // The same four values at each node.
  static Row repeat(Quad<double> q) {
    const V v = __builtin_shufflevector(q, q, 0, 1, 2, 3, 0, 1, 2, 3);
    return {v, v};
  }
  // Value n of q in all values of node n.
  static Row spread(Quad<double> q) {
    return {__builtin_shufflevector(q, q, 0, 0, 0, 0, 1, 1, 1, 1), __builtin_shufflevector(q, q, 2, 2, 2, 2, 3, 3, 3, 3)};
  }
  static Row zero() { return {V{}, V{}}; }
  // Sum over the four nodes.
  Quad<double> sum() const {
    const V s = a + b;
    return __builtin_shufflevector(s, s, 0, 1, 2, 3) + __builtin_shufflevector(s, s, 4, 5, 6, 7);
  }
  friend Row operator+(Row x, Row y) { return {x.a + y.a, x.b + y.b}; }
  friend Row operator-(Row x, Row y) { return {x.a - y.a, x.b - y.b}; }
  friend Row operator*(Row x, Row y) { return {x.a * y.a, x.b * y.b}; }
  friend Row operator*(double s, Row x) { return {s * x.a, s * x.b}; }
};

template <>
struct Row<float> {
  using V __attribute__((vector_size(64))) = float;
  V a;

  static Row load(const float* p) {
    Row r;
    std::memcpy(&r.a, p, 64);
    return r;
  }
  void store(float* p) const { std::memcpy(p, &a, 64); }
  // By doubling, and lane by lane after that: GCC 12 sends a shuffle of four numbers into sixteen through memory.
  static Row repeat(Quad<float> q) {
    const auto two = __builtin_shufflevector(q, q, 0, 1, 2, 3, 0, 1, 2, 3);
    return {__builtin_shufflevector(two, two, 0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7)};
  }
  static Row spread(Quad<float> q) {
    const V v = repeat(q).a;
    return {__builtin_shufflevector(v, v, 0, 0, 0, 0, 5, 5, 5, 5, 10, 10, 10, 10, 15, 15, 15, 15)};
  }
  static Row zero() { return {V{}}; }
  Quad<float> sum() const {
    return __builtin_shufflevector(a, a, 0, 1, 2, 3) + __builtin_shufflevector(a, a, 4, 5, 6, 7) +
           __builtin_shufflevector(a, a, 8, 9, 10, 11) + __builtin_shufflevector(a, a, 12, 13, 14, 15);
  }
  friend Row operator+(Row x, Row y) { return {x.a + y.a}; }
  friend Row operator-(Row x, Row y) { return {x.a - y.a}; }
  friend Row operator*(Row x, Row y) { return {x.a * y.a}; }
  friend Row operator*(float s, Row x) { return {s * x.a}; }
};

// The sums over the nodes of four rows, one quad behind the other. The rows are folded into each other, which takes half
// the shuffles of four sums by themselves.
inline void store_sums(const Row<double>& r0, const Row<double>& r1, const Row<double>& r2, const Row<double>& r3,
                       double* out) {
  using V = Row<double>::V;
  const V s0 = r0.a + r0.b, s1 = r1.a + r1.b, s2 = r2.a + r2.b, s3 = r3.a + r3.b;
  const V first = __builtin_shufflevector(s0, s1, 0, 1, 2, 3, 8, 9, 10, 11) +
                  __builtin_shufflevector(s0, s1, 4, 5, 6, 7, 12, 13, 14, 15);
  const V second = __builtin_shufflevector(s2, s3, 0, 1, 2, 3, 8, 9, 10, 11) +
                   __builtin_shufflevector(s2, s3, 4, 5, 6, 7, 12, 13, 14, 15);
  std::memcpy(out, &first, sizeof(V));
  std::memcpy(out + 8, &second, sizeof(V));
}
inline void store_sums(const Row<float>& r0, const Row<float>& r1, const Row<float>& r2, const Row<float>& r3,
                       float* out) {
  using V = Row<float>::V;
  const auto halves = [](const V& x, const V& y) {  // x0 + x2, x1 + x3, y0 + y2, y1 + y3 by quads
    return __builtin_shufflevector(x, y, 0, 1, 2, 3, 4, 5, 6, 7, 16, 17, 18, 19, 20, 21, 22, 23) +
           __builtin_shufflevector(x, y, 8, 9, 10, 11, 12, 13, 14, 15, 24, 25, 26, 27, 28, 29, 30, 31);
  };
  const V x = halves(r0.a, r1.a), y = halves(r2.a, r3.a);
  const V sum = __builtin_shufflevector(x, y, 0, 1, 2, 3, 8, 9, 10, 11, 16, 17, 18, 19, 24, 25, 26, 27) +
                __builtin_shufflevector(x, y, 4, 5, 6, 7, 12, 13, 14, 15, 20, 21, 22, 23, 28, 29, 30, 31);
  std::memcpy(out, &sum, sizeof(V));
}
#else
// Without registers of 64 bytes a row is four quads: the compiler takes a shuffle of a wider vector apart number by number.
template <class T>
struct Row {
  Quad<T> a, b, c, d;

  static Row load(const T* p) { return {load_quad(p), load_quad(p + 4), load_quad(p + 8), load_quad(p + 12)}; }
  void store(T* p) const {
    std::memcpy(p, &a, sizeof(a));
    std::memcpy(p + 4, &b, sizeof(b));
    std::memcpy(p + 8, &c, sizeof(c));
    std::memcpy(p + 12, &d, sizeof(d));
  }
  // The same four values at each node.
  static Row repeat(Quad<T> q) { return {q, q, q, q}; }
  // Value n of q in all values of node n.
  static Row spread(Quad<T> q) {
    return {__builtin_shufflevector(q, q, 0, 0, 0, 0), __builtin_shufflevector(q, q, 1, 1, 1, 1),
            __builtin_shufflevector(q, q, 2, 2, 2, 2), __builtin_shufflevector(q, q, 3, 3, 3, 3)};
  }
  static Row zero() { return {Quad<T>{}, Quad<T>{}, Quad<T>{}, Quad<T>{}}; }
  // Sum over the four nodes.
  Quad<T> sum() const { return (a + b) + (c + d); }
  friend Row operator+(const Row& x, const Row& y) { return {x.a + y.a, x.b + y.b, x.c + y.c, x.d + y.d}; }
  friend Row operator-(const Row& x, const Row& y) { return {x.a - y.a, x.b - y.b, x.c - y.c, x.d - y.d}; }
  friend Row operator*(const Row& x, const Row& y) { return {x.a * y.a, x.b * y.b, x.c * y.c, x.d * y.d}; }
  friend Row operator*(T s, const Row& x) { return {s * x.a, s * x.b, s * x.c, s * x.d}; }
};

// The sums over the nodes of four rows, one quad behind the other.
template <class T>
inline void store_sums(const Row<T>& r0, const Row<T>& r1, const Row<T>& r2, const Row<T>& r3, T* out) {
  const Quad<T> sums[4] = {r0.sum(), r1.sum(), r2.sum(), r3.sum()};
  std::memcpy(out, sums, sizeof(sums));
}
#endif

// f(integral_constant<0>) ... f(integral_constant<N - 1>), written out: what depends on the number is decided when compiled.
template <int N, class F>
inline void unrolled(F&& f) {
  [&f]<int... I>(std::integer_sequence<int, I...>) {
    (f(std::integral_constant<int, I>()), ...);
  }(std::make_integer_sequence<int, N>());
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
