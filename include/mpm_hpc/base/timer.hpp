// Wall-clock time of named stages on one rank; reductions over ranks are the business of the parallel layer.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace mpm {

// Stages are interned to small integers outside of loops: `const int p2g = timers.stage("p2g");`, and timed
// by
// `{ auto s = timers.scope(p2g); ... }`. Nested scopes of different stages each count their whole duration.
class Timers {
 public:
  using Clock = std::chrono::steady_clock;

  class Scope {
   public:
    Scope(Timers& timers, int stage) : timers_(&timers), stage_(stage), start_(Clock::now()) {}
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;
    ~Scope() { stop(); }
    // Ends the measurement before the scope does; a second call does nothing.
    void stop() {
      if (timers_) timers_->add(stage_, std::chrono::duration<double>(Clock::now() - start_).count());
      timers_ = nullptr;
    }

   private:
    Timers* timers_;
    int stage_;
    Clock::time_point start_;
  };

  // The number of a stage, made on the first call with that name; numbers count from 0 in order of creation.
  int stage(std::string_view name);
  [[nodiscard]] Scope scope(int stage) { return Scope(*this, stage); }
  [[nodiscard]] Scope scope(std::string_view name) { return Scope(*this, stage(name)); }
  void add(int stage, double seconds) {
    seconds_[stage] += seconds;
    ++calls_[stage];
  }
  void reset();  // zero times and calls, same stages

  int size() const { return static_cast<int>(names_.size()); }
  const std::vector<std::string>& names() const { return names_; }
  const std::vector<double>& seconds() const { return seconds_; }  // [s]
  const std::vector<std::int64_t>& calls() const { return calls_; }

 private:
  std::vector<std::string> names_;
  std::vector<double> seconds_;
  std::vector<std::int64_t> calls_;
};

}  // namespace mpm
