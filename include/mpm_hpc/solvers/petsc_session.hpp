// Starts and ends PETSc with the options of the command line.
#pragma once

#include <string>
#include <vector>

namespace mpm {

// One per process, alive while any solver is. Needs a running MPI.
class PetscSession {
 public:
  // Options as on a command line: "-phase_ksp_rtol", "1e-8", ...
  explicit PetscSession(const std::vector<std::string>& options = {});
  ~PetscSession();
  PetscSession(const PetscSession&) = delete;
  PetscSession& operator=(const PetscSession&) = delete;

  // Options that nothing has read so far, with their dash.
  static std::vector<std::string> unused_options();
  // Reductions over more than one rank that PETSc has done since the start of the process.
  static double reductions();

 private:
  bool owner_ = false;  // false when PETSc was running already
};

}  // namespace mpm
