#include "mpm_hpc/solvers/newton_solver.hpp"

#include <petscsnes.h>

#include <algorithm>
#include <cmath>
#include <exception>

#include "mpm_hpc/base/memory.hpp"
#include "mpm_hpc/parallel/mpi_handle.hpp"
#include "mpm_hpc/solvers/linear_solver.hpp"
#include "petsc_check.hpp"
#include "tangent_matrix.hpp"

namespace mpm {

namespace {

// Read access to a vector's entries on this rank.
class Entries {
 public:
  explicit Entries(::Vec v) : v_(v) { VecGetArrayRead(v_, &data_); }
  ~Entries() { VecRestoreArrayRead(v_, &data_); }
  Entries(const Entries&) = delete;
  Entries& operator=(const Entries&) = delete;
  const Real* data() const { return data_; }

 private:
  ::Vec v_;
  const PetscScalar* data_ = nullptr;
};

// Write access.
class Slots {
 public:
  explicit Slots(::Vec v) : v_(v) { VecGetArray(v_, &data_); }
  ~Slots() { VecRestoreArray(v_, &data_); }
  Slots(const Slots&) = delete;
  Slots& operator=(const Slots&) = delete;
  Real* data() const { return data_; }

 private:
  ::Vec v_;
  PetscScalar* data_ = nullptr;
};

}  // namespace

BlockStorage storage_for(const std::string& preconditioner) {
  if (preconditioner.empty()) return BlockStorage::symmetric;
  const bool coarsens = preconditioner == PCGAMG || preconditioner == PCHYPRE || preconditioner == PCML;
  return coarsens ? BlockStorage::entries : BlockStorage::full;
}

struct NewtonSolver::Impl {
  MPI_Comm comm = MPI_COMM_NULL;
  std::string prefix;
  int block = 1;
  NewtonOptions options;
  int local_rows = 0;  // blocks
  GlobalIndex first_row = 0, rows = 0;
  TangentMatrix tangent;
  ::Mat shell = nullptr;
  Apply apply;
  std::vector<Real> diagonal;

  const NewtonProblem* problem = nullptr;
  NewtonResult result;
  Real scale = 0;           // of the residual last computed
  bool linearised = false;  // at the present x, before SNES asks
  bool projected = true;    // the last tangent
  bool bends_down = false;  // seen in this solve
  NewtonProblem::Potential at{};
  std::exception_ptr fault;  // thrown inside a callback, where PETSc's frames must not be unwound

  ~Impl() { MatDestroy(&shell); }
  // What was put in place.
  ::Mat matrix() const { return shell ? shell : tangent.get(); }

  // Runs f inside a callback of PETSc.
  template <class F>
  PetscErrorCode guarded(F&& f) {
    try {
      f();
    } catch (...) {
      fault = std::current_exception();
      return PETSC_ERR_LIB;
    }
    return 0;
  }

  static PetscErrorCode residual(SNES, ::Vec x, ::Vec r, void* context) {
    Impl& self = *static_cast<Impl*>(context);
    return self.guarded([&] {
      const Entries in(x);
      const Slots out(r);
      self.scale = self.problem->residual(in.data(), out.data());
    });
  }
  static PetscErrorCode objective(SNES, ::Vec x, PetscReal* value, void* context) {
    Impl& self = *static_cast<Impl*>(context);
    return self.guarded([&] { *value = self.problem->potential(Entries(x).data()).value; });
  }
  static PetscErrorCode jacobian(SNES, ::Vec x, ::Mat, ::Mat, void* context) {
    Impl& self = *static_cast<Impl*>(context);
    if (std::exchange(self.linearised, false)) return 0;
    return self.guarded([&] { self.linearise(Entries(x).data(), self.result.residual < near); });
  }
  // Residual over its scale below which the tangent itself is worth trying.
  static constexpr Real near = 0.1;
  void linearise(const Real* x, bool is_near) {
    projected = options.projection == Projection::always ||
                (options.projection == Projection::automatic && (bends_down || !is_near));
    problem->linearise(x, projected);
  }
  static PetscErrorCode multiply(::Mat shell, ::Vec x, ::Vec y) {
    void* context = nullptr;
    PetscCall(MatShellGetContext(shell, &context));
    Impl& self = *static_cast<Impl*>(context);
    return self.guarded([&] {
      const Entries in(x);
      const Slots out(y);
      self.apply(in.data(), out.data());
    });
  }
  static PetscErrorCode get_diagonal(::Mat shell, ::Vec d) {
    void* context = nullptr;
    PetscCall(MatShellGetContext(shell, &context));
    const Slots out(d);
    const std::vector<Real>& diagonal = static_cast<Impl*>(context)->diagonal;
    std::copy(diagonal.begin(), diagonal.end(), out.data());
    return 0;
  }
  static PetscErrorCode converged(SNES, PetscInt iteration, PetscReal, PetscReal, PetscReal norm,
                                  SNESConvergedReason* reason, void* context) {
    Impl& self = *static_cast<Impl*>(context);
    self.result.residual = self.scale > 0 ? norm / self.scale : 0;
    if (iteration == 0) self.result.first_residual = self.result.residual;
    *reason = SNES_CONVERGED_ITERATING;
    if (!std::isfinite(norm)) {
      *reason = SNES_DIVERGED_FNORM_NAN;
    } else if (norm <= self.options.tolerance * self.scale) {
      *reason = SNES_CONVERGED_FNORM_RELATIVE;
    }
    return 0;
  }

  // PETSc's bt with two differences: the share of the step that is allowed at all, and a slack of the potential's rounding
  // errors, below which bt would find no decrease and give up.
  static PetscErrorCode backtrack(SNESLineSearch search, void* context) {
    Impl& self = *static_cast<Impl*>(context);
    ::Vec x, f, y, w, g;
    SNES snes;
    PetscCall(SNESLineSearchGetVecs(search, &x, &f, &y, &w, &g));
    PetscCall(SNESLineSearchGetSNES(search, &snes));
    PetscReal slope = 0, length = 0;
    PetscCall(self.guarded([&] { self.problem->project(Slots(y).data()); }));
    PetscCall(VecDot(f, y, &slope));
    PetscCall(VecNorm(y, NORM_2, &length));
    KSP ksp;
    KSPConvergedReason reason;
    PetscCall(SNESGetKSP(snes, &ksp));
    PetscCall(KSPGetConvergedReason(ksp, &reason));
    const bool bent =
        reason == KSP_DIVERGED_INDEFINITE_MAT || reason == KSP_DIVERGED_INDEFINITE_PC || !(slope > 0);
    self.bends_down = self.bends_down || bent;
    constexpr Real sufficient = 1e-4, rounding = 1e-14, least = 1e-10;
    Real share = 1;
    PetscCall(self.guarded([&] { share = self.problem->step_share(Entries(x).data(), Entries(y).data()); }));
    bool accepted = false;
    // No direction at all: x stays, and the next tangent is a projected one.
    if (!(slope > 0) && bent && !self.projected && self.options.projection == Projection::automatic) {
      share = 0;
      accepted = true;
      PetscCall(VecCopy(x, w));
    }
    // Conjugate gradients end at directions of descent, unless rounding is all that is left.
    while (share > least && slope > 0) {
      PetscCall(VecWAXPY(w, -share, y, x));
      NewtonProblem::Potential there{};
      PetscCall(self.guarded([&] { there = self.problem->potential(Entries(w).data()); }));
      const Real slack = rounding * std::max(self.at.magnitude, there.magnitude);
      self.result.rounding = std::max(self.result.rounding, slack);
      if (std::isfinite(there.value) && there.value <= self.at.value - sufficient * share * slope + slack) {
        self.at = there;
        accepted = true;
        break;
      }
      // The least of the parabola through both values with the slope at the start.
      const Real curvature = there.value - self.at.value + share * slope;
      const Real parabola =
          std::isfinite(curvature) && curvature > 0 ? share * share * slope / (2 * curvature) : 0;
      share = std::clamp(parabola, 0.1 * share, 0.5 * share);
    }
    if (accepted) {
      PetscCall(VecCopy(w, x));
      PetscCall(SNESComputeFunction(snes, x, f));
      self.result.potentials.push_back(self.at.value);
    }
    PetscReal norm = 0, size = 0;
    PetscCall(VecNorm(f, NORM_2, &norm));
    PetscCall(VecNorm(x, NORM_2, &size));
    PetscCall(SNESLineSearchSetLambda(search, share));
    PetscCall(SNESLineSearchSetNorms(search, size, norm, share * length));
    PetscCall(SNESLineSearchSetReason(search,
                                      accepted ? SNES_LINESEARCH_SUCCEEDED : SNES_LINESEARCH_FAILED_REDUCT));
    return 0;
  }

  // A solver with all settings; PETSc's options are read here, so that wrong ones are found before the first step.
  SNES make() {
    SNES snes = nullptr;
    KSP ksp = nullptr;
    PC pc = nullptr;
    SNESLineSearch search = nullptr;
    petsc_check(SNESCreate(comm, &snes), "SNESCreate");
    petsc_check(SNESSetOptionsPrefix(snes, prefix.c_str()), "SNESSetOptionsPrefix");
    petsc_check(SNESSetType(snes, SNESNEWTONLS), "SNESSetType");
    petsc_check(SNESSetTolerances(snes, 0, 0, 0, options.max_iterations, PETSC_MAX_INT), "SNESSetTolerances");
    petsc_check(SNESSetConvergenceTest(snes, &Impl::converged, this, nullptr), "SNESSetConvergenceTest");
    petsc_check(SNESSetObjective(snes, &Impl::objective, this), "SNESSetObjective");
    petsc_check(SNESGetLineSearch(snes, &search), "SNESGetLineSearch");
    petsc_check(SNESLineSearchSetType(search, SNESLINESEARCHSHELL), "SNESLineSearchSetType");
    petsc_check(SNESLineSearchShellSetUserFunc(search, &Impl::backtrack, this),
                "SNESLineSearchShellSetUserFunc");
    petsc_check(SNESKSPSetUseEW(snes, PETSC_TRUE), "SNESKSPSetUseEW");
    petsc_check(SNESKSPSetParametersEW(snes, 2, 0.01, 0.01, PETSC_DEFAULT, PETSC_DEFAULT, PETSC_DEFAULT,
                                       PETSC_DEFAULT),
                "SNESKSPSetParametersEW");
    // A direction that the Krylov solver didn't finish is one of descent all the same.
    petsc_check(SNESSetMaxLinearSolveFailures(snes, PETSC_MAX_INT), "SNESSetMaxLinearSolveFailures");
    petsc_check(SNESGetKSP(snes, &ksp), "SNESGetKSP");
    petsc_check(KSPSetType(ksp, KSPCG), "KSPSetType");
    petsc_check(KSPGetPC(ksp, &pc), "KSPGetPC");
    petsc_check(PCSetType(pc, PCJACOBI), "PCSetType");
    petsc_check(KSPSetTolerances(ksp, PETSC_DEFAULT, 0, PETSC_DEFAULT, options.max_krylov),
                "KSPSetTolerances");
    require(SNESSetFromOptions(snes) == 0,
            "PETSc refuses one of the options of -{}...; correct its value or leave it out", prefix);
    return snes;
  }
};

NewtonSolver::NewtonSolver(const Communicator& communicator, const std::string& prefix, int block,
                           const NewtonOptions& options)
    : impl_(std::make_unique<Impl>()) {
  impl_->comm = mpi_comm(communicator);
  impl_->prefix = prefix;
  impl_->block = block;
  impl_->options = options;
  SNES snes = impl_->make();
  petsc_check(SNESDestroy(&snes), "SNESDestroy");
  LinearSolver::add_prefix(prefix);
}

NewtonSolver::~NewtonSolver() = default;

GlobalIndex NewtonSolver::set_rows(int local_block_rows) {
  Impl& s = *impl_;
  s.local_rows = local_block_rows;
  long long mine = local_block_rows, first = 0, all = 0;
  MPI_Exscan(&mine, &first, 1, MPI_LONG_LONG, MPI_SUM, s.comm);
  MPI_Allreduce(&mine, &all, 1, MPI_LONG_LONG, MPI_SUM, s.comm);
  int rank = 0;
  MPI_Comm_rank(s.comm, &rank);
  s.first_row = rank == 0 ? 0 : first;
  s.rows = all;
  petsc_check(MatDestroy(&s.shell), "MatDestroy");
  s.tangent.set_rows(s.comm, s.block, s.local_rows, s.first_row);
  return s.first_row;
}

GlobalIndex NewtonSolver::first_row() const { return impl_->first_row; }
GlobalIndex NewtonSolver::global_rows() const { return impl_->rows; }

void NewtonSolver::assemble(const BlockRows& rows, BlockStorage storage) {
  impl_->tangent.fill(rows, storage);
}

void NewtonSolver::set_operator(Apply apply, std::vector<Real> diagonal) {
  Impl& s = *impl_;
  s.apply = std::move(apply);
  s.diagonal = std::move(diagonal);
  if (!s.shell) {
    const int size = s.block * s.local_rows;
    petsc_check(MatCreateShell(s.comm, size, size, PETSC_DETERMINE, PETSC_DETERMINE, &s, &s.shell),
                "MatCreateShell");
    petsc_check(MatShellSetOperation(s.shell, MATOP_MULT, reinterpret_cast<void (*)()>(&Impl::multiply)),
                "MatShellSetOperation");
    petsc_check(
        MatShellSetOperation(s.shell, MATOP_GET_DIAGONAL, reinterpret_cast<void (*)()>(&Impl::get_diagonal)),
        "MatShellSetOperation");
    petsc_check(MatSetOption(s.shell, MAT_SPD, PETSC_TRUE), "MatSetOption");
  }
  // So that the preconditioner learns of the new diagonal.
  petsc_check(MatAssemblyBegin(s.shell, MAT_FINAL_ASSEMBLY), "MatAssemblyBegin");
  petsc_check(MatAssemblyEnd(s.shell, MAT_FINAL_ASSEMBLY), "MatAssemblyEnd");
}

void NewtonSolver::multiply(const std::vector<Real>& d, std::vector<Real>& y) {
  Impl& s = *impl_;
  ::Vec in = nullptr, out = nullptr;
  y.resize(d.size());
  const int size = s.block * s.local_rows;
  petsc_check(VecCreateMPIWithArray(s.comm, s.block, size, PETSC_DETERMINE, d.data(), &in),
              "VecCreateMPIWithArray");
  petsc_check(VecCreateMPIWithArray(s.comm, s.block, size, PETSC_DETERMINE, y.data(), &out),
              "VecCreateMPIWithArray");
  petsc_check(MatMult(s.matrix(), in, out), "MatMult");
  petsc_check(VecDestroy(&in), "VecDestroy");
  petsc_check(VecDestroy(&out), "VecDestroy");
}

NewtonResult NewtonSolver::solve(const NewtonProblem& problem, std::vector<Real>& x) {
  Impl& s = *impl_;
  debug_check(static_cast<int>(x.size()) == s.block * s.local_rows,
              "x has an entry for each unknown of the rank");
  s.result = {};
  s.problem = &problem;
  s.fault = nullptr;
  if (s.rows == 0) {
    s.result.converged = true;
    return s.result;
  }
  s.at = problem.potential(x.data());
  s.result.potentials.push_back(s.at.value);
  s.bends_down = false;
  s.linearise(x.data(), false);
  s.linearised = true;

  SNES snes = s.make();
  ::Vec solution = nullptr, residual = nullptr;
  petsc_check(
      VecCreateMPIWithArray(s.comm, s.block, s.block * s.local_rows, PETSC_DETERMINE, x.data(), &solution),
      "VecCreateMPIWithArray");
  petsc_check(VecDuplicate(solution, &residual), "VecDuplicate");
  petsc_check(SNESSetFunction(snes, residual, &Impl::residual, &s), "SNESSetFunction");
  petsc_check(SNESSetJacobian(snes, s.matrix(), s.matrix(), &Impl::jacobian, &s), "SNESSetJacobian");
  const PetscErrorCode code = SNESSolve(snes, nullptr, solution);
  SNESConvergedReason reason = SNES_CONVERGED_ITERATING;
  PetscInt iterations = 0, krylov = 0;
  SNESGetConvergedReason(snes, &reason);
  SNESGetIterationNumber(snes, &iterations);
  SNESGetLinearSolveIterations(snes, &krylov);
  SNESDestroy(&snes);
  VecDestroy(&residual);
  VecDestroy(&solution);
  if (s.fault) std::rethrow_exception(s.fault);
  petsc_check(code, "SNESSolve");
  s.result.iterations = static_cast<int>(iterations);
  s.result.krylov_iterations = static_cast<int>(krylov);
  s.result.converged = reason > 0;
  if (!s.result.converged) s.result.reason = SNESConvergedReasons[reason];
  return s.result;
}

// With the vectors of the Newton and Krylov solvers.
std::size_t NewtonSolver::allocated_bytes() const {
  const Impl& s = *impl_;
  return s.tangent.allocated_bytes() + capacity_bytes(s.diagonal) +
         8 * sizeof(Real) * static_cast<std::size_t>(s.block * s.local_rows);
}

}  // namespace mpm
