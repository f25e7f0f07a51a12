// Drucker-Prager plasticity of granular solids in logarithmic strain, with cohesion and volume correction.
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/plasticity.hpp"

namespace mpm {

// With e = ln s, e' its deviator and the tip's tr e_c = c cot(phi) / kappa (Klar et al. 2016, section 7, for c = 0):
//   tr e > tr e_c: to the tip;  |e'| + a d kappa / (2 mu) (tr e - tr e_c) > 0: to the cone, along e'.
// In stresses the cone is |dev tau| = a d (p + c cot phi). Two cones meet Mohr-Coulomb's pyramid,
// tau_1 - tau_3 = (tau_1 + tau_3 + 2 c cot phi) sin phi with compression positive:
// - in plane strain: flow without dilation, which this return is, makes the middle stress the mean of the others, so that
//   p = (tau_1 + tau_3)/2, |dev tau| = (tau_1 - tau_3)/sqrt 2 and a = sqrt 2 sin phi / d. In 2D this holds at any stress;
// - in triaxial compression, as published: a = sqrt(2/3) 2 sin phi / (3 - sin phi), which in 2D is Mohr-Coulomb with
//   sin phi' = sqrt 2 a: 35.4 degrees for 37.
// The volume that expansion lost, v, is taken back from the next compression (Tampubolon et al. 2017): the trial is
// e + v/d, and v <- v + tr e - tr e_new.
template <int Dim>
struct DruckerPrager {
  static constexpr const char* name = "drucker_prager";
  static constexpr const char* doc = "friction cone with cohesion (sand)";
  template <class Law>
  static constexpr bool suits = LinearInLogarithmicStrain<Law, Dim>;
  static constexpr int own_count = 1;  // v

  Real friction_angle = 0;  // phi [rad]
  Real cohesion = 0;        // c [Pa]
  bool volume_correction = true;
  bool plane_strain = Dim == 2;  // where the cone meets Mohr-Coulomb's pyramid

  void declare(Parameters& parameters) {
    parameters.real("friction_angle", friction_angle,
                    {.unit = "rad",
                     .min = 0,
                     .min_exclusive = true,
                     .max = 1.5,
                     .required = true,
                     .doc = "friction angle, as \"30 deg\""});
    parameters.real("cohesion", cohesion, {.unit = "Pa", .min = 0, .doc = "shear strength without pressure"});
    std::string cone = plane_strain ? "plane_strain" : "triaxial_compression";
    parameters.choice(
        "cone", cone, {"plane_strain", "triaxial_compression"},
        "state of stress in which the cone is Mohr-Coulomb's with this friction angle; 2D scenes default to "
        "plane_strain");
    plane_strain = cone == "plane_strain";
    parameters.boolean("volume_correction", volume_correction,
                       {.doc = "take the volume that expansion lost back from the next compression"});
  }

  std::vector<OwnColumn> own_columns() const {
    if (volume_correction) return {{"lost_volume_strain", "1"}};
    return {};
  }
  std::vector<const char*> guards() const { return {}; }

  Real slope() const {
    const Real sine = std::sin(friction_angle);
    if (plane_strain) return std::sqrt(2.0) * sine / Dim;
    return std::sqrt(2.0 / 3) * 2 * sine / (3 - sine);
  }
  // tr e of the tip.
  template <class Law>
  Real tip(const Law& law) const {
    return cohesion / std::tan(friction_angle) / law.bulk_modulus();
  }

  template <class Law, class S>
  S return_stretches(const Law& law, S (&s)[Dim], S* own, S*) const {
    const S zero = broadcast<S>(0.0), one = broadcast<S>(1.0), tip_trace = broadcast<S>(tip(law));
    const S lost = volume_correction ? own[0] : zero;
    S e[Dim], trial = zero, squares = zero;
    for (int a = 0; a < Dim; ++a) {
      e[a] = log_of<S>(s[a]);
      trial += e[a];
    }
    const S trace = trial + lost, mean = broadcast<S>(1.0 / Dim) * trial;
    for (int a = 0; a < Dim; ++a) {
      e[a] -= mean;
      squares += e[a] * e[a];
    }
    const S length = sqrt_of<S>(squares), above = trace - tip_trace;
    const S allowed = broadcast<S>(-slope() * Dim * law.bulk_modulus() / (2 * law.mu)) * above;
    // Share of e' that is kept: nothing at the tip, all inside, the cone's otherwise.
    const S outside = select_less<S>(
        allowed, length, S(maximum<S>(allowed, zero) / select_less<S>(zero, length, length, one)), one);
    const S kept = select_less<S>(zero, above, zero, outside);
    const S new_trace = minimum<S>(trace, tip_trace);
    for (int a = 0; a < Dim; ++a) s[a] = exp_of<S>(broadcast<S>(1.0 / Dim) * new_trace + kept * e[a]);
    if (volume_correction) own[0] = trace - new_trace;
    return abs_of<S>(lost) + maximum<S>(above, zero) + (one - kept) * length;
  }
};

}  // namespace mpm
