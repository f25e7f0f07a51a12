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

// One Jacobi rotation by the smaller of the two angles that make A(p, q) vanish (Golub and Van Loan, section 8.5):
// cos(2 angle) = |d| / r, sin(2 angle) = 2 A_pq sign(d) / r with d = A_qq - A_pp and r^2 = d^2 + (2 A_pq)^2; by inverse roots
// alone, since divisions and roots are most of the cost.
template <int p, int q, class S, int Dim>
inline void rotate_away(SymTensor<S, Dim>& A, Tensor<S, Dim>& V) {
  const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0), half = broadcast<S>(0.5);
  const S difference = A(q, q) - A(p, p), twice = A(p, q) + A(p, q);
  const S square = difference * difference + twice * twice;
  // The processor's inverse roots don't know denormal numbers; what is that small needs no rotation.
  const S least = broadcast<S>(std::numeric_limits<typename PackTraits<S>::Scalar>::min());
  const S inverse = inverse_sqrt_of<S>(select_less<S>(least, square, square, one));
  const S cosine = select_less<S>(least, square, S(abs_of<S>(difference) * inverse), one);
  const S c2 = half + half * cosine, inverse_c = inverse_sqrt_of<S>(c2), c = c2 * inverse_c;
  const S signed_s = half * twice * inverse * inverse_c,
          s = select_less<S>(difference, zero, S(-signed_s), signed_s);
  const S shift = s * inverse_c * A(p, q);
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

// In 2D by one Jacobi rotation, in 3D by sweeps of three, until what is off the diagonal is below rounding in all lanes: it
// falls quadratically, in 3 to 4 sweeps for any tensor. Repeated eigenvalues need no care. A NaN stays in its lane.
template <class S, int Dim>
inline SymmetricEigen<S, Dim> symmetric_eigen(SymTensor<S, Dim> A) {
  SymmetricEigen<S, Dim> eigen{{}, Tensor<S, Dim>::identity()};
  if constexpr (Dim == 2) {
    detail::rotate_away<0, 1>(A, eigen.vectors);
  } else {
    using Scalar = typename PackTraits<S>::Scalar;
    constexpr int most = 8;
    constexpr Scalar enough = sizeof(Scalar) == 8 ? Scalar(1e-30) : Scalar(1e-15);
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
