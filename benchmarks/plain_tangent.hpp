// The plain assembly of an implicit step's tangent that the production one is measured against: a dense block for each
// particle, all pairs of its nodes, added to a preallocated matrix. What one would write first with PETSc.
#pragma once

#include <petscmat.h>

#include <vector>

#include "mpm_hpc/fields/node_box.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"
#include "reference_step.hpp"

namespace mpm {

// Rows of the matrix by node of the grid, the same on all ranks.
template <int Dim>
struct PlainRows {
  ReferenceGrid<Dim> grid;        // its numbering; momentum holds the nodes' velocities
  std::vector<PetscInt> numbers;  // -1: no unknown
  int local = 0;                  // nodes of this rank
};

// Compressible neo-Hookean (physics.md section 3) with MLS forces; the tangent as it is, not projected. With entries one by
// one (AIJ), or node by node (BAIJ).
template <class Kernel, int Dim>
class PlainTangent {
 public:
  enum class Insertion { entries, blocks };

  // Collective, like all members.
  PlainTangent(const Communicator& communicator, const GridGeometry<Dim>& geometry,
               const PlainRows<Dim>& rows, const std::vector<ReferenceParticle<Dim>>& particles,
               const ReferenceMaterial& material, Insertion insertion)
      : communicator_(communicator),
        geometry_(geometry),
        rows_(rows),
        particles_(particles),
        material_(material),
        insertion_(insertion) {
    PetscCallAbort(comm(), make());
  }
  ~PlainTangent() { MatDestroy(&matrix_); }
  PlainTangent(const PlainTangent&) = delete;
  PlainTangent& operator=(const PlainTangent&) = delete;

  void assemble(Real dt) {
    PetscCallAbort(comm(), MatZeroEntries(matrix_));
    for (const ReferenceParticle<Dim>& particle : particles_) PetscCallAbort(comm(), add(particle, dt));
    PetscCallAbort(comm(), MatAssemblyBegin(matrix_, MAT_FINAL_ASSEMBLY));
    PetscCallAbort(comm(), MatAssemblyEnd(matrix_, MAT_FINAL_ASSEMBLY));
  }

  // y = A d on this rank's rows.
  std::vector<Real> multiply(const std::vector<Real>& d) const {
    std::vector<Real> y(d.size());
    const auto size = static_cast<PetscInt>(d.size());
    ::Vec in = nullptr, out = nullptr;
    PetscCallAbort(comm(), VecCreateMPIWithArray(comm(), Dim, size, PETSC_DETERMINE, d.data(), &in));
    PetscCallAbort(comm(), VecCreateMPIWithArray(comm(), Dim, size, PETSC_DETERMINE, y.data(), &out));
    PetscCallAbort(comm(), MatMult(matrix_, in, out));
    VecDestroy(&in);
    VecDestroy(&out);
    return y;
  }

 private:
  static constexpr int block = Dim * Dim;
  static constexpr int nodes = box_nodes<Dim>(Kernel::support),
                       couplings = box_nodes<Dim>(2 * Kernel::support - 1);

  MPI_Comm comm() const { return mpi_comm(communicator_); }

  PetscErrorCode make() {
    const PetscInt size = Dim * rows_.local;
    // No row has more than all nodes within reach, and for few nodes the matrix has no more.
    PetscInt all = 0;
    for (const PetscInt row : rows_.numbers) all = std::max(all, row + 1);
    const PetscInt here = std::min(couplings, rows_.local), there = std::min(couplings, all - rows_.local);
    if (insertion_ == Insertion::entries) {
      PetscCall(MatCreateAIJ(comm(), size, size, PETSC_DETERMINE, PETSC_DETERMINE, Dim * here, nullptr,
                             Dim * there, nullptr, &matrix_));
    } else {
      PetscCall(MatCreateBAIJ(comm(), Dim, size, size, PETSC_DETERMINE, PETSC_DETERMINE, here, nullptr, there,
                              nullptr, &matrix_));
    }
    return 0;
  }

  // d^2 Psi / dL_ac dL_bd with F = (I + L) F^n at [a * Dim + c][b * Dim + d], from
  // dP = mu dF + (mu - lambda ln J) F^-T dF^T F^-T + lambda (F^-T : dF) F^-T and dF = dL F^n.
  Eigen::Matrix<Real, block, block> tangent(const Mat<Dim>& F, const Mat<Dim>& old) const {
    const Mat<Dim> inverse = F.inverse().transpose();
    const Real pressure = material_.mu - material_.lambda * std::log(F.determinant());
    Eigen::Matrix<Real, block, block> A;
    for (int b = 0; b < Dim; ++b)
      for (int d = 0; d < Dim; ++d) {
        Mat<Dim> dF = Mat<Dim>::Zero();
        dF.row(b) = old.row(d);
        const Mat<Dim> dP = material_.mu * dF + pressure * inverse * dF.transpose() * inverse +
                            material_.lambda * inverse.cwiseProduct(dF).sum() * inverse;
        const Mat<Dim> column = dP * old.transpose();
        for (int a = 0; a < Dim; ++a)
          for (int c = 0; c < Dim; ++c) A(a * Dim + c, b * Dim + d) = column(a, c);
      }
    return A;
  }

  PetscErrorCode add(const ReferenceParticle<Dim>& particle, Real dt) {
    const Real inverse_inertia = Kernel::inverse_inertia / (geometry_.spacing() * geometry_.spacing());
    PetscInt row[nodes];
    Real mass[nodes];
    Vec<Dim> g[nodes];
    Mat<Dim> L = Mat<Dim>::Zero();
    int count = 0;
    for_each_node<Kernel>(geometry_, particle.x,
                          [&](const IntVec<Dim>& node, Real w, const Vec<Dim>& distance) {
                            const std::size_t i = rows_.grid.index(node);
                            row[count] = rows_.numbers[i];
                            mass[count] = w * particle.mass;
                            g[count] = inverse_inertia * w * distance;
                            L += dt * rows_.grid.momentum[i] * g[count].transpose();
                            ++count;
                          });
    const Mat<Dim> F = (Mat<Dim>::Identity() + L) * particle.F;
    const Eigen::Matrix<Real, block, block> A = dt * dt * particle.volume * tangent(F, particle.F);
    // Entries of node i, direction a stand together, so that both kinds of insertion take the same array.
    Real entries[nodes * Dim][nodes * Dim];
    for (int i = 0; i < nodes; ++i) {
      Eigen::Matrix<Real, Dim, Dim> half[Dim];  // [a](b, d) = sum_c g_i[c] A[ac][bd]
      for (int a = 0; a < Dim; ++a) {
        const Eigen::Matrix<Real, 1, block> sum = g[i].transpose() * A.template middleRows<Dim>(a * Dim);
        half[a] = Eigen::Map<const Eigen::Matrix<Real, Dim, Dim, Eigen::RowMajor>>(sum.data());
      }
      for (int j = 0; j < nodes; ++j)
        for (int a = 0; a < Dim; ++a)
          for (int b = 0; b < Dim; ++b) entries[i * Dim + a][j * Dim + b] = half[a].row(b).dot(g[j]);
      for (int a = 0; a < Dim; ++a) entries[i * Dim + a][i * Dim + a] += mass[i];
    }
    if (insertion_ == Insertion::blocks) {
      PetscCall(MatSetValuesBlocked(matrix_, nodes, row, nodes, row, &entries[0][0], ADD_VALUES));
    } else {
      PetscInt entry[nodes * Dim];
      for (int k = 0; k < nodes * Dim; ++k) entry[k] = row[k / Dim] * Dim + k % Dim;
      PetscCall(MatSetValues(matrix_, nodes * Dim, entry, nodes * Dim, entry, &entries[0][0], ADD_VALUES));
    }
    return 0;
  }

  const Communicator& communicator_;
  GridGeometry<Dim> geometry_;
  const PlainRows<Dim>& rows_;
  const std::vector<ReferenceParticle<Dim>>& particles_;
  ReferenceMaterial material_;
  Insertion insertion_;
  ::Mat matrix_ = nullptr;
};

}  // namespace mpm
