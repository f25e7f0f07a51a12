// Particles as frames for ParaView: one VTKHDF 1.0 file (unstructured grid of vertices) per frame, and their
// index.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/io/frame_series.hpp"
#include "mpm_hpc/parallel/communicator.hpp"

namespace mpm {

// A field that is computed for the frame, such as a stress.
struct DerivedField {
  std::string name;
  int components = 1;
  // Component c of particle p of bodies[body] into values[c * (end - begin) + p - begin]. begin and end are
  // multiples of the pack width; entries of padding are ignored, and what stays untouched is NaN.
  std::function<void(std::size_t body, Index begin, Index end, Real* values)> fill;
};

struct FrameOptions {
  std::vector<std::string> fields =
      {};  // names of columns and derived fields; empty: columns with in_output, all derived
  Precision precision = Precision::single_precision;  // of real columns; positions are always double
  int deflate = 0;                                    // 0: contiguous; 1 to 9: compressed, much slower
  std::string where = {};                             // place of `fields` in the scene, for messages
};

// All bodies of a frame are one grid with one partition per rank and an array "body" with the number of the
// body. Vectors get three components and tensors nine; a column that a body lacks is NaN (integers: -1)
// there. A series that the folder has already is continued, and a frame of the same time is replaced.
template <int Dim>
class FrameWriter {
 public:
  // Throws FileError on all ranks when there is a damaged index. Collective.
  FrameWriter(const Communicator& communicator, std::filesystem::path folder, FrameOptions options);

  // Throws UserError when options.fields names something that isn't there.
  static void check_fields(const FrameOptions& options, const std::vector<Body<Dim>>& bodies,
                           const std::vector<DerivedField>& derived);

  // Throws FileError on all ranks; the index and the other frames stay as they are then. Collective.
  void write(GlobalIndex step, Real time, const std::vector<Body<Dim>>& bodies,
             const std::vector<DerivedField>& derived = {});

  int count() const { return static_cast<int>(frames_.size()); }
  std::filesystem::path last() const { return folder_ / frames_.back().name; }  // the file written last

 private:
  std::string next_name() const;

  Communicator communicator_;
  std::filesystem::path folder_;
  FrameOptions options_;
  std::vector<FrameEntry> frames_;
};

}  // namespace mpm
