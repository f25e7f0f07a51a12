// What typed tests over both dimensions and precisions are made for.
#pragma once

#include <gtest/gtest.h>

namespace mpm::test {

template <int D, class Number>
struct Case {
  static constexpr int Dim = D;
  using T = Number;
};

using EveryCase = testing::Types<Case<2, double>, Case<2, float>, Case<3, double>, Case<3, float>>;

}  // namespace mpm::test
