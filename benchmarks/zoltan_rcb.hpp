// Zoltan's recursive coordinate bisection of weighted points, where the library is installed.
#pragma once

#include <vector>

#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

struct WeightedPoint {
  double place[3];
  float weight;
  unsigned id;  // a number of its own over all ranks
};

class ZoltanRcb {
 public:
  // Keeps its cuts, so that a second call starts from those of the first if `reuse` is set.
  ZoltanRcb(const Communicator& communicator, int parts, bool reuse);
  ~ZoltanRcb();
  ZoltanRcb(const ZoltanRcb&) = delete;
  ZoltanRcb& operator=(const ZoltanRcb&) = delete;

  static bool available();
  // The part of each of this rank's points. Collective.
  std::vector<int> partition(const std::vector<WeightedPoint>& points);

 private:
  void* handle_ = nullptr;
};

}  // namespace mpm
