// Which arrays a frame has, and their values as rows of a file.
#pragma once

#include <string>
#include <vector>

#include "hdf5_ids.hpp"
#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/io/frames.hpp"

namespace mpm {

struct FrameColumn {
  std::string name;
  std::string units;
  FileType type = FileType::float32;
  int source_components = 1;
  int components = 1;                     // in the file
  bool identity = false;                  // a 2D tensor is that of plane strain: 1 out of the plane, not 0
  std::vector<FieldId> field;             // per body
  const DerivedField* derived = nullptr;  // instead of `field`
};

// In the order of the bodies' declarations, then the derived ones. Throws UserError for a name in
// options.fields that there isn't.
template <int Dim>
std::vector<FrameColumn> frame_columns(const std::vector<Body<Dim>>& bodies,
                                       const std::vector<DerivedField>& derived, const FrameOptions& options);

// Positions as a column with three components.
template <int Dim>
FrameColumn position_column(const std::vector<Body<Dim>>& bodies);

// Rows of the given particles, which lie in [begin, end), into `rows`.
template <int Dim>
void fill_frame_rows(const FrameColumn& column, const std::vector<Body<Dim>>& bodies, std::size_t body,
                     Index begin, Index end, const std::vector<Index>& particles, std::vector<char>& rows);

}  // namespace mpm
