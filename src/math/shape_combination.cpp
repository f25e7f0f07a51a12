#include <Eigen/Geometry>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {
namespace {

enum class Operation { union_of, intersection_of, difference_of };

// min, max, and max with the complement of all but the first part.
template <int Dim, Operation op>
struct Combination final : ShapeNode<Dim> {
  std::vector<Shape<Dim>> parts;

  explicit Combination(std::vector<Shape<Dim>> p) : parts(std::move(p)) {}

  static Real sign(std::size_t part) { return op == Operation::difference_of && part > 0 ? -1.0 : 1.0; }

  template <class Distance>
  std::pair<std::size_t, Real> active(Distance&& distance_to) const {
    std::pair<std::size_t, Real> best{0, distance_to(parts[0])};
    for (std::size_t i = 1; i < parts.size(); ++i) {
      const Real d = sign(i) * distance_to(parts[i]);
      if (op == Operation::union_of ? d < best.second : d > best.second) best = {i, d};
    }
    return best;
  }
  Real distance(const Vec<Dim>& x) const override {
    return active([&](const Shape<Dim>& part) { return part.distance(x); }).second;
  }
  Real bounded_distance(const Vec<Dim>& x, Real limit) const override {
    return active([&](const Shape<Dim>& part) { return part.bounded_distance(x, limit); }).second;
  }
  Vec<Dim> normal(const Vec<Dim>& x) const override {
    const std::size_t part = active([&](const Shape<Dim>& p) { return p.distance(x); }).first;
    return sign(part) * parts[part].normal(x);
  }
  bool contains(const Vec<Dim>& x) const override {
    if (op == Operation::union_of) {
      for (const auto& part : parts)
        if (part.contains(x)) return true;
      return false;
    }
    if (!parts[0].contains(x)) return false;
    for (std::size_t i = 1; i < parts.size(); ++i)
      if (parts[i].contains(x) != (op == Operation::intersection_of)) return false;
    return true;
  }
  BoundingBox<Dim> bounds() const override {
    BoundingBox<Dim> box = parts[0].bounds();
    for (std::size_t i = 1; i < parts.size(); ++i) {
      if (op == Operation::union_of) box = box.merged(parts[i].bounds());
      if (op == Operation::intersection_of) box = box.intersected(parts[i].bounds());
    }
    return box;
  }
};

// x -> rotation (x - about) + about + shift.
template <int Dim>
struct Moved final : ShapeNode<Dim> {
  Shape<Dim> shape;
  Mat<Dim> rotation;
  Vec<Dim> offset;  // of the whole map x -> rotation x + offset

  Moved(Shape<Dim> s, const Mat<Dim>& r, const Vec<Dim>& o) : shape(std::move(s)), rotation(r), offset(o) {}

  Vec<Dim> back(const Vec<Dim>& x) const { return rotation.transpose() * (x - offset); }
  Real distance(const Vec<Dim>& x) const override { return shape.distance(back(x)); }
  Real bounded_distance(const Vec<Dim>& x, Real limit) const override {
    return shape.bounded_distance(back(x), limit);
  }
  Vec<Dim> normal(const Vec<Dim>& x) const override { return rotation * shape.normal(back(x)); }
  bool contains(const Vec<Dim>& x) const override { return shape.contains(back(x)); }
  BoundingBox<Dim> bounds() const override {
    const BoundingBox<Dim> inner = shape.bounds();
    if (inner.is_empty()) return inner;
    if (!inner.is_finite()) return BoundingBox<Dim>::everything();
    BoundingBox<Dim> box;
    for (int c = 0; c < (1 << Dim); ++c) {
      Vec<Dim> corner;
      for (int a = 0; a < Dim; ++a) corner[a] = (c >> a) & 1 ? inner.upper[a] : inner.lower[a];
      box.add(rotation * corner + offset);
    }
    return box;
  }
};

template <int Dim, Operation op>
Shape<Dim> combined(std::vector<Shape<Dim>> parts) {
  require(!parts.empty(), "a combination of shapes needs one part at least.");
  return Shape<Dim>(std::make_shared<const Combination<Dim, op>>(std::move(parts)));
}

}  // namespace

template <int Dim>
Shape<Dim> Shape<Dim>::union_of(std::vector<Shape> parts) {
  return combined<Dim, Operation::union_of>(std::move(parts));
}

template <int Dim>
Shape<Dim> Shape<Dim>::intersection_of(std::vector<Shape> parts) {
  return combined<Dim, Operation::intersection_of>(std::move(parts));
}

template <int Dim>
Shape<Dim> Shape<Dim>::difference_of(std::vector<Shape> parts) {
  return combined<Dim, Operation::difference_of>(std::move(parts));
}

template <int Dim>
Shape<Dim> Shape<Dim>::translated(const Vec<Dim>& by) const {
  return Shape(std::make_shared<const Moved<Dim>>(*this, Mat<Dim>::Identity(), by));
}

template <int Dim>
Shape<Dim> Shape<Dim>::rotated(const Mat<Dim>& rotation, const Vec<Dim>& about) const {
  return Shape(std::make_shared<const Moved<Dim>>(*this, rotation, about - rotation * about));
}

template <int Dim>
Mat<Dim> rotation_matrix(Real angle, const Vec<3>& axis) {
  require(axis.norm() > 0, "the axis of a rotation must not be zero.");
  if constexpr (Dim == 2) return Eigen::Rotation2D<Real>(angle).toRotationMatrix();
  if constexpr (Dim == 3) return Eigen::AngleAxis<Real>(angle, axis.normalized()).toRotationMatrix();
}

#define MPM_INSTANTIATE(Dim)                                                       \
  template Shape<Dim> Shape<Dim>::union_of(std::vector<Shape<Dim>>);               \
  template Shape<Dim> Shape<Dim>::intersection_of(std::vector<Shape<Dim>>);        \
  template Shape<Dim> Shape<Dim>::difference_of(std::vector<Shape<Dim>>);          \
  template Shape<Dim> Shape<Dim>::translated(const Vec<Dim>&) const;               \
  template Shape<Dim> Shape<Dim>::rotated(const Mat<Dim>&, const Vec<Dim>&) const; \
  template Mat<Dim> rotation_matrix<Dim>(Real, const Vec<3>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
