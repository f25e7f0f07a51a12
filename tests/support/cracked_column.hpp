// What it costs to break a clamped strip (Rivlin and Thomas 1953) on the grid, from one column of particles across it: the least
// energy over c and the displacements, by dense matrices and without the program's transfers.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "mpm_hpc/math/bspline.hpp"

namespace mpm::test {

// W(u) without any damage at which the strip as a whole and broken have the same energy, and what this is: the load from which on
// a crack may run, and what it pays per length.
struct StripThreshold {
  double load, cost;
};

// Lengths in grid spacings, energies in G_c of the equations per length of the crack. The strip is uniform along the crack, so that
// the sums over particles are those of a column of `rows_per_cell` per cell; the nodes beyond its height are held.
template <class Kernel>
class CrackedColumn {
 public:
  struct Energy {
    double elastic = 0, surface = 0;
    double sum() const { return elastic + surface; }
  };

  // place of the rows: (k + shift) / rows_per_cell from the nodes.
  CrackedColumn(int height, double length, bool lumped, int rows_per_cell = 2, double shift = 0.5,
                double residual = 1e-3)
      : height_(height), length_(length), lumped_(lumped), residual_(residual), volume_(1.0 / rows_per_cell) {
    constexpr int beyond = 3;
    const int nodes = height + 2 * beyond + 1;
    first_free_ = beyond + 1;
    free_ = height - 1;
    mass_ = Vector::Zero(nodes);
    for (int k = -rows_per_cell; k < (height + 1) * rows_per_cell; ++k) {
      Row row;
      row.place = (k + shift) / rows_per_cell;
      const double first = std::floor(row.place - Kernel::shift), fx = row.place - first;
      row.node = static_cast<int>(first) + beyond;
      Kernel::weights(fx, row.w);
      // h D_p^-1 w (x_i - x_p), or h grad w where D_p is singular.
      Kernel::gradients(fx, row.g);
      if constexpr (Kernel::has_inertia)
        for (int n = 0; n < Kernel::support; ++n) row.g[n] = Kernel::inverse_inertia * row.w[n] * (n - fx);
      for (int n = 0; n < Kernel::support; ++n) mass_[row.node + n] += volume_ * row.w[n];
      rows_.push_back(row);
    }
  }

  // The strip as a whole, c the same all over, at W(u) = `load` without any damage.
  Energy whole(double load) const {
    const double density = load / height_, c = 1 / (1 + 4 * length_ * (1 - residual_) * density);
    return {height_ * ((1 - residual_) * c * c + residual_) * density,
            height_ * (1 - c) * (1 - c) / (4 * length_)};
  }

  // Broken at the same load: of the states that follow from a band of c = 0 at several places, the one of least energy; infinite
  // if the band closes in all of them.
  Energy broken(double load) const {
    Energy best{std::numeric_limits<double>::infinity(), 0};
    for (const double middle : {0.0, 0.25, 0.5})
      for (const double half : {0.51, 0.76}) {
        const Energy e = relax(load, height_ / 2 + middle, half);
        if (e.sum() < best.sum()) best = e;
      }
    return best;
  }

  StripThreshold threshold() const {
    double load = 1.5;
    for (int i = 0; i < 50; ++i) {
      const double cost = broken(load).sum();
      const double next = std::isinf(cost) ? 1.1 * load : load * cost / whole(load).sum();
      if (std::abs(next - load) < 1e-3 * load) return {next, cost};
      load = next;
    }
    return {NAN, NAN};
  }

 private:
  using Vector = Eigen::VectorXd;
  using Matrix = Eigen::MatrixXd;
  struct Row {
    double place, w[4], g[4];
    int node;
  };
  static double along(const double* weights, const Row& row, const Vector& x) {
    double sum = 0;
    for (int n = 0; n < Kernel::support; ++n) sum += weights[n] * x[row.node + n];
    return sum;
  }

  // Turns of displacements for c and of c for displacements; both lower the energy.
  Energy relax(double load, double middle, double half) const {
    std::vector<double> driving(rows_.size());
    for (std::size_t p = 0; p < rows_.size(); ++p)
      driving[p] = std::abs(rows_[p].place - middle) <= half ? 1e6 : 0;
    // E u^2 / 2 with the strip's elongation u as the unit of displacements.
    const double stiffness = load * height_;
    Energy energy, before{1e300, 0};
    double least = 1;  // c at the rows
    for (int turn = 0; turn < 100 && std::abs(before.sum() - energy.sum()) > 1e-6; ++turn) {
      const Vector c = phase(driving);
      least = 1;
      std::vector<double> g(rows_.size());
      for (std::size_t p = 0; p < rows_.size(); ++p) {
        const double at = along(rows_[p].w, rows_[p], c);
        g[p] = (1 - residual_) * at * at + residual_;
        least = std::min(least, at);
      }
      const Vector u = displacement(g);
      before = energy;
      energy = {0, (mass_.array() * (c.array() - 1).square()).sum() / (4 * length_)};
      for (std::size_t p = 0; p < rows_.size(); ++p) {
        driving[p] = stiffness * std::pow(along(rows_[p].g, rows_[p], u), 2);
        energy.elastic += volume_ * g[p] * driving[p];
        energy.surface += volume_ * length_ * std::pow(along(rows_[p].g, rows_[p], c), 2);
      }
    }
    constexpr double open = 0.2;
    return least < open ? energy : Energy{std::numeric_limits<double>::infinity(), 0};
  }

  Vector phase(const std::vector<double>& driving) const {
    Matrix A = mass_.asDiagonal();
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      const Row& r = rows_[p];
      const double drive = volume_ * 4 * length_ * (1 - residual_) * driving[p];
      for (int n = 0; n < Kernel::support; ++n) {
        if (lumped_) A(r.node + n, r.node + n) += drive * r.w[n];
        for (int m = 0; m < Kernel::support; ++m)
          A(r.node + n, r.node + m) +=
              volume_ * 4 * length_ * length_ * r.g[n] * r.g[m] + (lumped_ ? 0 : drive * r.w[n] * r.w[m]);
      }
    }
    for (int i = 0; i < A.rows(); ++i)
      if (mass_[i] == 0) A(i, i) = 1;
    return A.ldlt().solve(mass_);
  }

  Vector displacement(const std::vector<double>& g) const {
    const int nodes = static_cast<int>(mass_.size());
    Matrix A = Matrix::Zero(nodes, nodes);
    for (std::size_t p = 0; p < rows_.size(); ++p) {
      const Row& r = rows_[p];
      for (int n = 0; n < Kernel::support; ++n)
        for (int m = 0; m < Kernel::support; ++m)
          A(r.node + n, r.node + m) += volume_ * g[p] * r.g[n] * r.g[m];
    }
    Vector u = Vector::Zero(nodes);
    u.tail(nodes - first_free_ - free_).setOnes();
    u.segment(first_free_, free_) =
        A.block(first_free_, first_free_, free_, free_).ldlt().solve(-A.middleRows(first_free_, free_) * u);
    return u;
  }

  int height_;
  double length_;
  bool lumped_;
  double residual_, volume_;
  int first_free_ = 0, free_ = 0;
  std::vector<Row> rows_;
  Vector mass_;
};

}  // namespace mpm::test
