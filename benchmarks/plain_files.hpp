// What the program's files are measured against: the disk's plain write and read, and HDF5 as one would first use it.
#pragma once

#include <fcntl.h>
#include <hdf5.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

class PlainFile {
 public:
  PlainFile(const std::filesystem::path& file, int flags)
      : descriptor_(::open(file.c_str(), flags | O_CLOEXEC, 0666)) {
    check(descriptor_ >= 0, "open");
  }
  PlainFile(const PlainFile&) = delete;
  PlainFile& operator=(const PlainFile&) = delete;
  ~PlainFile() { ::close(descriptor_); }
  operator int() const { return descriptor_; }
  void sync() { check(::fsync(descriptor_) == 0, "sync"); }

  static void check(bool ok, const char* doing) {
    if (!ok) throw std::runtime_error(std::string("a file of the benchmark: can't ") + doing);
  }

 private:
  int descriptor_;
};

// The part of `total` bytes that a rank has.
struct Stretch {
  std::uint64_t begin, end;
  Stretch(const Communicator& communicator, std::uint64_t total)
      : begin(total / communicator.size() * communicator.rank()),
        end(communicator.rank() + 1 == communicator.size() ? total : begin + total / communicator.size()) {}
};

inline constexpr std::size_t plain_piece = std::size_t{4} << 20;

// One stream of pwrite per rank into one new file of known size, which then takes its name, as the program's files do.
// Collective.
inline void write_plainly(const Communicator& communicator, const std::filesystem::path& file,
                          std::uint64_t total, bool sync) {
  static const std::vector<char> data(plain_piece, 'x');
  std::filesystem::path temporary = file;
  temporary += ".tmp";
  if (communicator.root()) {
    const PlainFile out(temporary, O_WRONLY | O_CREAT | O_TRUNC);
    ::fallocate(out, 0, 0, static_cast<off_t>(total));  // as the program does; without effect where it can't be done
  }
  communicator.barrier();
  {
    PlainFile out(temporary, O_WRONLY);
    const Stretch mine(communicator, total);
    for (std::uint64_t at = mine.begin; at < mine.end;) {
      const ssize_t done = ::pwrite(out, data.data(), std::min<std::uint64_t>(mine.end - at, plain_piece),
                                    static_cast<off_t>(at));
      PlainFile::check(done > 0, "write");
      at += static_cast<std::uint64_t>(done);
    }
    if (sync) out.sync();
  }
  communicator.barrier();
  if (communicator.root()) std::filesystem::rename(temporary, file);
  communicator.barrier();
}

// One stream of pread per rank. Collective.
inline void read_plainly(const Communicator& communicator, const std::filesystem::path& file) {
  static std::vector<char> data(plain_piece);
  PlainFile in(file, O_RDONLY);
  const Stretch mine(communicator, std::filesystem::file_size(file));
  for (std::uint64_t at = mine.begin; at < mine.end;) {
    const ssize_t done =
        ::pread(in, data.data(), std::min<std::uint64_t>(mine.end - at, plain_piece), static_cast<off_t>(at));
    PlainFile::check(done > 0, "read");
    at += static_cast<std::uint64_t>(done);
  }
  communicator.barrier();
}

// A dataset of a file that rank 0 writes alone: `rows` makes this rank's rows.
struct GatheredColumn {
  std::string name;
  hid_t type;
  int components;
  std::function<std::vector<char>()> rows;
};

// Gathers column by column on rank 0, which writes with plain HDF5 calls. Collective.
inline void write_gathered(const Communicator& communicator, const std::filesystem::path& file,
                           const std::vector<GatheredColumn>& columns, bool sync) {
  const hid_t out =
      communicator.root() ? H5Fcreate(file.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT) : -1;
  for (const GatheredColumn& column : columns) {
    std::vector<char> all;
    for (const auto& part : communicator.gather(column.rows()))
      all.insert(all.end(), part.begin(), part.end());
    if (!communicator.root()) continue;
    const hsize_t shape[2] = {all.size() / H5Tget_size(column.type) / static_cast<hsize_t>(column.components),
                              static_cast<hsize_t>(column.components)};
    const hid_t space = H5Screate_simple(column.components == 1 ? 1 : 2, shape, nullptr);
    const hid_t dataset =
        H5Dcreate2(out, column.name.c_str(), column.type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    PlainFile::check(H5Dwrite(dataset, column.type, H5S_ALL, H5S_ALL, H5P_DEFAULT, all.data()) >= 0, "write");
    H5Dclose(dataset);
    H5Sclose(space);
  }
  if (communicator.root()) {
    H5Fclose(out);
    if (sync) PlainFile(file, O_WRONLY).sync();
  }
  communicator.barrier();
}

// Rows of `components` values of type Out, component c of particle p being value(p, c).
template <class Out, int Dim, class Value>
std::vector<char> rows_of(const Body<Dim>& body, int components, Value&& value) {
  std::vector<Out> rows;
  for (Index p = 0; p < body.particles.size(); ++p)
    if (!body.is_padding(p))
      for (int c = 0; c < components; ++c) rows.push_back(static_cast<Out>(value(p, c)));
  const char* bytes = reinterpret_cast<const char*>(rows.data());
  return {bytes, bytes + rows.size() * sizeof(Out)};
}

}  // namespace mpm
