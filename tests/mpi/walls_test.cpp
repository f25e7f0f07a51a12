// Slip and sticky walls as mirrors: whole steps against a plain step whose grid is folded side after side, a body at a wall
// against half of a pair without one, and the balance of momentum.
#include <gtest/gtest.h>

#include <cstdio>
#include <numeric>

#include "mpm_hpc/time/explicit_integrator.hpp"
#include "support/mpi_test.hpp"
#include "support/plain_steps.hpp"

using namespace mpm;

namespace {

constexpr Real poisson_ratio = 0.3, flip_blend = 0.9;

template <int Dim>
std::string list(Real x, Real y, Real z) {
  return Dim == 2 ? fmt::format("[{:.17g}, {:.17g}]", x, y)
                  : fmt::format("[{:.17g}, {:.17g}, {:.17g}]", x, y, z);
}

struct Names {
  std::string kernel, scheme, forces;
  std::string text() const {
    return fmt::format("kernel = \"{}\"\n[transfer]\nscheme = \"{}\"\nforces = \"{}\"\n{}", kernel, scheme,
                       forces, scheme == "flip" ? fmt::format("flip_blend = {}\n", flip_blend) : "");
  }
};

template <int Dim>
std::string scene_text(const Names& names, Real h, const std::string& lower, const std::string& upper, Real E,
                       const std::string& rest) {
  return fmt::format(
      "dimension = {}\nseed = 5\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {:.17g}\n{}[time]\nend "
      "= 1\n"
      "[material.soft]\nmodel = \"neo_hookean\"\nyoungs_modulus = {}\npoisson_ratio = {}\ndensity = 1\n{}",
      Dim, lower, upper, h, names.text(), E, poisson_ratio, rest);
}

// A plane on or between nodes, in half spacings of the grid's node coordinates, and what it does to the velocity at an image.
template <int Dim>
struct PlainWall {
  int axis, twice;
  bool upper, sticky;
  Vec<Dim> reflected(Vec<Dim> v) const {
    if (sticky) return -v;
    v[axis] = -v[axis];
    return v;
  }
  // f(node, its image inside or on the wall) for the nodes on and beyond it.
  template <class F>
  void for_images(const ReferenceGrid<Dim>& grid, F&& f) const {
    for (std::size_t i = 0; i < grid.mass.size(); ++i) {
      IntVec<Dim> node;
      std::size_t rest = i;
      for (int a = Dim - 1; a >= 0; --a) {
        node[a] = static_cast<std::int32_t>(rest % static_cast<std::size_t>(grid.size[a]));
        rest /= static_cast<std::size_t>(grid.size[a]);
      }
      if (upper ? 2 * node[axis] < twice : 2 * node[axis] > twice) continue;
      node[axis] = twice - node[axis];
      if (grid.mass[i] > 0) f(i, grid.index(node));
    }
  }
};

// The mass of a node beyond joins its image inside, and its momentum the reflected one; afterwards the velocities go back.
template <int Dim>
void fold(const std::vector<PlainWall<Dim>>& walls, ReferenceGrid<Dim>& grid) {
  for (const auto& wall : walls)
    wall.for_images(grid, [&](std::size_t from, std::size_t to) {
      for (auto* sums : {&grid.momentum, &grid.changes}) {
        const Vec<Dim> moved = (*sums)[from];
        if (from == to) {
          (*sums)[to] = 0.5 * (moved + wall.reflected(moved));
        } else {
          (*sums)[to] += wall.reflected(moved);
        }
      }
      if (from != to) grid.mass[to] += grid.mass[from];
    });
}
template <int Dim>
void unfold(const std::vector<PlainWall<Dim>>& walls, ReferenceGrid<Dim>& grid) {
  for (auto wall = walls.rbegin(); wall != walls.rend(); ++wall)
    wall->for_images(grid, [&](std::size_t to, std::size_t from) {
      if (from == to) return;
      grid.momentum[to] = wall->reflected(grid.momentum[from]);
      grid.changes[to] = wall->reflected(grid.changes[from]);
    });
}

// Two bodies that are pushed into opposite corners: x_min sticky, x_max and the others slip, y_max midway between nodes.
template <class Kernel, Scheme scheme, Forces forces, int Dim>
void compare_with_folded_grid() {
  constexpr Real h = 0.05, E = 100, dt = 0.002;
  constexpr int steps = Dim == 2 ? 60 : 20, margin = GridGeometry<Dim>::margin;
  const TransferOptions options{.scheme = scheme, .forces = forces};
  const Names names{Kernel::name, options.scheme_name(), options.forces_name()};
  std::string bodies =
      "[[body]]\nmaterial = \"soft\"\njitter = 0.2\nshape = {type = \"box\", lower = " + list<Dim>(0, 0, 0) +
      ", upper = " + list<Dim>(0.3, 0.25, 0.2) + "}\nvelocity = " + list<Dim>(-0.8, -0.9, -0.7) +
      "\nangular_velocity = " + (Dim == 2 ? "1.5" : "[1, 0, 1.5]") +
      "\n[[body]]\nmaterial = \"soft\"\njitter = 0.2\nshape = {type = \"box\", lower = " +
      list<Dim>(0.5, 0.4, 0.1) + ", upper = " + list<Dim>(0.8, 0.625, 0.3) +
      "}\nvelocity = " + list<Dim>(0.7, 0.9, 0.3) + "\n";
  std::string sides =
      "[effect.walls]\nx_min = \"sticky\"\nx_max = \"slip\"\ny_min = \"slip\"\ny_max = \"slip\"\n";
  std::vector<PlainWall<Dim>> walls = {{0, 2 * margin, false, true},
                                       {0, 2 * margin + 32, true, false},
                                       {1, 2 * margin, false, false},
                                       {1, 2 * margin + 25, true, false}};
  if (Dim == 3) {
    sides += "z_min = \"slip\"\n";
    walls.push_back({2, 2 * margin, false, false});
  }
  test::SceneWorld<Dim> world(
      scene_text<Dim>(names, h, list<Dim>(0, 0, 0), list<Dim>(0.8, 0.625, 0.6), E, bodies + sides));
  State<Dim>& state = world.state;
  std::vector<ModalParticle<Dim>> plain;
  for (const auto& entry : test::gather_particles(world)) plain.push_back(entry.second);
  ExplicitIntegrator<Dim> integrator(state, world.hooks, {});
  integrator.initialise(state);
  ReferenceGrid<Dim> grid(state.geometry(), true);
  for (int step = 0; step < steps; ++step) {
    state.dt = dt;
    integrator.step(state);
    test::plain_step<Kernel, TransferForm<scheme, forces>>(
        state.geometry(), {E, poisson_ratio}, dt, flip_blend, plain, grid,
        [&](ReferenceGrid<Dim>& g) { fold(walls, g); }, [&](ReferenceGrid<Dim>& g) { unfold(walls, g); });
  }
  const auto moved = test::gather_particles(world);
  Real place = 0, deformation = 0, strain = 0, outside = 0;
  std::size_t n = 0;
  for (const auto& [id, p] : moved) {
    place = std::max(place, (p.x - plain[n].x).norm() / h);
    deformation = std::max(deformation, (p.F - plain[n].F).norm());
    strain = std::max(strain, (p.F - Mat<Dim>::Identity()).norm());
    outside += !state.geometry().contains(p.x);
    ++n;
  }
  if (test::rank() == 0)
    std::printf("%dD %s %s %s: places differ by %.1e cells and F by %.1e (expected <= 1e-10), strain %.2f\n",
                Dim, names.kernel.c_str(), names.scheme.c_str(), names.forces.c_str(), place, deformation,
                strain);
  EXPECT_LT(place, 1e-10);
  EXPECT_LT(deformation, 1e-10);
  EXPECT_GT(strain, 0.02);
  EXPECT_EQ(outside, 0);
}

template <class Kernel, Forces forces, int Dim, Scheme... schemes>
void compare_all() {
  (compare_with_folded_grid<Kernel, schemes, forces, Dim>(), ...);
}

TEST(MirrorWalls, StepsAreThoseOfAFoldedGrid) {
  compare_all<QuadraticKernel, Forces::mls, 2, Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic,
              Scheme::polypic>();
  compare_all<QuadraticKernel, Forces::classical, 2, Scheme::apic>();
  compare_all<CubicKernel, Forces::mls, 2, Scheme::flip, Scheme::apic, Scheme::polypic>();
  compare_all<QuadraticKernel, Forces::mls, 3, Scheme::flip, Scheme::apic>();
  compare_all<CubicKernel, Forces::mls, 3, Scheme::apic>();
}

// A body that is thrown against a slip wall, against the upper or lower one of a pair that meet where the wall was.
// `plane` is the wall's place; the pair's domain goes on beyond it.
template <int Dim>
void compare_with_pair(const Names& names, bool upper, Real plane) {
  constexpr Real h = 1.0 / 16, E = 50, dt = 0.002;
  const Real inward = upper ? -1 : 1, near = plane, far = plane + inward * 5 * h;
  // The second body is the first one's image, with its velocity.
  const auto body = [&](bool image) {
    const auto place = [&](Real y) { return image ? 2 * plane - y : y; };
    const Real low = std::min(place(near), place(far)), high = std::max(place(near), place(far));
    const std::string y = image ? fmt::format("({:.17g} - y)", 2 * plane) : std::string("y");
    const std::string vx = fmt::format("\"0.4*{} + 0.3*sin(7*x)\"", y),
                      vy = fmt::format("\"{}({} + 0.3*x + 0.2*{})\"", image ? "-" : "", -inward, y);
    return "[[body]]\nmaterial = \"soft\"\nshape = {type = \"box\", lower = " +
           list<Dim>(-0.25, low, -0.125) + ", upper = " + list<Dim>(0.125, high, 0.125) + "}\nvelocity = [" +
           vx + ", " + vy + (Dim == 3 ? ", \"0.2*x\"]\n" : "]\n");
  };
  const Real low = upper ? -0.5 : plane, high = upper ? plane : 0.5;
  test::SceneWorld<Dim> half(
      scene_text<Dim>(names, h, list<Dim>(-0.75, low, -0.5), list<Dim>(0.75, high, 0.5), E,
                      body(false) + fmt::format("[effect.walls]\ny_{} = \"slip\"\n", upper ? "max" : "min")));
  test::SceneWorld<Dim> pair(scene_text<Dim>(names, h, list<Dim>(-0.75, upper ? low : low - 1, -0.5),
                                             list<Dim>(0.75, upper ? high + 1 : high, 0.5), E,
                                             body(false) + body(true)));
  for (auto* world : {&half, &pair}) {
    ExplicitIntegrator<Dim> integrator(world->state, world->hooks, {});
    integrator.initialise(world->state);
    world->state.dt = dt;
    for (int step = 0; step < 120; ++step) integrator.step(world->state);
  }
  const auto a = test::gather_particles(half), b = test::gather_particles(pair);
  EXPECT_EQ(2 * a.size(), b.size());
  Real worst = 0, strain = 0;
  for (const auto& [id, p] : a) {
    const ModalParticle<Dim>& q = b.at(id);
    worst = std::max({worst, (p.x - q.x).cwiseAbs().maxCoeff(), (p.v - q.v).cwiseAbs().maxCoeff(),
                      (p.F - q.F).cwiseAbs().maxCoeff()});
    strain = std::max(strain, (p.F - Mat<Dim>::Identity()).norm());
  }
  if (test::rank() == 0)
    std::printf("%dD %s %s %s, %s wall: half and pair differ by %.1e (expected <= 1e-11), strain %.2f\n", Dim,
                names.kernel.c_str(), names.scheme.c_str(), names.forces.c_str(), upper ? "upper" : "lower",
                worst, strain);
  EXPECT_LT(worst, 1e-11);
  EXPECT_GT(strain, 0.005);
}

TEST(MirrorWalls, ABodyAtAWallIsHalfOfAPair) {
  for (const std::string kernel : {"quadratic", "cubic"})
    for (const std::string scheme : {"pic", "rpic", "flip", "apic", "polypic"})
      for (const bool upper : {false, true}) {
        // On a grid line, and midway between two.
        compare_with_pair<2>({kernel, scheme, "mls"}, upper, upper ? 0.03125 : 0);
        if (scheme == "flip" || scheme == "apic")
          compare_with_pair<3>({kernel, scheme, scheme == "apic" ? "classical" : "mls"}, upper,
                               upper ? 0 : -0.5);
      }
}

// What the particles gain is what gravity, walls and an obstacle say that they gave.
template <int Dim>
void balance(const std::string& scheme) {
  constexpr Real h = 0.05, g = 5, dt = 0.002;
  test::SceneWorld<Dim> world(scene_text<Dim>(
      {"quadratic", scheme, "mls"}, h, list<Dim>(0, 0, 0), list<Dim>(0.8, 0.625, 0.6), 100,
      "[[body]]\nmaterial = \"soft\"\njitter = 0.2\nshape = {type = \"box\", lower = " + list<Dim>(0, 0, 0) +
          ", upper = " + list<Dim>(0.5, 0.3, 0.3) + "}\nvelocity = " + list<Dim>(0.9, -0.9, 0.4) +
          "\n[effect.gravity]\nacceleration = " + list<Dim>(0.5, -g, 0) +
          "\n[effect.walls]\nx_min = \"separate\"\nx_max = \"sticky\"\ny_min = \"slip\"\nfriction = 0.3\n" +
          (Dim == 3 ? "z_min = \"slip\"\n" : "") +
          "[[effect.obstacle]]\nname = \"step\"\ncondition = \"separate\"\nshape = {type = \"box\", lower "
          "= " +
          list<Dim>(0.55, -1, -1) + ", upper = " + list<Dim>(0.7, 0.12, 1) + "}\n"));
  State<Dim>& state = world.state;
  const auto momentum = [&] {
    Vec<Dim + 1> sum = Vec<Dim + 1>::Zero();
    for (const auto& [id, p] : test::gather_particles(world)) {
      sum.template head<Dim>() += p.mass * p.v;
      sum[Dim] += p.mass;
    }
    return sum;
  };
  const Vec<Dim + 1> before = momentum();
  ExplicitIntegrator<Dim> integrator(state, world.hooks, {});
  integrator.initialise(state);
  constexpr int steps = 150;
  state.dt = dt;
  for (int step = 0; step < steps; ++step) integrator.step(state);
  const Vec<Dim + 1> after = momentum();
  Vec<Dim> expected = before.template head<Dim>();
  expected[0] += 0.5 * steps * dt * before[Dim];
  expected[1] -= g * steps * dt * before[Dim];
  for (const std::string name : {"walls", "step"}) {
    Vec<Dim> impulse;
    for (int a = 0; a < Dim; ++a)
      impulse[a] = state.communicator().sum(state.ledger[fmt::format("impulse_{}_{}", name, "xyz"[a])]);
    EXPECT_GT(impulse.norm(), 0) << name;
    expected += impulse;
  }
  const Real error = (after.template head<Dim>() - expected).norm() / before[Dim];
  if (test::rank() == 0)
    std::printf(
        "%dD %s: momentum per mass differs by %.1e m/s from start, weight and impulses (expected <= 1e-12)\n",
        Dim, scheme.c_str(), error);
  EXPECT_LT(error, 1e-12);
}

TEST(MirrorWalls, TheReactionsBalance) {
  for (const std::string scheme : {"pic", "flip", "apic", "polypic"}) {
    balance<2>(scheme);
    balance<3>(scheme);
  }
}

// A node beyond a side and its image have one owner, wherever the upper sides lie and however the blocks are dealt out.
template <int Dim>
void check_owners(bool on_curve) {
  for (int half_cells = 8; half_cells <= 30; ++half_cells) {
    const GridGeometry<Dim> grid(Vec<Dim>::Zero(), Vec<Dim>::Constant(0.5 * half_cells), 1);
    Decomposition<Dim> decomposition(grid, on_curve ? Partitioner::curve : Partitioner::automatic);
    std::vector<std::int32_t> owners(static_cast<std::size_t>(decomposition.entries()));
    std::iota(owners.begin(), owners.end(), 0);
    CurveCuts cuts(std::size_t{1} << Dim * curve_levels<Dim>(grid.blocks()));
    std::iota(cuts.begin(), cuts.end(), 1);
    if (on_curve) {
      decomposition.restore({}, cuts, static_cast<int>(cuts.size()) + 1);
    } else {
      decomposition.set_owners(owners);
    }
    const auto owner = [&](const IntVec<Dim>& node) {
      return decomposition.owner(IntVec<Dim>(node / block_side));
    };
    for (int a = 0; a < Dim; ++a)
      for (const int twice : {2 * grid.margin, 2 * grid.margin + half_cells})
        for (int node = (twice - 3 + 1) / 2; 2 * node <= twice + 3; ++node) {
          IntVec<Dim> place = IntVec<Dim>::Constant(grid.margin + 1), image = place;
          place[a] = node;
          image[a] = twice - node;
          EXPECT_EQ(owner(place), owner(image)) << half_cells << " half cells, node " << node;
        }
  }
}
TEST(MirrorWalls, ANodeAndItsImageHaveOneOwner) {
  for (const bool on_curve : {false, true}) {
    check_owners<2>(on_curve);
    check_owners<3>(on_curve);
  }
}

TEST(MirrorWalls, SidesThatAreNoMirrorsSaySo) {
  const auto explained = [](Real width, Real height) {
    test::SceneWorld<2> world(scene_text<2>(
        {"quadratic", "apic", "mls"}, 0.05, "[0, 0]", list<2>(width, height, 0), 100,
        "[[body]]\nmaterial = \"soft\"\nshape = {type = \"box\", lower = [0, 0], upper = [0.1, 0.1]}\n"
        "[effect.walls]\nx_min = \"sticky\"\nx_max = \"slip\"\ny_min = \"slip\"\ny_max = \"separate\"\n"));
    return world.scene.effects.at(0)->explain();
  };
  const std::string why =
      " (no mirror, since the domain is no multiple of h/2 long, or shorter than 4 h: of first order)";
  EXPECT_EQ(explained(0.8, 0.625), "walls: x_min sticky, x_max slip, y_min slip, y_max separate");
  EXPECT_EQ(explained(0.81, 0.625), "walls: x_min sticky, x_max slip" + why + ", y_min slip, y_max separate");
  EXPECT_EQ(explained(0.15, 0.625),
            "walls: x_min sticky" + why + ", x_max slip" + why + ", y_min slip, y_max separate");
}

}  // namespace
