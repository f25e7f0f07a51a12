#include "mpm_hpc/io/text_file.hpp"

#include <fcntl.h>

#include "file_descriptor.hpp"
#include "mpm_hpc/io/together.hpp"

namespace mpm {

void replace_text_file(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::path temporary = file;
  temporary += temporary_ending;
  try {
    FileDescriptor descriptor(temporary, O_WRONLY | O_CREAT | O_TRUNC);
    descriptor.write(0, text.data(), text.size());
    descriptor.sync();
    descriptor.close();
    rename_file(temporary, file, true);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(temporary, ignored);
    throw;
  }
}

void write_text_file(const Communicator& communicator, const std::filesystem::path& file,
                     const std::string& text) {
  on_root(communicator, [&] { replace_text_file(file, text); });
}

std::string read_text_file(const std::filesystem::path& file) {
  const FileDescriptor descriptor(file, O_RDONLY);
  std::string text(descriptor.size(), '\0');
  descriptor.read(0, text.data(), text.size());
  return text;
}

}  // namespace mpm
