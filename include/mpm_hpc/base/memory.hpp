// What memory is taken for: accounts of arrays by name, and the process's own peaks by phase of a run.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace mpm {

// Bytes on this rank by holder, such as ("particles/block/velocity", 12288000).
using MemoryAccount = std::vector<std::pair<std::string, std::size_t>>;

std::size_t total_bytes(const MemoryAccount& account);

template <class T>
std::size_t capacity_bytes(const std::vector<T>& values) {
  return values.capacity() * sizeof(T);
}

// Makes malloc return large blocks to the system when they are freed. By default it keeps those of up to 32 MB, and the
// SuperLU_DIST that comes with PETSc tells it to keep all: then a rank's memory stays at its highest peak and is torn into
// pieces. To be called first in main(). Without effect where malloc can't be told.
void return_freed_memory();

// Resident memory of this process [bytes], as Linux counts it; zeros elsewhere.
struct ResidentMemory {
  std::size_t now = 0, peak = 0;
};
ResidentMemory resident_memory();

// The largest resident memory in each phase of a run. Linux lets a process restart its own peak; where that isn't allowed,
// all phases share one peak.
class MemoryWatch {
 public:
  MemoryWatch();

  // From here on to the matching end() the memory belongs to a phase; outside of all phases it belongs to `steps`. Phases may
  // lie in phases. The name comes at the end, when it is known what happened.
  void begin();
  void end(const std::string& name);

  class Scope {
   public:
    Scope(MemoryWatch& watch, std::string name) : watch_(watch), name_(std::move(name)) { watch_.begin(); }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;
    ~Scope() { watch_.end(name_); }

   private:
    MemoryWatch& watch_;
    std::string name_;
  };
  [[nodiscard]] Scope phase(std::string name) { return Scope(*this, std::move(name)); }

  static constexpr const char* steps = "steps";
  bool has_phases() const { return restarts_; }
  std::size_t before() const { return before_; }  // when the watch was made
  // By phase, the present one included.
  std::map<std::string, std::size_t> peaks();

 private:
  void look();  // credits the peak so far to the phase under way and starts a new one

  std::vector<std::size_t> open_;  // peaks of the phases under way; the first one is that of the steps
  std::map<std::string, std::size_t> peaks_;
  std::size_t before_ = 0;
  bool restarts_ = false;
};

}  // namespace mpm
