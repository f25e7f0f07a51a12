// What the machine can do at most, measured on every rank at once: memory bandwidth and arithmetic.
#pragma once

#include <time.h>

#include <algorithm>
#include <vector>

namespace mpm {

// Wall time, or the process's CPU time where others keep the machine busy; waiting ranks poll, so that both agree
// on an idle machine.
inline clockid_t clock_of_benchmarks = CLOCK_MONOTONIC;

inline double seconds_now() {
  timespec now;
  clock_gettime(clock_of_benchmarks, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

inline double seconds_of(const auto& work) {
  const double start = seconds_now();
  work();
  return seconds_now() - start;
}

inline double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

// Length of the triad's arrays, far larger than the caches where the figure counts.
inline std::size_t triad_length = std::size_t{32} << 20;

// a = b + s c; counts three streams, as STREAM does [GB/s].
inline double triad_gb_per_s() {
  const std::size_t count = triad_length;
  std::vector<double> a(count, 0.0), b(count, 1.0), c(count, 2.0);
  std::vector<double> rates;
  for (int repeat = 0; repeat < 7; ++repeat) {
    const double s = 0.5 + repeat;
    const double seconds = seconds_of([&] {
      double *out = a.data(), *x = b.data(), *y = c.data();
      asm volatile("" : "+r"(out), "+r"(x), "+r"(y));
      for (std::size_t i = 0; i < count; ++i) out[i] = x[i] + s * y[i];
      asm volatile("" : : "r"(out) : "memory");
    });
    rates.push_back(3e-9 * static_cast<double>(sizeof(double) * count) / seconds);
  }
  return *std::max_element(rates.begin(), rates.end());
}

// Independent multiply-adds, in the widest registers that the program is compiled for [Gflop/s].
template <class T>
double fma_gflops() {
#ifdef __AVX512F__
  constexpr int lanes = 64 / sizeof(T);
#else
  constexpr int lanes = 32 / sizeof(T);
#endif
  using V __attribute__((vector_size(lanes * sizeof(T)))) = T;
  constexpr int chains = 10;  // at least latency times units, few enough to stay in sixteen registers
  constexpr int repeats = 2'000'000;
  std::vector<double> rates;
  for (int repeat = 0; repeat < 30; ++repeat) {
    V sum[chains], factor = V{} + T(0.999999), term = V{} + T(1e-6);
    for (int c = 0; c < chains; ++c) sum[c] = V{} + T(c);
    asm volatile("" : "+v"(factor), "+v"(term));
    const double seconds = seconds_of([&] {
      for (int i = 0; i < repeats; ++i)
#pragma GCC unroll 10
        for (int c = 0; c < chains; ++c) sum[c] = sum[c] * factor + term;
    });
    for (int c = 0; c < chains; ++c) asm volatile("" : : "v"(sum[c]));
    rates.push_back(2e-9 * lanes * chains * repeats / seconds);
  }
  return *std::max_element(rates.begin(), rates.end());
}

}  // namespace mpm
