// Faults, sorted by whom they concern; each class fixes the exit code of the program.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>

namespace mpm {

enum class ExitCode : int {
  done = 0,
  user_error = 2,
  numerical_failure = 3,
  file_failure = 4,
  stopped_by_signal = 75,  // after a checkpoint
};

class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& what) : std::runtime_error(what), code_(code) {}
  ExitCode code() const { return code_; }

 private:
  ExitCode code_;
};

// The scene or the command line is wrong: one sentence with file, line and remedy.
struct UserError : Error {
  explicit UserError(const std::string& what) : Error(ExitCode::user_error, what) {}
};

// The run itself went wrong: names the particle, the place, the step and a suggestion.
struct NumericalFailure : Error {
  explicit NumericalFailure(const std::string& what) : Error(ExitCode::numerical_failure, what) {}
};

// A file is missing, damaged, foreign or can't be written.
struct FileError : Error {
  explicit FileError(const std::string& what) : Error(ExitCode::file_failure, what) {}
};

// A bug of ours; never the user's fault.
struct LogicError : std::logic_error {
  using std::logic_error::logic_error;
};

template <class... A>
void require(bool ok, fmt::format_string<A...> message, A&&... args) {
  if (!ok) throw UserError(fmt::format(message, std::forward<A>(args)...));
}

// Guards internal invariants; active in every build because each use is outside the particle loops.
inline void debug_check(bool ok, const char* message) {
  if (!ok) throw LogicError(message);
}

}  // namespace mpm
