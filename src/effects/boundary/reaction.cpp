#include "mpm_hpc/effects/boundary/reaction.hpp"

#include "mpm_hpc/base/error.hpp"

namespace mpm {

std::string numbered_name(const Parameters& p, const std::string& kind) {
  const std::string path = p.path();
  return kind + "_" + path.substr(path.rfind('.') + 1);
}

std::string read_effect_name(Parameters& p, const std::string& kind) {
  std::optional<std::string> given;
  p.optional_text(
      "name", given,
      {.doc = "Unique; names the history's columns reaction_NAME_x, ... Default: " + kind + "_0, ..."});
  const std::string name = given.value_or(numbered_name(p, kind));
  const bool valid = !name.empty() && name.find_first_not_of(
                                          "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
                                          "0123456789_-") == std::string::npos;
  if (!valid) p.error_at("name", fmt::format("name \"{}\" must consist of letters, digits, _ and -.", name));
  return name;
}

template <int Dim>
Exchange<Dim> NodeImpulses<Dim>::take(const State<Dim>& state) {
  Exchange<Dim> sum;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    const T* nodes = state.fields.template data<T>(state.nodes);
    for (const auto& [node, impulse] : given_) {
      sum.impulse += impulse;
      for (int a = 0; a < Dim; ++a)
        sum.work += impulse[a] * nodes[node * node_values + static_cast<std::size_t>(a)];
    }
  });
  given_.clear();
  return sum;
}

template <int Dim>
void Reaction<Dim>::declare(State<Dim>& state) const {
  require(!state.ledger.entries().contains(impulse_entry(0)),
          "{}: another effect is already called \"{}\"; give each obstacle and grip a name of its own.",
          where_, name_);
  state.ledger["external_work"];
  for (int a = 0; a < Dim; ++a) state.ledger[impulse_entry(a)] = 0;
}

template <int Dim>
void Reaction<Dim>::join(StepHooks<Dim>& hooks) {
  hooks.after_grid.push_back([this](State<Dim>& state) { add(state, impulses_.take(state)); });
}

template <int Dim>
void Reaction<Dim>::add(State<Dim>& state, const Exchange<Dim>& exchange) {
  for (int a = 0; a < Dim; ++a) state.ledger[impulse_entry(a)] += exchange.impulse[a];
  state.ledger["external_work"] += exchange.work;
  span_ += state.dt;
}

template <int Dim>
void Reaction<Dim>::history(State<Dim>& state, std::vector<HistoryValue>& row) {
  for (int a = 0; a < Dim; ++a) {
    Real& impulse = state.ledger[impulse_entry(a)];
    row.push_back({"reaction_" + name_ + "_" + "xyz"[a], "N", span_ > 0 ? impulse / span_ : 0});
    impulse = 0;
  }
  span_ = 0;
}

template <int Dim>
void Reaction<Dim>::save(std::map<std::string, std::vector<Real>>& numbers) const {
  numbers[span_entry()] = {span_};
}

template <int Dim>
void Reaction<Dim>::restore(const std::map<std::string, std::vector<Real>>& numbers) {
  const auto found = numbers.find(span_entry());
  span_ = found == numbers.end() ? 0 : found->second.at(0);  // a run may go on with an obstacle that is new
}

template class NodeImpulses<2>;
template class NodeImpulses<3>;
template class Reaction<2>;
template class Reaction<3>;

}  // namespace mpm
