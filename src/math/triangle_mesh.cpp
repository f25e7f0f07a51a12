#include "mpm_hpc/math/triangle_mesh.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/shape.hpp"

namespace mpm {
namespace {

constexpr std::int32_t leaf_size = 4;

// Ericson, Real-Time Collision Detection (2005), section 5.1.5.
Vec<3> nearest_on_triangle(const Vec<3>& x, const Vec<3>& a, const Vec<3>& b, const Vec<3>& c) {
  const Vec<3> ab = b - a, ac = c - a, ax = x - a;
  const Real d1 = ab.dot(ax), d2 = ac.dot(ax);
  if (d1 <= 0 && d2 <= 0) return a;
  const Vec<3> bx = x - b;
  const Real d3 = ab.dot(bx), d4 = ac.dot(bx);
  if (d3 >= 0 && d4 <= d3) return b;
  const Real vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return a + d1 / (d1 - d3) * ab;
  const Vec<3> cx = x - c;
  const Real d5 = ab.dot(cx), d6 = ac.dot(cx);
  if (d6 >= 0 && d5 <= d6) return c;
  const Real vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return a + d2 / (d2 - d6) * ac;
  const Real va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) return b + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b);
  const Real sum = va + vb + vc;
  return sum > 0 ? Vec<3>(a + (vb * ab + vc * ac) / sum) : a;
}

Real box_distance2(const Vec<3>& x, const Vec<3>& lower, const Vec<3>& upper) {
  return (lower - x).cwiseMax(x - upper).cwiseMax(0.0).squaredNorm();
}

// Turns of the edge from a to b around (x, y), seen along z: +1, -1 or 0 by whether it crosses the ray in +x.
// Both triangles at an edge get opposite values, whatever the roundoff, since the corners are taken in a
// fixed order, and one compiled copy rounds alike.
[[gnu::noinline]] int crossing(const Vec<3>& x, std::int32_t number_a, std::int32_t number_b, const Vec<3>& a,
                               const Vec<3>& b) {
  if ((a.y() > x.y()) == (b.y() > x.y())) return 0;
  const int way = b.y() > a.y() ? 1 : -1;
  if (x.x() < std::min(a.x(), b.x())) return way;
  if (x.x() >= std::max(a.x(), b.x())) return 0;
  const bool in_order = number_a < number_b;
  const Vec<3>&p = in_order ? a : b, &q = in_order ? b : a;
  const Real side = (q.x() - p.x()) * (x.y() - p.y()) - (q.y() - p.y()) * (x.x() - p.x());
  const bool is_left = (side > 0) == (q.y() > p.y());  // x is left of the edge, so the edge is on the ray
  return is_left ? way : 0;
}

struct MeshNode final : ShapeNode<3> {
  std::shared_ptr<const TriangleMesh> mesh;

  explicit MeshNode(std::shared_ptr<const TriangleMesh> m) : mesh(std::move(m)) {}
  Real distance(const Vec<3>& x) const override { return mesh->distance(x); }
  Real bounded_distance(const Vec<3>& x, Real limit) const override { return mesh->distance(x, limit); }
  Vec<3> normal(const Vec<3>& x) const override { return mesh->normal(x); }
  bool contains(const Vec<3>& x) const override { return mesh->contains(x); }
  BoundingBox<3> bounds() const override { return mesh->bounds(); }
};

}  // namespace

TriangleMesh::TriangleMesh(TriangleSoup soup) : soup_(std::move(soup)) {
  require(!soup_.triangles.empty(), "a mesh needs triangles.");
  turned_ = orient(soup_);
  std::vector<Vec<3>> centers;
  for (const Triangle& t : soup_.triangles)
    centers.push_back((soup_.vertices[t[0]] + soup_.vertices[t[1]] + soup_.vertices[t[2]]) / 3);
  std::vector<std::int32_t> order(soup_.triangles.size());
  std::iota(order.begin(), order.end(), 0);
  build(0, static_cast<std::int32_t>(order.size()), centers, order);
  std::vector<Triangle> sorted;
  for (std::int32_t t : order) sorted.push_back(soup_.triangles[t]);
  soup_.triangles = std::move(sorted);
}

TriangleMesh TriangleMesh::read(const std::filesystem::path& file, Real scale) {
  TriangleSoup soup = read_triangles(file);
  for (Vec<3>& x : soup.vertices) x *= scale;
  try {
    return TriangleMesh(std::move(soup));
  } catch (const UserError& error) {
    throw UserError(fmt::format("the mesh {} can't be used: {}", file.string(), error.what()));
  }
}

void TriangleMesh::build(std::int32_t first, std::int32_t count, std::vector<Vec<3>>& centers,
                         std::vector<std::int32_t>& order) {
  BoundingBox<3> box, spread;
  for (std::int32_t i = first; i < first + count; ++i) {
    for (std::int32_t v : soup_.triangles[order[i]]) box.add(soup_.vertices[v]);
    spread.add(centers[order[i]]);
  }
  const std::size_t self = branches_.size();
  branches_.push_back({box.lower, box.upper, -1, first, count});
  if (count <= leaf_size) return;
  int axis = 0;
  spread.extent().maxCoeff(&axis);
  const std::int32_t half = count / 2;
  std::nth_element(order.begin() + first, order.begin() + first + half, order.begin() + first + count,
                   [&](std::int32_t a, std::int32_t b) { return centers[a][axis] < centers[b][axis]; });
  build(first, half, centers, order);
  branches_[self].right = static_cast<std::int32_t>(branches_.size());
  build(first + half, count - half, centers, order);
}

TriangleMesh::Nearest TriangleMesh::nearest(const Vec<3>& x, Real limit) const {
  struct Entry {
    std::int32_t branch;
    Real distance2;
  };
  std::array<Entry, 64> stack;  // a branch halves its triangles, so 32 levels suffice
  std::size_t height = 0;
  Nearest best{Vec<3>::Zero(), -1, 0};
  Real best2 = limit * limit;
  stack[height++] = {0, box_distance2(x, branches_[0].lower, branches_[0].upper)};
  while (height > 0) {
    const Entry entry = stack[--height];
    if (entry.distance2 >= best2) continue;
    const Branch& branch = branches_[entry.branch];
    if (branch.right < 0) {
      for (std::int32_t i = branch.first; i < branch.first + branch.count; ++i) {
        const Triangle& t = soup_.triangles[i];
        const Vec<3> point =
            nearest_on_triangle(x, soup_.vertices[t[0]], soup_.vertices[t[1]], soup_.vertices[t[2]]);
        const Real distance2 = (x - point).squaredNorm();
        if (distance2 < best2) {
          best2 = distance2;
          best = {point, i, 0};
        }
      }
      continue;
    }
    const Branch &left = branches_[entry.branch + 1], &right = branches_[branch.right];
    Entry near{entry.branch + 1, box_distance2(x, left.lower, left.upper)};
    Entry far{branch.right, box_distance2(x, right.lower, right.upper)};
    if (far.distance2 < near.distance2) std::swap(near, far);
    stack[height++] = far;
    stack[height++] = near;
  }
  best.distance = best.triangle < 0 ? limit : std::sqrt(best2);
  return best;
}

// Counts the triangles above x, each by how it winds around the vertical line through x.
int TriangleMesh::winding_number(const Vec<3>& x) const {
  std::array<std::int32_t, 64> stack;
  std::size_t height = 0;
  stack[height++] = 0;
  int sum = 0;
  while (height > 0) {
    const std::int32_t number = stack[--height];
    const Branch& branch = branches_[number];
    if (x.x() < branch.lower.x() || x.x() > branch.upper.x() || x.y() < branch.lower.y() ||
        x.y() > branch.upper.y() || x.z() > branch.upper.z())
      continue;
    if (branch.right >= 0) {
      stack[height++] = branch.right;
      stack[height++] = number + 1;
      continue;
    }
    for (std::int32_t i = branch.first; i < branch.first + branch.count; ++i) {
      const Triangle& t = soup_.triangles[i];
      const Vec<3>&a = soup_.vertices[t[0]], &b = soup_.vertices[t[1]], &c = soup_.vertices[t[2]];
      const int turns =
          crossing(x, t[0], t[1], a, b) + crossing(x, t[1], t[2], b, c) + crossing(x, t[2], t[0], c, a);
      if (turns == 0 || x.z() > std::max({a.z(), b.z(), c.z()})) continue;
      const Vec<3> normal = (b - a).cross(c - a);
      const bool is_above = x.z() < std::min({a.z(), b.z(), c.z()}) ||
                            (normal.z() != 0 && (x - a).dot(normal) / normal.z() < 0);
      if (is_above) sum += turns;
    }
  }
  return sum;
}

Real TriangleMesh::distance(const Vec<3>& x, Real limit) const {
  const Real size = nearest(x, limit).distance;
  return contains(x) ? -size : size;
}

Vec<3> TriangleMesh::normal(const Vec<3>& x) const {
  const Nearest found = nearest(x);
  const Triangle& t = soup_.triangles[found.triangle];
  const Vec<3> ab = soup_.vertices[t[1]] - soup_.vertices[t[0]],
               ac = soup_.vertices[t[2]] - soup_.vertices[t[0]];
  // Too near to the surface for a direction: that of the triangle.
  if (found.distance < 1e-9 * std::max(ab.norm(), ac.norm())) return ab.cross(ac).normalized();
  const Vec<3> away = (x - found.point) / found.distance;
  return contains(x) ? Vec<3>(-away) : away;
}

Real TriangleMesh::volume() const {
  const Vec<3> origin = soup_.vertices[soup_.triangles[0][0]];
  Real sum = 0;
  for (const Triangle& t : soup_.triangles)
    sum += (soup_.vertices[t[0]] - origin)
               .dot((soup_.vertices[t[1]] - origin).cross(soup_.vertices[t[2]] - origin)) /
           6;
  return sum;
}

BoundingBox<3> TriangleMesh::bounds() const { return {branches_[0].lower, branches_[0].upper}; }

template <int Dim>
Shape<Dim> Shape<Dim>::mesh(std::shared_ptr<const TriangleMesh> mesh) requires(Dim == 3) {
  return Shape(std::make_shared<const MeshNode>(std::move(mesh)));
}

template Shape<3> Shape<3>::mesh(std::shared_ptr<const TriangleMesh>);

}  // namespace mpm
