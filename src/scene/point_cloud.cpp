#include "mpm_hpc/scene/point_cloud.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <set>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/text.hpp"
#include "mpm_hpc/base/units.hpp"

namespace mpm {
namespace {

enum class Quantities { position, velocity, volume, deformation_gradient };

struct Column {
  std::string name;
  Quantities quantity;
  int component;  // row-major for the tensor
  Real factor;    // to SI
};

template <int Dim>
std::vector<Column> known_columns() {
  const std::string axes = "xyz";
  std::vector<Column> columns;
  for (int a = 0; a < Dim; ++a) columns.push_back({{axes[a]}, Quantities::position, a, 1});
  for (int a = 0; a < Dim; ++a) columns.push_back({std::string("v") + axes[a], Quantities::velocity, a, 1});
  columns.push_back({"volume", Quantities::volume, 0, 1});
  for (int a = 0; a < Dim; ++a)
    for (int b = 0; b < Dim; ++b)
      columns.push_back(
          {std::string("F_") + axes[a] + axes[b], Quantities::deformation_gradient, Dim * a + b, 1});
  return columns;
}

std::string unit_of(Quantities quantity, int dim) {
  switch (quantity) {
    case Quantities::position:
      return "m";
    case Quantities::velocity:
      return "m/s";
    case Quantities::volume:
      return dim == 2 ? "m^2" : "m^3";
    case Quantities::deformation_gradient:
      return "";
  }
  return {};
}

template <int Dim>
class CloudReader {
 public:
  CloudReader(const std::filesystem::path& file, int part, int parts) : file_(file.string()) {
    read_header();
    std::string line;
    const std::streampos first_row = stream_.tellg();
    const int first_number = number_;
    while (next_line(line)) ++cloud_.total;
    require(cloud_.total > 0, "{}: the file has a header but no particles; add rows.", file_);
    stream_.clear();
    stream_.seekg(first_row);
    number_ = first_number;
    const GlobalIndex begin = share(part, parts), end = share(part + 1, parts);
    for (GlobalIndex row = 0; row < end && next_line(line); ++row)
      if (row >= begin) read_row(line);
  }
  PointCloud<Dim> take() { return std::move(cloud_); }

 private:
  template <class... A>
  void check(bool ok, fmt::format_string<A...> message, A&&... args) const {
    if (!ok)
      throw UserError(
          fmt::format("{}:{}: {}", file_, number_, fmt::format(message, std::forward<A>(args)...)));
  }
  GlobalIndex share(int part, int parts) const {
    return cloud_.total / parts * part + std::min<GlobalIndex>(part, cloud_.total % parts);
  }
  bool next_line(std::string& line) {
    while (std::getline(stream_, line)) {
      ++number_;
      line.resize(std::min(line.find('#'), line.size()));
      if (!trimmed(line).empty()) return true;
    }
    return false;
  }
  bool has(Quantities quantity) const {
    return std::any_of(columns_.begin(), columns_.end(),
                       [&](const Column& c) { return c.quantity == quantity; });
  }

  void read_header() {
    require(std::filesystem::is_regular_file(file_),
            "the point cloud {} doesn't exist or is no file; check the path.", file_);
    stream_.open(file_);
    require(stream_.good(), "the point cloud {} can't be opened; check its permissions.", file_);
    std::string line;
    require(next_line(line), "{}:1: the point cloud is empty; it needs a header such as x,y,z,volume.",
            file_);
    const std::vector<Column> known = known_columns<Dim>();
    std::vector<std::string> names;
    for (const Column& column : known) names.push_back(column.name);
    std::set<std::string> seen;
    for (const std::string& cell : split(line, ',')) {
      const std::size_t bracket = cell.find('[');
      const std::string name(trimmed(cell.substr(0, bracket)));
      const auto found = std::find(names.begin(), names.end(), name);
      const std::string near = nearest_word(name, names);
      check(found != names.end(), "unknown column \"{}\"; {}", name,
            near.empty() ? fmt::format("the columns of a {}D cloud are {}.", Dim, fmt::join(names, ", "))
                         : fmt::format("did you mean \"{}\"?", near));
      check(seen.insert(name).second, "the column \"{}\" appears twice; remove one.", name);
      Column column = known[static_cast<std::size_t>(found - names.begin())];
      if (bracket != std::string::npos) column.factor = unit_factor(column, cell.substr(bracket));
      columns_.push_back(column);
    }
    // Vectors and tensors come whole.
    for (const Column& column : known) {
      const bool is_needed = column.quantity == Quantities::position || has(column.quantity);
      check(!is_needed || seen.contains(column.name), "the column \"{}\" is missing; add it.", column.name);
    }
  }

  Real unit_factor(const Column& column, const std::string& bracket) const {
    const std::string_view text = trimmed(bracket);
    check(text.ends_with(']'), "the unit of column \"{}\" lacks its closing bracket.", column.name);
    const std::string expected = unit_of(column.quantity, Dim);
    try {
      const Unit unit = parse_unit(text.substr(1, text.size() - 2));
      check(unit.dimension == parse_unit(expected).dimension,
            "column \"{}\" is given in {}, but {} is expected.", column.name, text,
            expected.empty() ? "a pure number" : expected);
      return unit.factor;
    } catch (const UnitError& error) {
      check(false, "column \"{}\": {}.", column.name, error.what());
    }
    return 1;
  }

  void read_row(const std::string& line) {
    const std::vector<std::string> cells = split(line, ',');
    check(cells.size() == columns_.size(), "the row has {} values, but the header names {} columns.",
          cells.size(), columns_.size());
    Vec<Dim> position = Vec<Dim>::Zero(), velocity = Vec<Dim>::Zero();
    Mat<Dim> deformation = Mat<Dim>::Identity();
    Real volume = 0;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const Column& column = columns_[i];
      const std::string_view text = trimmed(cells[i]);
      const char* begin = text.data() + text.starts_with('+');
      Real value = 0;
      const auto [end, error] = std::from_chars(begin, text.data() + text.size(), value);
      check(error == std::errc() && end == text.data() + text.size() && std::isfinite(value),
            "\"{}\" in column \"{}\" is no finite number.", text, column.name);
      value *= column.factor;
      switch (column.quantity) {
        case Quantities::position:
          position[column.component] = value;
          break;
        case Quantities::velocity:
          velocity[column.component] = value;
          break;
        case Quantities::volume:
          volume = value;
          break;
        case Quantities::deformation_gradient:
          deformation(column.component / Dim, column.component % Dim) = value;
          break;
      }
    }
    cloud_.positions.push_back(position);
    if (has(Quantities::velocity)) cloud_.velocities.push_back(velocity);
    if (has(Quantities::volume)) {
      check(volume > 0, "the volume {} must be positive.", volume);
      cloud_.volumes.push_back(volume);
    }
    if (has(Quantities::deformation_gradient)) {
      check(deformation.determinant() > 0, "the determinant of F is {}, it must be positive.",
            deformation.determinant());
      cloud_.deformation_gradients.push_back(deformation);
    }
  }

  std::string file_;
  std::ifstream stream_;
  int number_ = 0;  // of the line read last
  std::vector<Column> columns_;
  PointCloud<Dim> cloud_;
};

}  // namespace

template <int Dim>
PointCloud<Dim> read_point_cloud_csv(const std::filesystem::path& file, int part, int parts) {
  return CloudReader<Dim>(file, part, parts).take();
}

template PointCloud<2> read_point_cloud_csv<2>(const std::filesystem::path&, int, int);
template PointCloud<3> read_point_cloud_csv<3>(const std::filesystem::path&, int, int);

}  // namespace mpm
