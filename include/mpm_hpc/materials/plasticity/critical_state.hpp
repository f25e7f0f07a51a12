// The yield ellipse and the hardening that modified Cam-Clay and NACC share (physics.md section 4).
#pragma once

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/plasticity.hpp"

namespace mpm {

// y = q^2 (1 + 2 beta) + M^2 (p + beta p0) (p - p0), q^2 = (6 - d)/2 |dev tau|^2, p0 = kappa (1e-5 + sinh(xi max(-alpha, 0)))
// with alpha, the logarithm of the plastic volume ratio: compaction makes alpha smaller and p0 larger.
template <int Dim>
struct CriticalState {
  static constexpr Real least_pressure = 1e-5;  // p0 over kappa of what has lost all hardening
  static constexpr Real most_hardening = 30;    // xi |alpha|, p0 = 5e12 kappa
  static constexpr Real tolerance = 1e-9;       // of y / (M p0)^2, below which y counts as 0
  static constexpr Real deviator_factor = (6.0 - Dim) / 2;

  Real slope = 0;      // M
  Real cohesion = 0;   // beta
  Real hardening = 3;  // xi
  Real initial_alpha = 0;
  bool hardens = true;

  void declare(Parameters& parameters) {
    Real friction_angle = 0, plastic_volume = 0.99;
    parameters.real("friction_angle", friction_angle,
                    {.unit = "rad",
                     .min = 0,
                     .min_exclusive = true,
                     .max = 1.5,
                     .required = true,
                     .doc = "friction angle that sets the slope of the critical state line, as \"45 deg\""});
    parameters.real("cohesion", cohesion, {.min = 0, .doc = "beta: tensile over compressive strength p0"});
    parameters.real("hardening", hardening,
                    {.min = 0, .min_exclusive = true, .doc = "xi of p0 = kappa sinh(-xi alpha)"});
    parameters.real("initial_plastic_volume", plastic_volume,
                    {.min = 0,
                     .min_exclusive = true,
                     .doc = "exp(alpha) at the start; below 1: compacted, which gives strength"});
    parameters.boolean("hardens", hardens, {.doc = "whether alpha follows the plastic change of volume"});
    slope = critical_slope(friction_angle);
    initial_alpha = std::log(plastic_volume);
    if (hardening * -initial_alpha > most_hardening)
      parameters.error_at("initial_plastic_volume",
                          fmt::format("hardening times -ln(initial_plastic_volume) is {:.3g}, but p0 = kappa "
                                      "sinh(...) is defined up to {}; "
                                      "raise initial_plastic_volume or lower hardening.",
                                      hardening * -initial_alpha, most_hardening));
  }

  // M = sqrt(2/3) 2 sin f / (3 - sin f) d / sqrt(2 / (6 - d))
  static Real critical_slope(Real friction_angle) {
    const Real sine = std::sin(friction_angle);
    return std::sqrt(2.0 / 3) * 2 * sine / (3 - sine) * Dim / std::sqrt(2.0 / (6 - Dim));
  }

  std::vector<OwnColumn> own_columns() const {
    if (hardens) return {{"log_plastic_volume", "1", initial_alpha}};
    return {};
  }

  template <class S>
  S alpha(const S* own) const {
    return hardens ? own[0] : broadcast<S>(initial_alpha);
  }
  // p0 over kappa. Beyond most_hardening it would overflow; `capped` is 1 where it is held there.
  template <class S>
  S hardening_pressure(const S& alpha, S& capped) const {
    const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0), most = broadcast<S>(most_hardening);
    const S asked = broadcast<S>(hardening) * maximum<S>(-alpha, zero), x = minimum<S>(asked, most);
    capped = select_less<S>(most, asked, one, zero);
    const S grown = expm1_of<S>(x);
    return broadcast<S>(least_pressure) + broadcast<S>(0.5) * (grown + grown / (one + grown));
  }
  // y over (M p0)^2, for p, p0 and q in the same unit.
  template <class S>
  S yield_of(const S& p, const S& p0, const S& q2) const {
    return broadcast<S>((1 + 2 * cohesion) / (slope * slope)) * q2 / (p0 * p0) +
           (p / p0 + broadcast<S>(cohesion)) * (p / p0 - broadcast<S>(1.0));
  }
};

}  // namespace mpm
