// Faults of file work become the same exception on every rank, so that no rank waits for one that gave up.
#pragma once

#include <exception>
#include <utility>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// Rethrows the fault of the lowest rank that has one, with its kind and text, on every rank; faults that are
// no Error arrive as LogicError. Does nothing if no rank has one. Collective.
void agree_on_fault(const Communicator& communicator, const std::exception_ptr& fault);

// Runs `action`, which must not communicate, on every rank, and then agrees on its fault. Collective.
template <class Action>
void together(const Communicator& communicator, Action&& action) {
  std::exception_ptr fault;
  try {
    std::forward<Action>(action)();
  } catch (...) {
    fault = std::current_exception();
  }
  agree_on_fault(communicator, fault);
}

// The same for an action of rank 0 alone. Collective.
template <class Action>
void on_root(const Communicator& communicator, Action&& action) {
  together(communicator, [&] {
    if (communicator.root()) std::forward<Action>(action)();
  });
}

}  // namespace mpm
