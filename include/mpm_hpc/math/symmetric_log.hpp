// The logarithm of symmetric positive definite tensors, a pack of them at once.
#pragma once

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/symmetric_eigen.hpp"

namespace mpm {

namespace detail {

// The product of symmetric tensors that commute, which is symmetric.
template <class S, int Dim>
inline SymTensor<S, Dim> commuting_product(const SymTensor<S, Dim>& a, const SymTensor<S, Dim>& b) {
  SymTensor<S, Dim> c;
  for (int i = 0; i < Dim; ++i)
    for (int j = i; j < Dim; ++j) {
      c(i, j) = a(i, 0) * b(0, j);
      for (int k = 1; k < Dim; ++k) c(i, j) += a(i, k) * b(k, j);
    }
  return c;
}

template <class S, int Dim>
inline SymTensor<S, Dim> plus_diagonal(SymTensor<S, Dim> a, Real x) {
  for (int i = 0; i < Dim; ++i) a(i, i) += broadcast<S>(x);
  return a;
}

template <class S, int Dim>
inline SymTensor<S, Dim> inverse(const SymTensor<S, Dim>& a) {
  SymTensor<S, Dim> c;
  if constexpr (Dim == 2) {
    c(0, 0) = a(1, 1);
    c(1, 1) = a(0, 0);
    c(0, 1) = -a(0, 1);
  } else {
    c(0, 0) = a(1, 1) * a(2, 2) - a(1, 2) * a(1, 2);
    c(0, 1) = a(0, 2) * a(1, 2) - a(0, 1) * a(2, 2);
    c(0, 2) = a(0, 1) * a(1, 2) - a(0, 2) * a(1, 1);
    c(1, 1) = a(0, 0) * a(2, 2) - a(0, 2) * a(0, 2);
    c(1, 2) = a(0, 1) * a(0, 2) - a(0, 0) * a(1, 2);
    c(2, 2) = a(0, 0) * a(1, 1) - a(0, 1) * a(0, 1);
  }
  S determinant = a(0, 0) * c(0, 0);
  for (int k = 1; k < Dim; ++k) determinant += a(0, k) * c(0, k);
  return S(broadcast<S>(1.0) / determinant) * c;
}

}  // namespace detail

// ln A = 2 atanh X = 2 X (I + X^2/3 + X^4/5 + ...) with X = (A - I)(A + I)^-1, where |X| <= 0.1 in all lanes (eigenvalues
// of A within 20 % of 1): a fifth of the cost of the eigenvalues, which serve otherwise.
template <class S, int Dim>
inline SymTensor<S, Dim> symmetric_log(const SymTensor<S, Dim>& A) {
  const SymTensor<S, Dim> X =
      detail::commuting_product(detail::plus_diagonal(A, -1), detail::inverse(detail::plus_diagonal(A, 1)));
  const S length = norm(X);
  if (none_above<S>(length, broadcast<S>(0.1))) {
    constexpr int last = sizeof(typename PackTraits<S>::Scalar) == 8 ? 15 : 7;
    const SymTensor<S, Dim> X2 = detail::commuting_product(X, X);
    SymTensor<S, Dim> sum = detail::plus_diagonal(S(broadcast<S>(1.0 / last)) * X2, 1.0 / (last - 2));
    for (int n = last - 4; n >= 1; n -= 2)
      sum = detail::plus_diagonal(detail::commuting_product(X2, sum), 1.0 / n);
    return S(broadcast<S>(2.0)) * detail::commuting_product(X, sum);
  }
  const SymmetricEigen<S, Dim> eigen = symmetric_eigen(A);
  S logarithms[Dim];
  for (int a = 0; a < Dim; ++a) logarithms[a] = log_of<S>(eigen.values[a]);
  return eigen.with_values(logarithms);
}

}  // namespace mpm
