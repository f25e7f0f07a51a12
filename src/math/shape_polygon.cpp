#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {
namespace {

Real cross(const Vec<2>& a, const Vec<2>& b) { return a.x() * b.y() - a.y() * b.x(); }

Vec<2> nearest_on_segment(const Vec<2>& x, const Vec<2>& a, const Vec<2>& b) {
  const Vec<2> ab = b - a;
  const Real t = std::min(std::max((x - a).dot(ab) / ab.squaredNorm(), 0.0), 1.0);
  return a + t * ab;
}

// Whether two closed segments touch, up to roundoff relative to their size.
bool segments_touch(const Vec<2>& a, const Vec<2>& b, const Vec<2>& c, const Vec<2>& d, Real tolerance) {
  const bool crosses = (cross(b - a, c - a) > 0) != (cross(b - a, d - a) > 0) &&
                       (cross(d - c, a - c) > 0) != (cross(d - c, b - c) > 0);
  if (crosses) return true;
  const auto near = [&](const Vec<2>& x, const Vec<2>& p, const Vec<2>& q) {
    return (x - nearest_on_segment(x, p, q)).norm() <= tolerance;
  };
  return near(a, c, d) || near(b, c, d) || near(c, a, b) || near(d, a, b);
}

struct Polygon final : ShapeNode<2> {
  std::vector<Vec<2>> points;  // counter-clockwise

  explicit Polygon(std::vector<Vec<2>> corners) : points(std::move(corners)) {}

  const Vec<2>& corner(std::size_t i) const { return points[i % points.size()]; }

  struct Nearest {
    Vec<2> point;
    std::size_t edge;
    Real distance;
  };
  Nearest nearest(const Vec<2>& x) const {
    Nearest best{points[0], 0, std::numeric_limits<Real>::infinity()};
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec<2> point = nearest_on_segment(x, corner(i), corner(i + 1));
      if (const Real d = (x - point).norm(); d < best.distance) best = {point, i, d};
    }
    return best;
  }
  bool contains(const Vec<2>& x) const override {
    bool inside = false;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec<2>&a = corner(i), &b = corner(i + 1);
      if ((a.y() > x.y()) == (b.y() > x.y())) continue;
      const bool left = cross(b - a, x - a) > 0;  // of the edge, walked from a to b
      if (left == (b.y() > a.y())) inside = !inside;
    }
    return inside;
  }
  Real distance(const Vec<2>& x) const override {
    const Real size = nearest(x).distance;
    return contains(x) ? -size : size;
  }
  Vec<2> normal(const Vec<2>& x) const override {
    const Nearest found = nearest(x);
    const Vec<2> edge = corner(found.edge + 1) - corner(found.edge);
    const Vec<2> away = x - found.point;
    // Too near to the surface for a direction: that of the edge.
    if (found.distance < 1e-9 * edge.norm()) return Vec<2>(edge.y(), -edge.x()).normalized();
    return contains(x) ? Vec<2>(-away.normalized()) : Vec<2>(away.normalized());
  }
  BoundingBox<2> bounds() const override {
    BoundingBox<2> box;
    for (const Vec<2>& point : points) box.add(point);
    return box;
  }
};

}  // namespace

template <int Dim>
Shape<Dim> Shape<Dim>::polygon(std::vector<Vec<Dim>> points) requires(Dim == 2) {
  require(points.size() >= 3, "a polygon needs three points at least.");
  if (points.size() > 3 && points.front() == points.back()) points.pop_back();  // closed by the user
  const std::size_t n = points.size();
  BoundingBox<2> box;
  for (const Vec<2>& point : points) box.add(point);
  const Real tolerance = 1e-12 * box.extent().norm();
  Real area = 0;
  for (std::size_t i = 0; i < n; ++i) {
    require((points[i] - points[(i + 1) % n]).norm() > tolerance,
            "points {} and {} of the polygon coincide; remove one.", i, (i + 1) % n);
    area += cross(points[i] - box.lower, points[(i + 1) % n] - box.lower) / 2;
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = i + 1; j < n; ++j) {
      const bool neighbours = j == i + 1 || (i == 0 && j == n - 1);
      bool touch = false;
      if (!neighbours) {
        touch = segments_touch(points[i], points[(i + 1) % n], points[j], points[(j + 1) % n], tolerance);
      } else {  // neighbours share a corner and may only fold back on each other
        const std::size_t shared = j == i + 1 ? j : i;
        const Vec<2> before = points[(shared + n - 1) % n] - points[shared];
        const Vec<2> after = points[(shared + 1) % n] - points[shared];
        touch = before.dot(after) > 0 && std::abs(cross(before, after)) <= tolerance * before.norm();
      }
      require(!touch, "edges {} and {} of the polygon touch or cross; a polygon must not intersect itself.",
              i, j);
    }
  require(std::abs(area) > tolerance * tolerance, "the polygon has no area.");
  if (area < 0) std::reverse(points.begin(), points.end());
  return Shape(std::make_shared<const Polygon>(std::move(points)));
}

template Shape<2> Shape<2>::polygon(std::vector<Vec<2>>);

}  // namespace mpm
