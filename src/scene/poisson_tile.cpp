#include "mpm_hpc/scene/poisson_tile.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "random_bits.hpp"

namespace mpm {

namespace {

constexpr int points_of_tile = 4096;  // about; enough that the repetition isn't seen
constexpr int smallest_side = 4;
constexpr int candidates_per_point = 5;

// Candidates on a torus, each with its neighbours nearer than `reach`.
template <int Dim>
class Torus {
 public:
  Torus(std::vector<Vec<Dim>> points, Real period, Real reach)
      : points_(std::move(points)),
        period_(period),
        reach_(reach),
        bins_(std::max(1, static_cast<int>(period / reach))) {
    std::size_t count = 1;
    for (int a = 0; a < Dim; ++a) count *= static_cast<std::size_t>(bins_);
    bin_.resize(count);
    for (std::size_t i = 0; i < points_.size(); ++i) bin_[bin_of(points_[i], 0, 0)].push_back(i);
  }

  // f(neighbour, its distance).
  template <class F>
  void for_neighbours(std::size_t i, F&& f) const {
    int around = 1;
    for (int a = 0; a < Dim; ++a) around *= 3;
    for (int n = 0; n < around; ++n)
      for (const std::size_t j : bin_[bin_of(points_[i], n, 1)]) {
        Vec<Dim> way = points_[j] - points_[i];
        for (int a = 0; a < Dim; ++a) way[a] -= period_ * std::round(way[a] / period_);
        const Real distance = way.norm();
        if (j != i && distance < reach_) f(j, distance);
      }
  }

 private:
  // The bin of x, shifted by the digits of n, each less `centre`.
  std::size_t bin_of(const Vec<Dim>& x, int n, int centre) const {
    std::size_t bin = 0;
    for (int a = 0; a < Dim; ++a, n /= 3) {
      const int place = std::min(static_cast<int>(x[a] / period_ * bins_), bins_ - 1) + n % 3 - centre;
      bin = bin * static_cast<std::size_t>(bins_) + static_cast<std::size_t>((place + bins_) % bins_);
    }
    return bin;
  }

  std::vector<Vec<Dim>> points_;
  Real period_, reach_;
  int bins_;
  std::vector<std::vector<std::size_t>> bin_;
};

}  // namespace

template <int Dim>
Real densest_distance(int points_per_cell) {
  // Yuksel's 2 r_max, equations 2 and 3.
  return Dim == 2 ? 2 * std::sqrt(1 / (2 * std::sqrt(3.0) * points_per_cell))
                  : 2 * std::cbrt(1 / (4 * std::sqrt(2.0) * points_per_cell));
}

template <int Dim>
PoissonTile<Dim>::PoissonTile(int points_per_cell, std::uint64_t seed)
    : side_(std::max(smallest_side, static_cast<int>(std::lround(
                                        std::pow(Real(points_of_tile) / points_per_cell, 1.0 / Dim))))) {
  std::size_t cells = 1;
  for (int a = 0; a < Dim; ++a) cells *= static_cast<std::size_t>(side_);
  const std::size_t wanted = cells * static_cast<std::size_t>(points_per_cell),
                    all = candidates_per_point * wanted;
  std::vector<Vec<Dim>> candidates(all);
  const std::uint64_t start = mixed(seed);
  for (std::size_t i = 0; i < all; ++i)
    for (int a = 0; a < Dim; ++a)
      candidates[i][a] = side_ * uniform(start + i * Dim + static_cast<std::uint64_t>(a));

  // Weights of Yuksel's section 3.3: alpha = 8, beta = 0.65, gamma = 1.5.
  const Real reach = densest_distance<Dim>(points_per_cell);
  const Real shortest = reach * (1 - std::pow(Real(wanted) / Real(all), 1.5)) * 0.65;
  auto share = [&](Real distance) {
    const Real one = 1 - std::max(distance, shortest) / reach, two = one * one, four = two * two;
    return four * four;
  };
  const Torus<Dim> torus(candidates, side_, reach);
  std::vector<Real> weight(all, 0);
  std::set<std::pair<Real, std::size_t>> crowded;
  for (std::size_t i = 0; i < all; ++i) {
    torus.for_neighbours(i, [&](std::size_t, Real distance) { weight[i] += share(distance); });
    crowded.insert({weight[i], i});
  }
  std::vector<char> kept(all, 1);
  for (std::size_t count = all; count > wanted; --count) {
    const auto worst = std::prev(crowded.end());
    const std::size_t i = worst->second;
    crowded.erase(worst);
    kept[i] = 0;
    torus.for_neighbours(i, [&](std::size_t j, Real distance) {
      if (!kept[j]) return;
      crowded.erase({weight[j], j});
      weight[j] -= share(distance);
      crowded.insert({weight[j], j});
    });
  }

  std::vector<std::vector<Vec<Dim>>> by_cell(cells);
  for (std::size_t i = 0; i < all; ++i) {
    if (!kept[i]) continue;
    std::size_t cell = 0;
    Vec<Dim> local;
    for (int a = Dim - 1; a >= 0; --a) {
      const Real corner = std::floor(candidates[i][a]);
      cell = cell * static_cast<std::size_t>(side_) + static_cast<std::size_t>(corner);
      local[a] = candidates[i][a] - corner;
    }
    by_cell[cell].push_back(local);
  }
  first_.push_back(0);
  for (const auto& list : by_cell) {
    points_.insert(points_.end(), list.begin(), list.end());
    first_.push_back(points_.size());
  }
}

template <int Dim>
std::span<const Vec<Dim>> PoissonTile<Dim>::cell(const Eigen::Matrix<std::int64_t, Dim, 1>& place) const {
  std::size_t cell = 0;
  for (int a = Dim - 1; a >= 0; --a)
    cell =
        cell * static_cast<std::size_t>(side_) + static_cast<std::size_t>((place[a] % side_ + side_) % side_);
  return {&points_[first_[cell]], first_[cell + 1] - first_[cell]};
}

template class PoissonTile<2>;
template class PoissonTile<3>;
template Real densest_distance<2>(int);
template Real densest_distance<3>(int);

}  // namespace mpm
