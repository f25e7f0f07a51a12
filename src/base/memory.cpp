#include "mpm_hpc/base/memory.hpp"

#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace mpm {

std::size_t total_bytes(const MemoryAccount& account) {
  std::size_t total = 0;
  for (const auto& [holder, bytes] : account) total += bytes;
  return total;
}

void return_freed_memory() {
#ifdef M_MMAP_THRESHOLD
  constexpr int large = 1 << 20;
  mallopt(M_MMAP_MAX, 1 << 16);  // the C library's own value
  mallopt(M_MMAP_THRESHOLD, large);
  mallopt(M_TRIM_THRESHOLD, 2 * large);
#endif
}

ResidentMemory resident_memory() {
  char text[4096] = "";
  const int file = ::open("/proc/self/status", O_RDONLY | O_CLOEXEC);
  if (file < 0) return {};
  const ssize_t size = ::read(file, text, sizeof(text) - 1);
  ::close(file);
  if (size <= 0) return {};
  const auto value = [&text](const char* key) -> std::size_t {
    const char* line = std::strstr(text, key);
    return line ? std::strtoull(line + std::strlen(key), nullptr, 10) * 1024 : 0;
  };
  return {value("VmRSS:"), value("VmHWM:")};
}

namespace {

// Whether the peak of resident_memory() starts anew.
bool restart_peak() {
  const int file = ::open("/proc/self/clear_refs", O_WRONLY | O_CLOEXEC);
  if (file < 0) return false;
  const bool done = ::write(file, "5", 1) == 1;
  ::close(file);
  return done;
}

}  // namespace

MemoryWatch::MemoryWatch() : open_{0} {
  restarts_ = restart_peak();
  before_ = resident_memory().now;
}

void MemoryWatch::look() {
  open_.back() = std::max(open_.back(), resident_memory().peak);
  if (restarts_) restart_peak();
}

void MemoryWatch::begin() {
  look();
  open_.push_back(0);
}

void MemoryWatch::end(const std::string& name) {
  look();
  const std::size_t highest = open_.back();
  std::size_t& peak = peaks_[name];
  peak = std::max(peak, highest);
  open_.pop_back();
  if (open_.size() > 1) open_.back() = std::max(open_.back(), highest);
}

std::map<std::string, std::size_t> MemoryWatch::peaks() {
  look();
  std::map<std::string, std::size_t> all = peaks_;
  all[steps] = std::max(all[steps], open_.front());
  return all;
}

}  // namespace mpm
