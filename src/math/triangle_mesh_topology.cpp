#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/triangle_mesh.hpp"

namespace mpm {
namespace {

// One side of a triangle: from its corner c to the next.
struct Side {
  std::int32_t from, to, triangle;

  std::pair<std::int32_t, std::int32_t> edge() const { return std::minmax(from, to); }
};

std::vector<Side> sorted_sides(const TriangleSoup& soup) {
  std::vector<Side> sides;
  for (std::size_t t = 0; t < soup.triangles.size(); ++t)
    for (std::size_t c = 0; c < 3; ++c)
      sides.push_back({soup.triangles[t][c], soup.triangles[t][(c + 1) % 3], static_cast<std::int32_t>(t)});
  std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) {
    return std::pair(a.edge(), a.triangle) < std::pair(b.edge(), b.triangle);
  });
  return sides;
}

std::string place(const Vec<3>& x) { return fmt::format("({:.6g}, {:.6g}, {:.6g})", x[0], x[1], x[2]); }

// Each edge has two sides, or the mesh is refused.
void check_watertight(const TriangleSoup& soup, const std::vector<Side>& sides) {
  std::size_t open = 0, crowded = 0;
  Vec<3> first_open, first_crowded;
  for (std::size_t i = 0, next; i < sides.size(); i = next) {
    for (next = i; next < sides.size() && sides[next].edge() == sides[i].edge();) ++next;
    const Vec<3> middle = (soup.vertices[sides[i].from] + soup.vertices[sides[i].to]) / 2;
    if (next - i == 1 && open++ == 0) first_open = middle;
    if (next - i > 2 && crowded++ == 0) first_crowded = middle;
  }
  if (open > 0)
    throw UserError(fmt::format("not watertight: {} open edges, first near {}; close the holes of the mesh.",
                                open, place(first_open)));
  if (crowded > 0)
    throw UserError(
        fmt::format("not watertight: {} edges have more than two triangles, first near {}; separate the "
                    "parts of the mesh that touch there.",
                    crowded, place(first_crowded)));
}

Real six_volumes(const TriangleSoup& soup, const Triangle& t, const Vec<3>& origin) {
  const Vec<3> a = soup.vertices[t[0]] - origin, b = soup.vertices[t[1]] - origin,
               c = soup.vertices[t[2]] - origin;
  return a.dot(b.cross(c));
}

// Whether x is inside of a part, by its solid angle (Van Oosterom and Strackee 1983, equation 8).
bool is_inside(const Vec<3>& x, const TriangleSoup& soup, const std::vector<std::int32_t>& part) {
  Real angle = 0;
  for (std::int32_t t : part) {
    Vec<3> r[3];
    Real l[3];
    for (std::size_t c = 0; c < 3; ++c) {
      r[c] = soup.vertices[soup.triangles[t][c]] - x;
      l[c] = r[c].norm();
    }
    angle += 2 * std::atan2(r[0].dot(r[1].cross(r[2])), l[0] * l[1] * l[2] + r[0].dot(r[1]) * l[2] +
                                                            r[1].dot(r[2]) * l[0] + r[2].dot(r[0]) * l[1]);
  }
  return std::abs(angle) > 2 * std::numbers::pi;  // 4 pi inside, 0 outside
}

}  // namespace

int orient(TriangleSoup& soup) {
  const std::vector<Side> sides = sorted_sides(soup);
  check_watertight(soup, sides);

  // The neighbour of each triangle across each edge, and whether the two walk along it the same way.
  struct Neighbour {
    std::int32_t triangle;
    bool same_way;
  };
  const std::size_t n = soup.triangles.size();
  std::vector<std::array<Neighbour, 3>> neighbours(n);
  std::vector<int> filled(n, 0);
  for (std::size_t i = 0; i < sides.size(); i += 2) {
    const Side &a = sides[i], &b = sides[i + 1];
    neighbours[a.triangle][filled[a.triangle]++] = {b.triangle, a.from == b.from};
    neighbours[b.triangle][filled[b.triangle]++] = {a.triangle, a.from == b.from};
  }

  std::vector<int> part_of(n, -1);
  std::vector<bool> turned(n, false);
  std::vector<std::vector<std::int32_t>> parts;
  for (std::size_t seed = 0; seed < n; ++seed) {
    if (part_of[seed] >= 0) continue;
    const int number = static_cast<int>(parts.size());
    parts.push_back({static_cast<std::int32_t>(seed)});
    part_of[seed] = number;
    for (std::size_t i = 0; i < parts.back().size(); ++i) {
      const std::int32_t t = parts.back()[i];
      for (const Neighbour& other : neighbours[t]) {
        const bool turn = turned[t] != other.same_way;
        if (part_of[other.triangle] < 0) {
          part_of[other.triangle] = number;
          turned[other.triangle] = turn;
          parts.back().push_back(other.triangle);
        }
        require(turned[other.triangle] == turn,
                "the surface near {} has one side only (like a Moebius strip), so it has no inside; repair "
                "the mesh.",
                place(soup.vertices[soup.triangles[t][0]]));
      }
    }
  }
  for (std::size_t t = 0; t < n; ++t)
    if (turned[t]) std::swap(soup.triangles[t][1], soup.triangles[t][2]);

  // A part turned inside out is a cavity if another part surrounds it, else a mistake.
  std::vector<Real> volumes;
  for (const auto& part : parts) {
    Real volume = 0;
    for (std::int32_t t : part)
      volume += six_volumes(soup, soup.triangles[t], soup.vertices[soup.triangles[part[0]][0]]);
    volumes.push_back(volume);
  }
  for (std::size_t p = 0; p < parts.size(); ++p) {
    if (volumes[p] >= 0) continue;
    const Vec<3> x = soup.vertices[soup.triangles[parts[p][0]][0]];
    bool is_cavity = false;
    for (std::size_t other = 0; other < parts.size(); ++other)
      is_cavity = is_cavity || (other != p && std::abs(volumes[other]) > std::abs(volumes[p]) &&
                                is_inside(x, soup, parts[other]));
    if (is_cavity) continue;
    for (std::int32_t t : parts[p]) {
      std::swap(soup.triangles[t][1], soup.triangles[t][2]);
      turned[t] = !turned[t];
    }
  }
  return static_cast<int>(std::count(turned.begin(), turned.end(), true));
}

}  // namespace mpm
