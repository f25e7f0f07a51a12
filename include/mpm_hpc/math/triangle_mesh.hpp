// Closed triangle meshes with fast distance and inside queries.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/bounding_box.hpp"

namespace mpm {

using Triangle = std::array<std::int32_t, 3>;  // vertex numbers, counter-clockwise seen from outside

struct TriangleSoup {
  std::vector<Vec<3>> vertices;
  std::vector<Triangle> triangles;
};

// STL (ASCII or binary; equal vertices are joined) or OBJ (faces of any number of corners), by the file's
// ending. Throws UserError that names the file.
TriangleSoup read_triangles(const std::filesystem::path& file);

// Gives all triangles of a connected part the same orientation, and each part the one that makes it solid (a
// part inside of another may be a cavity). Returns the number of turned triangles. Throws UserError if an
// edge doesn't belong to exactly two triangles, or the surface has one side only.
int orient(TriangleSoup& soup);

class TriangleMesh {
 public:
  // Checks and orients the triangles; throws UserError.
  explicit TriangleMesh(TriangleSoup soup);
  static TriangleMesh read(const std::filesystem::path& file, Real scale = 1);

  struct Nearest {
    Vec<3> point;
    std::int32_t triangle;  // -1 if there is none within the limit
    Real distance;          // >= 0; the limit if there is none
  };
  Nearest nearest(const Vec<3>& x, Real limit = std::numeric_limits<Real>::infinity()) const;
  // How often the surface winds around x: 0 outside, 1 inside, more where parts overlap.
  int winding_number(const Vec<3>& x) const;
  bool contains(const Vec<3>& x) const { return winding_number(x) > 0; }
  // Negative inside; beyond the limit only the sign counts.
  Real distance(const Vec<3>& x, Real limit = std::numeric_limits<Real>::infinity()) const;
  Vec<3> normal(const Vec<3>& x) const;  // outward, of the nearest point

  Real volume() const;
  BoundingBox<3> bounds() const;
  const std::vector<Vec<3>>& vertices() const { return soup_.vertices; }
  const std::vector<Triangle>& triangles() const { return soup_.triangles; }
  int turned_triangles() const { return turned_; }

 private:
  // Bounding volume hierarchy in depth-first order: the left child follows its parent.
  struct Branch {
    Eigen::Vector3d lower, upper;
    std::int32_t right;         // of an inner branch; -1 for a leaf
    std::int32_t first, count;  // triangles of a leaf
  };
  void build(std::int32_t first, std::int32_t count, std::vector<Vec<3>>& centers,
             std::vector<std::int32_t>& order);

  TriangleSoup soup_;  // triangles in the order of the leaves
  std::vector<Branch> branches_;
  int turned_ = 0;
};

}  // namespace mpm
