#include "mpm_hpc/scene/seeding.hpp"

#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"
#include "random_bits.hpp"

namespace mpm {
namespace {

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
      "particles_per_cell = {} is no perfect {}; the nearest that are so are {} and {}; or take sampling = "
      "\"poisson_disk\".", particles_per_cell,
      Dim == 2 ? "square" : "cube", integer_power(root, Dim), integer_power(root + 1, Dim)));
}

template <int Dim>
void declare_seeding(Parameters& p, SeedingOptions<Dim>& options) {
  p.integer("particles_per_cell", options.particles_per_cell,
            {.min = 1,
             .max = 1000000,
             .doc = Dim == 2 ? "Particles per grid cell; a perfect square unless sampling = \"poisson_disk\"."
                             : "Particles per grid cell; a perfect cube unless sampling = \"poisson_disk\"."});
  std::string sampling = "lattice";
  const bool chosen = p.choice("sampling", sampling, {"lattice", "jittered", "poisson_disk"},
                               "How the shape is filled: on a lattice, with random shifts from it, or at random with even "
                               "density and no two particles close together.");
  const bool shifted = p.real(
      "jitter", options.jitter,
      {.min = 0,
       .max = 0.5,
       .doc = "Largest random shift per direction, over the distance of particles; 0.5 with sampling = \"jittered\"."});
  options.sampling = sampling == "poisson_disk" ? Sampling::poisson_disk : Sampling::lattice;
  if (shifted && options.jitter > 0 && chosen && sampling != "jittered")
    p.error_at("jitter", fmt::format("jitter has no effect with sampling = \"{}\"; take \"jittered\", or drop it.", sampling));
  if (!shifted && sampling == "jittered") options.jitter = 0.5;
  if (options.sampling == Sampling::poisson_disk) return;
  try {
    particles_per_direction<Dim>(options.particles_per_cell);
  } catch (const UserError& error) {
    p.error_at("particles_per_cell", error.what());
  }
}

template <int Dim>
Seeding<Dim>::Seeding(Shape<Dim> shape, const SeedingOptions<Dim>& options)
    : shape_(std::move(shape)),
      options_(options),
      volume_(std::pow(options.spacing, Dim) / options.particles_per_cell) {
  require(options_.spacing > 0, "the grid spacing must be positive.");
  require(options_.jitter >= 0 && options_.jitter <= 0.5, "jitter = {} must lie between 0 and 0.5.",
          options_.jitter);
  if (options_.sampling == Sampling::lattice) {
    per_direction_ = particles_per_direction<Dim>(options.particles_per_cell);
  } else {
    tile_ = std::make_shared<const PoissonTile<Dim>>(options.particles_per_cell, options.seed);
  }
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
Real Seeding<Dim>::cell_radius() const {
  return 0.5 * options_.spacing * std::sqrt(Real(Dim)) * (1 + 1e-5);
}

template <int Dim>
Vec<Dim> Seeding<Dim>::jittered(const Vec<Dim>& x, const LatticePoint& sub_cell) const {
  std::uint64_t hash = mixed(options_.seed);
  for (int a = 0; a < Dim; ++a) hash = mixed(hash ^ static_cast<std::uint64_t>(sub_cell[a]));
  Vec<Dim> result = x;
  for (int a = 0; a < Dim; ++a) {
    result[a] += options_.jitter * (2 * uniform(hash + static_cast<std::uint64_t>(a)) - 1) * options_.spacing / per_direction_;
  }
  return result;
}

template <int Dim>
template <class F>
void Seeding<Dim>::for_cells(GlobalIndex begin_cell, GlobalIndex end_cell, F&& f) const {
  const Real half_diagonal = cell_radius();
  for (GlobalIndex cell = begin_cell; cell < end_cell; ++cell) {
    LatticePoint place = lower_;
    GlobalIndex rest = cell;
    for (int a = 0; a < Dim; ++a) {
      place[a] += rest % counts_[a];
      rest /= counts_[a];
    }
    // Distances are 1-Lipschitz: most cells are wholly inside or outside.
    const Vec<Dim> center =
        options_.origin + options_.spacing * (place.template cast<Real>() + Vec<Dim>::Constant(0.5));
    const Real distance = shape_.bounded_distance(center, half_diagonal);
    if (distance < half_diagonal) f(place, distance);
  }
}

template <int Dim>
std::vector<Vec<Dim>> Seeding<Dim>::particles(GlobalIndex begin_cell, GlobalIndex end_cell) const {
  std::vector<Vec<Dim>> result;
  const Real h = options_.spacing, half_diagonal = cell_radius();
  const Vec<Dim> shift = Vec<Dim>::Constant(tie_shift * h / per_direction_);
  for_cells(begin_cell, end_cell, [&](const LatticePoint& place, Real distance) {
    const bool whole = distance <= -half_diagonal;
    if (tile_) {
      for (const Vec<Dim>& local : tile_->cell(place)) {
        const Vec<Dim> x = options_.origin + h * (place.template cast<Real>() + local);
        if ((whole || shape_.contains(x)) && options_.domain.contains(x)) result.push_back(x);
      }
      return;
    }
    for (int s = 0; s < options_.particles_per_cell; ++s) {
      LatticePoint sub_cell = place * per_direction_;
      int sub = s;
      for (int a = 0; a < Dim; ++a) {
        sub_cell[a] += sub % per_direction_;
        sub /= per_direction_;
      }
      const Vec<Dim> x =
          options_.origin + (h / per_direction_) * (sub_cell.template cast<Real>() + Vec<Dim>::Constant(0.5));
      if ((whole || shape_.contains(x + shift)) && options_.domain.contains(x)) result.push_back(jittered(x, sub_cell));
    }
  });
  return result;
}

template <int Dim>
Real Seeding<Dim>::shape_volume(GlobalIndex begin_cell, GlobalIndex end_cell) const {
  constexpr int fine = Dim == 2 ? 16 : 8;  // points per direction
  const Real h = options_.spacing, half_diagonal = cell_radius();
  const Vec<Dim> shift = Vec<Dim>::Constant(tie_shift * h / fine);
  const BoundingBox<Dim>& domain = options_.domain;
  Real cells = 0;
  for_cells(begin_cell, end_cell, [&](const LatticePoint& place, Real distance) {
    const Vec<Dim> corner = options_.origin + h * place.template cast<Real>();
    if (distance <= -half_diagonal && domain.contains(corner) && domain.contains(corner + Vec<Dim>::Constant(h))) {
      ++cells;
      return;
    }
    const int all = integer_power(fine, Dim);
    int inside = 0;
    for (int s = 0; s < all; ++s) {
      Vec<Dim> x = corner;
      for (int a = 0, sub = s; a < Dim; ++a, sub /= fine) x[a] += h / fine * (sub % fine + 0.5);
      inside += shape_.contains(x + shift) && domain.contains(x);
    }
    cells += static_cast<Real>(inside) / all;
  });
  return cells * std::pow(h, Dim);
}

template int particles_per_direction<2>(int);
template int particles_per_direction<3>(int);
template void declare_seeding<2>(Parameters&, SeedingOptions<2>&);
template void declare_seeding<3>(Parameters&, SeedingOptions<3>&);
template class Seeding<2>;
template class Seeding<3>;

}  // namespace mpm
