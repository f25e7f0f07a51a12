#include "mpm_hpc/base/timer.hpp"

#include <gtest/gtest.h>

#include <thread>

namespace mpm {
namespace {

TEST(Timers, InternsNamesAndSumsScopes) {
  Timers timers;
  const int p2g = timers.stage("p2g");
  const int g2p = timers.stage("g2p");
  EXPECT_EQ(p2g, 0);
  EXPECT_EQ(g2p, 1);
  EXPECT_EQ(timers.stage("p2g"), p2g);
  for (int i = 0; i < 3; ++i) {
    auto s = timers.scope("p2g");
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_GE(timers.seconds()[p2g], 0.015);
  EXPECT_EQ(timers.calls()[p2g], 3);
  EXPECT_EQ(timers.seconds()[g2p], 0.0);
  EXPECT_EQ(timers.names(), (std::vector<std::string>{"p2g", "g2p"}));
  timers.reset();
  EXPECT_EQ(timers.seconds()[p2g], 0.0);
  EXPECT_EQ(timers.size(), 2);
}

TEST(Timers, StopEndsAMeasurementOnce) {
  Timers timers;
  auto s = timers.scope("output");
  s.stop();
  const double once = timers.seconds()[0];
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  s.stop();
  EXPECT_EQ(timers.seconds()[0], once);
  EXPECT_EQ(timers.calls()[0], 1);
}

}  // namespace
}  // namespace mpm
