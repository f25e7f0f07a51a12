#include "mpm_hpc/math/shape.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"

namespace mpm {
namespace {

constexpr Real pi = std::numbers::pi;

template <int Dim>
Vec<Dim> random_point(std::mt19937& generator, Real reach) {
  std::uniform_real_distribution<Real> uniform(-reach, reach);
  Vec<Dim> x;
  for (int a = 0; a < Dim; ++a) x[a] = uniform(generator);
  return x;
}

template <int Dim>
std::vector<std::pair<const char*, Shape<Dim>>> primitives() {
  Vec<Dim> lower = Vec<Dim>::Constant(-0.4), upper = Vec<Dim>::Constant(0.3), a = Vec<Dim>::Zero(), b, radii;
  upper[0] = 0.7;
  b = Vec<Dim>::LinSpaced(Dim, 0.5, -0.3);
  radii = Vec<Dim>::LinSpaced(Dim, 0.8, 0.3);
  return {{"box", Shape<Dim>::box(lower, upper)},
          {"rounded box", Shape<Dim>::box(lower, upper, 0.15)},
          {"sphere", Shape<Dim>::sphere(b, 0.4)},
          {"cylinder", Shape<Dim>::cylinder(a, b, 0.25)},
          {"capsule", Shape<Dim>::capsule(a, b, 0.25)},
          {"plane", Shape<Dim>::plane(b, radii)},
          {"ellipsoid", Shape<Dim>::ellipsoid(b, radii)},
          {"rotated box", Shape<Dim>::box(lower, upper).rotated(rotation_matrix<Dim>(0.7, {1, 2, 3}), b)},
          {"translated ellipsoid", Shape<Dim>::ellipsoid(b, radii).translated(b)}};
}

// An exact distance: walking back along the normal by the distance ends on the surface, the gradient is the
// normal.
template <int Dim>
void check_eikonal() {
  std::mt19937 generator(1);
  for (const auto& [name, shape] : primitives<Dim>()) {
    int smooth = 0;
    for (int i = 0; i < 2000; ++i) {
      const Vec<Dim> x = random_point<Dim>(generator, 1.5);
      const Real d = shape.distance(x);
      const Vec<Dim> n = shape.normal(x);
      EXPECT_NEAR(n.norm(), 1, 1e-12) << name;
      EXPECT_EQ(shape.contains(x), d < 0) << name;
      EXPECT_NEAR(shape.distance(x - d * n), 0, 1e-9) << name << " at " << x.transpose();
      const Real h = 1e-5;
      Vec<Dim> gradient;
      for (int a = 0; a < Dim; ++a)
        gradient[a] =
            (shape.distance(x + h * Vec<Dim>::Unit(a)) - shape.distance(x - h * Vec<Dim>::Unit(a))) / (2 * h);
      if (std::abs(gradient.norm() - 1) > 1e-6) continue;  // across a medial surface
      ++smooth;
      EXPECT_LT((gradient - n).norm(), 1e-5) << name << " at " << x.transpose();
      if (d < 0) {
        EXPECT_TRUE(shape.bounds().contains(x)) << name;
      }
    }
    EXPECT_GT(smooth, 1900) << name;
  }
}

TEST(Shape, DistanceAndNormalAgree2D) { check_eikonal<2>(); }
TEST(Shape, DistanceAndNormalAgree3D) { check_eikonal<3>(); }

TEST(Shape, ClosedFormDistances) {
  const auto box = Shape<3>::box({0, 0, 0}, {2, 4, 6});
  EXPECT_DOUBLE_EQ(box.distance({1, 2, 3}), -1);
  EXPECT_DOUBLE_EQ(box.distance({5, 8, 3}), 5);     // 3-4-5 off an edge
  EXPECT_DOUBLE_EQ(box.distance({-2, -3, -6}), 7);  // 2-3-6-7 off a corner
  const auto rounded = Shape<2>::box({-1, -1}, {1, 1}, 0.5);
  EXPECT_DOUBLE_EQ(rounded.distance({1, 1}), std::sqrt(0.5) - 0.5);
  EXPECT_DOUBLE_EQ(rounded.distance({1, 0}), 0);
  EXPECT_DOUBLE_EQ(Shape<2>::sphere({1, 2}, 3).distance({4, 6}), 2);
  const auto cylinder = Shape<3>::cylinder({0, 0, -1}, {0, 0, 1}, 2);
  EXPECT_DOUBLE_EQ(cylinder.distance({5, 0, 5}), 5);
  EXPECT_DOUBLE_EQ(cylinder.distance({0, 0.5, 0}), -1);
  EXPECT_DOUBLE_EQ(cylinder.distance({0, 1.75, 0}), -0.25);
  // In 2D a cylinder is a box of width 2 r.
  const auto flat = Shape<2>::cylinder({-1, 0}, {1, 0}, 0.5), same = Shape<2>::box({-1, -0.5}, {1, 0.5});
  std::mt19937 generator(2);
  for (int i = 0; i < 100; ++i) {
    const Vec<2> x = random_point<2>(generator, 2);
    EXPECT_NEAR(flat.distance(x), same.distance(x), 1e-15);
  }
  EXPECT_DOUBLE_EQ(Shape<2>::capsule({0, 0}, {4, 0}, 1).distance({7, 4}), 4);
  const auto plane = Shape<3>::plane({0, 0, 2}, {0, 0, 5});
  EXPECT_DOUBLE_EQ(plane.distance({7, 7, 0}), -2);
  EXPECT_FALSE(plane.bounds().is_finite());
  EXPECT_EQ(cylinder.bounds().upper, Vec<3>(2, 2, 1));
}

// On and beside the axes the nearest point of an ellipse is known: x = a^2 p / (a^2 - b^2) within the
// evolute.
TEST(Shape, EllipsoidDistancesAreExact) {
  const Real a = 2, b = 1;
  const auto ellipse = Shape<2>::ellipsoid({0, 0}, {a, b});
  EXPECT_DOUBLE_EQ(ellipse.distance({0, 0}), -b);
  EXPECT_DOUBLE_EQ(ellipse.distance({5, 0}), 3);
  EXPECT_DOUBLE_EQ(ellipse.distance({0, -5}), 4);
  const Real p = 0.6, foot = a * a * p / (a * a - b * b);
  EXPECT_NEAR(ellipse.distance({p, 0}), -std::hypot(foot - p, b * std::sqrt(1 - foot * foot / (a * a))),
              1e-15);
  EXPECT_NEAR(ellipse.distance({1.9, 0}), -0.1, 1e-15);  // beyond the evolute: the vertex
  // Points offset along the normal from (a cos t, b sin t), up to the evolute inside.
  for (Real t : {1e-9, 1e-4, 0.3, 1.0, 1.5, pi / 2 - 1e-9}) {
    const Vec<2> foot_point(a * std::cos(t), b * std::sin(t));
    const Vec<2> n = Vec<2>(std::cos(t) / a, std::sin(t) / b).normalized();
    const Real evolute = std::pow(std::hypot(a * std::sin(t), b * std::cos(t)), 3) / (a * b);
    const Real inner = std::min(evolute, foot_point.y() / n.y());  // not across the long axis either
    for (Real d : {-0.99 * inner, -0.5 * inner, -1e-6, 1e-6, 1.0, 1e3})
      EXPECT_NEAR(ellipse.distance(foot_point + d * n), d, 2e-8 * std::max(1.0, std::abs(d)))
          << t << " " << d;
  }
  const auto sphere = Shape<3>::ellipsoid({1, 1, 1}, {2, 2, 2});
  EXPECT_NEAR(sphere.distance({1, 1, 1}), -2, 1e-15);
  EXPECT_NEAR(sphere.distance({4, 5, 1}), 3, 1e-14);
}

TEST(Shape, PolygonsEitherWayRound) {
  // An L: 2 x 2 without its upper right quarter.
  std::vector<Vec<2>> points = {{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
  const auto l = Shape<2>::polygon(points);
  std::reverse(points.begin(), points.end());
  const auto reversed = Shape<2>::polygon(points);
  const auto csg = Shape<2>::difference_of({Shape<2>::box({0, 0}, {2, 2}), Shape<2>::box({1, 1}, {3, 3})});
  EXPECT_DOUBLE_EQ(l.distance({0.5, 0.5}), -0.5);
  EXPECT_DOUBLE_EQ(l.distance({1.5, 1.5}), 0.5);
  EXPECT_DOUBLE_EQ(l.distance({5, -4}), 5);
  EXPECT_LT((l.normal({1.0, 1.5}) - Vec<2>(1, 0)).norm(), 1e-15);  // on the surface
  EXPECT_LT((l.normal({-1, 1.5}) - Vec<2>(-1, 0)).norm(), 1e-15);
  std::mt19937 generator(3);
  for (int i = 0; i < 2000; ++i) {
    const Vec<2> x = random_point<2>(generator, 3);
    EXPECT_DOUBLE_EQ(l.distance(x), reversed.distance(x));
    EXPECT_EQ(l.contains(x), csg.contains(x));
    EXPECT_LE(std::abs(csg.distance(x)), std::abs(l.distance(x)) + 1e-15);
  }
}

std::string refusal(const std::vector<Vec<2>>& points) {
  try {
    Shape<2>::polygon(points);
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Shape, BadPolygonsAreRefused) {
  EXPECT_EQ(refusal({{0, 0}, {1, 1}, {1, 0}, {0, 1}}),
            "edges 0 and 2 of the polygon touch or cross; a polygon must not intersect itself.");
  EXPECT_EQ(refusal({{0, 0}, {2, 0}, {1, 0}, {1, 1}}).rfind("edges 0 and 1", 0), 0u);  // folds back
  EXPECT_NE(refusal({{0, 0}, {1, 0}, {1, 0}, {0, 1}}).find("coincide"), std::string::npos);
  EXPECT_NE(refusal({{0, 0}, {1, 0}}).find("three points"), std::string::npos);
  // A corner that touches another edge.
  EXPECT_NE(refusal({{0, 0}, {4, 0}, {4, 4}, {2, 0}, {0, 4}}), "accepted");
  EXPECT_EQ(refusal({{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}}), "accepted");  // closed by hand
  EXPECT_EQ(refusal({{0, 0}, {1, 0}, {2, 0}, {2, 1}}), "accepted");          // straight corner
}

template <int Dim>
void check_combinations() {
  std::mt19937 generator(4);
  const auto a = Shape<Dim>::sphere(Vec<Dim>::Zero(), 0.8);
  const auto b = Shape<Dim>::box(Vec<Dim>::Constant(0.1), Vec<Dim>::Constant(1));
  const auto either = Shape<Dim>::union_of({a, b}), both = Shape<Dim>::intersection_of({a, b}),
             first = Shape<Dim>::difference_of({a, b});
  for (int i = 0; i < 2000; ++i) {
    const Vec<Dim> x = random_point<Dim>(generator, 1.2);
    const bool in_a = a.contains(x), in_b = b.contains(x);
    EXPECT_EQ(either.contains(x), in_a || in_b);
    EXPECT_EQ(both.contains(x), in_a && in_b);
    EXPECT_EQ(first.contains(x), in_a && !in_b);
    for (const auto& shape : {either, both, first}) {
      EXPECT_EQ(shape.distance(x) < 0, shape.contains(x));
      if (shape.contains(x)) {
        EXPECT_TRUE(shape.bounds().contains(x));
      }
      // 1-Lipschitz, and the normal is the gradient.
      const Vec<Dim> y = x + random_point<Dim>(generator, 0.3);
      EXPECT_LE(std::abs(shape.distance(x) - shape.distance(y)), (x - y).norm() * (1 + 1e-12));
      const Real h = 1e-6, slope = (shape.distance(x + h * shape.normal(x)) - shape.distance(x)) / h;
      EXPECT_NEAR(slope, 1, 0.5);
    }
  }
  EXPECT_EQ(both.bounds().lower, Vec<Dim>::Constant(0.1));
  EXPECT_EQ(both.bounds().upper, Vec<Dim>::Constant(0.8));
  EXPECT_EQ(either.bounds().upper, Vec<Dim>::Constant(1));
}

TEST(Shape, Combinations2D) { check_combinations<2>(); }
TEST(Shape, Combinations3D) { check_combinations<3>(); }

TEST(Shape, RotationsAreRightHandedAboutAPoint) {
  const auto bar = Shape<2>::box({1, -0.1}, {2, 0.1});
  EXPECT_TRUE(bar.rotated(rotation_matrix<2>(pi / 2), {0, 0}).contains({0, 1.5}));
  EXPECT_TRUE(bar.rotated(rotation_matrix<2>(pi / 2), {1, 0}).contains({1, 0.5}));
  const auto rod = Shape<3>::box({1, -0.1, -0.1}, {2, 0.1, 0.1});
  EXPECT_TRUE(rod.rotated(rotation_matrix<3>(pi / 2, {0, 0, 7}), Vec<3>::Zero()).contains({0, 1.5, 0}));
  EXPECT_TRUE(rod.rotated(rotation_matrix<3>(pi / 2, {0, 1, 0}), Vec<3>::Zero()).contains({0, 0, -1.5}));
  const auto turned = bar.rotated(rotation_matrix<2>(pi / 4), {0, 0}).bounds();
  EXPECT_NEAR(turned.upper.x(), (2 + 0.1) / std::sqrt(2), 1e-15);
}

template <int Dim>
Shape<Dim> from_scene(const std::string& text) {
  Parameters p = Parameters::read_text(text, "scene.toml");
  Shape<Dim> shape;
  declare_shape<Dim>(p, "shape", shape, true, "");
  p.finish();
  return shape;
}

template <int Dim>
std::string scene_fault(const std::string& text) {
  try {
    from_scene<Dim>(text);
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ShapeParameters, ReadsNestedShapesWithUnits) {
  const auto plate = from_scene<2>(R"(
[shape]
type = "difference"
translate = [1, 0]
of = [{type = "box", lower = ["0 mm", 0], upper = ["100 mm", "40 mm"]},
      {type = "union", of = [{type = "sphere", center = [0.05, 0.02], radius = "5 mm"},
                             {type = "cylinder", a = [0, 0.02], b = [0.05, 0.02], radius = "1 mm"}]}])");
  EXPECT_TRUE(plate.contains({1.08, 0.02}));
  EXPECT_FALSE(plate.contains({1.05, 0.024}));
  EXPECT_FALSE(plate.contains({1.02, 0.0205}));
  EXPECT_TRUE(plate.contains({1.02, 0.0215}));
  EXPECT_NEAR(plate.distance({1.05, 0.02}), 0.005, 1e-12);
  const auto turned = from_scene<3>(
      R"(shape = {type = "ellipsoid", center = [0, 0, 0], radii = [3, 1, 1], rotate = {angle = "90 deg", axis = [0, 0, 1]}})");
  EXPECT_TRUE(turned.contains({0, 2.9, 0}));
  EXPECT_FALSE(turned.contains({2.9, 0, 0}));
  const auto triangle = from_scene<2>(R"(shape = {type = "polygon", points = [[0, 0], [1, 0], [0, 1]]})");
  EXPECT_TRUE(triangle.contains({0.2, 0.2}));
}

TEST(ShapeParameters, ErrorsHavePlaces) {
  EXPECT_EQ(scene_fault<2>("[shape]\ntype = \"sphere\"\ncenter = [0, 0]\nradius = -1"),
            "scene.toml:4:10: radius = -1 is below the allowed range (> 0 m); give a positive radius.");
  EXPECT_EQ(scene_fault<2>("[shape]\ntype = \"box\"\nlower = [0, 0]\nupper = [1, -1]"),
            "scene.toml:4:9: a box needs upper > lower in each direction.");
  EXPECT_EQ(
      scene_fault<2>("[shape]\ntype = \"circel\""),
      "scene.toml:2:8: type = \"circel\" is no choice; choose one of \"box\", \"sphere\", \"cylinder\", "
      "\"capsule\", \"plane\", \"ellipsoid\", \"polygon\", \"union\", \"intersection\", \"difference\".");
  EXPECT_EQ(
      scene_fault<2>("[shape]\ntype = \"polygon\"\npoints = [[0, 0], [1, 1], [1, 0], [0, 1]]"),
      "scene.toml:3:10: edges 0 and 2 of the polygon touch or cross; a polygon must not intersect itself.");
  EXPECT_EQ(
      scene_fault<3>("[shape]\ntype = \"union\"\nof = [{type = \"sphere\", center = [0, 0], radius = 1}]"),
      "scene.toml:3:34: center must be a list of 3 numbers, one per direction, not a list of 2.");
  EXPECT_EQ(scene_fault<2>("[shape]\ntype = \"sphere\"\ncenter = [0, 0]\nradius = 1\nlower = [0, 0]")
                .rfind("scene.toml:5:1: unknown key \"lower\" in [shape]", 0),
            0u);
  EXPECT_EQ(scene_fault<2>("[shape]\ntype = \"union\"\nof = []").rfind("scene.toml:3:6: of is empty", 0), 0u);
  EXPECT_NE(scene_fault<2>("").find("lacks the required key \"shape\""), std::string::npos);
  EXPECT_EQ(scene_fault<3>("[shape]\ntype = \"mesh\"\nfile = \"no.stl\""),
            "scene.toml:3:8: the mesh no.stl doesn't exist or is no file; check the path.");
  EXPECT_EQ(scene_fault<3>("[shape]\ntype = \"plane\"\npoint = [0,0,0]\nnormal = [0,0,0]"),
            "scene.toml:4:10: a plane needs a normal that isn't zero.");
}

TEST(ShapeParameters, DescribesEachTypeOnce) {
  Parameters p = Parameters::describe();
  Shape<3> shape;
  declare_shape<3>(p, "shape", shape, true, "What the body fills.");
  const std::string text = p.describe_text();
  for (const char* part : {"with type = \"ellipsoid\"", "of the form shape_3d", "rotate", "axis"})
    EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
}

}  // namespace
}  // namespace mpm
