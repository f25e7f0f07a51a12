// Shares of the program's own timers in a piece of work that is repeated.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "machine.hpp"
#include "mpm_hpc/base/timer.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// What the program's timers say of each block of steps, as shares of it; medians, because other work comes and goes.
class StageShares {
 public:
  void measure(Timers& timers, const std::function<void()>& steps) {
    const std::vector<double> before = timers.seconds();
    {
      auto s = timers.scope(whole);
      steps();
    }
    blocks_.emplace_back();
    for (int i = 0; i < timers.size(); ++i)
      blocks_.back()[timers.names()[i]] =
          timers.seconds()[i] - (i < static_cast<int>(before.size()) ? before[i] : 0);
  }
  // Of some stages together; 0 for those that were never entered. Over all ranks and the blocks after the first, which
  // warms up. Collective.
  double of(const Communicator& communicator, const std::vector<std::string>& stages) const {
    std::vector<double> shares;
    for (std::size_t i = 1; i < blocks_.size(); ++i) {
      double sum = 0;
      for (const std::string& stage : stages) sum += seconds(i, stage);
      shares.push_back(communicator.sum(sum) / communicator.sum(seconds(i, whole)));
    }
    return median(std::move(shares));
  }

 private:
  static constexpr const char* whole = "benchmark steps";
  double seconds(std::size_t block, const std::string& stage) const {
    const auto found = blocks_[block].find(stage);
    return found == blocks_[block].end() ? 0 : found->second;
  }
  std::vector<std::map<std::string, double>> blocks_;
};

}  // namespace mpm
