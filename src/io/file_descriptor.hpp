// POSIX files with every error reported; MPI-IO of Open MPI 4.1 returns success when an aggregator's disk is
// full.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace mpm {

// Ending of files that are still being written.
inline constexpr const char* temporary_ending = ".tmp";

class FileDescriptor {
 public:
  FileDescriptor() = default;
  // Throws FileError, as all members but the destructor do.
  FileDescriptor(const std::filesystem::path& file, int flags);
  ~FileDescriptor();
  FileDescriptor(FileDescriptor&& other) noexcept;
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;

  void write(std::uint64_t offset, const void* data, std::size_t bytes);
  void read(std::uint64_t offset, void* data, std::size_t bytes) const;
  std::uint64_t size() const;
  // Takes the space on the disk beforehand, so that a full disk shows at once; no effect where the file
  // system can't.
  void reserve(std::uint64_t bytes);
  void resize(std::uint64_t bytes);
  void sync();
  void close();

 private:
  [[noreturn]] void fail(const char* doing) const;

  int descriptor_ = -1;
  std::filesystem::path file_;
};

// `durable` waits until the disk knows the new name. Throws FileError.
void rename_file(const std::filesystem::path& from, const std::filesystem::path& to, bool durable);

}  // namespace mpm
