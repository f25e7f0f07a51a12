// Positive semi-definite projection of a hyperelastic tangent, so that Newton's directions descend: in the
// principal frame d^2 Psi / dF dF falls into one Dim x Dim block and one 2x2 block per pair of axes, each
// projected by itself (Teran et al. 2005).
#pragma once

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <concepts>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// An isotropic law given through its principal stretches s: d Psi / d s_a and d^2 Psi / d s_a d s_b.
template <class Law, int Dim>
concept HasPrincipalDerivatives = requires(const Law law, const Vec<Dim>& s) {
  { law.principal_first_piola(s) } -> std::convertible_to<Vec<Dim>>;
  { law.principal_hessian(s) } -> std::convertible_to<Mat<Dim>>;
};

// The projected tangent at one F with det F > 0, ready to be applied to many dF.
template <int Dim>
class ProjectedTangent {
 public:
  template <HasPrincipalDerivatives<Dim> Law>
  ProjectedTangent(const Law& law, const Mat<Dim>& F) {
    const Eigen::JacobiSVD<Mat<Dim>> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
    U_ = svd.matrixU();
    V_ = svd.matrixV();
    const Vec<Dim> s = svd.singularValues();
    const Vec<Dim> piola = law.principal_first_piola(s);
    diagonal_ = semi_definite_part(law.principal_hessian(s));
    for (int a = 0; a < Dim; ++a)
      for (int b = a + 1; b < Dim; ++b) {
        symmetric_(a, b) = std::max(0.0, stress_slope(law, s, piola, a, b));
        skew_(a, b) = std::max(0.0, (piola(a) + piola(b)) / (s(a) + s(b)));
      }
  }

  // The projected dP/dF : dF.
  Mat<Dim> apply(const Mat<Dim>& dF) const {
    const Mat<Dim> in = U_.transpose() * dF * V_;
    Mat<Dim> out;
    out.diagonal() = diagonal_ * in.diagonal();
    for (int a = 0; a < Dim; ++a)
      for (int b = a + 1; b < Dim; ++b) {
        const Real even = 0.5 * symmetric_(a, b) * (in(a, b) + in(b, a));
        const Real odd = 0.5 * skew_(a, b) * (in(a, b) - in(b, a));
        out(a, b) = even + odd;
        out(b, a) = even - odd;
      }
    return U_ * out * V_.transpose();
  }

 private:
  static Mat<Dim> semi_definite_part(const Mat<Dim>& block) {
    const Eigen::SelfAdjointEigenSolver<Mat<Dim>> eigen(block);
    return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() *
           eigen.eigenvectors().transpose();
  }

  // (P_a - P_b) / (s_a - s_b). Below a gap of 1e-5 the quotient would lose more digits than its value at the
  // middle, H_aa - H_ab, which is right to the square of the gap.
  template <class Law>
  static Real stress_slope(const Law& law, const Vec<Dim>& s, const Vec<Dim>& piola, int a, int b) {
    const Real gap = s(a) - s(b);
    if (std::abs(gap) > 1e-5 * std::max(s(a), s(b))) return (piola(a) - piola(b)) / gap;
    Vec<Dim> middle = s;
    middle(a) = middle(b) = 0.5 * (s(a) + s(b));
    const Mat<Dim> hessian = law.principal_hessian(middle);
    return hessian(a, a) - hessian(a, b);
  }

  Mat<Dim> U_, V_;             // F = U diag(s) V^T
  Mat<Dim> diagonal_;          // acts on the diagonal of U^T dF V
  Mat<Dim> symmetric_, skew_;  // factors of the symmetric and the skew part of entries (a, b), a < b
};

}  // namespace mpm
