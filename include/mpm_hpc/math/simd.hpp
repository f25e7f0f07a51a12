// Packs: W numbers handled at once in the lane stage; materials and kernels are templates on their scalar
// type and run with plain double in the tests and with packs in production.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

namespace mpm {

// One cache line per pack on every instruction set, so that padding and file order don't depend on the
// machine.
template <class T>
inline constexpr int pack_width = 64 / static_cast<int>(sizeof(T));

template <class T>
using Pack = Eigen::Array<T, pack_width<T>, 1>;

template <class S>
struct PackTraits {
  using Scalar = S;
  static constexpr int width = 1;
};
template <class T, int W>
struct PackTraits<Eigen::Array<T, W, 1>> {
  using Scalar = T;
  static constexpr int width = W;
};

namespace detail {

// The compiler's own vector of Width numbers, for what Eigen's arrays don't do in registers: conversion and
// bits.
template <class T, int Width>
using NativeVector [[gnu::vector_size(Width * sizeof(T))]] = T;

// How many numbers of a pack of Width the machine holds in one register.
template <class T, int Width>
inline constexpr int register_width = std::min<int>(
    Width,
    Eigen::internal::unpacket_traits<typename Eigen::internal::find_best_packet<T, Width>::type>::size);

// A vector's numbers in another type. Written number by number, which GCC 12 makes one instruction of; __builtin_convertvector
// is three to five where the numbers become wider.
template <class To, class From, int... I>
inline NativeVector<To, sizeof...(I)> converted(const NativeVector<From, sizeof...(I)>& v, std::integer_sequence<int, I...>) {
  return NativeVector<To, sizeof...(I)>{static_cast<To>(v[I])...};
}
template <int Width, class To, class From>
inline NativeVector<To, Width> load_converted(const From* from) {
  NativeVector<From, Width> raw;
  std::memcpy(&raw, from, sizeof(raw));
  return converted<To, From>(raw, std::make_integer_sequence<int, Width>());
}

// Converts Width numbers, a register at a time. A register made of two narrower ones is joined before it is stored: the
// machine can't load what two stores have written until both have reached the cache.
template <class T, int... I>
inline NativeVector<T, sizeof...(I)> joined(const NativeVector<T, sizeof...(I) / 2>& a,
                                            const NativeVector<T, sizeof...(I) / 2>& b,
                                            std::integer_sequence<int, I...>) {
  return __builtin_shufflevector(a, b, I...);
}
template <int Width, class From, class To>
inline void convert(const From* from, To* to) {
  constexpr int step = std::min(register_width<From, Width>, register_width<To, Width>);
  if constexpr (register_width<To, Width> == 2 * step) {
    for (int i = 0; i < Width; i += 2 * step) {
      const auto both = joined<To>(load_converted<step, To>(from + i), load_converted<step, To>(from + i + step),
                                   std::make_integer_sequence<int, 2 * step>());
      std::memcpy(to + i, &both, sizeof(both));
    }
  } else {
    for (int i = 0; i < Width; i += step) {
      const auto part = load_converted<step, To>(from + i);
      std::memcpy(to + i, &part, sizeof(part));
    }
  }
}

// f of the registers of some packs, register by register, where f takes and returns Eigen's packets.
template <class F, class S, class... More>
inline S by_register(F&& f, const S& first, const More&... more) {
  constexpr int width = PackTraits<S>::width;
  using Packet = typename Eigen::internal::find_best_packet<typename PackTraits<S>::Scalar, width>::type;
  S out;
  for (int i = 0; i < width; i += Eigen::internal::unpacket_traits<Packet>::size) {
    const auto part = [i](const S& s) { return Eigen::internal::pload<Packet>(s.data() + i); };
    Eigen::internal::pstore(out.data() + i, f(part(first), part(more)...));
  }
  return out;
}

}  // namespace detail

// Loads PackTraits<S>::width consecutive numbers, converting between float and double if need be. p is
// aligned to a cache line when S is a pack of T.
template <class S, class T>
inline S load(const T* p) {
  constexpr int width = PackTraits<S>::width;
  if constexpr (width == 1) {
    return static_cast<S>(*p);
  } else if constexpr (std::is_same_v<typename PackTraits<S>::Scalar, T>) {
    return Eigen::Map<const S, Eigen::Aligned64>(p);
  } else {
    S out;
    detail::convert<width>(p, out.data());
    return out;
  }
}

template <class S, class T>
inline void store(T* p, const S& value) {
  constexpr int width = PackTraits<S>::width;
  if constexpr (width == 1) {
    *p = static_cast<T>(value);
  } else if constexpr (std::is_same_v<typename PackTraits<S>::Scalar, T>) {
    Eigen::Map<S, Eigen::Aligned64>{p} = value;
  } else {
    detail::convert<width>(value.data(), p);
  }
}

// A pack (or number) with every lane equal to value.
template <class S, class T>
inline S broadcast(T value) {
  if constexpr (PackTraits<S>::width == 1) {
    return static_cast<S>(value);
  } else {
    return S::Constant(static_cast<typename PackTraits<S>::Scalar>(value));
  }
}

// Lane by lane a < b ? x : y; a comparison with NaN is false. In Eigen's packets, because its select goes
// through an array of bool and a loop over lanes is not vectorised inside larger functions.
template <class S>
inline S select_less(const S& a, const S& b, const S& x, const S& y) {
  if constexpr (PackTraits<S>::width == 1) {
    return a < b ? x : y;
  } else {
    return detail::by_register(
        [](const auto& pa, const auto& pb, const auto& px, const auto& py) {
          return Eigen::internal::pselect(Eigen::internal::pcmp_lt(pa, pb), px, py);
        },
        a, b, x, y);
  }
}

// a b + c, rounded once where the machine can. In a sum of two products the compiler chooses which of them is rounded, and not
// always the same one; this way the result doesn't depend on where it is inlined.
template <class S>
inline S multiply_add(const S& a, const S& b, const S& c) {
  if constexpr (PackTraits<S>::width == 1) {
    return a * b + c;
  } else {
    return detail::by_register(
        [](const auto& pa, const auto& pb, const auto& pc) { return Eigen::internal::pmadd(pa, pb, pc); }, a, b, c);
  }
}

// Whether a > b in no lane; a comparison with NaN is false.
template <class S>
inline bool none_above(const S& a, const std::type_identity_t<S>& b) {
  if constexpr (PackTraits<S>::width == 1) {
    return !(a > b);
  } else {
    return !(a > b).any();
  }
}

template <class S>
inline S maximum(const S& a, const S& b) {
  if constexpr (PackTraits<S>::width == 1) {
    return a < b ? b : a;
  } else {
    return a.max(b);
  }
}

template <class S>
inline S minimum(const S& a, const S& b) {
  if constexpr (PackTraits<S>::width == 1) {
    return b < a ? b : a;
  } else {
    return a.min(b);
  }
}

// Elementary functions for numbers and packs alike; found by argument for Eigen arrays.
template <class S>
inline S log_of(const S& a) {
  using std::log;
  return log(a);
}
template <class S>
inline S exp_of(const S& a) {
  using std::exp;
  return exp(a);
}
template <class S>
inline S sqrt_of(const S& a) {
  using std::sqrt;
  return sqrt(a);
}
template <class S>
inline S abs_of(const S& a) {
  using std::abs;
  return abs(a);
}
// 1 / sqrt(a).
template <class S>
inline S inverse_sqrt_of(const S& a) {
  if constexpr (PackTraits<S>::width == 1) {
    return broadcast<S>(1.0) / sqrt_of<S>(a);
  } else {
    return a.rsqrt();
  }
}
// log(1 + a) with all digits for small a: 2 atanh(a / (2 + a)) by its series, where no lane needs more.
template <class S>
inline S log1p_of(const S& a) {
  if constexpr (PackTraits<S>::width == 1) {
    using std::log1p;
    return log1p(a);
  } else {
    const S limit = broadcast<S>(0.25), size = abs_of<S>(a), r = a / (broadcast<S>(2.0) + a), r2 = r * r;
    S series = broadcast<S>(0.0);
    for (int n = 19; n >= 1; n -= 2) series = series * r2 + broadcast<S>(1.0 / n);
    series = broadcast<S>(2.0) * r * series;
    if (none_above<S>(size, limit)) return series;
    return select_less<S>(limit, size, log_of<S>(broadcast<S>(1.0) + a), series);
  }
}
// exp(a) - 1 with all digits for small a: by its series, where no lane needs more.
template <class S>
inline S expm1_of(const S& a) {
  if constexpr (PackTraits<S>::width == 1) {
    using std::expm1;
    return expm1(a);
  } else {
    const S limit = broadcast<S>(0.35), size = abs_of<S>(a), one = broadcast<S>(1.0);
    S series = one;
    for (int n = 13; n >= 2; --n) series = one + broadcast<S>(1.0 / n) * a * series;
    series = a * series;
    if (none_above<S>(size, limit)) return series;
    return select_less<S>(limit, size, exp_of<S>(a) - one, series);
  }
}

namespace detail {

// A first guess of a^(-1/3), right to 4 %: the bits of a number are about its logarithm, so the guess has the
// bits magic - bits / 3. The magic number is 4/3 of the exponent's bias less a fraction that centres the
// error.
template <class T, int Width>
inline void guess_inverse_cube_root(const T* a, T* guess) {
  using Integer = std::conditional_t<sizeof(T) == 8, std::uint64_t, std::uint32_t>;
  constexpr Integer magic = sizeof(T) == 8 ? Integer(0x553EF0FF289DD796u) : Integer(0x54A2FA8Cu);
  constexpr int step = register_width<T, Width>;
  for (int i = 0; i < Width; i += step) {
    NativeVector<Integer, step> bits;
    std::memcpy(&bits, a + i, sizeof(bits));
    bits = (bits >> 2) + (bits >> 4);  // 5/16, then times 17/16 and 257/256: 1/3 to 2e-5
    bits += bits >> 4;
    bits += bits >> 8;
    bits = magic - bits;
    std::memcpy(guess + i, &bits, sizeof(bits));
  }
}

}  // namespace detail

// a^(-1/3) to 1 ulp for normal numbers a, NaN for a <= 0; several times faster than exp(-1/3 log a).
template <class S>
inline S inverse_cube_root(const S& a) {
  using Scalar = typename PackTraits<S>::Scalar;
  S y;
  if constexpr (PackTraits<S>::width == 1) {
    detail::guess_inverse_cube_root<Scalar, 1>(&a, &y);
  } else {
    detail::guess_inverse_cube_root<Scalar, PackTraits<S>::width>(a.data(), y.data());
  }
  // Three terms of y (1 - r)^(-1/3) with r = 1 - a y^3: each iteration is of fourth order.
  for (int iteration = 0; iteration < 2; ++iteration) {
    const S r = broadcast<S>(1.0) - a * y * y * y;
    const S series = broadcast<S>(1.0 / 3) + r * (broadcast<S>(2.0 / 9) + r * broadcast<S>(14.0 / 81));
    y += y * r * series;
  }
  return select_less<S>(broadcast<S>(0.0), a, y, broadcast<S>(std::numeric_limits<Scalar>::quiet_NaN()));
}

}  // namespace mpm
