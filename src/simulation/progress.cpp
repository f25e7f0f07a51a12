#include "mpm_hpc/simulation/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace mpm {

namespace {

// mpirun gives its ranks a pseudo terminal even when its own output goes to a file, so under mpirun its output counts.
bool writes_to_terminal() {
  if (!isatty(STDOUT_FILENO)) return false;
  if (!std::getenv("OMPI_COMM_WORLD_SIZE")) return true;
  char target[256];
  const std::string link = fmt::format("/proc/{}/fd/1", getppid());
  const ssize_t length = readlink(link.c_str(), target, sizeof(target));
  if (length <= 0) return false;
  const std::string name(target, static_cast<std::size_t>(length));
  return name.starts_with("/dev/pts/") || name.starts_with("/dev/tty");
}

}  // namespace

std::string short_duration(Real seconds) {
  const auto s = static_cast<std::int64_t>(std::ceil(seconds));
  if (s < 60) return fmt::format("{}s", s);
  if (s < 3600) return fmt::format("{}m{:02d}s", s / 60, s % 60);
  return fmt::format("{}h{:02d}m", s / 3600, s / 60 % 60);
}

Progress::Progress(bool speaks, Real start, Real end)
    : speaks_(speaks), terminal_(writes_to_terminal()), start_(start), end_(end), began_(Clock::now()), last_(began_) {}

Progress::~Progress() {
  if (open_line_) std::printf("\n");
}

void Progress::report(std::int64_t step, Real time, Real dt, const char* bound_by,
                      const std::string& solved) {
  if (!speaks_) return;
  const Clock::time_point now = Clock::now();
  const Real interval = terminal_ ? 0.2 : 10;
  if (std::chrono::duration<Real>(now - last_).count() < interval) return;
  last_ = now;
  const Real share = (time - start_) / (end_ - start_), spent = std::chrono::duration<Real>(now - began_).count();
  const std::string eta = share > 0 ? short_duration(spent * (1 - share) / share) : "?";
  const std::string line = fmt::format("{:5.1f} %  step {}  t = {:.4e} s  dt = {:.2e} s ({})  {}{}left {}", 100 * share,
                                       step, time, dt, bound_by, solved, solved.empty() ? "" : "  ", eta);
  if (terminal_) {
    std::printf("\r\033[K%s", line.c_str());
    open_line_ = true;
  } else {
    std::printf("%s\n", line.c_str());
  }
  std::fflush(stdout);
}

void Progress::log(std::int64_t step, Real time, Real dt, const std::string& solved) {
  if (!speaks_ || terminal_) return;
  std::printf("step %lld  t = %.4e s  dt = %.2e s  %s\n", static_cast<long long>(step), time, dt, solved.c_str());
  std::fflush(stdout);
}

void Progress::say(const std::string& line) {
  if (!speaks_) return;
  std::printf("%s%s\n", open_line_ ? "\r\033[K" : "", line.c_str());
  open_line_ = false;
  std::fflush(stdout);
}

}  // namespace mpm
