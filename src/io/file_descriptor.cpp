#include "file_descriptor.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

FileDescriptor::FileDescriptor(const std::filesystem::path& file, int flags) : file_(file) {
  descriptor_ = ::open(file.c_str(), flags | O_CLOEXEC, 0666);
  if (descriptor_ < 0) fail(flags & (O_WRONLY | O_RDWR) ? "open for writing" : "open");
}

FileDescriptor::~FileDescriptor() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

FileDescriptor::FileDescriptor(FileDescriptor&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), file_(std::move(other.file_)) {}

FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(file_, other.file_);
  return *this;
}

void FileDescriptor::fail(const char* doing) const {
  throw FileError(fmt::format("can't {} {}: {}", doing, file_.string(), std::strerror(errno)));
}

// Linux moves at most 2 GiB in one call, and any call may move less than asked.
void FileDescriptor::write(std::uint64_t offset, const void* data, std::size_t bytes) {
  const char* from = static_cast<const char*>(data);
  while (bytes > 0) {
    const ssize_t done = ::pwrite(descriptor_, from, bytes, static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done == 0) errno = ENOSPC;
    if (done <= 0) fail("write");
    from += done;
    offset += static_cast<std::uint64_t>(done);
    bytes -= static_cast<std::size_t>(done);
  }
}

void FileDescriptor::read(std::uint64_t offset, void* data, std::size_t bytes) const {
  char* to = static_cast<char*>(data);
  while (bytes > 0) {
    const ssize_t done = ::pread(descriptor_, to, bytes, static_cast<off_t>(offset));
    if (done < 0 && errno == EINTR) continue;
    if (done == 0) throw FileError(fmt::format("{} ends before byte {}", file_.string(), offset + bytes));
    if (done < 0) fail("read");
    to += done;
    offset += static_cast<std::uint64_t>(done);
    bytes -= static_cast<std::size_t>(done);
  }
}

std::uint64_t FileDescriptor::size() const {
  struct stat status;
  if (::fstat(descriptor_, &status) != 0) fail("look at");
  return static_cast<std::uint64_t>(status.st_size);
}

void FileDescriptor::reserve(std::uint64_t bytes) {
  // Not posix_fallocate, which writes zeros where the file system can't reserve.
  if (bytes > 0 && ::fallocate(descriptor_, 0, 0, static_cast<off_t>(bytes)) != 0 && errno != EOPNOTSUPP &&
      errno != ENOSYS && errno != EINTR)
    fail("write");
}

void FileDescriptor::resize(std::uint64_t bytes) {
  if (::ftruncate(descriptor_, static_cast<off_t>(bytes)) != 0) fail("resize");
}

void FileDescriptor::sync() {
  if (::fsync(descriptor_) != 0) fail("write");
}

void FileDescriptor::close() {
  if (descriptor_ >= 0 && ::close(std::exchange(descriptor_, -1)) != 0) fail("write");
}

void rename_file(const std::filesystem::path& from, const std::filesystem::path& to, bool durable) {
  std::error_code error;
  std::filesystem::rename(from, to, error);
  if (error)
    throw FileError(fmt::format("can't rename {} to {}: {}", from.string(), to.string(), error.message()));
  if (!durable) return;
  // The name lives in the folder. Some file systems can't sync folders, and then there is nothing more to do.
  const std::filesystem::path folder = to.has_parent_path() ? to.parent_path() : ".";
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  ::fsync(descriptor);
  ::close(descriptor);
}

}  // namespace mpm
