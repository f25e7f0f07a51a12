#include "mpm_hpc/scene/seeding.hpp"

#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"

namespace mpm {
namespace {

// SplitMix64 (Steele, Lea and Flood 2014): a bijection of 64 bits that passes BigCrush as a counter-based
// generator.
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

int integer_power(int base, int exponent) {
  int result = 1;
  for (int i = 0; i < exponent; ++i) result *= base;
  return result;
}

// Sub-cell edges: far above the roundoff of a lattice point, far below anything that matters.
constexpr Real tie_shift = 1e-6;

}  // namespace

template <int Dim>
int particles_per_direction(int particles_per_cell) {
  require(particles_per_cell >= 1 && particles_per_cell <= 1000000,
          "particles_per_cell = {} must lie between 1 and 1000000.", particles_per_cell);
  int root = static_cast<int>(std::lround(std::pow(particles_per_cell, 1.0 / Dim)));
  if (integer_power(root, Dim) == particles_per_cell) return root;
  while (integer_power(root, Dim) > particles_per_cell) --root;
  throw UserError(fmt::format(
      "particles_per_cell = {} is no perfect {}; the nearest that are so are {} and {}.", particles_per_cell,
      Dim == 2 ? "square" : "cube", integer_power(root, Dim), integer_power(root + 1, Dim)));
}

template <int Dim>
void declare_seeding(Parameters& p, SeedingOptions<Dim>& options) {
  p.integer("particles_per_cell", options.particles_per_cell,
            {.min = 1,
             .max = 1000000,
             .doc = Dim == 2 ? "Particles per grid cell, a perfect square."
                             : "Particles per grid cell, a perfect cube."});
  try {
    particles_per_direction<Dim>(options.particles_per_cell);
  } catch (const UserError& error) {
    p.error_at("particles_per_cell", error.what());
  }
  p.real(
      "jitter", options.jitter,
      {.min = 0, .max = 0.5, .doc = "Largest random shift per direction, over the distance of particles."});
}

template <int Dim>
Seeding<Dim>::Seeding(Shape<Dim> shape, const SeedingOptions<Dim>& options)
    : shape_(std::move(shape)),
      options_(options),
      per_direction_(particles_per_direction<Dim>(options.particles_per_cell)),
      volume_(std::pow(options.spacing, Dim) / options.particles_per_cell) {
  require(options_.spacing > 0, "the grid spacing must be positive.");
  require(options_.jitter >= 0 && options_.jitter <= 0.5, "jitter = {} must lie between 0 and 0.5.",
          options_.jitter);
  const BoundingBox<Dim> box = shape_.bounds().intersected(options_.domain);
  lower_.setZero();
  counts_.setZero();
  if (box.is_empty()) return;
  require(box.is_finite(),
          "a body can't be filled with particles, since its shape is unbounded; intersect it with a box.");
  for (int a = 0; a < Dim; ++a) {
    const Real low = std::floor((box.lower[a] - options_.origin[a]) / options_.spacing);
    const Real high = std::ceil((box.upper[a] - options_.origin[a]) / options_.spacing);
    require(std::abs(low) < 1e9 && std::abs(high) < 1e9,
            "a body spans more than 1e9 grid cells from the grid's origin; enlarge grid.spacing or check the "
            "units.");
    lower_[a] = static_cast<std::int64_t>(low) - 1;  // a margin for roundoff
    counts_[a] = static_cast<std::int64_t>(high) + 1 - lower_[a];
  }
  require(static_cast<double>(counts_.template cast<double>().prod()) < 4e18,
          "a body spans too many grid cells to be numbered; enlarge grid.spacing or check the units.");
}

template <int Dim>
GlobalIndex Seeding<Dim>::cells() const {
  return counts_.prod();
}

template <int Dim>
GlobalIndex Seeding<Dim>::first_cell(int part, int parts) const {
  const GlobalIndex whole = cells() / parts, rest = cells() % parts;
  return whole * part + std::min<GlobalIndex>(part, rest);
}

template <int Dim>
Vec<Dim> Seeding<Dim>::jittered(const Vec<Dim>& x, const LatticePoint& sub_cell) const {
  std::uint64_t hash = mixed(options_.seed);
  for (int a = 0; a < Dim; ++a) hash = mixed(hash ^ static_cast<std::uint64_t>(sub_cell[a]));
  Vec<Dim> result = x;
  for (int a = 0; a < Dim; ++a) {
    const Real uniform =
        static_cast<Real>(mixed(hash + static_cast<std::uint64_t>(a)) >> 11) * 0x1p-53;  // [0, 1)
    result[a] += options_.jitter * (2 * uniform - 1) * options_.spacing / per_direction_;
  }
  return result;
}

template <int Dim>
std::vector<Vec<Dim>> Seeding<Dim>::particles(GlobalIndex begin_cell, GlobalIndex end_cell) const {
  std::vector<Vec<Dim>> result;
  const Real h = options_.spacing;
  const Real half_diagonal = 0.5 * h * std::sqrt(Real(Dim)) * (1 + 1e-5);  // with room for the tie shift
  const Vec<Dim> shift = Vec<Dim>::Constant(tie_shift * h / per_direction_);
  for (GlobalIndex cell = begin_cell; cell < end_cell; ++cell) {
    LatticePoint place = lower_;
    GlobalIndex rest = cell;
    for (int a = 0; a < Dim; ++a) {
      place[a] += rest % counts_[a];
      rest /= counts_[a];
    }
    // Distances are 1-Lipschitz: most cells are wholly inside or outside.
    const Vec<Dim> center = options_.origin + h * (place.template cast<Real>() + Vec<Dim>::Constant(0.5));
    const Real distance = shape_.bounded_distance(center, half_diagonal);
    if (distance >= half_diagonal) continue;
    for (int s = 0; s < options_.particles_per_cell; ++s) {
      LatticePoint sub_cell = place * per_direction_;
      int sub = s;
      for (int a = 0; a < Dim; ++a) {
        sub_cell[a] += sub % per_direction_;
        sub /= per_direction_;
      }
      const Vec<Dim> x =
          options_.origin + (h / per_direction_) * (sub_cell.template cast<Real>() + Vec<Dim>::Constant(0.5));
      const bool is_inside = distance <= -half_diagonal || shape_.contains(x + shift);
      if (is_inside && options_.domain.contains(x)) result.push_back(jittered(x, sub_cell));
    }
  }
  return result;
}

template int particles_per_direction<2>(int);
template int particles_per_direction<3>(int);
template void declare_seeding<2>(Parameters&, SeedingOptions<2>&);
template void declare_seeding<3>(Parameters&, SeedingOptions<3>&);
template class Seeding<2>;
template class Seeding<3>;

}  // namespace mpm
