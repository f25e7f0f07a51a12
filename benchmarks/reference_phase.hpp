// The plain solve of the phase field that the production one is measured against: the matrix from each particle's block of
// entries, Jacobi-PCG from zero. What one would write first with PETSc.
#pragma once

#include <petscksp.h>

#include <algorithm>
#include <vector>

#include "mpm_hpc/effects/phase_field/phase_law.hpp"
#include "mpm_hpc/fields/node_box.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"
#include "reference_step.hpp"

namespace mpm {

template <int Dim>
struct ReferencePhaseParticles {
  std::vector<ReferenceParticle<Dim>> particles;
  std::vector<Real> phase, least_energy;  // c^n; lower bound of the driving energy [J/m^3]
};

// The equations are those of phase_law.hpp, with the reaction at the particles.
template <class Kernel, int Dim>
class ReferencePhase {
 public:
  ReferencePhase(const Communicator& communicator, const GridGeometry<Dim>& geometry,
                 ReferencePhaseParticles<Dim> start, const ReferenceMaterial& material, const PhaseLaw& law)
      : communicator_(communicator),
        geometry_(geometry),
        start_(std::move(start)),
        material_(material),
        law_(law),
        grid_(geometry) {}

  // The particles keep c^n, so that the same solve can be repeated. Returns the iterations. Collective.
  int solve(Real dt) {
    const int rows = number_nodes();
    PetscInt iterations = 0;
    PetscCallAbort(comm(), solve_system(dt, rows, iterations));
    gather();
    return static_cast<int>(iterations);
  }
  // What the last solve gives back to the particles near a node: c^{n+1}, or with a mobility its increment.
  Real result(const IntVec<Dim>& node) const {
    const std::size_t i = grid_.index(node);
    return row_[i] < 0 ? 0 : solution_[row_[i]] - (by_increment() ? node_phase_[i] : 0);
  }

 private:
  static constexpr int nodes = box_nodes<Dim>(Kernel::support), couplings = box_nodes<Dim>(2 * Kernel::support - 1);

  MPI_Comm comm() const { return mpi_comm(communicator_); }

  // Volume and c^n of each node, over all ranks; those with volume are numbered.
  int number_nodes() {
    std::vector<Real>& volume = grid_.mass;
    std::fill(volume.begin(), volume.end(), 0.0);
    node_phase_.assign(volume.size(), 0.0);
    for (std::size_t p = 0; p < start_.particles.size(); ++p) {
      const ReferenceParticle<Dim>& particle = start_.particles[p];
      const Real of_particle = particle.F.determinant() * particle.volume;
      for_each_node<Kernel>(geometry_, particle.x, [&](const IntVec<Dim>& node, Real w, const Vec<Dim>&) {
        volume[grid_.index(node)] += w * of_particle;
        node_phase_[grid_.index(node)] += w * of_particle * start_.phase[p];
      });
    }
    communicator_.sum(volume);
    communicator_.sum(node_phase_);
    row_.assign(volume.size(), -1);
    int rows = 0;
    for (std::size_t i = 0; i < volume.size(); ++i)
      if (volume[i] > 0) {
        node_phase_[i] /= volume[i];
        row_[i] = rows++;
      }
    return rows;
  }

  PetscErrorCode solve_system(Real dt, int rows, PetscInt& iterations) {
    ::Mat matrix;
    ::Vec rhs, solution, everywhere;
    KSP ksp;
    PC pc;
    VecScatter scatter;
    PetscCall(MatCreateAIJ(comm(), PETSC_DECIDE, PETSC_DECIDE, rows, rows, couplings, nullptr, couplings,
                           nullptr, &matrix));
    PetscCall(MatCreateVecs(matrix, &solution, &rhs));
    for (std::size_t p = 0; p < start_.particles.size(); ++p) PetscCall(add_particle(p, dt, matrix, rhs));
    PetscCall(MatAssemblyBegin(matrix, MAT_FINAL_ASSEMBLY));
    PetscCall(MatAssemblyEnd(matrix, MAT_FINAL_ASSEMBLY));
    PetscCall(VecAssemblyBegin(rhs));
    PetscCall(VecAssemblyEnd(rhs));

    PetscCall(KSPCreate(comm(), &ksp));
    PetscCall(KSPSetOperators(ksp, matrix, matrix));
    PetscCall(KSPSetType(ksp, KSPCG));
    PetscCall(KSPGetPC(ksp, &pc));
    PetscCall(PCSetType(pc, PCJACOBI));
    PetscCall(
        KSPSetTolerances(ksp, LinearSolverOptions().relative_tolerance, 0.0, PETSC_DEFAULT, PETSC_DEFAULT));
    PetscCall(KSPSolve(ksp, rhs, solution));
    PetscCall(KSPGetIterationNumber(ksp, &iterations));

    PetscCall(VecScatterCreateToAll(solution, &scatter, &everywhere));
    PetscCall(VecScatterBegin(scatter, solution, everywhere, INSERT_VALUES, SCATTER_FORWARD));
    PetscCall(VecScatterEnd(scatter, solution, everywhere, INSERT_VALUES, SCATTER_FORWARD));
    const PetscScalar* values;
    PetscCall(VecGetArrayRead(everywhere, &values));
    solution_.assign(values, values + rows);
    PetscCall(VecRestoreArrayRead(everywhere, &values));
    PetscCall(VecScatterDestroy(&scatter));
    PetscCall(VecDestroy(&everywhere));
    PetscCall(KSPDestroy(&ksp));
    PetscCall(VecDestroy(&rhs));
    PetscCall(VecDestroy(&solution));
    PetscCall(MatDestroy(&matrix));
    return 0;
  }

  PetscErrorCode add_particle(std::size_t p, Real dt, ::Mat matrix, ::Vec rhs) const {
    const ReferenceParticle<Dim>& particle = start_.particles[p];
    const Real volume = particle.F.determinant() * particle.volume;
    const Real energy = std::max(start_.least_energy[p], material_.energy_plus<Dim>(particle.F));
    const Real reaction = volume * law_.drive(energy), conductivity = volume * law_.conductivity();
    const Real storage = volume * law_.storage(dt),
               source = volume * (1 + law_.memory(dt) * start_.phase[p]);
    const Real inverse_inertia = Kernel::inverse_inertia / (geometry_.spacing() * geometry_.spacing());
    PetscInt row[nodes];
    Real weight[nodes], value[nodes], block[nodes * nodes];
    Vec<Dim> gradient[nodes];
    int count = 0;
    for_each_node<Kernel>(geometry_, particle.x,
                          [&](const IntVec<Dim>& node, Real w, const Vec<Dim>& distance) {
                            row[count] = row_[grid_.index(node)];
                            weight[count] = w;
                            value[count] = w * source;
                            gradient[count++] = inverse_inertia * w * distance;
                          });
    for (int i = 0; i < nodes; ++i)
      for (int j = 0; j < nodes; ++j)
        block[i * nodes + j] = conductivity * gradient[i].dot(gradient[j]) +
                               reaction * weight[i] * weight[j] + (i == j ? storage * weight[i] : 0.0);
    PetscCall(MatSetValues(matrix, nodes, row, nodes, row, block, ADD_VALUES));
    PetscCall(VecSetValues(rhs, nodes, row, value, ADD_VALUES));
    return 0;
  }

  bool by_increment() const { return law_.inverse_mobility > 0; }

  // Nothing heals.
  void gather() {
    new_phase_.resize(start_.phase.size());
    for (std::size_t p = 0; p < start_.particles.size(); ++p) {
      Real phase = by_increment() ? start_.phase[p] : 0;
      for_each_node<Kernel>(
          geometry_, start_.particles[p].x,
          [&](const IntVec<Dim>& node, Real w, const Vec<Dim>&) { phase += w * result(node); });
      new_phase_[p] = std::max(0.0, std::min(start_.phase[p], phase));
    }
  }

  const Communicator& communicator_;
  GridGeometry<Dim> geometry_;
  ReferencePhaseParticles<Dim> start_;
  ReferenceMaterial material_;
  PhaseLaw law_;
  ReferenceGrid<Dim> grid_;  // its numbering; mass is the volume here
  std::vector<Real> node_phase_, solution_, new_phase_;
  std::vector<int> row_;
};

}  // namespace mpm
