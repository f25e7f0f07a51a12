// PETSc's error codes as exceptions; not to be used inside PETSc's callbacks.
#pragma once

#include <petscsys.h>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

inline void petsc_check(PetscErrorCode code, const char* what) {
  if (code == 0) return;
  const char* text = nullptr;
  PetscErrorMessage(code, &text, nullptr);
  throw NumericalFailure(fmt::format("PETSc failed in {}: {}", what, text ? text : "unknown error"));
}

}  // namespace mpm
