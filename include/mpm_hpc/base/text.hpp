// Small helpers on strings for messages and readers.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace mpm {

std::string lower_case(std::string_view text);  // ASCII letters only
std::string_view trimmed(std::string_view text);
std::vector<std::string> split(std::string_view text, char separator);

// Damerau-Levenshtein distance: insertions, deletions, substitutions and swaps of neighbours.
int edit_distance(std::string_view a, std::string_view b);

// The candidate that `word` is most likely a slip of; empty if none is near enough.
std::string nearest_word(std::string_view word, const std::vector<std::string>& candidates);

}  // namespace mpm
