// Eigenvalues and eigenvectors of symmetric tensors, a pack of them at once.
#pragma once

#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

// A = V diag(values) V^T; column a of the rotation V belongs to values[a]. In no order.
template <class S, int Dim>
struct SymmetricEigen {
  S values[Dim];
  Tensor<S, Dim> vectors;

  // V diag(x) V^T
  SymTensor<S, Dim> with_values(const S (&x)[Dim]) const {
    SymTensor<S, Dim> sum;
    for (int i = 0; i < Dim; ++i)
      for (int j = i; j < Dim; ++j) {
        sum(i, j) = x[0] * vectors(i, 0) * vectors(j, 0);
        for (int a = 1; a < Dim; ++a) sum(i, j) += x[a] * vectors(i, a) * vectors(j, a);
      }
    return sum;
  }
};

namespace detail {

// One Jacobi rotation, which makes A(p, q) vanish: t = tan of the angle, the smaller root of t^2 + t (A_pp - A_qq) / A_pq = 1
// (Golub and Van Loan, section 8.5).
template <int p, int q, class S, int Dim>
inline void rotate_away(SymTensor<S, Dim>& A, Tensor<S, Dim>& V) {
  const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0);
  const S difference = A(q, q) - A(p, p), twice = A(p, q) + A(p, q);
  const S length = sqrt_of<S>(difference * difference + twice * twice);
  const S size = abs_of<S>(difference) + length;
  const S quotient = twice / select_less<S>(zero, size, size, one);
  const S t = select_less<S>(difference, zero, -quotient, quotient);
  const S c = one / sqrt_of<S>(one + t * t), s = t * c;
  const S shift = t * A(p, q);
  A(p, p) -= shift;
  A(q, q) += shift;
  A(p, q) = zero;
  if constexpr (Dim == 3) {
    constexpr int r = 3 - p - q;
    const S rp = A(r, p), rq = A(r, q);
    A(r, p) = c * rp - s * rq;
    A(r, q) = s * rp + c * rq;
  }
  for (int i = 0; i < Dim; ++i) {
    const S ip = V(i, p), iq = V(i, q);
    V(i, p) = c * ip - s * iq;
    V(i, q) = s * ip + c * iq;
  }
}

}  // namespace detail

// In 2D by one Jacobi rotation, in 3D by sweeps of three, until all lanes have converged: the sum of the squares off the
// diagonal falls quadratically, 3 to 4 sweeps for any tensor. Repeated eigenvalues need no care. A NaN stays in its lane.
template <class S, int Dim>
inline SymmetricEigen<S, Dim> symmetric_eigen(SymTensor<S, Dim> A) {
  SymmetricEigen<S, Dim> eigen{{}, Tensor<S, Dim>::identity()};
  if constexpr (Dim == 2) {
    detail::rotate_away<0, 1>(A, eigen.vectors);
  } else {
    using Scalar = typename PackTraits<S>::Scalar;
    constexpr int most = 8;
    constexpr Scalar enough = sizeof(Scalar) == 8 ? Scalar(1e-34) : Scalar(1e-17);
    for (int sweep = 0; sweep < most; ++sweep) {
      const S off = A(0, 1) * A(0, 1) + A(0, 2) * A(0, 2) + A(1, 2) * A(1, 2);
      const S size = A(0, 0) * A(0, 0) + A(1, 1) * A(1, 1) + A(2, 2) * A(2, 2);
      if (none_above<S>(off, broadcast<S>(enough) * size)) break;
      detail::rotate_away<0, 1>(A, eigen.vectors);
      detail::rotate_away<0, 2>(A, eigen.vectors);
      detail::rotate_away<1, 2>(A, eigen.vectors);
    }
  }
  for (int a = 0; a < Dim; ++a) eigen.values[a] = A(a, a);
  return eigen;
}

}  // namespace mpm
