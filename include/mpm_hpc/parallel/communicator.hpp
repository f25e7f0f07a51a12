// The ranks that share one simulation; the only place from which the layers above talk to other ranks.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// A sum that carries its rounding error along, so that it doesn't depend on the order of the terms to double precision.
struct CompensatedSum {
  Real high = 0, low = 0;
  void add(Real value) {
    const Real sum = high + value, part = sum - high;
    low += (high - (sum - part)) + (value - part);
    high = sum;
  }
  Real value() const { return high + low; }
};

// Every member but rank(), size(), root() and abort() is collective.
class Communicator {
 public:
  using Bytes = std::vector<char>;

  static Communicator world();

  int rank() const { return rank_; }
  int size() const { return size_; }
  bool root() const { return rank_ == 0; }

  Real sum(Real value) const;
  Real min(Real value) const;
  Real max(Real value) const;
  GlobalIndex sum(GlobalIndex value) const;
  GlobalIndex max(GlobalIndex value) const;
  // In place, element by element.
  void sum(std::vector<Real>& values) const;
  void min(std::vector<Real>& values) const;
  void max(std::vector<Real>& values) const;
  void max(std::vector<GlobalIndex>& values) const;
  void sum(std::vector<CompensatedSum>& values) const;
  // Sum over the ranks before this one.
  GlobalIndex exclusive_sum(GlobalIndex value) const;
  // Largest of the ranks before this one; -1 on rank 0.
  GlobalIndex exclusive_max(GlobalIndex value) const;
  bool any(bool value) const { return max(static_cast<GlobalIndex>(value)) != 0; }

  void broadcast(Bytes& bytes, int from = 0) const;
  void broadcast(std::string& text, int from = 0) const;
  // All ranks' bytes on rank 0, in the order of the ranks; empty elsewhere.
  std::vector<Bytes> gather(const Bytes& bytes) const;

  // Sends each (rank, bytes) and returns what came in, in the order of the source ranks. Nobody has to know who will
  // send (non-blocking consensus), so the cost doesn't grow with the number of ranks that stay silent.
  std::vector<std::pair<int, Bytes>> exchange(const std::map<int, Bytes>& outgoing) const;

  // Throws NumericalFailure with the same text on every rank if any rank gives a text (the lowest rank's wins).
  void fail_together(const std::string& failure) const;

  void barrier() const;
  // Ends all ranks at once; for faults that only this rank knows of.
  [[noreturn]] void abort(int code) const;

  // Messages and bytes sent through exchange() by this rank.
  GlobalIndex messages() const;
  GlobalIndex bytes() const;
  // Times that all ranks waited for each other: reductions, broadcasts, gathers, barriers, rounds of exchange().
  GlobalIndex collectives() const;

  struct Handle;
  const Handle& handle() const { return *handle_; }

 private:
  std::shared_ptr<Handle> handle_;
  int rank_ = 0, size_ = 1;
};

}  // namespace mpm
