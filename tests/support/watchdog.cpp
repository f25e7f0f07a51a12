#include "support/watchdog.hpp"

#include <cxxabi.h>
#include <execinfo.h>
#include <mpi.h>
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cstdio>
#include <cstdlib>

namespace mpm::test {
namespace {

constexpr int exit_code = 124;  // as timeout(1)

void* frames[64];
std::atomic<int> frame_count = 0;

void record_stack(int) { frame_count = backtrace(frames, 64); }

// "object(mangled+0x1f) [address]" as the function's name, or as it is where the name is not known.
std::string readable(const std::string& frame) {
  const auto open = frame.find('('), end = frame.find_first_of("+)", open);
  if (open == std::string::npos || end == std::string::npos) return frame;
  const std::string mangled = frame.substr(open + 1, end - open - 1);
  char* name = abi::__cxa_demangle(mangled.c_str(), nullptr, nullptr, nullptr);
  const std::string result = name ? name : mangled.empty() ? frame : mangled;
  std::free(name);
  return result;
}

// The calls of the main thread from where it stands up to GoogleTest's own.
std::string stack_of(std::thread::native_handle_type thread) {
  frame_count = 0;
  pthread_kill(thread, SIGUSR2);
  for (int i = 0; i < 100 && frame_count == 0; ++i) usleep(10000);
  char** symbols = backtrace_symbols(frames, frame_count);
  std::string text;
  for (int i = 2; symbols && i < frame_count; ++i) {  // 0 and 1 are the signal handler
    const std::string name = readable(symbols[i]);
    if (name.find("testing::") != std::string::npos) break;
    text.append("    ").append(name).append("\n");
  }
  std::free(symbols);
  return text;
}

}  // namespace

Watchdog::Watchdog(int rank) : rank_(rank), main_thread_(pthread_self()) {
  void* warm_up[1];
  backtrace(warm_up, 1);  // the first call loads a library, which a signal handler may not do
  signal(SIGUSR2, record_stack);
  thread_ = std::thread([this] { run(); });
}

Watchdog::~Watchdog() {
  {
    std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

void Watchdog::watch(const std::string& activity, std::chrono::seconds limit) {
  {
    std::lock_guard lock(mutex_);
    activity_ = activity;
    limit_ = limit;
    deadline_ = std::chrono::steady_clock::now() + limit;
  }
  changed_.notify_one();
}

void Watchdog::run() {
  std::unique_lock lock(mutex_);
  while (!stopped_) {
    if (deadline_ == std::chrono::steady_clock::time_point::max()) {
      changed_.wait(lock);
    } else if (std::chrono::steady_clock::now() >= deadline_) {
      end_everything();
    } else {
      changed_.wait_until(lock, deadline_);
    }
  }
}

void Watchdog::end_everything() {
  const std::string text = "[rank " + std::to_string(rank_) + "] HANGS: " + activity_ +
                           " lasted longer than " + std::to_string(limit_.count()) +
                           " s; innermost call first:\n" + stack_of(main_thread_);
  std::fwrite(text.data(), 1, text.size(), stderr);
  sleep(1);  // the other ranks' watchdogs print their stacks as well
  int finalized = 0;
  MPI_Finalized(&finalized);
  if (finalized) _exit(exit_code);
  signal(SIGALRM, SIG_DFL);
  alarm(10);  // in case MPI_Abort waits for a lock that the main thread holds
  MPI_Abort(MPI_COMM_WORLD, exit_code);
}

}  // namespace mpm::test
