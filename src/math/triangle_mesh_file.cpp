#include <charconv>
#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>
#include <unordered_map>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/text.hpp"
#include "mpm_hpc/math/triangle_mesh.hpp"

namespace mpm {
namespace {

std::string content_of(const std::filesystem::path& file) {
  require(std::filesystem::is_regular_file(file), "the mesh {} doesn't exist or is no file; check the path.",
          file.string());
  std::ifstream stream(file, std::ios::binary);
  require(stream.good(), "the mesh {} can't be opened; check its permissions.", file.string());
  std::ostringstream text;
  text << stream.rdbuf();
  return std::move(text).str();
}

// Joins vertices with the same coordinates: an STL repeats them for each triangle.
class VertexWelder {
 public:
  explicit VertexWelder(TriangleSoup& soup) : soup_(soup) {}

  std::int32_t add(Vec<3> x) {
    x += Vec<3>::Zero();  // -0 becomes 0
    const auto [place, is_new] =
        numbers_.try_emplace({x[0], x[1], x[2]}, static_cast<std::int32_t>(numbers_.size()));
    if (is_new) soup_.vertices.push_back(x);
    return place->second;
  }

 private:
  struct Hash {
    std::size_t operator()(const std::array<Real, 3>& x) const {
      std::uint64_t h = 0;
      for (Real value : x) {
        std::uint64_t bits;
        std::memcpy(&bits, &value, sizeof bits);
        h = (h ^ bits) * 0x9e3779b97f4a7c15ULL;
        h ^= h >> 32;
      }
      return h;
    }
  };
  TriangleSoup& soup_;
  std::unordered_map<std::array<Real, 3>, std::int32_t, Hash> numbers_;
};

TriangleSoup read_binary_stl(const std::string& bytes, std::uint32_t count) {
  TriangleSoup soup;
  VertexWelder welder(soup);
  for (std::uint32_t t = 0; t < count; ++t) {
    Triangle triangle;
    for (std::size_t c = 0; c < 3; ++c) {
      float x[3];
      std::memcpy(x, bytes.data() + 84 + std::size_t{50} * t + 12 + 12 * c, sizeof x);
      triangle[c] = welder.add({x[0], x[1], x[2]});
    }
    soup.triangles.push_back(triangle);
  }
  return soup;
}

// The words of one line, and numbers from them with the line's place in the message.
class Line {
 public:
  Line(const std::string& file, int number, std::string_view text) : file_(file), number_(number) {
    std::size_t at = 0;
    while ((at = text.find_first_not_of(" \t\r", at)) != std::string_view::npos) {
      const std::size_t end = std::min(text.find_first_of(" \t\r", at), text.size());
      words_.push_back(text.substr(at, end - at));
      at = end;
    }
  }
  std::size_t size() const { return words_.size(); }
  std::string_view word(std::size_t i) const { return i < words_.size() ? words_[i] : std::string_view(); }
  Real number(std::size_t i) const {
    const std::string_view text = word(i);
    Real value = 0;
    const char* begin = text.data() + text.starts_with('+');
    const auto [end, error] = std::from_chars(begin, text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
      fail(fmt::format("'{}' is no number", text));
    return value;
  }
  Vec<3> point(std::size_t first) const { return {number(first), number(first + 1), number(first + 2)}; }
  [[noreturn]] void fail(const std::string& reason) const {
    throw UserError(fmt::format("{}:{}: {}; the mesh is damaged.", file_, number_, reason));
  }

 private:
  const std::string& file_;
  int number_;
  std::vector<std::string_view> words_;
};

template <class F>
void for_each_line(const std::string& text, const std::string& file, F&& f) {
  std::size_t start = 0;
  for (int number = 1; start < text.size(); ++number) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    f(Line(file, number, std::string_view(text).substr(start, end - start)));
    start = end + 1;
  }
}

TriangleSoup read_ascii_stl(const std::string& text, const std::string& file) {
  TriangleSoup soup;
  VertexWelder welder(soup);
  std::vector<std::int32_t> corners;
  for_each_line(text, file, [&](const Line& line) {
    if (line.word(0) == "vertex") corners.push_back(welder.add(line.point(1)));
    if (line.word(0) != "endloop") return;
    if (corners.size() != 3) line.fail(fmt::format("a facet has {} vertices instead of 3", corners.size()));
    soup.triangles.push_back({corners[0], corners[1], corners[2]});
    corners.clear();
  });
  return soup;
}

TriangleSoup read_obj(const std::string& text, const std::string& file) {
  TriangleSoup soup;
  for_each_line(text, file, [&](const Line& line) {
    if (line.word(0) == "v") soup.vertices.push_back(line.point(1));
    if (line.word(0) != "f") return;
    std::vector<std::int32_t> corners;
    for (std::size_t i = 1; i < line.size(); ++i) {
      const std::string_view word = line.word(i).substr(0, line.word(i).find('/'));  // vertex/texture/normal
      std::int64_t number = 0;
      const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
      const auto count = static_cast<std::int64_t>(soup.vertices.size());
      if (number < 0) number += count + 1;  // counted from the end
      if (error != std::errc() || end != word.data() + word.size() || number < 1 || number > count)
        line.fail(fmt::format("'{}' is no vertex number from 1 to {}", line.word(i), count));
      corners.push_back(static_cast<std::int32_t>(number - 1));
    }
    if (corners.size() < 3) line.fail("a face has fewer than 3 vertices");
    for (std::size_t i = 2; i < corners.size(); ++i)
      soup.triangles.push_back({corners[0], corners[i - 1], corners[i]});
  });
  return soup;
}

}  // namespace

TriangleSoup read_triangles(const std::filesystem::path& file) {
  const std::string ending = lower_case(file.extension().string());
  require(ending == ".stl" || ending == ".obj", "the mesh {} is neither .stl nor .obj; convert it.",
          file.string());
  const std::string content = content_of(file);
  TriangleSoup soup;
  if (ending == ".obj") {
    soup = read_obj(content, file.string());
  } else {
    // The text form begins with "solid", but so do some binary files: only the size tells.
    std::uint32_t count = 0;
    if (content.size() >= 84) std::memcpy(&count, content.data() + 80, sizeof count);
    const bool is_binary = content.size() >= 84 && content.size() == 84 + std::size_t{50} * count;
    require(is_binary || (content.starts_with("solid") && content.find("facet") != std::string::npos),
            "the mesh {} is no STL file, or cut short.", file.string());
    soup = is_binary ? read_binary_stl(content, count) : read_ascii_stl(content, file.string());
  }
  for (const Vec<3>& x : soup.vertices)
    require(x.allFinite(), "the mesh {} has a vertex that isn't finite; the mesh is damaged.", file.string());
  // Triangles without area between joined vertices carry no surface, and would count as a third neighbour.
  std::erase_if(soup.triangles,
                [](const Triangle& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
  require(!soup.triangles.empty(), "the mesh {} has no triangles.", file.string());
  return soup;
}

}  // namespace mpm
