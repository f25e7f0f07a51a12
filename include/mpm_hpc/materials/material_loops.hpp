// The loops over particles, written once for all laws: every loop handles a pack of particles at a time.
#pragma once

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/materials/fluid_model.hpp"
#include "mpm_hpc/materials/solid_model.hpp"
#include "mpm_hpc/materials/trial_response.hpp"

namespace mpm {

template <class Law, int Dim, class Rule = Elastic>
class MaterialLoops final : public Material<Dim> {
  static_assert(MaterialLaw<Law, Dim>, "a material law lacks one of the functions of materials/material.hpp");
  static constexpr bool splits = SplitsEnergy<Law, Dim>;
  static constexpr bool is_fluid = FluidLaw<Law>;

 public:
  template <class T>
  using Columns = MaterialColumns<Dim, T>;

  MaterialLoops(typename Material<Dim>::Common common, const Law& law, const Rule& rule = {})
      : Material<Dim>(std::move(common)), model_(make_model(law, rule)) {}

  const char* model() const override { return Law::name; }
  const char* plasticity() const override {
    if constexpr (std::is_same_v<Rule, Elastic>) {
      return nullptr;
    } else {
      return Rule::name;
    }
  }
  bool splits_energy() const override { return splits; }
  bool has_tangent() const override { return HasTangent<Law, Dim>; }
  bool needs_deformation_gradient() const override { return Model::has_deformation_gradient; }
  bool needs_velocity_gradient() const override { return model_.viscosity() > 0; }
  std::vector<OwnColumn> own_columns() const override { return model_.own_columns(); }
  std::vector<const char*> guards() const override { return model_.guards(); }

  void stress(const Columns<double>& c, Index begin, Index end, double* const* tau) const override {
    stress_loop(c, begin, end, tau);
  }
  void stress(const Columns<float>& c, Index begin, Index end, float* const* tau) const override {
    stress_loop(c, begin, end, tau);
  }
  MaterialUpdate advance(const Columns<double>& c, const double* const* gradient, const DeformationStep& step,
                         Index begin, Index end) const override {
    return advance_loop(c, gradient, step, begin, end);
  }
  MaterialUpdate advance(const Columns<float>& c, const float* const* gradient, const DeformationStep& step,
                         Index begin, Index end) const override {
    return advance_loop(c, gradient, step, begin, end);
  }
  TrialSums trial(const Columns<double>& c, const double* const* gradient, Real dt, Index begin, Index end,
                  const TrialColumns<Dim>& out) const override {
    if constexpr (HasTangent<Law, Dim>) {
      return trial_loop(c, gradient, dt, begin, end, out);
    } else {
      debug_check(false, "the law of this material has no tangent");
      return {};
    }
  }
  MaterialLimits limits(const Columns<double>& c, Index begin, Index end) const override {
    return limits_loop(c, begin, end);
  }
  MaterialLimits limits(const Columns<float>& c, Index begin, Index end) const override {
    return limits_loop(c, begin, end);
  }
  void energy_density(const Columns<double>& c, Index begin, Index end, double* out) const override {
    energy_density_loop(c, begin, end, out);
  }
  void energy_density(const Columns<float>& c, Index begin, Index end, float* out) const override {
    energy_density_loop(c, begin, end, out);
  }
  void energy_plus(const Columns<double>& c, Index begin, Index end, double* out) const override {
    energy_plus_loop(c, begin, end, out);
  }
  void energy_plus(const Columns<float>& c, Index begin, Index end, float* out) const override {
    energy_plus_loop(c, begin, end, out);
  }
  void jacobian(const Columns<double>& c, Index begin, Index end, double* out) const override {
    jacobian_loop(c, begin, end, out);
  }
  void jacobian(const Columns<float>& c, Index begin, Index end, float* out) const override {
    jacobian_loop(c, begin, end, out);
  }

 private:
  using Model = std::conditional_t<is_fluid, FluidModel<Law, Dim>, SolidModel<Law, Rule, Dim>>;
  // Energies are differences of numbers near 1: a float keeps no digit of them below a strain of 3e-4, so
  // they are evaluated in double whatever the columns are.
  using EnergyPack = Pack<double>;

  static Model make_model(const Law& law, [[maybe_unused]] const Rule& rule) {
    if constexpr (is_fluid) {
      return {law};
    } else {
      return {law, rule};
    }
  }

  template <class T>
  [[gnu::flatten]] void stress_loop(const Columns<T>& columns, Index begin, Index end, T* const* tau) const {
    using S = Pack<T>;
    const Model model = model_;
    const Columns<T> c = columns;
    if (c.phase == nullptr) {
      for (Index p = begin; p < end; p += pack_width<T>)
        store_tensor(tau, p - begin, model.stress(model.template load_point<S>(c, p)));
    } else if constexpr (splits) {
      for (Index p = begin; p < end; p += pack_width<T>)
        store_tensor(tau, p - begin,
                     model.stress_degraded(model.template load_point<S>(c, p), degradation<S>(c, p)));
    } else {
      refuse_to_split();
    }
  }

  // The limits of a run of particles, pack by pack.
  template <class S>
  struct LimitPacks {
    using Scalar = typename PackTraits<S>::Scalar;
    const S infinity = broadcast<S>(std::numeric_limits<Scalar>::infinity());
    S stiffness = broadcast<S>(0.0), wave_modulus = stiffness, max_J = stiffness, min_J = infinity;

    // columns and p: of the particles whose phase weakens the stress.
    template <class Point, class T>
    void include(const Model& model, const Point& point, const Columns<T>& columns, Index p) {
      if constexpr (splits)
        if (columns.phase != nullptr) {
          const S g = degradation<S>(columns, p);
          // g - g is 0, or NaN for a g that is no finite number, which a maximum of packs may lose.
          include(model, point, S(model.stiffness_bound_degraded(point, g) + (g - g)),
                  model.wave_modulus_degraded(point, g));
          return;
        }
      include(model, point, model.stiffness_bound(point), model.wave_modulus(point));
    }
    template <class Point>
    void include(const Model& model, const Point& point, const S& stiffness_bound, const S& modulus_bound) {
      const S J = model.jacobian(point);
      const S k = stiffness_bound + (J - J), w = modulus_bound + (J - J);  // likewise
      stiffness = maximum<S>(stiffness, select_less<S>(k, infinity, k, infinity));
      wave_modulus = maximum<S>(wave_modulus, select_less<S>(w, infinity, w, infinity));
      min_J = minimum<S>(min_J, select_less<S>(-infinity, J, J, -infinity));
      if constexpr (is_fluid) max_J = maximum<S>(max_J, select_less<S>(J, infinity, J, infinity));
    }
    // No NaN is left that a reduction could lose.
    MaterialLimits limits(Real viscosity) const {
      return {.stiffness = stiffness.maxCoeff(),
              .wave_modulus = wave_modulus.maxCoeff(),
              .min_jacobian = min_J.minCoeff(),
              .viscosity = viscosity > 0 ? viscosity * max_J.maxCoeff() : 0};
    }
  };

  // What the returns of a run of particles add up to, lane by lane.
  template <class S>
  struct Tally {
    S plastic_work = broadcast<S>(0.0);
    S guards[max_material_guards] = {plastic_work, plastic_work, plastic_work};
  };

  template <class T>
  [[gnu::flatten]] MaterialUpdate advance_loop(const Columns<T>& columns, const T* const* gradient,
                                               const DeformationStep& step, Index begin, Index end) const {
    using S = Pack<typename Model::template AdvanceScalar<T>>;
    const Model model = model_;
    const Columns<T> c = columns;
    LimitPacks<S> limits;
    Tally<S> tally;
    for (Index p = begin; p < end; p += PackTraits<S>::width)
      limits.include(model, model.template advance<S>(c, gradient, step, p, begin, tally), c, p);
    MaterialUpdate update{.limits = limits.limits(model.viscosity())};
    if constexpr (!std::is_same_v<Rule, Elastic>) {
      update.plastic_work = tally.plastic_work.sum();
      for (int k = 0; k < max_material_guards; ++k)
        update.guards[k] = static_cast<GlobalIndex>(tally.guards[k].sum());
    }
    return update;
  }

  // The law's part is made once for all rules, which are not asked for more than a factor.
  TrialSums trial_loop(const Columns<double>& c, const double* const* gradient, Real dt, Index begin, Index end,
                       const TrialColumns<Dim>& out) const {
    constexpr int most = 64;
    alignas(64) double weight[most];
    TrialSums sums;
    for (Index p = begin; p < end; p += most) {
      const Index last = std::min<Index>(p + most, end);
      for (Index q = p; q < last; q += pack_width<double>)
        store(weight + (q - p), model_.template energy_weight<Pack<double>>(c, q));
      sums.include(trial_run(model_.law, c, weight, gradient, dt, p, last, begin, out));
    }
    return sums;
  }

  template <class T>
  [[gnu::flatten]] MaterialLimits limits_loop(const Columns<T>& columns, Index begin, Index end) const {
    const Model model = model_;
    const Columns<T> c = columns;
    LimitPacks<Pack<T>> limits;
    for (Index p = begin; p < end; p += pack_width<T>)
      limits.include(model, model.template load_point<Pack<T>>(c, p), c, p);
    return limits.limits(model.viscosity());
  }

  template <class T>
  [[gnu::flatten]] void energy_density_loop(const Columns<T>& columns, Index begin, Index end, T* out) const {
    using S = EnergyPack;
    const Model model = model_;
    const Columns<T> c = columns;
    if (c.phase == nullptr) {
      for (Index p = begin; p < end; p += pack_width<double>)
        store(out + (p - begin), model.energy(model.template load_point<S>(c, p)));
    } else if constexpr (splits) {
      for (Index p = begin; p < end; p += pack_width<double>)
        store(out + (p - begin),
              model.energy_degraded(model.template load_point<S>(c, p), degradation<S>(c, p)));
    } else {
      refuse_to_split();
    }
  }

  template <class T>
  [[gnu::flatten]] void energy_plus_loop(const Columns<T>& columns, Index begin, Index end, T* out) const {
    if constexpr (splits) {
      const Model model = model_;
      const Columns<T> c = columns;
      for (Index p = begin; p < end; p += pack_width<double>)
        store(out + (p - begin), model.energy_plus(model.template load_point<EnergyPack>(c, p)));
    } else {
      refuse_to_split();
    }
  }

  template <class T>
  [[gnu::flatten]] void jacobian_loop(const Columns<T>& columns, Index begin, Index end, T* out) const {
    const Columns<T> c = columns;
    for (Index p = begin; p < end; p += pack_width<T>)
      store(out + (p - begin), model_.jacobian(model_.template load_point<Pack<T>>(c, p)));
  }

  [[noreturn, gnu::noinline]] static void refuse_to_split() {
    throw LogicError(std::string("the material law ") + Law::name + " doesn't split its energy");
  }

  Model model_;
};

}  // namespace mpm
