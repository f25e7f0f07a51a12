// Solids as signed distance functions: primitives, meshes and their combinations, in 2D and 3D.
#pragma once

#include <memory>
#include <string_view>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/bounding_box.hpp"

namespace mpm {

class Parameters;
class TriangleMesh;

// A solid behind a Shape. Distances are 1-Lipschitz, so that |distance| never exceeds the true one.
template <int Dim>
class ShapeNode {
 public:
  virtual ~ShapeNode() = default;
  virtual Real distance(const Vec<Dim>& x) const = 0;
  virtual Vec<Dim> normal(const Vec<Dim>& x) const = 0;
  virtual BoundingBox<Dim> bounds() const = 0;
  virtual bool contains(const Vec<Dim>& x) const { return distance(x) < 0; }
  virtual Real bounded_distance(const Vec<Dim>& x, Real limit) const {
    (void)limit;
    return distance(x);
  }
};

// A solid, immutable and cheap to copy. The distance [m] is negative inside and zero on the surface; it is
// exact for primitives and meshes. Of a combination the sign is exact, and the size is a lower bound where
// another part's surface cuts off the nearest point. Where the normal isn't unique (an edge, a centre) it is
// one of the candidates. Factories throw UserError, without a place, for degenerate solids.
template <int Dim>
class Shape {
 public:
  Shape() = default;  // nothing; only assignment and the test for it are allowed
  explicit Shape(std::shared_ptr<const ShapeNode<Dim>> node) : node_(std::move(node)) {}

  // Edges rounded with radius `rounding` inside of the box.
  static Shape box(const Vec<Dim>& lower, const Vec<Dim>& upper, Real rounding = 0);
  static Shape sphere(const Vec<Dim>& center, Real radius);
  // Flat ends at a and b; in 2D a rectangle of width 2 radius.
  static Shape cylinder(const Vec<Dim>& a, const Vec<Dim>& b, Real radius);
  static Shape capsule(const Vec<Dim>& a, const Vec<Dim>& b, Real radius);
  // The half-space that the normal points away from.
  static Shape plane(const Vec<Dim>& point, const Vec<Dim>& normal);
  static Shape ellipsoid(const Vec<Dim>& center, const Vec<Dim>& radii);
  // Corners in order, either way round, closed by itself.
  static Shape polygon(std::vector<Vec<Dim>> points) requires(Dim == 2);
  static Shape mesh(std::shared_ptr<const TriangleMesh> mesh) requires(Dim == 3);

  static Shape union_of(std::vector<Shape> parts);
  static Shape intersection_of(std::vector<Shape> parts);
  // The first part without the others.
  static Shape difference_of(std::vector<Shape> parts);
  Shape translated(const Vec<Dim>& by) const;
  // x -> rotation (x - about) + about; the rotation is a proper orthogonal matrix.
  Shape rotated(const Mat<Dim>& rotation, const Vec<Dim>& about) const;

  explicit operator bool() const { return node_ != nullptr; }
  Real distance(const Vec<Dim>& x) const { return node_->distance(x); }
  Vec<Dim> normal(const Vec<Dim>& x) const { return node_->normal(x); }  // outward, length 1
  // The distance where its size is below the limit, else anything beyond the limit with the right sign: far
  // cheaper than distance() for meshes.
  Real bounded_distance(const Vec<Dim>& x, Real limit) const { return node_->bounded_distance(x, limit); }
  bool contains(const Vec<Dim>& x) const { return node_->contains(x); }  // cheaper than distance for meshes
  BoundingBox<Dim> bounds() const { return node_->bounds(); }            // infinite for a plane

 private:
  std::shared_ptr<const ShapeNode<Dim>> node_;
};

// key = {type = "box", ...}; nested in the combinations. Returns whether the scene gives the key.
template <int Dim>
bool declare_shape(Parameters& p, std::string_view key, Shape<Dim>& shape, bool required, const char* doc);

// Rotation by an angle [rad], in 3D about an axis of any length but 0, right-handed.
template <int Dim>
Mat<Dim> rotation_matrix(Real angle, const Vec<3>& axis = Vec<3>::UnitZ());

}  // namespace mpm
