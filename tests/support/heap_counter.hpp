// Counts every byte that the process takes from malloc, libraries included: replaces malloc and its kin, so exactly one
// file of a program may include this. Without effect under the address sanitizer, which has its own malloc.
#pragma once

#include <malloc.h>

#include <atomic>
#include <cerrno>
#include <cstddef>

namespace mpm::test {

class HeapCounter {
 public:
#ifdef __SANITIZE_ADDRESS__
  static constexpr bool works = false;
#else
  static constexpr bool works = true;
#endif
  static std::size_t live() { return live_; }
  // Largest live() since the last restart_peak().
  static std::size_t peak() { return peak_; }
  static void restart_peak() { peak_.store(live_); }

  static void* taken(void* block) {
    if (!block) return block;
    const std::size_t now = live_ += malloc_usable_size(block);
    std::size_t peak = peak_;
    while (now > peak && !peak_.compare_exchange_weak(peak, now)) {
    }
    return block;
  }
  static void returned(void* block) {
    if (block) live_ -= malloc_usable_size(block);
  }

 private:
  static inline std::atomic<std::size_t> live_ = 0, peak_ = 0;
};

}  // namespace mpm::test

#ifndef __SANITIZE_ADDRESS__
// The C library's own functions under their other names.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);
void __libc_free(void*);

void* malloc(std::size_t bytes) { return mpm::test::HeapCounter::taken(__libc_malloc(bytes)); }
void* calloc(std::size_t count, std::size_t bytes) {
  return mpm::test::HeapCounter::taken(__libc_calloc(count, bytes));
}
void* realloc(void* block, std::size_t bytes) {
  mpm::test::HeapCounter::returned(block);
  void* moved = __libc_realloc(block, bytes);
  if (!moved && bytes > 0) mpm::test::HeapCounter::taken(block);
  return mpm::test::HeapCounter::taken(moved);
}
void* memalign(std::size_t alignment, std::size_t bytes) {
  return mpm::test::HeapCounter::taken(__libc_memalign(alignment, bytes));
}
void* aligned_alloc(std::size_t alignment, std::size_t bytes) { return memalign(alignment, bytes); }
int posix_memalign(void** block, std::size_t alignment, std::size_t bytes) {
  *block = memalign(alignment, bytes);
  return *block ? 0 : ENOMEM;
}
void free(void* block) {
  mpm::test::HeapCounter::returned(block);
  __libc_free(block);
}
}
#endif
