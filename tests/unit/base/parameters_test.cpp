#include "mpm_hpc/base/parameters.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "mpm_hpc/base/error.hpp"
#include "support/temporary_folder.hpp"

namespace mpm {
namespace {

// A small program's worth of declarations, as components write them.
struct Material {
  std::string name, model = "neo_hookean";
  Real density = 0, youngs_modulus = 1e9, poisson_ratio = 0.3, friction_angle = 0, toughness = 0;
};
struct Body {
  std::string material;
  Vec<2> velocity = Vec<2>::Zero();
  std::vector<Vec<2>> points;
};
struct Scene {
  int dimension = 2;
  Real spacing = 0, end = 1;
  std::optional<Real> dt;
  bool restart = false;
  std::string precision = "double";
  std::vector<Real> weights;
  std::vector<std::string> fields;
  std::vector<std::int64_t> ids;
  std::vector<Material> materials;
  std::vector<Body> bodies;

  void declare(Parameters& p) {
    p.integer("dimension", dimension, {.min = 2, .max = 3, .doc = "Number of space dimensions."});
    p.boolean("restart", restart);
    p.choice("precision", precision, {"single", "double"}, "Of columns.");
    p.vector("weights", weights, {.min = 0});
    p.text_list("fields", fields);
    p.integer_list("ids", ids, {.min = 0});
    p.section("grid", "Background grid.", [&](Parameters& q) {
      q.real("spacing", spacing,
             {.unit = "m", .min = 0, .min_exclusive = true, .required = true, .doc = "Node spacing."});
    });
    p.section("time", [&](Parameters& q) {
      q.real("end", end, {.unit = "s", .min = 0});
      q.optional_real("dt", dt, {.unit = "s", .min = 0, .min_exclusive = true});
      if (dt && *dt > end) q.error_at("dt", "dt is larger than time.end; lower it.");
    });
    p.named_sections("material", [&](Parameters& q, const std::string& name) {
      Material m;
      m.name = name;
      q.real("density", m.density, {.unit = "kg/m^3", .min = 0, .min_exclusive = true, .required = true});
      q.real("poisson_ratio", m.poisson_ratio,
             {.min = -1, .min_exclusive = true, .max = 0.5, .max_exclusive = true});
      q.real("youngs_modulus", m.youngs_modulus, {.unit = "Pa", .min = 0, .min_exclusive = true});
      q.choice("model", m.model, {"neo_hookean", "drucker_prager"});
      q.when("model", m.model, {"drucker_prager"}, [&] {
        q.real("friction_angle", m.friction_angle, {.unit = "rad", .min = 0, .required = true});
      });
      q.real("toughness", m.toughness, {.unit = "J/m^2", .min = 0, .min_exclusive = true});
      materials.push_back(m);
    });
    p.section_list("body", "one body", [&](Parameters& q, int) {
      Body b;
      q.text("material", b.material, {.required = true});
      q.vector<2>("velocity", b.velocity, {.unit = "m/s"});
      q.points<2>("points", b.points, {.unit = "m"});
      bodies.push_back(b);
    });
    p.finish();
  }
};

constexpr const char* good = R"(dimension = 2
restart = true
precision = "single"
weights = [1, 2.5, "50 %"]
fields = ["a", "b"]
ids = [3, 1]
[grid]
spacing = "0.25 mm"
[time]
end = "80 us"
[material.glass]
density = 2450
youngs_modulus = "32 GPa"
[material.sand]
model = "drucker_prager"
density = "1.6 g/cm^3"
friction_angle = "30 deg"
[[body]]
material = "glass"
velocity = [0, "-2 km/s"]
[[body]]
material = "sand"
points = [[0, 0], ["1 mm", 0], [0, "1 mm"]]
)";

Scene read(const std::string& text, const std::vector<std::string>& overrides = {}) {
  Scene scene;
  Parameters p = Parameters::read_text(text, "plate.toml", overrides);
  scene.declare(p);
  return scene;
}

std::string fault(const std::string& text, const std::vector<std::string>& overrides = {}) {
  try {
    read(text, overrides);
  } catch (const UserError& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "accepted";
}

// The good scene with one line replaced.
std::string with_line(int line, const std::string& replacement) {
  std::istringstream in(good);
  std::string out, row;
  for (int i = 1; std::getline(in, row); ++i) out += (i == line ? replacement : row) + "\n";
  return out;
}

TEST(Parameters, ReadsEveryTypeWithUnits) {
  const Scene s = read(good);
  EXPECT_EQ(s.dimension, 2);
  EXPECT_TRUE(s.restart);
  EXPECT_EQ(s.precision, "single");
  EXPECT_EQ(s.weights, (std::vector<Real>{1, 2.5, 0.5}));
  EXPECT_EQ(s.fields, (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(s.ids, (std::vector<std::int64_t>{3, 1}));
  EXPECT_DOUBLE_EQ(s.spacing, 0.25e-3);
  EXPECT_DOUBLE_EQ(s.end, 80e-6);
  EXPECT_FALSE(s.dt.has_value());
  ASSERT_EQ(s.materials.size(), 2u);
  EXPECT_EQ(s.materials[0].name, "glass");
  EXPECT_EQ(s.materials[0].density, 2450);  // an integer where a real is asked
  EXPECT_DOUBLE_EQ(s.materials[0].youngs_modulus, 32e9);
  EXPECT_EQ(s.materials[0].poisson_ratio, 0.3);  // default
  EXPECT_DOUBLE_EQ(s.materials[1].density, 1600);
  EXPECT_DOUBLE_EQ(s.materials[1].friction_angle, 3.14159265358979323846 / 6);
  ASSERT_EQ(s.bodies.size(), 2u);
  EXPECT_EQ(s.bodies[0].velocity, Vec<2>(0, -2000));
  ASSERT_EQ(s.bodies[1].points.size(), 3u);
  EXPECT_DOUBLE_EQ(s.bodies[1].points[2].y(), 1e-3);
}

TEST(Parameters, ErrorsNamePlaceAndRemedy) {
  // Out of range.
  EXPECT_EQ(
      fault(with_line(12, "density = -1")),
      "plate.toml:12:11: density = -1 is below the allowed range (> 0 kg/m^3); give a positive density.");
  EXPECT_EQ(fault(with_line(13, "poisson_ratio = 0.5")),
            "plate.toml:13:17: poisson_ratio = 0.5 is above the allowed range (> -1 and < 0.5); give a value "
            "below 0.5.");
  EXPECT_EQ(fault(with_line(1, "dimension = 4")),
            "plate.toml:1:13: dimension = 4 is above the allowed range (>= 2 and <= 3); give a value of at "
            "most 3.");
  // Unknown keys.
  EXPECT_EQ(fault(with_line(13, "tougness = 3")),
            "plate.toml:13:1: unknown key \"tougness\" in [material.glass]; did you mean \"toughness\"?");
  EXPECT_EQ(fault(with_line(10, "colour = 3")),
            "plate.toml:10:1: unknown key \"colour\" in [time]; the keys here are end, dt.");
  EXPECT_EQ(fault(with_line(2, "dimensoin = 3")),
            "plate.toml:2:1: unknown key \"dimensoin\" in the scene; did you mean \"dimension\"?");
  EXPECT_EQ(fault(with_line(13, "friction_angle = 0.3")),
            "plate.toml:13:1: unknown key \"friction_angle\" in [material.glass]; the keys here are density, "
            "poisson_ratio, youngs_modulus, model, toughness.");
  // Wrong types.
  EXPECT_EQ(fault(with_line(8, "spacing = true")),
            "plate.toml:8:11: spacing must be a number in m or a text such as \"1 m\", not true.");
  EXPECT_EQ(fault(with_line(1, "dimension = 2.5")),
            "plate.toml:1:13: dimension must be a whole number, not 2.5.");
  EXPECT_EQ(fault(with_line(2, "restart = 1")), "plate.toml:2:11: restart must be true or false, not 1.");
  EXPECT_EQ(fault(with_line(19, "material = 7")),
            "plate.toml:19:12: material must be a text in quotes, not 7.");
  EXPECT_EQ(fault(with_line(20, "velocity = [0, 1, 2]")),
            "plate.toml:20:12: velocity must be a list of 2 numbers, one per direction, not a list of 3.");
  EXPECT_EQ(
      fault(with_line(3, "precision = \"doubel\"")),
      "plate.toml:3:13: precision = \"doubel\" is no choice; did you mean \"double\"? If not, choose one of "
      "\"single\", \"double\".");
  EXPECT_EQ(fault("grid = 3"),
            "plate.toml:1:8: grid must be a table, written [grid] or grid = {...}, not 3.");
  EXPECT_NE(fault("grid.spacing = 1\n[body]\nmaterial = \"x\"")
                .find("plate.toml:2:1: body must be a list of tables, "
                      "written [[body]]"),
            std::string::npos);
  // Wrong unit, and inside of a list.
  EXPECT_EQ(fault(with_line(8, "spacing = \"0.25 ms\"")),
            "plate.toml:8:11: spacing: \"0.25 ms\" is in s, but m is expected.");
  EXPECT_EQ(fault(with_line(20, "velocity = [0, \"2 m\"]")),
            "plate.toml:20:16: velocity[1]: \"2 m\" is in m, but m/s is expected.");
  // Not finite.
  EXPECT_EQ(fault(with_line(12, "density = nan")),
            "plate.toml:12:11: density = nan is not finite; give an ordinary number.");
  EXPECT_EQ(fault(with_line(20, "velocity = [0, inf]")),
            "plate.toml:20:16: velocity[1] = inf is not finite; give an ordinary number.");
  // Missing.
  EXPECT_EQ(fault(with_line(12, "")),
            "plate.toml:11:1: [material.glass] lacks the required key \"density\"; add "
            "material.glass.density = ... "
            "there.");
  EXPECT_EQ(fault(with_line(17, "")),
            "plate.toml:14:1: [material.sand] lacks the required key \"friction_angle\"; add "
            "material.sand.friction_angle = ... there.");
  EXPECT_EQ(fault("dimension = 2"),
            "plate.toml:1:1: [grid] lacks the required key \"spacing\" (Node spacing.); add grid.spacing = "
            "... there.");
  // A misspelt key explains the missing one.
  EXPECT_EQ(fault(with_line(12, "densty = 2450")),
            "plate.toml:12:1: unknown key \"densty\" in [material.glass]; did you mean \"density\"?");
  // Syntax and duplicates, found by toml++.
  EXPECT_EQ(fault(with_line(12, "density = ")).rfind("plate.toml:12:", 0), 0u);
  EXPECT_EQ(fault(with_line(13, "density = 3")).rfind("plate.toml:13:", 0), 0u)
      << fault(with_line(13, "density = 3"));
  // Cross-checks of components.
  EXPECT_EQ(fault(with_line(10, "dt = 2")), "plate.toml:10:6: dt is larger than time.end; lower it.");
}

TEST(Parameters, TheFirstOfSeveralErrorsIsReported) {
  EXPECT_EQ(fault(with_line(12, "poisson_ratio = 3\ndensity = -1")).rfind("plate.toml:12:17", 0), 0u);
  EXPECT_EQ(fault(with_line(12, "toughnes = 3\ndensity = -1")).rfind("plate.toml:12:1:", 0), 0u);
  // The file comes before the overrides.
  EXPECT_EQ(
      fault(with_line(12, "density = -1"), {"material.glass.toughness=-1"}).rfind("plate.toml:12:11", 0), 0u);
  // An error found before a cross-check hides it: the check worked on a default.
  EXPECT_EQ(fault(with_line(10, "end = -1\ndt = 2")).rfind("plate.toml:10:7", 0), 0u);
}

TEST(Parameters, OverridesReachTablesAndLists) {
  const Scene s =
      read(good, {"grid.spacing=0.5 mm", "body.0.velocity=[1, \"2 m/s\"]", "time.dt=1e-7", "precision=double",
                  "material.glass.density = 2500", "weights.1=.5", "dimension=3"});
  EXPECT_DOUBLE_EQ(s.spacing, 0.5e-3);
  EXPECT_EQ(s.bodies[0].velocity, Vec<2>(1, 2));
  EXPECT_EQ(s.dt, 1e-7);
  EXPECT_EQ(s.precision, "double");
  EXPECT_EQ(s.materials[0].density, 2500);
  EXPECT_EQ(s.weights[1], 0.5);
  EXPECT_EQ(s.dimension, 3);

  const Scene added = read("grid.spacing = 1", {"material.x.density=1", "material.x.model=neo_hookean"});
  ASSERT_EQ(added.materials.size(), 1u);
  EXPECT_EQ(added.materials[0].density, 1);
}

TEST(Parameters, OverrideErrorsNameTheOverride) {
  EXPECT_EQ(
      fault(good, {"material.glass.density=-1"}),
      "--set material.glass.density: density = -1 is below the allowed range (> 0 kg/m^3); give a positive "
      "density.");
  EXPECT_EQ(fault(good, {"time.ende=1"}),
            "--set time.ende: unknown key \"ende\" in [time]; did you mean \"end\"?");
  EXPECT_EQ(
      fault(good, {"body.2.velocity=[1, 2]"}),
      "--set body.2.velocity: body has 2 entries, so there is no number 2; it takes an index from 0 to 1.");
  EXPECT_EQ(fault(good, {"body.first.velocity=[1, 2]"}),
            "--set body.first.velocity: body is a list, so 'first' can't follow it; it takes an index from 0 "
            "to 1.");
  EXPECT_EQ(fault(good, {"dimension.x=1"}),
            "--set dimension.x: dimension is an integer, so 'x' can't follow it.");
  EXPECT_EQ(fault(good, {"time.end"}),
            "--set time.end: an override has the form key.path=value, such as time.end=1e-3.");
  EXPECT_EQ(fault(good, {"body.0.velocity=[1, 2"}).rfind("--set body.0.velocity: the value can't be read", 0),
            0u);
  EXPECT_EQ(fault(good, {"grid.spacing=fine"}),
            "--set grid.spacing: spacing: \"fine\" is no number with a unit, such as \"32 GPa\".");
}

TEST(Parameters, FilesAreLocatedAndKept) {
  EXPECT_THROW(Parameters::read_file("no/such/scene.toml"), UserError);
  const test::TemporaryFolder folder;
  EXPECT_THROW(Parameters::read_file(folder.path()), UserError);
  const auto file = folder / "scene.toml";
  std::ofstream(file) << good;
  Scene scene;
  Parameters p = Parameters::read_file(file);
  scene.declare(p);
  EXPECT_EQ(p.scene_text(), good);
  EXPECT_EQ(p.resolve("bunny.stl"), folder / "bunny.stl");
  EXPECT_EQ(p.where("precision"), file.string() + ":3:13");
  EXPECT_TRUE(p.has("precision"));
  EXPECT_FALSE(p.has("seed"));
}

std::string described_json() {
  Scene scene;
  Parameters p = Parameters::describe();
  scene.declare(p);
  return p.describe_json_schema();
}

TEST(Parameters, DescribesItselfAsText) {
  Scene scene;
  Parameters p = Parameters::describe();
  scene.declare(p);
  const std::string text = p.describe_text();
  for (const char* part :
       {"[grid]  Background grid.", "number [m], > 0 m, required", "Node spacing.", "[material.NAME]",
        "[[body]]  one body", "list of 2 numbers [m/s], default [0, 0]",
        "one of \"single\", \"double\", default \"double\"", "with model = \"drucker_prager\""})
    EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
}

TEST(Parameters, DescribesItselfAsJsonSchema) {
  const test::TemporaryFolder folder;
  const auto file = folder / "schema.json";
  std::ofstream(file) << described_json();
  EXPECT_EQ(std::system(("python3 -m json.tool " + file.string() + " > /dev/null").c_str()), 0)
      << described_json();
}

// A recursive form is described once and referred to.
void declare_tree(Parameters& p, int& nodes) {
  ++nodes;
  Real size = 1;
  p.real("size", size, {.unit = "m"});
  p.section_list("of", {"children", false, "tree"}, [&](Parameters& q, int) { declare_tree(q, nodes); });
}

TEST(Parameters, RecursiveFormsAreDefinitions) {
  int nodes = 0;
  Parameters p = Parameters::describe();
  p.section("tree", {"a tree", true, "tree"}, [&](Parameters& q) { declare_tree(q, nodes); });
  EXPECT_EQ(nodes, 1);
  const std::string schema = p.describe_json_schema();
  EXPECT_NE(schema.find("\"$ref\": \"#/$defs/tree\""), std::string::npos) << schema;

  nodes = 0;
  Parameters q = Parameters::read_text("tree = {size = 1, of = [{of = [{size = 2}]}, {size = 3}]}", "t.toml");
  q.section("tree", [&](Parameters& r) { declare_tree(r, nodes); });
  q.finish();
  EXPECT_EQ(nodes, 4);
  nodes = 0;
  Parameters bad =
      Parameters::read_text("tree = {size = 1, of = [{of = [{siz = 2}]}, {size = 3}]}", "t.toml");
  try {
    bad.section("tree", [&](Parameters& r) { declare_tree(r, nodes); });
    FAIL();
  } catch (const UserError& error) {
    EXPECT_STREQ(error.what(),
                 "t.toml:1:33: unknown key \"siz\" in [tree.of.0.of.0]; did you mean \"size\"?");
  }
}

}  // namespace
}  // namespace mpm
