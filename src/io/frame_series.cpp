#include "mpm_hpc/io/frame_series.hpp"

#include <nlohmann/json.hpp>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/io/text_file.hpp"

namespace mpm {

std::string frame_name(int number) { return fmt::format("frame_{:06d}.hdf", number); }

std::vector<FrameEntry> read_frame_series(const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / frame_series_name;
  if (!std::filesystem::exists(file)) return {};
  std::vector<FrameEntry> frames;
  try {
    const nlohmann::json index = nlohmann::json::parse(read_text_file(file));
    for (const auto& entry : index.at("files"))
      frames.push_back({entry.at("name").get<std::string>(), entry.at("time").get<Real>()});
  } catch (const nlohmann::json::exception&) {
    throw FileError(fmt::format("{} is damaged; remove it to start a new series of frames", file.string()));
  }
  return frames;
}

void write_frame_series(const std::filesystem::path& folder, const std::vector<FrameEntry>& frames) {
  // One line per frame, so that the file can be read and compared.
  std::string text = "{\n  \"file-series-version\": \"1.0\",\n  \"files\": [";
  for (std::size_t f = 0; f < frames.size(); ++f)
    text += fmt::format("{}\n    {{\"name\": {}, \"time\": {}}}", f == 0 ? "" : ",",
                        nlohmann::json(frames[f].name).dump(), nlohmann::json(frames[f].time).dump());
  replace_text_file(folder / frame_series_name, text + "\n  ]\n}\n");
}

void trim_frame_series(const std::filesystem::path& folder, Real time) {
  std::vector<FrameEntry> kept;
  bool trimmed = false;
  for (const FrameEntry& frame : read_frame_series(folder)) {
    if (frame.time <= time) {
      kept.push_back(frame);
      continue;
    }
    trimmed = true;
    std::error_code error;
    std::filesystem::remove(folder / frame.name, error);
    if (error)
      throw FileError(fmt::format("can't remove {}: {}", (folder / frame.name).string(), error.message()));
  }
  if (trimmed) write_frame_series(folder, kept);
}

}  // namespace mpm
