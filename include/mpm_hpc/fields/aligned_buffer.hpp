// Raw storage of one column component, aligned to cache lines and staggered against its neighbours.
#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <new>
#include <utility>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#endif

namespace mpm {

// Streams whose bases differ by a multiple of 4096 B compete for one L1 set; stagger_lines moves the base of each
// buffer by its own number of cache lines inside the page. Contents are lost when the buffer is reallocated. It takes a
// little more than it was asked for, so that it needn't move whenever a few particles arrive, and gives back what is
// far too much.
class AlignedBuffer {
 public:
  static constexpr std::size_t line = 64, page = 4096;
  // Parts of its size that a buffer takes more: one that grows is likely to grow again, on a rank that a body moves to.
  static constexpr std::size_t steady = 64, growing = 16;

  AlignedBuffer() = default;
  AlignedBuffer(std::size_t bytes, int stagger_lines) { allocate(bytes, stagger_lines); }
  AlignedBuffer(AlignedBuffer&& other) noexcept { swap(other); }
  AlignedBuffer& operator=(AlignedBuffer&& other) noexcept {
    swap(other);
    return *this;
  }
  ~AlignedBuffer() { std::free(raw_); }

  void allocate(std::size_t bytes, int stagger_lines) {
    const std::size_t needed = whole_pages(bytes);
    if (needed > allocated_ || needed + needed / 8 + 16 * page < allocated_) {
      const std::size_t room = bytes / (allocated_ > 0 && needed > allocated_ ? growing : steady);
      std::free(std::exchange(raw_, nullptr));
      allocated_ = 0;
      const std::size_t total = whole_pages(bytes + room);
      raw_ = std::aligned_alloc(page, total);
      if (!raw_) throw std::bad_alloc();
      allocated_ = total;
#ifdef MADV_HUGEPAGE
      // First touch costs more than a copy with pages of 4 KB; columns grow and move when particles arrive.
      if (total >= huge_page) madvise(raw_, total, MADV_HUGEPAGE);
#endif
    }
    data_ = static_cast<char*>(raw_) + (static_cast<std::size_t>(stagger_lines) * line) % page;
    fence(bytes);
  }

  // Says that only so many bytes from the base on are in use. It costs nothing without the address sanitizer, which
  // would take an overrun into the room for staggering or for growth for a good access.
  void fence([[maybe_unused]] std::size_t bytes) {
#ifdef __SANITIZE_ADDRESS__
    __asan_poison_memory_region(raw_, allocated_);
    __asan_unpoison_memory_region(data_, bytes);
#endif
  }

  void swap(AlignedBuffer& other) noexcept {
    std::swap(raw_, other.raw_);
    std::swap(data_, other.data_);
    std::swap(allocated_, other.allocated_);
  }

  void* data() const { return data_; }
  std::size_t capacity() const { return allocated_ > page ? allocated_ - page : 0; }
  std::size_t allocated() const { return allocated_; }

 private:
  static constexpr std::size_t huge_page = std::size_t{2} << 20;
  // With a page for the stagger.
  static constexpr std::size_t whole_pages(std::size_t bytes) { return (bytes + page + page - 1) / page * page; }

  void* raw_ = nullptr;
  void* data_ = nullptr;
  std::size_t allocated_ = 0;
};

}  // namespace mpm
