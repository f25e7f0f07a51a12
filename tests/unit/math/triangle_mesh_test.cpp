#include "mpm_hpc/math/triangle_mesh.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <random>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/math/shape.hpp"
#include "support/temporary_folder.hpp"

namespace mpm {
namespace {

namespace fs = std::filesystem;
constexpr Real pi = std::numbers::pi;

// The unit cube or a moved one, 12 triangles, outward.
TriangleSoup cube(const Vec<3>& lower = Vec<3>::Zero(), Real edge = 1) {
  TriangleSoup soup;
  for (int c = 0; c < 8; ++c)
    soup.vertices.push_back(lower + edge * Vec<3>(c & 1, (c >> 1) & 1, (c >> 2) & 1));
  soup.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                    {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  return soup;
}

// An octahedron divided `levels` times and pushed onto the unit sphere: 8 * 4^levels triangles.
TriangleSoup ball(int levels) {
  TriangleSoup soup;
  for (int a = 0; a < 3; ++a)
    for (Real s : {1.0, -1.0}) soup.vertices.push_back(s * Vec<3>::Unit(a));
  soup.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<int, int>, int> middles;
    const auto middle = [&](int a, int b) {
      const auto [place, is_new] =
          middles.try_emplace(std::minmax(a, b), static_cast<int>(soup.vertices.size()));
      if (is_new) soup.vertices.push_back((soup.vertices[a] + soup.vertices[b]).normalized());
      return place->second;
    };
    std::vector<Triangle> finer;
    for (const auto& [a, b, c] : soup.triangles) {
      const int ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    soup.triangles = std::move(finer);
  }
  return soup;
}

TriangleSoup joined(TriangleSoup a, const TriangleSoup& b) {
  const auto offset = static_cast<std::int32_t>(a.vertices.size());
  a.vertices.insert(a.vertices.end(), b.vertices.begin(), b.vertices.end());
  for (const auto& [p, q, r] : b.triangles) a.triangles.push_back({p + offset, q + offset, r + offset});
  return a;
}

void turn(TriangleSoup& soup) {
  for (Triangle& t : soup.triangles) std::swap(t[0], t[1]);
}

std::string refusal(TriangleSoup soup) {
  try {
    TriangleMesh mesh(std::move(soup));
  } catch (const UserError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(TriangleMesh, CubeEqualsBox) {
  const TriangleMesh mesh(cube());
  const auto box = Shape<3>::box({0, 0, 0}, {1, 1, 1});
  EXPECT_DOUBLE_EQ(mesh.volume(), 1);
  EXPECT_EQ(mesh.turned_triangles(), 0);
  std::mt19937 generator(1);
  std::uniform_real_distribution<Real> uniform(-0.5, 1.5);
  for (int i = 0; i < 5000; ++i) {
    const Vec<3> x(uniform(generator), uniform(generator), uniform(generator));
    EXPECT_NEAR(mesh.distance(x), box.distance(x), 1e-14);
    EXPECT_NEAR(mesh.distance(x - mesh.distance(x) * mesh.normal(x)), 0, 1e-13);
  }
  // Within a limit the distance is the same, beyond it the sign.
  const auto shape = Shape<3>::mesh(std::make_shared<const TriangleMesh>(cube()));
  const auto moved = Shape<3>::union_of({shape.translated({0.5, 0, 0}), shape});
  for (int i = 0; i < 5000; ++i) {
    const Vec<3> x(uniform(generator), uniform(generator), uniform(generator));
    const Real d = moved.distance(x), bounded = moved.bounded_distance(x, 0.1);
    if (std::abs(d) < 0.1) {
      EXPECT_DOUBLE_EQ(bounded, d);
    } else {
      EXPECT_GE(std::abs(bounded), 0.1);
      EXPECT_EQ(bounded < 0, d < 0);
    }
  }
  // Rays through edges and corners: lattice points of the cube's own coordinates.
  for (int i = -2; i <= 6; ++i)
    for (int j = -2; j <= 6; ++j)
      for (int k = -2; k <= 6; ++k) {
        const Vec<3> x(i / 4.0, j / 4.0, k / 4.0);
        if (std::abs(box.distance(x)) > 0) {
          EXPECT_EQ(mesh.contains(x), box.contains(x)) << x.transpose();
        }
      }
  EXPECT_LT((mesh.normal({0.3, 0.4, 1}) - Vec<3>(0, 0, 1)).norm(), 1e-15);
}

TEST(TriangleMesh, BallConvergesToSphere) {
  const TriangleMesh mesh(ball(5));  // 8192 triangles; edges near pi / 64
  const Real sagitta = std::pow(pi / 64, 2);
  EXPECT_NEAR(mesh.volume(), 4 * pi / 3, 0.01);
  std::mt19937 generator(2);
  std::uniform_real_distribution<Real> uniform(-1.3, 1.3);
  for (int i = 0; i < 5000; ++i) {
    const Vec<3> x(uniform(generator), uniform(generator), uniform(generator));
    EXPECT_NEAR(mesh.distance(x), x.norm() - 1, sagitta);
    if (std::abs(x.norm() - 1) > sagitta) {
      EXPECT_EQ(mesh.winding_number(x), x.norm() < 1 ? 1 : 0);
    }
  }
  // Vertices and edges of the mesh right above: the axes hold vertices, the planes edges.
  EXPECT_EQ(mesh.winding_number({0, 0, 0}), 1);
  EXPECT_EQ(mesh.winding_number({0, 0, -0.5}), 1);
  EXPECT_EQ(mesh.winding_number({0, 0, -1.5}), 0);
  for (const Vec<3>& v : mesh.vertices()) {
    EXPECT_EQ(mesh.winding_number({v.x(), v.y(), -2}), 0);
    const Real z = std::sqrt(std::max(0.0, 1 - v.head<2>().squaredNorm()));
    if (z > 0.1) {
      EXPECT_EQ(mesh.winding_number({v.x(), v.y(), 0.5 * z}), 1);
      EXPECT_EQ(mesh.winding_number({v.x(), v.y(), -0.5 * z}), 1);
    }
  }
}

TEST(TriangleMesh, HolesAreCountedAndPlaced) {
  TriangleSoup open = cube();
  open.triangles.pop_back();  // (3, 7, 5) on x = 1; of its edges, 3-5 comes first
  const std::string reason = refusal(open);
  EXPECT_EQ(reason.rfind("not watertight: 3 open edges, first near (1, 0.5, 0.5)", 0), 0u) << reason;
  TriangleSoup doubled = cube();
  doubled.triangles.push_back({0, 2, 1});
  EXPECT_NE(refusal(doubled).find("more than two triangles"), std::string::npos);
}

TEST(TriangleMesh, OrientationIsRepaired) {
  TriangleSoup inward = cube();
  turn(inward);
  const TriangleMesh repaired(inward);
  EXPECT_EQ(repaired.turned_triangles(), 12);
  EXPECT_DOUBLE_EQ(repaired.volume(), 1);
  TriangleSoup mixed = cube();
  std::swap(mixed.triangles[3][0], mixed.triangles[3][1]);
  const TriangleMesh even(mixed);
  EXPECT_EQ(even.turned_triangles(), 1);
  EXPECT_TRUE(even.contains({0.5, 0.5, 0.5}));

  // A cavity keeps its inward surface; a separate part turned inside out doesn't.
  TriangleSoup inner = cube({1, 1, 1}, 1);
  turn(inner);
  const TriangleMesh hollow(joined(cube({0, 0, 0}, 3), inner));
  EXPECT_EQ(hollow.turned_triangles(), 0);
  EXPECT_FALSE(hollow.contains({1.5, 1.5, 1.5}));
  EXPECT_TRUE(hollow.contains({0.5, 1.5, 1.5}));
  EXPECT_DOUBLE_EQ(hollow.volume(), 26);
  TriangleSoup beside = cube({5, 0, 0}, 1);
  turn(beside);
  const TriangleMesh two(joined(cube({0, 0, 0}, 3), beside));
  EXPECT_EQ(two.turned_triangles(), 12);
  EXPECT_TRUE(two.contains({5.5, 0.5, 0.5}));
  // Parts that overlap are a union.
  const TriangleMesh overlapping(joined(cube(), cube({0.5, 0.5, 0.5}, 1)));
  EXPECT_EQ(overlapping.winding_number({0.75, 0.75, 0.75}), 2);
  EXPECT_TRUE(overlapping.contains({0.75, 0.75, 0.75}));
}

TEST(TriangleMesh, OneSidedSurfacesAreRefused) {
  // The projective plane with 6 vertices: closed, each edge in two triangles, one-sided.
  TriangleSoup soup;
  for (int i = 0; i < 6; ++i) soup.vertices.push_back({std::cos(i), std::sin(i), 0.1 * i * i});
  soup.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 1},
                    {1, 2, 4}, {2, 3, 5}, {3, 4, 1}, {4, 5, 2}, {5, 1, 3}};
  EXPECT_NE(refusal(soup).find("one side only"), std::string::npos) << refusal(soup);
}

class TriangleFiles : public ::testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& content) {
    std::ofstream(folder_ / name, std::ios::binary) << content;
    return folder_ / name;
  }
  std::string fault(const std::string& name, const std::string& content) {
    try {
      TriangleMesh::read(write(name, content));
    } catch (const UserError& error) {
      return error.what();
    }
    return "accepted";
  }
  test::TemporaryFolder folder_;
};

std::string binary_stl(const TriangleSoup& soup) {
  std::string bytes = "solid in name only, as some programs write it";
  bytes.resize(80, ' ');
  const auto append = [&](const auto& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  append(static_cast<std::uint32_t>(soup.triangles.size()));
  for (const Triangle& t : soup.triangles) {
    for (int i = 0; i < 3; ++i) append(0.0f);
    for (auto v : t)
      for (int a = 0; a < 3; ++a) append(static_cast<float>(soup.vertices[v][a]));
    append(static_cast<std::uint16_t>(0));
  }
  return bytes;
}

std::string ascii_stl(const TriangleSoup& soup) {
  std::string text = "solid cube\n";
  for (const Triangle& t : soup.triangles) {
    text += " facet normal 0 0 0\r\n  outer loop\n";
    for (auto v : t)
      text += fmt::format("   vertex {:e} {:e} {:e}\n", soup.vertices[v][0], soup.vertices[v][1],
                          soup.vertices[v][2]);
    text += "  endloop\n endfacet\n";
  }
  return text + "endsolid cube\n";
}

TEST_F(TriangleFiles, AllFormatsGiveTheSameCube) {
  const std::string obj =
      "# quads, negative numbers, normals\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nv 0 0 1\nv 1 0 1\nv 0 1 1\nv "
      "1 1 1\n"
      "vn 0 0 1\nf 1 3 4 2\nf 5//1 6//1 8//1 7//1\nf 1/1 2/1 6/1 5/1\nf -6 -2 -1 -5\nf 1 5 7 3\nf 2 4 8 6\n";
  for (const fs::path& file :
       {write("a.stl", ascii_stl(cube())), write("b.STL", binary_stl(cube())), write("c.obj", obj)}) {
    const TriangleMesh mesh = TriangleMesh::read(file, 2);
    EXPECT_EQ(mesh.vertices().size(), 8u) << file;
    EXPECT_EQ(mesh.triangles().size(), 12u) << file;
    EXPECT_EQ(mesh.turned_triangles(), 0) << file;
    EXPECT_DOUBLE_EQ(mesh.volume(), 8) << file;
  }
}

TEST_F(TriangleFiles, DamageIsNamed) {
  EXPECT_NE(fault("cut.stl", binary_stl(cube()).substr(0, 500)).find("no STL file, or cut short"),
            std::string::npos);
  EXPECT_NE(fault("text.stl", "hello").find("no STL file, or cut short"), std::string::npos);
  EXPECT_NE(fault("mesh.ply", "ply").find("neither .stl nor .obj"), std::string::npos);
  EXPECT_NE(fault("empty.obj", "v 0 0 0\n").find("has no triangles"), std::string::npos);
  EXPECT_NE(fault("number.obj", "v 0 0 zero\n").find("number.obj:1: 'zero' is no number"), std::string::npos);
  EXPECT_NE(fault("face.obj", "v 0 0 0\nf 1 2 3\n").find("face.obj:2: '2' is no vertex number"),
            std::string::npos);
  EXPECT_NE(fault("open.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
                .find("open.obj can't be used: not watertight: 3 open"),
            std::string::npos);
  std::string infinite = ascii_stl(cube());
  infinite.replace(infinite.find("1.000000e+00"), 12, "inf         ");
  EXPECT_NE(fault("inf.stl", infinite), "accepted");
}

}  // namespace
}  // namespace mpm
