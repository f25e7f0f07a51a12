// How a step deforms particles: F <- (I + A) F, (I + A + A^2/2) F or exp(A) F with A = dt grad v (physics.md section 1).
#pragma once

#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

enum class DeformationUpdate { first_order, second_order, exponential };

namespace detail {

// Terms of exp(A) after which the rest is below rounding for |A| <= 0.2, the bound of a step: 0.2^n / n!.
template <class Scalar>
inline constexpr int exponential_terms = sizeof(Scalar) == 8 ? 12 : 7;

// (I + A + ... + A^terms / terms!) F by Horner's rule.
template <class S, int Dim>
[[gnu::noinline]] Tensor<S, Dim> taylor_deformed(int terms, const Tensor<S, Dim>& A,
                                                 const Tensor<S, Dim>& F) {
  Tensor<S, Dim> sum = F;
  for (int n = terms; n > 0; --n) sum = F + broadcast<S>(1.0 / n) * multiply(A, sum);
  return sum;
}

}  // namespace detail

template <class S, int Dim>
inline Tensor<S, Dim> deformed(DeformationUpdate update, const Tensor<S, Dim>& A, const Tensor<S, Dim>& F) {
  using Scalar = typename PackTraits<S>::Scalar;
  if (update == DeformationUpdate::first_order) return F + multiply(A, F);
  return detail::taylor_deformed(
      update == DeformationUpdate::second_order ? 2 : detail::exponential_terms<Scalar>, A, F);
}

// The growth (J_new - J) / J of a volume that follows tr A: tr A, tr A + (tr A)^2 / 2, or exp(tr A) - 1.
template <class S>
inline S volume_growth(DeformationUpdate update, const S& trace) {
  if (update == DeformationUpdate::first_order) return trace;
  if (update == DeformationUpdate::second_order) return trace + broadcast<S>(0.5) * trace * trace;
  return expm1_of<S>(trace);
}

}  // namespace mpm
