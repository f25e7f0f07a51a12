#include <cmath>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {
namespace {

template <int Dim>
Vec<Dim> unit_or_axis(const Vec<Dim>& v) {
  const Real length = v.norm();
  return length > 0 ? Vec<Dim>(v / length) : Vec<Dim>(Vec<Dim>::UnitX());
}

template <int Dim>
struct Box final : ShapeNode<Dim> {
  Vec<Dim> lower, upper, center, half;
  Real rounding;

  Box(const Vec<Dim>& low, const Vec<Dim>& high, Real r)
      : lower(low), upper(high), center((low + high) / 2), half((high - low) / 2), rounding(r) {}

  Vec<Dim> beyond(const Vec<Dim>& x) const {
    return (x - center).cwiseAbs() - half + Vec<Dim>::Constant(rounding);
  }
  Real distance(const Vec<Dim>& x) const override {
    const Vec<Dim> q = beyond(x);
    return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0) - rounding;
  }
  Vec<Dim> normal(const Vec<Dim>& x) const override {
    const Vec<Dim> q = beyond(x);
    int axis = 0;
    Vec<Dim> n = q.cwiseMax(0.0);
    if (q.maxCoeff(&axis) <= 0) n = Vec<Dim>::Unit(axis);
    for (int a = 0; a < Dim; ++a)
      if (x[a] < center[a]) n[a] = -n[a];
    return n.normalized();
  }
  BoundingBox<Dim> bounds() const override { return {lower, upper}; }
};

template <int Dim>
struct Sphere final : ShapeNode<Dim> {
  Vec<Dim> center;
  Real radius;

  Sphere(const Vec<Dim>& c, Real r) : center(c), radius(r) {}
  Real distance(const Vec<Dim>& x) const override { return (x - center).norm() - radius; }
  Vec<Dim> normal(const Vec<Dim>& x) const override { return unit_or_axis<Dim>(x - center); }
  BoundingBox<Dim> bounds() const override {
    return {center - Vec<Dim>::Constant(radius), center + Vec<Dim>::Constant(radius)};
  }
};

template <int Dim>
struct Cylinder final : ShapeNode<Dim> {
  Vec<Dim> center, axis;
  Real half_length, radius;

  Cylinder(const Vec<Dim>& a, const Vec<Dim>& b, Real r)
      : center((a + b) / 2), axis((b - a).normalized()), half_length((b - a).norm() / 2), radius(r) {}

  struct Split {
    Real along;
    Vec<Dim> across;
    Real side, end;  // beyond the mantle, beyond the flat ends
  };
  Split split(const Vec<Dim>& x) const {
    const Real along = (x - center).dot(axis);
    const Vec<Dim> across = x - center - along * axis;
    return {along, across, across.norm() - radius, std::abs(along) - half_length};
  }
  Real distance(const Vec<Dim>& x) const override {
    const Split s = split(x);
    return std::hypot(std::max(s.side, 0.0), std::max(s.end, 0.0)) + std::min(std::max(s.side, s.end), 0.0);
  }
  Vec<Dim> normal(const Vec<Dim>& x) const override {
    const Split s = split(x);
    const Vec<Dim> out = s.along < 0 ? Vec<Dim>(-axis) : axis;
    // On the axis any direction across will do.
    int least = 0;
    axis.cwiseAbs().minCoeff(&least);
    const Vec<Dim> unit = Vec<Dim>::Unit(least);
    const Vec<Dim> radial = s.across.norm() > 0 ? Vec<Dim>(s.across.normalized())
                                                : Vec<Dim>((unit - unit.dot(axis) * axis).normalized());
    if (s.side <= 0 && s.end <= 0) return s.side > s.end ? radial : out;
    return (std::max(s.side, 0.0) * radial + std::max(s.end, 0.0) * out).normalized();
  }
  BoundingBox<Dim> bounds() const override {
    const Vec<Dim> across = radius * (Vec<Dim>::Ones() - axis.cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
    const Vec<Dim> reach = half_length * axis.cwiseAbs() + across;
    return {center - reach, center + reach};
  }
};

template <int Dim>
struct Capsule final : ShapeNode<Dim> {
  Vec<Dim> a, b;
  Real radius;

  Capsule(const Vec<Dim>& from, const Vec<Dim>& to, Real r) : a(from), b(to), radius(r) {}

  Vec<Dim> from_segment(const Vec<Dim>& x) const {
    const Vec<Dim> ab = b - a;
    const Real length2 = ab.squaredNorm();
    const Real t = length2 > 0 ? std::min(std::max((x - a).dot(ab) / length2, 0.0), 1.0) : 0.0;
    return x - a - t * ab;
  }
  Real distance(const Vec<Dim>& x) const override { return from_segment(x).norm() - radius; }
  Vec<Dim> normal(const Vec<Dim>& x) const override { return unit_or_axis<Dim>(from_segment(x)); }
  BoundingBox<Dim> bounds() const override {
    return {a.cwiseMin(b) - Vec<Dim>::Constant(radius), a.cwiseMax(b) + Vec<Dim>::Constant(radius)};
  }
};

template <int Dim>
struct Plane final : ShapeNode<Dim> {
  Vec<Dim> point, out;

  Plane(const Vec<Dim>& p, const Vec<Dim>& n) : point(p), out(n.normalized()) {}
  Real distance(const Vec<Dim>& x) const override { return (x - point).dot(out); }
  Vec<Dim> normal(const Vec<Dim>&) const override { return out; }
  BoundingBox<Dim> bounds() const override { return BoundingBox<Dim>::everything(); }
};

// Nearest point by the root of Eberly's secular equation (Distance from a Point to an Ellipse, 2013, equation
// 10), F(s) = sum_i (r_i y_i / (s + r_i^2 - r_min^2))^2 - 1, convex and falling, so that Newton from the left
// is monotone.
template <int Dim>
struct Ellipsoid final : ShapeNode<Dim> {
  Vec<Dim> center, radii;

  Ellipsoid(const Vec<Dim>& c, const Vec<Dim>& r) : center(c), radii(r) {}

  Vec<Dim> nearest(const Vec<Dim>& x) const {
    int shortest = 0;
    const Real r_min = radii.minCoeff(&shortest);
    const Vec<Dim> y = (x - center).cwiseAbs();
    const Vec<Dim> gap = ((radii.array() - r_min) * (radii.array() + r_min)).matrix();
    const Vec<Dim> ry = radii.cwiseProduct(y);
    const auto excess = [&](Real s) { return (ry.array() / (s + gap.array())).square().sum() - 1; };

    Real s = std::max((ry - gap).maxCoeff(), 0.0);  // F >= 0 here, if s > 0
    Vec<Dim> point;
    if (s == 0) {
      // The nearest point may lie off the plane of symmetry that x lies in.
      Real used = 0;
      for (int a = 0; a < Dim; ++a) {
        point[a] = gap[a] > 0 ? radii[a] * ry[a] / gap[a] : 0.0;
        used += point[a] * point[a] / (radii[a] * radii[a]);
      }
      if (used <= 1) {
        point[shortest] = r_min * std::sqrt(1 - used);
        return mirrored(x, point);
      }
    }
    for (int i = 0; i < 100; ++i) {
      const Real f = excess(s);
      Real slope = 0;
      for (int a = 0; a < Dim; ++a)
        if (ry[a] > 0) slope -= 2 * ry[a] * ry[a] / std::pow(s + gap[a], 3);
      const Real next = s - f / slope;
      if (!(next > s * (1 + 1e-16))) break;
      s = next;
    }
    for (int a = 0; a < Dim; ++a) point[a] = ry[a] > 0 ? radii[a] * ry[a] / (s + gap[a]) : 0.0;
    return mirrored(x, point);
  }
  Vec<Dim> mirrored(const Vec<Dim>& x, Vec<Dim> point) const {
    for (int a = 0; a < Dim; ++a)
      if (x[a] < center[a]) point[a] = -point[a];
    return center + point;
  }
  Real distance(const Vec<Dim>& x) const override {
    const Real size = (x - nearest(x)).norm();
    return contains(x) ? -size : size;
  }
  bool contains(const Vec<Dim>& x) const override {
    return (x - center).cwiseQuotient(radii).squaredNorm() < 1;
  }
  Vec<Dim> normal(const Vec<Dim>& x) const override {
    return (nearest(x) - center).cwiseQuotient(radii.cwiseAbs2()).normalized();
  }
  BoundingBox<Dim> bounds() const override { return {center - radii, center + radii}; }
};

template <class Node, class... A>
auto made(A&&... args) {
  return std::make_shared<const Node>(std::forward<A>(args)...);
}

}  // namespace

template <int Dim>
Shape<Dim> Shape<Dim>::box(const Vec<Dim>& lower, const Vec<Dim>& upper, Real rounding) {
  require((upper.array() > lower.array()).all(), "a box needs upper > lower in each direction.");
  require(rounding >= 0 && 2 * rounding <= (upper - lower).minCoeff(),
          "the rounding of a box must lie between 0 and half of its shortest edge, {}.",
          (upper - lower).minCoeff() / 2);
  return Shape(made<Box<Dim>>(lower, upper, rounding));
}

template <int Dim>
Shape<Dim> Shape<Dim>::sphere(const Vec<Dim>& center, Real radius) {
  require(radius > 0, "a sphere needs a positive radius.");
  return Shape(made<Sphere<Dim>>(center, radius));
}

template <int Dim>
Shape<Dim> Shape<Dim>::cylinder(const Vec<Dim>& a, const Vec<Dim>& b, Real radius) {
  require(radius > 0 && (b - a).norm() > 0,
          "a cylinder needs a positive radius and ends a and b that differ.");
  return Shape(made<Cylinder<Dim>>(a, b, radius));
}

template <int Dim>
Shape<Dim> Shape<Dim>::capsule(const Vec<Dim>& a, const Vec<Dim>& b, Real radius) {
  require(radius > 0, "a capsule needs a positive radius.");
  return Shape(made<Capsule<Dim>>(a, b, radius));
}

template <int Dim>
Shape<Dim> Shape<Dim>::plane(const Vec<Dim>& point, const Vec<Dim>& normal) {
  require(normal.norm() > 0, "a plane needs a normal that isn't zero.");
  return Shape(made<Plane<Dim>>(point, normal));
}

template <int Dim>
Shape<Dim> Shape<Dim>::ellipsoid(const Vec<Dim>& center, const Vec<Dim>& radii) {
  require((radii.array() > 0).all(), "an ellipsoid needs positive radii.");
  return Shape(made<Ellipsoid<Dim>>(center, radii));
}

#define MPM_INSTANTIATE(Dim)                                                        \
  template Shape<Dim> Shape<Dim>::box(const Vec<Dim>&, const Vec<Dim>&, Real);      \
  template Shape<Dim> Shape<Dim>::sphere(const Vec<Dim>&, Real);                    \
  template Shape<Dim> Shape<Dim>::cylinder(const Vec<Dim>&, const Vec<Dim>&, Real); \
  template Shape<Dim> Shape<Dim>::capsule(const Vec<Dim>&, const Vec<Dim>&, Real);  \
  template Shape<Dim> Shape<Dim>::plane(const Vec<Dim>&, const Vec<Dim>&);          \
  template Shape<Dim> Shape<Dim>::ellipsoid(const Vec<Dim>&, const Vec<Dim>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
