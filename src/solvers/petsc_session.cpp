#include "mpm_hpc/solvers/petsc_session.hpp"

#include <petsclog.h>
#include <petscsys.h>

#include "petsc_check.hpp"

namespace mpm {

PetscSession::PetscSession(const std::vector<std::string>& options) {
  PetscBool running = PETSC_FALSE;
  petsc_check(PetscInitialized(&running), "PetscInitialized");
  if (running) return;
  owner_ = true;
  std::vector<std::string> words = {"mpm_hpc", "-no_signal_handler"};  // SIGTERM means a checkpoint here
  words.insert(words.end(), options.begin(), options.end());
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  int count = static_cast<int>(words.size());
  char** arguments = pointers.data();
  petsc_check(PetscInitialize(&count, &arguments, nullptr, nullptr), "PetscInitialize");
  // Errors come back as codes, which petsc_check turns into exceptions.
  petsc_check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr), "PetscPushErrorHandler");
}

PetscSession::~PetscSession() {
  if (!owner_) return;
  PetscPopErrorHandler();
  PetscFinalize();
}

std::vector<std::string> PetscSession::unused_options() {
  PetscInt count = 0;
  char **names = nullptr, **values = nullptr;
  petsc_check(PetscOptionsLeftGet(nullptr, &count, &names, &values), "PetscOptionsLeftGet");
  std::vector<std::string> unused;
  for (PetscInt i = 0; i < count; ++i) unused.push_back(std::string("-") + names[i]);
  petsc_check(PetscOptionsLeftRestore(nullptr, &count, &names, &values), "PetscOptionsLeftRestore");
  return unused;
}

double PetscSession::reductions() { return petsc_allreduce_ct; }

}  // namespace mpm
