// Small dense tensors whose entries are numbers or packs. Plain arrays with every loop unrolled: Eigen's
// small matrices inside the particle loops cost a factor of four.
#pragma once

#include <type_traits>

#include "mpm_hpc/math/simd.hpp"

namespace mpm {

// Second-order tensor, row-major, entries of type S.
template <class S, int Dim>
struct Tensor {
  S m[Dim * Dim];

  S& operator()(int i, int j) { return m[i * Dim + j]; }
  const S& operator()(int i, int j) const { return m[i * Dim + j]; }

  static Tensor identity() {
    Tensor t;
    for (int i = 0; i < Dim; ++i)
      for (int j = 0; j < Dim; ++j) t(i, j) = broadcast<S>(i == j ? 1.0 : 0.0);
    return t;
  }
};

// Symmetric second-order tensor: the upper triangle, row by row (xx, xy, xz, yy, yz, zz or xx, xy, yy).
template <class S, int Dim>
struct SymTensor {
  static constexpr int size = Dim * (Dim + 1) / 2;
  S m[size];

  static constexpr int index(int i, int j) {
    const int a = i < j ? i : j, b = i < j ? j : i;
    return a * Dim - a * (a - 1) / 2 + (b - a);
  }
  S& operator()(int i, int j) { return m[index(i, j)]; }
  const S& operator()(int i, int j) const { return m[index(i, j)]; }
};

// The factor may be a number, a pack, or an expression of packs.
template <class S, int Dim>
inline Tensor<S, Dim> operator*(const std::type_identity_t<S>& factor, const Tensor<S, Dim>& a) {
  Tensor<S, Dim> c;
  for (int i = 0; i < Dim * Dim; ++i) c.m[i] = factor * a.m[i];
  return c;
}
template <class S, int Dim>
inline SymTensor<S, Dim> operator*(const std::type_identity_t<S>& factor, const SymTensor<S, Dim>& a) {
  SymTensor<S, Dim> c;
  for (int i = 0; i < a.size; ++i) c.m[i] = factor * a.m[i];
  return c;
}

template <class S, int Dim>
inline Tensor<S, Dim> operator+(const Tensor<S, Dim>& a, const Tensor<S, Dim>& b) {
  Tensor<S, Dim> c;
  for (int i = 0; i < Dim * Dim; ++i) c.m[i] = a.m[i] + b.m[i];
  return c;
}
template <class S, int Dim>
inline Tensor<S, Dim> operator-(const Tensor<S, Dim>& a, const Tensor<S, Dim>& b) {
  Tensor<S, Dim> c;
  for (int i = 0; i < Dim * Dim; ++i) c.m[i] = a.m[i] - b.m[i];
  return c;
}

template <class S, int Dim>
inline SymTensor<S, Dim> operator+(const SymTensor<S, Dim>& a, const SymTensor<S, Dim>& b) {
  SymTensor<S, Dim> c;
  for (int i = 0; i < a.size; ++i) c.m[i] = a.m[i] + b.m[i];
  return c;
}

template <class S, int Dim>
inline Tensor<S, Dim> transpose(const Tensor<S, Dim>& a) {
  Tensor<S, Dim> c;
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) c(i, j) = a(j, i);
  return c;
}

// Double contraction A : B.
template <class S, int Dim>
inline S inner(const Tensor<S, Dim>& a, const Tensor<S, Dim>& b) {
  S sum = a.m[0] * b.m[0];
  for (int i = 1; i < Dim * Dim; ++i) sum += a.m[i] * b.m[i];
  return sum;
}

template <class S, int Dim>
inline S determinant(const Tensor<S, Dim>& a) {
  if constexpr (Dim == 2) {
    return a(0, 0) * a(1, 1) - a(0, 1) * a(1, 0);
  } else {
    return a(0, 0) * (a(1, 1) * a(2, 2) - a(1, 2) * a(2, 1)) -
           a(0, 1) * (a(1, 0) * a(2, 2) - a(1, 2) * a(2, 0)) +
           a(0, 2) * (a(1, 0) * a(2, 1) - a(1, 1) * a(2, 0));
  }
}

// Cofactor matrix J F^-T, defined for singular F as well.
template <class S, int Dim>
inline Tensor<S, Dim> cofactor(const Tensor<S, Dim>& a) {
  Tensor<S, Dim> c;
  if constexpr (Dim == 2) {
    c(0, 0) = a(1, 1);
    c(0, 1) = -a(1, 0);
    c(1, 0) = -a(0, 1);
    c(1, 1) = a(0, 0);
  } else {
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const int p = (i + 1) % 3, q = (i + 2) % 3, r = (j + 1) % 3, s = (j + 2) % 3;
        c(i, j) = a(p, r) * a(q, s) - a(p, s) * a(q, r);
      }
  }
  return c;
}

template <class S, int Dim>
inline Tensor<S, Dim> multiply(const Tensor<S, Dim>& a, const Tensor<S, Dim>& b) {
  Tensor<S, Dim> c;
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) {
      S sum = a(i, 0) * b(0, j);
      for (int k = 1; k < Dim; ++k) sum += a(i, k) * b(k, j);
      c(i, j) = sum;
    }
  return c;
}

// A A^T, the left Cauchy-Green tensor b of a deformation gradient.
template <class S, int Dim>
inline SymTensor<S, Dim> left_cauchy_green(const Tensor<S, Dim>& f) {
  SymTensor<S, Dim> b;
  for (int i = 0; i < Dim; ++i)
    for (int j = i; j < Dim; ++j) {
      S sum = f(i, 0) * f(j, 0);
      for (int k = 1; k < Dim; ++k) sum += f(i, k) * f(j, k);
      b(i, j) = sum;
    }
  return b;
}

template <class S, int Dim>
inline S trace(const SymTensor<S, Dim>& a) {
  S sum = a(0, 0);
  for (int i = 1; i < Dim; ++i) sum += a(i, i);
  return sum;
}

// A - tr(A)/d I, from differences of the diagonal, which vanish exactly where the entries agree.
template <class S, int Dim>
inline SymTensor<S, Dim> deviator(const SymTensor<S, Dim>& a) {
  SymTensor<S, Dim> c = a;
  if constexpr (Dim == 2) {
    c(0, 0) = broadcast<S>(0.5) * (a(0, 0) - a(1, 1));
    c(1, 1) = -c(0, 0);
  } else {
    const S xy = a(0, 0) - a(1, 1), yz = a(1, 1) - a(2, 2), zx = a(2, 2) - a(0, 0);
    c(0, 0) = broadcast<S>(1.0 / 3) * (xy - zx);
    c(1, 1) = broadcast<S>(1.0 / 3) * (yz - xy);
    c(2, 2) = broadcast<S>(1.0 / 3) * (zx - yz);
  }
  return c;
}

// Frobenius norm, the off-diagonal entries counted twice.
template <class S, int Dim>
inline S norm(const SymTensor<S, Dim>& a) {
  S diagonal = a(0, 0) * a(0, 0), rest = a(0, 1) * a(0, 1);
  for (int i = 1; i < Dim; ++i) diagonal += a(i, i) * a(i, i);
  if constexpr (Dim == 3) rest += a(0, 2) * a(0, 2) + a(1, 2) * a(1, 2);
  return sqrt_of<S>(diagonal + rest + rest);
}

// Upper bound of the largest eigenvalue from the invariants, the same in every rotated frame: exact in 2D,
// and in 3D where the two smaller eigenvalues agree; tr(A)/d + sqrt((d-1)/d) |dev A| (Wolkowicz and Styan
// 1980).
template <class S, int Dim>
inline S largest_eigenvalue_bound(const SymTensor<S, Dim>& a) {
  return broadcast<S>(1.0 / Dim) * trace(a) + broadcast<S>(std::sqrt((Dim - 1.0) / Dim)) * norm(deviator(a));
}

// Largest absolute row sum: an upper bound of the largest eigenvalue (Gershgorin), exact for a diagonal
// tensor.
template <class S, int Dim>
inline S row_sum_bound(const SymTensor<S, Dim>& a) {
  S bound = broadcast<S>(0.0);
  for (int i = 0; i < Dim; ++i) {
    S sum = abs_of<S>(a(i, 0));
    for (int j = 1; j < Dim; ++j) sum += abs_of<S>(a(i, j));
    bound = maximum<S>(bound, sum);
  }
  return bound;
}

// Entry k of the tensor of particle `index` is columns[k][index]; packs take the particles from index on.
template <class S, int Dim, class T>
inline Tensor<S, Dim> load_tensor(const T* const* columns, std::ptrdiff_t index) {
  Tensor<S, Dim> a;
  for (int k = 0; k < Dim * Dim; ++k) a.m[k] = load<S>(columns[k] + index);
  return a;
}

template <class S, int Dim, class T>
inline void store_tensor(T* const* columns, std::ptrdiff_t index, const Tensor<S, Dim>& a) {
  for (int k = 0; k < Dim * Dim; ++k) store(columns[k] + index, a.m[k]);
}
template <class S, int Dim, class T>
inline void store_tensor(T* const* columns, std::ptrdiff_t index, const SymTensor<S, Dim>& a) {
  for (int k = 0; k < a.size; ++k) store(columns[k] + index, a.m[k]);
}

}  // namespace mpm
