// A number that counts the operations done with it: a law run once with it says what it costs.
#pragma once

#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>

#include "mpm_hpc/math/simd.hpp"

namespace mpm {

// + - * / and sqrt count as one operation each, logarithms and powers as the multiply-adds of Eigen's polynomials;
// comparisons, choices and signs are free.
struct Counted {
  static constexpr std::int64_t transcendental = 25;
  static inline std::int64_t operations = 0;

  double value;
  Counted() = default;
  constexpr Counted(double v) : value(v) {}
  constexpr operator double() const { return value; }

  Counted operator-() const { return -value; }
  Counted& operator+=(Counted b) { return *this = counted(value + b.value); }
  Counted& operator-=(Counted b) { return *this = counted(value - b.value); }
  Counted& operator*=(Counted b) { return *this = counted(value * b.value); }
  Counted& operator/=(Counted b) { return *this = counted(value / b.value); }

  static Counted counted(double result, std::int64_t cost = 1) {
    operations += cost;
    return result;
  }
};

template <class A, class B>
concept CountedPair = (std::same_as<A, Counted> && std::convertible_to<B, double>) ||
                      (std::same_as<B, Counted> && std::convertible_to<A, double>);

template <class A, class B>
requires CountedPair<A, B> Counted operator+(const A& a, const B& b) {
  return Counted::counted(static_cast<double>(a) + static_cast<double>(b));
}
template <class A, class B>
requires CountedPair<A, B> Counted operator-(const A& a, const B& b) {
  return Counted::counted(static_cast<double>(a) - static_cast<double>(b));
}
template <class A, class B>
requires CountedPair<A, B> Counted operator*(const A& a, const B& b) {
  return Counted::counted(static_cast<double>(a) * static_cast<double>(b));
}
template <class A, class B>
requires CountedPair<A, B> Counted operator/(const A& a, const B& b) {
  return Counted::counted(static_cast<double>(a) / static_cast<double>(b));
}
inline Counted sqrt(Counted a) { return Counted::counted(std::sqrt(a.value)); }
inline Counted abs(Counted a) { return std::abs(a.value); }
inline Counted log(Counted a) { return Counted::counted(std::log(a.value), Counted::transcendental); }
inline Counted exp(Counted a) { return Counted::counted(std::exp(a.value), Counted::transcendental); }
inline Counted pow(Counted a, double b) {
  return Counted::counted(std::pow(a.value, b), 2 * Counted::transcendental);
}

// Operations of f().
template <class F>
std::int64_t count_operations(F&& f) {
  const std::int64_t before = Counted::operations;
  f();
  return Counted::operations - before;
}

}  // namespace mpm

template <>
struct std::numeric_limits<mpm::Counted> : std::numeric_limits<double> {};
