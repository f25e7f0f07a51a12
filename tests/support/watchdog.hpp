// Ends a run that hangs, because a rank that waits for another one would wait forever.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string>
#include <thread>

namespace mpm::test {

// A thread that prints what hangs, with the stack of the main thread, and calls MPI_Abort once the current
// activity has lasted too long. Construct it on the main thread after MPI_Init.
class Watchdog {
 public:
  explicit Watchdog(int rank);
  ~Watchdog();
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  // Starts the clock anew for `activity`, which may last `limit`.
  void watch(const std::string& activity, std::chrono::seconds limit);

 private:
  void run();
  void end_everything();

  int rank_;
  std::thread::native_handle_type main_thread_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopped_ = false;
  std::string activity_;
  std::chrono::seconds limit_{0};
  std::chrono::steady_clock::time_point deadline_ = std::chrono::steady_clock::time_point::max();
  std::thread thread_;
};

}  // namespace mpm::test
