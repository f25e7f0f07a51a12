#include <optional>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/math/shape.hpp"
#include "mpm_hpc/math/triangle_mesh.hpp"

namespace mpm {
namespace {

// A factory's complaint gets the place of the key that it is about.
template <class Make>
auto located(Parameters& p, std::string_view key, Make&& make) -> decltype(make()) {
  try {
    return make();
  } catch (const UserError& error) {
    p.error_at(key, error.what());
  }
  return {};
}

template <int Dim>
std::vector<std::string> type_names() {
  std::vector<std::string> names = {"box",       "sphere",  "cylinder", "capsule",      "plane",
                                    "ellipsoid", "polygon", "union",    "intersection", "difference"};
  if (Dim == 3) names[6] = "mesh";
  return names;
}

template <int Dim>
const char* definition_name() {
  return Dim == 2 ? "shape_2d" : "shape_3d";
}

RealOptions length(const char* doc, bool positive = false) {
  RealOptions options{.unit = "m", .required = true, .doc = doc};
  if (positive) options.min = 0, options.min_exclusive = true;
  return options;
}

template <int Dim>
class ShapeReader {
 public:
  explicit ShapeReader(Parameters& p) : p_(p) {}

  Shape<Dim> read() {
    p_.choice("type", type_, type_names<Dim>(), {.required = true});
    read_primitives();
    if constexpr (Dim == 2) {
      variant({"polygon"}, [&] {
        std::vector<Vec<2>> points;
        p_.template points<2>("points", points, length("Corners in order; the last is joined to the first."));
        make("points", [&] { return Shape<2>::polygon(points); });
      });
    } else {
      variant({"mesh"}, [&] { read_mesh(); });
    }
    variant({"union", "intersection", "difference"}, [&] { read_parts(); });
    read_motion();
    return shape_;
  }

 private:
  template <class Declarations>
  void variant(const std::vector<std::string>& types, Declarations&& declarations) {
    p_.when("type", type_, types, declarations);
  }
  template <class Make>
  void make(std::string_view key, Make&& factory) {
    if (!p_.describing()) shape_ = located(p_, key, factory);
  }

  void read_primitives() {
    Vec<Dim> a = Vec<Dim>::Zero(), b = Vec<Dim>::Zero();
    Real radius = 0;
    variant({"box"}, [&] {
      p_.template vector<Dim>("lower", a, length("Corner with the smallest coordinates."));
      p_.template vector<Dim>("upper", b, length("Corner with the largest coordinates."));
      Real rounding = 0;
      const bool rounded =
          p_.real("rounding", rounding, {.unit = "m", .min = 0, .doc = "Radius of the rounded edges."});
      make(rounded ? "rounding" : "upper", [&] { return Shape<Dim>::box(a, b, rounding); });
    });
    variant({"sphere"}, [&] {
      p_.template vector<Dim>("center", a, length("Centre."));
      p_.real("radius", radius, length("Radius.", true));
      make("radius", [&] { return Shape<Dim>::sphere(a, radius); });
    });
    variant({"cylinder", "capsule"}, [&] {
      p_.template vector<Dim>("a", a, length("One end of the axis."));
      p_.template vector<Dim>("b", b, length("Other end of the axis."));
      p_.real("radius", radius, length("Radius; in 2D half of the width.", true));
      make("b", [&] {
        return type_ == "capsule" ? Shape<Dim>::capsule(a, b, radius) : Shape<Dim>::cylinder(a, b, radius);
      });
    });
    variant({"plane"}, [&] {
      p_.template vector<Dim>("point", a, length("Any point of the plane."));
      p_.template vector<Dim>("normal", b, {.required = true, .doc = "Points out of the solid; any length."});
      make("normal", [&] { return Shape<Dim>::plane(a, b); });
    });
    variant({"ellipsoid"}, [&] {
      p_.template vector<Dim>("center", a, length("Centre."));
      p_.template vector<Dim>("radii", b, length("Semi-axes.", true));
      make("radii", [&] { return Shape<Dim>::ellipsoid(a, b); });
    });
  }

  void read_mesh() requires(Dim == 3) {
    std::string file;
    Real scale = 1;
    p_.text("file", file, {.required = true, .doc = "STL or OBJ, relative to the scene's folder."});
    p_.real("scale", scale,
            {.min = 0, .min_exclusive = true, .doc = "Length of one unit of the file in metres."});
    if (!p_.describing() && !file.empty())
      make("file", [&] {
        return Shape<3>::mesh(
            std::make_shared<const TriangleMesh>(TriangleMesh::read(p_.resolve(file), scale)));
      });
  }

  void read_parts();

  void read_motion() {
    if (p_.has("rotate"))
      p_.section("rotate", "A rotation, before the translation.", [&](Parameters& q) {
        Real angle = 0;
        Vec<3> axis = Vec<3>::UnitZ();
        Vec<Dim> about = Vec<Dim>::Zero();
        q.real("angle", angle, {.unit = "rad", .required = true});
        if constexpr (Dim == 3)
          q.template vector<3>("axis", axis, {.required = true, .doc = "Of any length."});
        q.template vector<Dim>("about", about, {.unit = "m", .doc = "A point that stays."});
        const Mat<Dim> rotation = located(q, "axis", [&] { return rotation_matrix<Dim>(angle, axis); });
        if (shape_) shape_ = shape_.rotated(rotation, about);
      });
    Vec<Dim> by = Vec<Dim>::Zero();
    const bool moved = p_.template vector<Dim>("translate", by, {.unit = "m", .doc = "A shift, at last."});
    if (moved && shape_) shape_ = shape_.translated(by);
  }

  Parameters& p_;
  std::string type_;
  Shape<Dim> shape_;
};

template <int Dim>
void ShapeReader<Dim>::read_parts() {
  std::vector<Shape<Dim>> parts;
  p_.section_list(
      "of", {"The parts; a difference keeps the first without the others.", true, definition_name<Dim>()},
      [&](Parameters& q, int) { parts.push_back(ShapeReader<Dim>(q).read()); });
  if (p_.describing()) return;
  if (type_ == "union") shape_ = Shape<Dim>::union_of(std::move(parts));
  if (type_ == "intersection") shape_ = Shape<Dim>::intersection_of(std::move(parts));
  if (type_ == "difference") shape_ = Shape<Dim>::difference_of(std::move(parts));
}

}  // namespace

template <int Dim>
bool declare_shape(Parameters& p, std::string_view key, Shape<Dim>& shape, bool required, const char* doc) {
  if (!required && !p.has(key)) return false;
  return p.section(key, {doc, required, definition_name<Dim>()},
                   [&](Parameters& q) { shape = ShapeReader<Dim>(q).read(); });
}

template bool declare_shape<2>(Parameters&, std::string_view, Shape<2>&, bool, const char*);
template bool declare_shape<3>(Parameters&, std::string_view, Shape<3>&, bool, const char*);

}  // namespace mpm
