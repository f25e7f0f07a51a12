#include "mpm_hpc/math/polar.hpp"

#include <Eigen/Dense>

namespace mpm::detail {

namespace {

template <int Dim>
void rotation(const double* F, double* R) {
  using Matrix = Eigen::Matrix<double, Dim, Dim>;
  using RowMajor = Eigen::Matrix<double, Dim, Dim, Eigen::RowMajor>;
  const Matrix a = Eigen::Map<const RowMajor>(F);
  Eigen::Map<RowMajor> out(R);
  if (!a.allFinite()) {
    out.setConstant(std::numeric_limits<double>::quiet_NaN());
    return;
  }
  const Eigen::JacobiSVD<Matrix> svd(a, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix U = svd.matrixU();
  if ((U * svd.matrixV().transpose()).determinant() < 0) U.col(Dim - 1) *= -1;
  out = U * svd.matrixV().transpose();
}

}  // namespace

void rotation_by_svd(int dim, const double* F, double* R) {
  if (dim == 2) {
    rotation<2>(F, R);
  } else {
    rotation<3>(F, R);
  }
}

}  // namespace mpm::detail
