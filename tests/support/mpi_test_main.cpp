// GoogleTest main for tests under mpirun: every rank runs every test and all ranks return the same exit code.
// `--only=NAME` runs the tests of the source file NAME.cpp; MPM_TEST_TIMEOUT [s] limits each test.
#include <gtest/gtest.h>
#include <mpi.h>
#include <petscsys.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "support/mpi_test.hpp"
#include "support/watchdog.hpp"

namespace {

using std::chrono::seconds;

// Tells failures of ranks > 0 at once and makes a test fail on rank 0 when it failed anywhere.
class RankListener : public testing::EmptyTestEventListener {
 public:
  RankListener(mpm::test::Watchdog& watchdog, seconds limit) : watchdog_(watchdog), limit_(limit) {
    MPI_Comm_dup(MPI_COMM_WORLD, &comm_);
  }
  ~RankListener() override { MPI_Comm_free(&comm_); }

  void OnTestSuiteStart(const testing::TestSuite& suite) override {
    start(std::string("set-up of ") + suite.name());
  }

  void OnTestStart(const testing::TestInfo& test) override { start(name(test)); }

  void OnTestPartResult(const testing::TestPartResult& part) override {
    if (!part.failed() || mpm::test::rank() == 0) return;
    const std::string text = "[rank " + std::to_string(mpm::test::rank()) + "] FAILED in " + running_ + "\n" +
                             (part.file_name() ? part.file_name() : "unknown file") + ":" +
                             std::to_string(part.line_number()) + ": " + part.message() + "\n";
    std::fwrite(text.data(), 1, text.size(), stderr);
  }

  // Runs before the printer's, so that what is added here shows up in the printed result.
  void OnTestEnd(const testing::TestInfo& test) override {
    const char failed = test.result()->Failed();
    // A rank that left the test early may have left the others in a collective: don't wait the whole limit.
    watchdog_.watch(failed ? name(test) + " failed here and the other ranks still run it; waiting for them"
                           : name(test) + " ended here; waiting for the other ranks",
                    failed ? limit_ / 4 + seconds(1) : limit_);
    std::vector<char> failed_on(mpm::test::size());
    MPI_Request request;
    MPI_Iallgather(&failed, 1, MPI_CHAR, failed_on.data(), 1, MPI_CHAR, comm_, &request);
    for (int done = 0; MPI_Test(&request, &done, MPI_STATUS_IGNORE), !done;)
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    start("what follows " + name(test));

    if (mpm::test::rank() != 0 || failed) return;
    std::string ranks;
    for (int r = 0; r < mpm::test::size(); ++r)
      if (failed_on[r]) ranks.append(" ").append(std::to_string(r));
    if (!ranks.empty()) ADD_FAILURE() << "failed on rank" << ranks << ", see stderr";
  }

 private:
  static std::string name(const testing::TestInfo& test) {
    return std::string(test.test_suite_name()) + "." + test.name();
  }

  void start(const std::string& what) {
    running_ = what;
    watchdog_.watch(what, limit_);
  }

  mpm::test::Watchdog& watchdog_;
  seconds limit_;
  std::string running_;  // GoogleTest can't be asked for it while it reports a failure: it holds its lock
  MPI_Comm comm_ = MPI_COMM_NULL;
};

// Narrows the filter to the tests of one source file.
void select_source(const std::string& stem) {
  std::string filter;
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  for (int s = 0; s < all.total_test_suite_count(); ++s) {
    const testing::TestSuite& suite = *all.GetTestSuite(s);
    for (int t = 0; t < suite.total_test_count(); ++t) {
      const testing::TestInfo& test = *suite.GetTestInfo(t);
      if (std::filesystem::path(test.file()).stem() == stem)
        filter += std::string(suite.name()) + "." + test.name() + ":";
    }
  }
  testing::GTEST_FLAG(filter) = filter.empty() ? "no test stands in " + stem : filter;
}

// Collective. Returns the exit code, the same on every rank.
int run_tests(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument.starts_with("--only=")) {
      select_source(std::string(argument.substr(7)));
    } else {
      if (mpm::test::rank() == 0) std::fprintf(stderr, "unknown argument %s\n", argv[i]);
      return 1;
    }
  }

  testing::TestEventListeners& listeners = testing::UnitTest::GetInstance()->listeners();
  if (mpm::test::rank() != 0) {
    delete listeners.Release(listeners.default_result_printer());
    delete listeners.Release(listeners.default_xml_generator());
  }
  const char* timeout = std::getenv("MPM_TEST_TIMEOUT");
  const seconds limit(timeout && std::atoi(timeout) > 0 ? std::atoi(timeout) : 300);
  mpm::test::Watchdog watchdog(mpm::test::rank());
  auto* listener = new RankListener(watchdog, limit);
  listeners.Append(listener);

  int failed = RUN_ALL_TESTS();
  if (testing::UnitTest::GetInstance()->test_to_run_count() == 0) {
    if (mpm::test::rank() == 0) std::fprintf(stderr, "FAILED: no test was selected\n");
    failed = 1;
  }
  watchdog.watch("the end of the program", limit);
  MPI_Allreduce(MPI_IN_PLACE, &failed, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
  delete listeners.Release(listener);  // it owns a communicator, which must go before MPI_Finalize
  return failed;
}

}  // namespace

int main(int argc, char** argv) {
  int provided = 0;
  MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &provided);
  // Tests depend on nothing in the user's home, and a sanitizer wants to see the signals.
  PetscOptionsSetValue(nullptr, "-skip_petscrc", "true");
  PetscOptionsSetValue(nullptr, "-no_signal_handler", "true");
  if (PetscInitializeNoArguments()) MPI_Abort(MPI_COMM_WORLD, 1);
  PetscOptionsClear(nullptr);  // what is left from here on was set by a test
  const int exit_code = run_tests(argc, argv);
  PetscFinalize();
  MPI_Finalize();
  return exit_code;
}
