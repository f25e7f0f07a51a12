// What a test that runs on several ranks may use besides GoogleTest; mpi_test_main.cpp provides the main.
#pragma once

#include <filesystem>
#include <string>

namespace mpm::test {

// Rank and size of the world.
int rank();
int size();

// Collective: true where `ok` holds on every rank. ASSERT_TRUE(all_ranks_ok(...)) leaves a test on all ranks
// together, so that none of them waits in a collective that the others never enter.
bool all_ranks_ok(bool ok);

// A fresh folder that all ranks share; construction and destruction are collective.
// Throws std::runtime_error on every rank when it can't be created.
class SharedTemporaryFolder {
 public:
  SharedTemporaryFolder();
  ~SharedTemporaryFolder();
  SharedTemporaryFolder(const SharedTemporaryFolder&) = delete;
  SharedTemporaryFolder& operator=(const SharedTemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  // Path of a file in the folder.
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace mpm::test
