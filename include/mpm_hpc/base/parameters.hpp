// Self-describing typed reader of scenes: one declaration serves reading, the manual and the JSON schema.
#pragma once

#include <algorithm>
#include <concepts>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// What a number may be; `unit` is SI and empty for a pure number.
struct RealOptions {
  std::string unit = {};
  Real min = -std::numeric_limits<Real>::infinity();
  bool min_exclusive = false;
  Real max = std::numeric_limits<Real>::infinity();
  bool max_exclusive = false;
  bool required = false;
  std::string doc = {};
};

struct IntegerOptions {
  std::int64_t min = std::numeric_limits<std::int64_t>::min();
  std::int64_t max = std::numeric_limits<std::int64_t>::max();
  bool required = false;
  std::string doc = {};
};

struct TextOptions {
  bool required = false;
  std::string doc = {};
};

// A nested table; `definition` names a recursive type (a shape made of shapes), described once.
struct SectionOptions {
  SectionOptions(const char* text = "") : doc(text) {}
  SectionOptions(std::string text, bool must_be_given, std::string definition_name = {})
      : doc(std::move(text)), required(must_be_given), definition(std::move(definition_name)) {}

  std::string doc;
  bool required = false;
  std::string definition;
};

// A number in SI, or the text of a formula (math/formula.hpp), with its place in the scene.
struct FormulaText {
  Real number = 0;
  std::string text = {};  // empty for a number
  std::string where = {};
};

// A table of the scene while it is read, or the collector of its description. A component writes
//   void declare(Parameters& p) { p.real("density", density, {.unit = "kg/m^3", .min = 0, .doc = "..."}); }
// where the variable's value is the default. Every reader returns whether the scene gives the key. Faults
// throw UserError with file:line:column; a table's errors are thrown when its section ends, the first in file
// order.
class Parameters {
 public:
  using Section = std::function<void(Parameters&)>;
  using IndexedSection = std::function<void(Parameters&, int index)>;
  using NamedSection = std::function<void(Parameters&, const std::string& name)>;

  // `overrides` are "key.path=value" as given to --set; arrays take an index: body.0.velocity=[1, 0].
  static Parameters read_file(const std::filesystem::path& file,
                              const std::vector<std::string>& overrides = {});
  static Parameters read_text(std::string text, std::string file_name,
                              const std::vector<std::string>& overrides = {});
  // Runs declarations against no data and collects their description.
  static Parameters describe();

  Parameters(Parameters&&) noexcept;
  Parameters& operator=(Parameters&&) noexcept;
  ~Parameters();

  // Numbers in SI, or strings with a unit: "32 GPa", "20 deg", "80 us".
  bool real(std::string_view key, Real& value, const RealOptions& options = {});
  bool optional_real(std::string_view key, std::optional<Real>& value, const RealOptions& options = {});

  template <std::integral I>
  requires(!std::same_as<I, bool>) bool integer(std::string_view key, I& value, IntegerOptions options = {}) {
    options.min = std::max<std::int64_t>(options.min, clamp_low<I>());
    options.max = std::min<std::int64_t>(options.max, clamp_high<I>());
    std::int64_t wide = static_cast<std::int64_t>(value);
    const bool given = read_integer(key, wide, options, true);
    value = static_cast<I>(wide);
    return given;
  }
  bool optional_integer(std::string_view key, std::optional<std::int64_t>& value,
                        const IntegerOptions& options = {});

  bool boolean(std::string_view key, bool& value, const TextOptions& options = {});
  bool text(std::string_view key, std::string& value, const TextOptions& options = {});
  bool optional_text(std::string_view key, std::optional<std::string>& value,
                     const TextOptions& options = {});
  // One of several names; a wrong one is thrown at once, since what follows depends on it.
  bool choice(std::string_view key, std::string& value, const std::vector<std::string>& choices,
              const TextOptions& options = {});
  bool choice(std::string_view key, std::string& value, const std::vector<std::string>& choices,
              const char* doc) {
    return choice(key, value, choices, TextOptions{.doc = doc});
  }

  // Arrays of numbers or unit strings; the range holds for each component.
  template <int Dim>
  bool vector(std::string_view key, Vec<Dim>& value, const RealOptions& options = {}) {
    return read_fixed(key, value.data(), Dim, options, true);
  }
  template <int Dim>
  bool optional_vector(std::string_view key, std::optional<Vec<Dim>>& value,
                       const RealOptions& options = {}) {
    Vec<Dim> read = Vec<Dim>::Zero();
    const bool given = read_fixed(key, read.data(), Dim, options, false);
    if (given) value = read;
    return given;
  }
  bool vector(std::string_view key, std::vector<Real>& value, const RealOptions& options = {});
  // A list of points: [[0, 0], [1, 0], ...].
  template <int Dim>
  bool points(std::string_view key, std::vector<Vec<Dim>>& value, const RealOptions& options = {}) {
    std::vector<Real> flat;
    const bool given = read_points(key, flat, Dim, options);
    if (!given) return false;
    value.clear();
    for (std::size_t i = 0; i + Dim <= flat.size(); i += Dim)
      value.push_back(Eigen::Map<const Vec<Dim>>(flat.data() + i));
    return true;
  }
  bool text_list(std::string_view key, std::vector<std::string>& value, const TextOptions& options = {});
  bool integer_list(std::string_view key, std::vector<std::int64_t>& value,
                    const IntegerOptions& options = {});

  // As many components as `value` has, which are its defaults: numbers, texts with a unit, or formulas. With `row_length`
  // the components come in rows: [[0, 1], [2, "x"]].
  bool formulas(std::string_view key, std::vector<FormulaText>& value, const RealOptions& options = {}, int row_length = 0);
  // A table of numbers, of texts with any unit, and of formulas, by names that the scene chooses. Every table of the scene
  // finds them in definitions() afterwards.
  bool define_formulas(std::string_view key, const std::string& doc);
  const std::vector<std::pair<std::string, FormulaText>>& definitions() const;

  // [grid]: the callback runs also when the table is absent (all defaults); guard with has() if it must not.
  bool section(std::string_view key, const SectionOptions& options, const Section& callback);
  bool section(std::string_view key, const Section& callback) {
    return section(key, SectionOptions{}, callback);
  }
  // [[body]]: once for each table of the array; returns their number.
  int section_list(std::string_view key, const SectionOptions& options, const IndexedSection& callback);
  // [material.NAME]: once for each name in file order; returns their number.
  int named_sections(std::string_view key, const SectionOptions& options, const NamedSection& callback);
  int named_sections(std::string_view key, const NamedSection& callback) {
    return named_sections(key, SectionOptions{}, callback);
  }
  // Declarations that hold for one variant only, when("type", type, {"box"}, [&] {...}): run when `value` is
  // among `variants`, and always in describe mode, where their rows carry the condition.
  void when(std::string_view key, const std::string& value, const std::vector<std::string>& variants,
            const std::function<void()>& declarations);

  // Whether the scene gives the key; true in describe mode, so that optional parts are described.
  bool has(std::string_view key) const;
  bool describing() const;
  // Ends a table: unknown keys and pending errors are thrown. Sections do it themselves; the root's owner
  // calls it.
  void finish();

  // Throws a UserError located at that key (at the table, if the key is absent); nothing in describe mode.
  void error_at(std::string_view key, const std::string& message) const;
  // "plate.toml:12:11" of the value of a key; of the table if the key is absent or empty.
  std::string where(std::string_view key = {}) const;
  // "body.0.shape" of this table; empty for the root.
  std::string path() const;

  const std::string& scene_text() const;
  const std::string& file_name() const;
  // A path in the scene is relative to the scene's folder.
  std::filesystem::path resolve(const std::string& relative_path) const;

  // What was declared since describe().
  std::string describe_text() const;
  std::string describe_json_schema() const;  // draft 2020-12

 private:
  struct Impl;
  explicit Parameters(std::unique_ptr<Impl> impl);

  template <class I>
  static constexpr std::int64_t clamp_low() {
    return std::is_unsigned_v<I> ? 0 : static_cast<std::int64_t>(std::numeric_limits<I>::min());
  }
  template <class I>
  static constexpr std::int64_t clamp_high() {
    constexpr auto wide = std::numeric_limits<std::int64_t>::max();
    return static_cast<std::uint64_t>(std::numeric_limits<I>::max()) > static_cast<std::uint64_t>(wide)
               ? wide
               : static_cast<std::int64_t>(std::numeric_limits<I>::max());
  }
  bool read_integer(std::string_view key, std::int64_t& value, const IntegerOptions& options,
                    bool has_default);
  bool read_real(std::string_view key, Real& value, const RealOptions& options, bool has_default);
  bool read_fixed(std::string_view key, Real* value, int size, const RealOptions& options, bool has_default);
  bool read_points(std::string_view key, std::vector<Real>& flat, int size, const RealOptions& options);

  std::unique_ptr<Impl> impl_;
};

}  // namespace mpm
