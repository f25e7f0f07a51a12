// The loops over particles, written once for all laws: every loop handles a pack of particles at a time.
#pragma once

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/materials/material.hpp"
#include "mpm_hpc/materials/material_update.hpp"

namespace mpm {

template <class Law, int Dim>
class MaterialLoops final : public Material<Dim> {
  static_assert(MaterialLaw<Law, Dim>, "a material law lacks one of the functions of materials/material.hpp");

 public:
  MaterialLoops(typename Material<Dim>::Common common, const Law& law)
      : Material<Dim>(std::move(common)), law_(law) {}

  const char* model() const override { return Law::name; }
  bool splits_energy() const override { return SplitsEnergy<Law, Dim>; }
  bool has_tangent() const override { return HasTangent<Law, Dim>; }

  void stress(const double* const* F, const double* phase, Real residual, Index begin, Index end,
              double* const* tau) const override {
    stress_loop(F, phase, residual, begin, end, tau);
  }
  void stress(const float* const* F, const float* phase, Real residual, Index begin, Index end,
              float* const* tau) const override {
    stress_loop(F, phase, residual, begin, end, tau);
  }

  MaterialLimits advance(double* const* F, const double* const* gradient, Real dt, Index begin,
                         Index end) const override {
    return advance_loop(F, gradient, dt, begin, end);
  }
  MaterialLimits advance(float* const* F, const float* const* gradient, Real dt, Index begin,
                         Index end) const override {
    return advance_loop(F, gradient, dt, begin, end);
  }

  MaterialLimits limits(const double* const* F, Index begin, Index end) const override {
    return limits_loop(F, begin, end);
  }
  MaterialLimits limits(const float* const* F, Index begin, Index end) const override {
    return limits_loop(F, begin, end);
  }

  void energy_density(const double* const* F, const double* phase, Real residual, Index begin, Index end,
                      double* out) const override {
    energy_density_loop(F, phase, residual, begin, end, out);
  }
  void energy_density(const float* const* F, const float* phase, Real residual, Index begin, Index end,
                      float* out) const override {
    energy_density_loop(F, phase, residual, begin, end, out);
  }

  void energy_plus(const double* const* F, Index begin, Index end, double* out) const override {
    energy_plus_loop(F, begin, end, out);
  }
  void energy_plus(const float* const* F, Index begin, Index end, float* out) const override {
    energy_plus_loop(F, begin, end, out);
  }

 private:
  // Energies are differences of numbers near 1: a float keeps no digit of them below a strain of 3e-4, so
  // they are evaluated in double whatever the columns are.
  using EnergyPack = Pack<double>;

  template <class S, class T>
  static S degradation(const T* phase, Index particle, Real residual) {
    const S c = load<S>(phase + particle);
    return broadcast<S>(1 - residual) * c * c + broadcast<S>(residual);
  }

  template <class T>
  [[gnu::flatten]] void stress_loop(const T* const* F, const T* phase, Real residual, Index begin, Index end,
                                    T* const* tau) const {
    using S = Pack<T>;
    const Law law = law_;
    if (phase == nullptr) {
      for (Index p = begin; p < end; p += pack_width<T>)
        store_tensor(tau, p - begin, law.kirchhoff_stress(load_tensor<S, Dim>(F, p)));
    } else if constexpr (SplitsEnergy<Law, Dim>) {
      for (Index p = begin; p < end; p += pack_width<T>)
        store_tensor(
            tau, p - begin,
            law.kirchhoff_stress_degraded(load_tensor<S, Dim>(F, p), degradation<S>(phase, p, residual)));
    } else {
      refuse_to_split();
    }
  }

  // The limits of a run of particles, pack by pack.
  template <class T>
  struct LimitPacks {
    using S = Pack<T>;
    const S infinity = broadcast<S>(std::numeric_limits<T>::infinity());
    S stiffness = broadcast<S>(0.0), wave_modulus = stiffness, min_J = infinity;

    void include(const Law& law, const Tensor<S, Dim>& F) {
      const S J = determinant(F);
      // J - J is 0, or NaN for a J that is no finite number, which a maximum of packs may lose.
      const S k = law.stiffness_bound(F) + (J - J), w = law.wave_modulus(F) + (J - J);
      stiffness = maximum<S>(stiffness, select_less<S>(k, infinity, k, infinity));
      wave_modulus = maximum<S>(wave_modulus, select_less<S>(w, infinity, w, infinity));
      min_J = minimum<S>(min_J, select_less<S>(-infinity, J, J, -infinity));
    }
    MaterialLimits limits() const {
      MaterialLimits limits;
      for (int lane = 0; lane < pack_width<T>; ++lane)
        limits.include(
            {.stiffness = stiffness[lane], .wave_modulus = wave_modulus[lane], .min_jacobian = min_J[lane]});
      return limits;
    }
  };

  template <class T>
  [[gnu::flatten]] MaterialLimits advance_loop(T* const* F, const T* const* gradient, Real dt, Index begin,
                                               Index end) const {
    using S = Pack<T>;
    const Law law = law_;
    const S step = broadcast<S>(dt);
    LimitPacks<T> limits;
    for (Index p = begin; p < end; p += pack_width<T>) {
      const Tensor<S, Dim> old = load_tensor<S, Dim>(F, p);
      const Tensor<S, Dim> updated = old + step * multiply(load_tensor<S, Dim>(gradient, p - begin), old);
      store_tensor(F, p, updated);
      limits.include(law, updated);
    }
    return limits.limits();
  }

  template <class T>
  [[gnu::flatten]] MaterialLimits limits_loop(const T* const* F, Index begin, Index end) const {
    const Law law = law_;
    LimitPacks<T> limits;
    for (Index p = begin; p < end; p += pack_width<T>) limits.include(law, load_tensor<Pack<T>, Dim>(F, p));
    return limits.limits();
  }

  template <class T>
  [[gnu::flatten]] void energy_density_loop(const T* const* F, const T* phase, Real residual, Index begin,
                                            Index end, T* out) const {
    using S = EnergyPack;
    const Law law = law_;
    if (phase == nullptr) {
      for (Index p = begin; p < end; p += pack_width<double>)
        store(out + (p - begin), law.energy_density(load_tensor<S, Dim>(F, p)));
    } else if constexpr (SplitsEnergy<Law, Dim>) {
      for (Index p = begin; p < end; p += pack_width<double>)
        store(out + (p - begin),
              law.energy_degraded(load_tensor<S, Dim>(F, p), degradation<S>(phase, p, residual)));
    } else {
      refuse_to_split();
    }
  }

  template <class T>
  [[gnu::flatten]] void energy_plus_loop(const T* const* F, Index begin, Index end, T* out) const {
    if constexpr (SplitsEnergy<Law, Dim>) {
      const Law law = law_;
      for (Index p = begin; p < end; p += pack_width<double>)
        store(out + (p - begin), law.energy_plus(load_tensor<EnergyPack, Dim>(F, p)));
    } else {
      refuse_to_split();
    }
  }

  [[noreturn, gnu::noinline]] static void refuse_to_split() {
    throw LogicError(std::string("the material law ") + Law::name + " doesn't split its energy");
  }

  Law law_;
};

}  // namespace mpm
