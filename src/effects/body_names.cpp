#include "mpm_hpc/effects/body_names.hpp"

#include <fmt/ranges.h>

#include <algorithm>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

template <int Dim>
std::vector<char> named_bodies(const State<Dim>& state, const std::vector<std::string>& names,
                               const std::string& where) {
  std::vector<std::string> known;
  for (const Body<Dim>& body : state.bodies) known.push_back(body.name);
  std::vector<char> chosen(known.size(), names.empty());
  for (const std::string& name : names) {
    const auto found = std::find(known.begin(), known.end(), name);
    require(found != known.end(), "{}: there is no body \"{}\"; the bodies are {}.", where, name,
            fmt::join(known, ", "));
    chosen[static_cast<std::size_t>(found - known.begin())] = true;
  }
  return chosen;
}

template std::vector<char> named_bodies<2>(const State<2>&, const std::vector<std::string>&,
                                           const std::string&);
template std::vector<char> named_bodies<3>(const State<3>&, const std::vector<std::string>&,
                                           const std::string&);

}  // namespace mpm
