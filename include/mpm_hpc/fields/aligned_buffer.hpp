// Raw storage of one column component, aligned to cache lines and staggered against its neighbours.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <new>
#include <utility>

namespace mpm {

// Streams whose bases differ by a multiple of 4096 B compete for one L1 set; stagger_lines moves the base of each
// buffer by its own number of cache lines inside the page. Contents are lost when the buffer is reallocated.
class AlignedBuffer {
 public:
  static constexpr std::size_t line = 64, page = 4096;

  AlignedBuffer() = default;
  AlignedBuffer(std::size_t bytes, int stagger_lines) { allocate(bytes, stagger_lines); }
  AlignedBuffer(AlignedBuffer&& other) noexcept { swap(other); }
  AlignedBuffer& operator=(AlignedBuffer&& other) noexcept {
    swap(other);
    return *this;
  }
  ~AlignedBuffer() { std::free(raw_); }

  void allocate(std::size_t bytes, int stagger_lines) {
    const std::size_t total = (bytes + page + page - 1) / page * page;
    if (total > allocated_) {
      std::free(raw_);
      raw_ = std::aligned_alloc(page, total);
      if (!raw_) {
        allocated_ = 0;
        throw std::bad_alloc();
      }
      allocated_ = total;
    }
    stagger(stagger_lines);
  }

  // Moves the base to another cache line; the contents don't move with it.
  void stagger(int lines) { data_ = static_cast<char*>(raw_) + (static_cast<std::size_t>(lines) * line) % page; }

  void swap(AlignedBuffer& other) noexcept {
    std::swap(raw_, other.raw_);
    std::swap(data_, other.data_);
    std::swap(allocated_, other.allocated_);
  }

  void* data() const { return data_; }
  std::size_t capacity() const { return allocated_ > page ? allocated_ - page : 0; }
  std::size_t allocated() const { return allocated_; }

 private:
  void* raw_ = nullptr;
  void* data_ = nullptr;
  std::size_t allocated_ = 0;
};

}  // namespace mpm
