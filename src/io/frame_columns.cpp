#include "frame_columns.hpp"

#include <algorithm>
#include <limits>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/text.hpp"

namespace mpm {

namespace {

// Components in the file: VTK draws vectors of three and tensors of nine.
int padded_components(int components, int dim) {
  if (components == dim) return 3;
  if (components == dim * dim) return 9;
  return components;
}

int padded_component(int c, const FrameColumn& column, int dim) {
  return column.components == 9 && column.source_components == dim * dim ? 3 * (c / dim) + c % dim : c;
}

void check_names(const std::vector<FrameColumn>& columns, const FrameOptions& options) {
  std::vector<std::string> names;
  for (const FrameColumn& column : columns) names.push_back(column.name);
  for (const std::string& name : options.fields) {
    if (std::find(names.begin(), names.end(), name) != names.end()) continue;
    const std::string near = nearest_word(name, names);
    throw UserError(fmt::format("{}{}there is no field \"{}\" to write{}; the fields of this scene are {}.",
                                options.where, options.where.empty() ? "" : ": ", name,
                                near.empty() ? "" : fmt::format(" (did you mean \"{}\"?)", near),
                                fmt::join(names, ", ")));
  }
}

template <class Out, class In>
void scatter(const In* values, const std::vector<Index>& particles, int stride, Out* out) {
  for (std::size_t i = 0; i < particles.size(); ++i) out[i * stride] = static_cast<Out>(values[particles[i]]);
}

template <class Out>
void scatter_component(const FieldSet& set, FieldId field, int c, const std::vector<Index>& particles,
                       int stride, Out* out) {
  switch (set.traits(field).type) {
    case ScalarType::float32:
      return scatter(set.data<float>(field, c), particles, stride, out);
    case ScalarType::float64:
      return scatter(set.data<double>(field, c), particles, stride, out);
    case ScalarType::int64:
      return scatter(set.data<GlobalIndex>(field, c), particles, stride, out);
  }
}

template <class Out>
constexpr Out absent() {
  if constexpr (std::is_integral_v<Out>)
    return -1;
  else
    return std::numeric_limits<Out>::quiet_NaN();
}

template <int Dim, class Out>
void fill_rows(const FrameColumn& column, const std::vector<Body<Dim>>& bodies, std::size_t body, Index begin,
               Index end, const std::vector<Index>& particles, Out* rows) {
  const int stride = column.components;
  const bool present = column.derived || column.field[body] != no_field;
  std::fill(rows, rows + particles.size() * stride, present ? Out{0} : absent<Out>());
  if (!present) return;
  if (column.identity && stride == 9)
    for (std::size_t i = 0; i < particles.size(); ++i) rows[i * stride + 8] = 1;

  std::vector<Real> values;
  std::vector<Index> shifted;
  const Index count = end - begin;
  if (column.derived) {
    values.assign(static_cast<std::size_t>(count) * column.source_components,
                  std::numeric_limits<Real>::quiet_NaN());
    column.derived->fill(body, begin, end, values.data());
    shifted = particles;
    for (Index& p : shifted) p -= begin;
  }
  for (int c = 0; c < column.source_components; ++c) {
    Out* out = rows + padded_component(c, column, Dim);
    if (column.derived) {
      scatter(&values[static_cast<std::size_t>(c) * count], shifted, stride, out);
    } else {
      scatter_component(bodies[body].particles, column.field[body], c, particles, stride, out);
    }
  }
}

}  // namespace

template <int Dim>
std::vector<FrameColumn> frame_columns(const std::vector<Body<Dim>>& bodies,
                                       const std::vector<DerivedField>& derived,
                                       const FrameOptions& options) {
  const FileType real =
      options.precision == Precision::single_precision ? FileType::float32 : FileType::float64;
  std::vector<FrameColumn> columns;
  std::vector<bool> by_default;
  const auto find = [&](const std::string& name) {
    return std::find_if(columns.begin(), columns.end(), [&](const FrameColumn& c) { return c.name == name; });
  };
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const FieldSet& set = bodies[b].particles;
    for (FieldId f = 0; f < set.count(); ++f) {
      const FieldTraits& traits = set.traits(f);
      if (f == core::position || !set.has(f)) continue;
      auto column = find(traits.name);
      if (column == columns.end()) {
        columns.push_back({.name = traits.name,
                           .units = traits.units,
                           .type = traits.type == ScalarType::int64 ? FileType::int64 : real,
                           .source_components = traits.components,
                           .components = padded_components(traits.components, Dim),
                           .identity = traits.identity,
                           .field = std::vector<FieldId>(bodies.size(), no_field)});
        by_default.push_back(traits.in_output);
        column = columns.end() - 1;
      }
      debug_check(column->source_components == traits.components,
                  "bodies disagree about the shape of a column");
      column->field[b] = f;
    }
  }
  for (const DerivedField& field : derived) {
    debug_check(find(field.name) == columns.end(), "a derived field has the name of a column");
    columns.push_back({.name = field.name,
                       .units = "",
                       .type = real,
                       .source_components = field.components,
                       .components = padded_components(field.components, Dim),
                       .field = {},
                       .derived = &field});
    by_default.push_back(true);
  }
  check_names(columns, options);
  std::vector<FrameColumn> chosen;
  for (std::size_t c = 0; c < columns.size(); ++c) {
    const bool named =
        std::find(options.fields.begin(), options.fields.end(), columns[c].name) != options.fields.end();
    if (options.fields.empty() ? by_default[c] : named) chosen.push_back(std::move(columns[c]));
  }
  return chosen;
}

template <int Dim>
FrameColumn position_column(const std::vector<Body<Dim>>& bodies) {
  return {.name = "Points",
          .units = "m",
          .type = FileType::float64,
          .source_components = Dim,
          .components = 3,
          .field = std::vector<FieldId>(bodies.size(), core::position)};
}

template <int Dim>
void fill_frame_rows(const FrameColumn& column, const std::vector<Body<Dim>>& bodies, std::size_t body,
                     Index begin, Index end, const std::vector<Index>& particles, std::vector<char>& rows) {
  rows.resize(particles.size() * column.components * bytes_of(column.type));
  switch (column.type) {
    case FileType::int64:
      return fill_rows(column, bodies, body, begin, end, particles,
                       reinterpret_cast<GlobalIndex*>(rows.data()));
    case FileType::float64:
      return fill_rows(column, bodies, body, begin, end, particles, reinterpret_cast<double*>(rows.data()));
    default:
      return fill_rows(column, bodies, body, begin, end, particles, reinterpret_cast<float*>(rows.data()));
  }
}

#define MPM_INSTANTIATE(Dim)                                                                              \
  template std::vector<FrameColumn> frame_columns(const std::vector<Body<Dim>>&,                          \
                                                  const std::vector<DerivedField>&, const FrameOptions&); \
  template FrameColumn position_column(const std::vector<Body<Dim>>&);                                    \
  template void fill_frame_rows(const FrameColumn&, const std::vector<Body<Dim>>&, std::size_t, Index,    \
                                Index, const std::vector<Index>&, std::vector<char>&);
MPM_INSTANTIATE(2)
MPM_INSTANTIATE(3)
#undef MPM_INSTANTIATE

}  // namespace mpm
