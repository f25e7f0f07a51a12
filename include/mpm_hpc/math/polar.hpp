// The rotation of a polar decomposition F = R S, for numbers and packs.
#pragma once

#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

namespace detail {

// R of one matrix by singular values, row-major: the rotation nearest to F. It exists where F is singular or turned inside
// out as well: the smallest singular value then counts as negative. NaN if F is not finite.
void rotation_by_svd(int dim, const double* F, double* R);

// Puts the rotation of lane `lane` right.
template <class S, int Dim>
[[gnu::noinline]] void repair_rotation(const Tensor<S, Dim>& F, int lane, Tensor<S, Dim>& R) {
  using Scalar = typename PackTraits<S>::Scalar;
  double in[Dim * Dim], out[Dim * Dim];
  for (int k = 0; k < Dim * Dim; ++k) {
    if constexpr (PackTraits<S>::width == 1) {
      in[k] = F.m[k];
    } else {
      in[k] = F.m[k][lane];
    }
  }
  rotation_by_svd(Dim, in, out);
  for (int k = 0; k < Dim * Dim; ++k) {
    if constexpr (PackTraits<S>::width == 1) {
      R.m[k] = static_cast<Scalar>(out[k]);
    } else {
      R.m[k][lane] = static_cast<Scalar>(out[k]);
    }
  }
}

template <class S>
inline auto lane_of(const S& a, int lane) {
  if constexpr (PackTraits<S>::width == 1) {
    return a;
  } else {
    return a[lane];
  }
}

// False if any lane's a isn't below the limit; a NaN isn't.
template <class S>
inline bool all_below(const S& a, typename PackTraits<S>::Scalar limit) {
  if constexpr (PackTraits<S>::width == 1) {
    return a < limit;
  } else {
    return (a < limit).all();
  }
}

}  // namespace detail

// In 2D in closed form. In 3D by Newton's iteration X <- (X + X^-T) / 2 from X = F (Higham 1986), which is of second order
// and takes 3 to 4 steps for stretches within a factor 1.5 of 1; lanes with det F <= 0, or where it hasn't converged, go
// the slow way.
template <class S, int Dim>
inline Tensor<S, Dim> rotation_of(const Tensor<S, Dim>& F) {
  const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0);
  if constexpr (Dim == 2) {
    const S a = F(0, 0) + F(1, 1), b = F(1, 0) - F(0, 1), r = sqrt_of<S>(a * a + b * b);
    // r = 0 where F is a reflection: every rotation is as near as any other.
    const S inverse = one / select_less<S>(zero, r, r, one);
    const S cosine = select_less<S>(zero, r, S(a * inverse), S(one + r)), sine = b * inverse;
    Tensor<S, Dim> R;
    R(0, 0) = R(1, 1) = cosine;
    R(0, 1) = -sine;
    R(1, 0) = sine;
    return R;
  } else {
    using Scalar = typename PackTraits<S>::Scalar;
    constexpr int most = 20;  // stretches up to 1e5
    // The squared change after which the next error is below rounding.
    constexpr Scalar enough = sizeof(Scalar) == 8 ? Scalar(1e-16) : Scalar(1e-8);
    const S half = broadcast<S>(0.5), J = determinant(F);
    Tensor<S, Dim> X = F;
    S change = one, det = J;
    for (int i = 0; i < most; ++i) {
      const Tensor<S, Dim> next = half * X + S(half / det) * cofactor(X), step = next - X;
      change = inner(step, step);
      X = next;
      if (detail::all_below(change, enough)) break;
      det = determinant(X);
    }
    if (!detail::all_below(change, enough) || !detail::all_below<S>(-J, 0))
      for (int lane = 0; lane < PackTraits<S>::width; ++lane)
        if (!(detail::lane_of(change, lane) < enough) || !(detail::lane_of(J, lane) > 0))
          detail::repair_rotation(F, lane, X);
    return X;
  }
}

}  // namespace mpm
