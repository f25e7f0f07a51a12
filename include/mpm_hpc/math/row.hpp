// A row of a tile: four nodes times four values, held in one or two wide registers. GCC's and Clang's vector types keep
// this portable: on narrower machines the compiler splits the operations.
#pragma once

#include <cstring>
#include <type_traits>
#include <utility>

namespace mpm {

inline constexpr int row_nodes = 4;   // nodes per row
inline constexpr int row_values = 4; // values per node

template <class T>
struct Row;

// Four values of one node, or the four weights of a row.
template <class T>
using Quad __attribute__((vector_size(4 * sizeof(T)))) = T;

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

template <class T>
inline Quad<T> load_quad(const T* p) {
  Quad<T> q;
  std::memcpy(&q, p, sizeof(q));
  return q;
}

}  // namespace mpm
