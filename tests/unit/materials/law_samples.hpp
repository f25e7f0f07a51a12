// Deformation gradients, constants and conversions that the tests of the material laws share.
#pragma once

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/materials/elastic_constants.hpp"
#include "mpm_hpc/materials/material_list.hpp"

namespace mpm::test {

constexpr Real test_mu = 1.3e9, test_lambda = 2.1e9;  // [Pa]

template <class Law>
struct Traits;
template <int D>
struct Traits<NeoHookean<D>> {
  static constexpr int dim = D;
  static constexpr bool softens = false;  // terms of opposite sign make the moduli small or negative
  static NeoHookean<D> law(Real mu = test_mu, Real lambda = test_lambda) { return {mu, lambda}; }
};
template <int D>
struct Traits<SplitNeoHookean<D>> {
  static constexpr int dim = D;
  static constexpr bool softens = false;
  static SplitNeoHookean<D> law(Real mu = test_mu, Real lambda = test_lambda) {
    return {mu, ElasticConstants{mu, lambda}.bulk_modulus<D>()};
  }
};

template <int D>
struct Traits<FixedCorotated<D>> {
  static constexpr int dim = D;
  static constexpr bool softens = true;
  static FixedCorotated<D> law(Real mu = test_mu, Real lambda = test_lambda) { return {mu, lambda}; }
};

template <int D>
struct Traits<Hencky<D>> {
  static constexpr int dim = D;
  static constexpr bool softens = false;
  static Hencky<D> law(Real mu = test_mu, Real lambda = test_lambda) { return {mu, lambda}; }
};

template <int Dim>
Tensor<double, Dim> to_tensor(const Mat<Dim>& a) {
  Tensor<double, Dim> t;
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) t(i, j) = a(i, j);
  return t;
}
template <int Dim>
Mat<Dim> to_matrix(const Tensor<double, Dim>& t) {
  Mat<Dim> a;
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) a(i, j) = t(i, j);
  return a;
}
template <int Dim>
Mat<Dim> to_matrix(const SymTensor<double, Dim>& t) {
  Mat<Dim> a;
  for (int i = 0; i < Dim; ++i)
    for (int j = 0; j < Dim; ++j) a(i, j) = t(i, j);
  return a;
}

template <int Dim>
Mat<Dim> random_matrix(std::mt19937& generator) {
  std::normal_distribution<double> normal;
  return Mat<Dim>::NullaryExpr([&] { return normal(generator); });
}

template <int Dim>
Mat<Dim> random_rotation(std::mt19937& generator) {
  std::normal_distribution<double> normal;
  if constexpr (Dim == 2) {
    return Eigen::Rotation2Dd(3 * normal(generator)).toRotationMatrix();
  } else {
    return Eigen::Quaterniond(Eigen::Vector4d::NullaryExpr([&] { return normal(generator); }))
        .normalized()
        .toRotationMatrix();
  }
}

template <int Dim>
struct Sample {
  std::string name;
  Mat<Dim> F;
};

// Random, repeated and nearly repeated singular values, strong compression and expansion; det F > 0
// throughout.
template <int Dim>
std::vector<Sample<Dim>> sample_deformations(int random_ones = 20) {
  std::mt19937 generator(20240607);
  std::uniform_real_distribution<double> stretch(0.6, 1.7);
  const auto rotated = [&](const Vec<Dim>& s) -> Mat<Dim> {
    return random_rotation<Dim>(generator) * s.asDiagonal() * random_rotation<Dim>(generator).transpose();
  };
  const auto random_stretches = [&] {
    return Vec<Dim>::NullaryExpr([&] { return stretch(generator); }).eval();
  };

  std::vector<Sample<Dim>> samples;
  for (int i = 0; i < random_ones; ++i)
    samples.push_back({"random " + std::to_string(i), rotated(random_stretches())});
  samples.push_back({"all equal", rotated(Vec<Dim>::Constant(1.2))});
  Vec<Dim> pair = Vec<Dim>::Constant(0.8);
  pair(Dim - 1) = Dim == 2 ? 0.8 : 1.3;
  samples.push_back({"two equal", rotated(pair)});
  pair(0) += 1e-8;
  samples.push_back({"two nearly equal", rotated(pair)});
  for (const double J : {0.01, 10.0}) {
    Vec<Dim> s = random_stretches();
    s *= std::pow(J / s.prod(), 1.0 / Dim);
    samples.push_back({"J = " + std::to_string(J), rotated(s)});
  }
  return samples;
}

// d tau_a / d ln s_b by central differences of the stress of F = diag(s).
template <int Dim, class Stress>
Mat<Dim> principal_moduli(const Stress& stress, const Vec<Dim>& s) {
  const double h = 1e-5;
  Mat<Dim> A;
  for (int b = 0; b < Dim; ++b) {
    Vec<Dim> up = s, down = s;
    up(b) *= std::exp(h);
    down(b) *= std::exp(-h);
    A.col(b) = (to_matrix<Dim>(stress(to_tensor<Dim>(up.asDiagonal()))).diagonal() -
                to_matrix<Dim>(stress(to_tensor<Dim>(down.asDiagonal()))).diagonal()) /
               (2 * h);
  }
  return A;
}

inline double largest_eigenvalue(const Eigen::MatrixXd& a) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(0.5 * (a + a.transpose())).eigenvalues().maxCoeff();
}

// The Dim^2 x Dim^2 matrix of a linear map of matrices, column-major in both.
template <int Dim, class Map>
Eigen::MatrixXd matrix_of(const Map& map) {
  Eigen::MatrixXd m(Dim * Dim, Dim * Dim);
  for (int k = 0; k < Dim * Dim; ++k) {
    Mat<Dim> unit = Mat<Dim>::Zero();
    unit.data()[k] = 1;
    const Mat<Dim> image = map(unit);
    for (int row = 0; row < Dim * Dim; ++row) m(row, k) = image.data()[row];
  }
  return m;
}

// A law on matrices, and differences of its energy and stress.
template <class Law>
struct LawProbe {
  static constexpr int dim = Traits<Law>::dim;
  using M = Mat<dim>;
  Law law = Traits<Law>::law();

  double energy(const M& F) const { return law.energy_density(to_tensor<dim>(F)); }
  M piola(const M& F) const { return to_matrix<dim>(law.first_piola(to_tensor<dim>(F))); }
  M kirchhoff(const M& F) const { return to_matrix<dim>(law.kirchhoff_stress(to_tensor<dim>(F))); }
  M differential(const M& F, const M& dF) const {
    return to_matrix<dim>(law.first_piola_differential(to_tensor<dim>(F), to_tensor<dim>(dF)));
  }
  M difference_of_energy(const M& F, double h) const {
    M P;
    for (int k = 0; k < dim * dim; ++k) {
      M up = F, down = F;
      up.data()[k] += h;
      down.data()[k] -= h;
      P.data()[k] = (energy(up) - energy(down)) / (2 * h);
    }
    return P;
  }
  // Relative errors of P and of dP along dF by central differences of the step h.
  double gradient_error(const M& F, double h) const {
    const M P = piola(F);
    return (difference_of_energy(F, h) - P).norm() / P.norm();
  }
  double tangent_error(const M& F, const M& dF, double h) const {
    const M dP = differential(F, dF);
    return ((piola(F + h * dF) - piola(F - h * dF)) / (2 * h) - dP).norm() / dP.norm();
  }
};

// The least relative error of differences before roundoff takes over.
template <class Error>
double best_difference(const Error& relative_error, double length) {
  double best = 1;
  for (double h = 1e-3; h > 1e-7; h /= 2) best = std::min(best, relative_error(h * length));
  return best;
}

}  // namespace mpm::test
