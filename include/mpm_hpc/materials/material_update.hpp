// What the rest of the code sees of a material law: loops over particle columns behind one virtual call per
// block.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "mpm_hpc/base/types.hpp"
#include "mpm_hpc/math/tensor.hpp"

namespace mpm {

class Parameters;

// What the step-size rules need of a set of particles. A NaN counts as +infinity in the two maxima and as
// -infinity in the minimum, so that neither std::max nor a reduction over ranks can lose it. The maxima are
// never negative.
struct MaterialLimits {
  Real stiffness = 0;     // max over particles of a bound of lambda_max(d tau_a / d ln s_b) [Pa]
  Real wave_modulus = 0;  // max over particles of a bound of max_a d tau_a / d ln s_a [Pa]; c^2 = this / rho0
  Real min_jacobian = std::numeric_limits<Real>::infinity();  // min over particles of det F [-]

  void include(const MaterialLimits& other);
};

// One material of the scene. Columns are given by component: F[i * Dim + j] points at F_ij of particle 0,
// row-major, every pointer aligned to a cache line; begin and end are multiples of pack_width<T>, and padding
// particles hold finite values (F = I). Outputs start at particle `begin`: out[i - begin].
template <int Dim>
class Material {
 public:
  struct Common {
    std::string name;              // as in [material.NAME]
    Real density = 0;              // [kg/m^3], undeformed
    Real fracture_toughness = -1;  // [J/m^2], negative: can't fracture
    std::string where = {};        // place of `model` in the scene, for messages
  };

  explicit Material(Common common) : common_(std::move(common)) {}
  virtual ~Material() = default;
  Material(const Material&) = delete;
  Material& operator=(const Material&) = delete;

  const std::string& name() const { return common_.name; }
  Real density() const { return common_.density; }
  Real fracture_toughness() const { return common_.fracture_toughness; }
  const std::string& where() const { return common_.where; }
  bool can_fracture() const { return common_.fracture_toughness > 0; }

  virtual const char* model() const = 0;
  virtual bool splits_energy() const = 0;
  virtual bool has_tangent() const = 0;

  // Kirchhoff stress [Pa] into tau[SymTensor::index(i, j)][p - begin]. With a phase column (1 intact, 0
  // broken) the part that drives cracks is scaled by g = (1 - residual) c^2 + residual; phase == nullptr:
  // undamaged. Throws LogicError for a phase column and a law that doesn't split its energy.
  virtual void stress(const double* const* F, const double* phase, Real residual, Index begin, Index end,
                      double* const* tau) const = 0;
  virtual void stress(const float* const* F, const float* phase, Real residual, Index begin, Index end,
                      float* const* tau) const = 0;

  // Deforms the particles by one step, F <- (I + dt grad v) F with gradient[i * Dim + j][p - begin] = d v_i / d x_j [1/s],
  // and returns the limits of what they have become.
  virtual MaterialLimits advance(double* const* F, const double* const* gradient, Real dt, Index begin,
                                 Index end) const = 0;
  virtual MaterialLimits advance(float* const* F, const float* const* gradient, Real dt, Index begin,
                                 Index end) const = 0;

  virtual MaterialLimits limits(const double* const* F, Index begin, Index end) const = 0;
  virtual MaterialLimits limits(const float* const* F, Index begin, Index end) const = 0;

  // Energy per undeformed volume [J/m^3], degraded like the stress when a phase column is given.
  virtual void energy_density(const double* const* F, const double* phase, Real residual, Index begin,
                              Index end, double* out) const = 0;
  virtual void energy_density(const float* const* F, const float* phase, Real residual, Index begin,
                              Index end, float* out) const = 0;

  // Psi+, the undegraded part that drives cracks [J/m^3]; throws LogicError if the law doesn't split its
  // energy.
  virtual void energy_plus(const double* const* F, Index begin, Index end, double* out) const = 0;
  virtual void energy_plus(const float* const* F, Index begin, Index end, float* out) const = 0;

 private:
  Common common_;
};

// Reads `model`, `density`, optional `fracture_toughness` and the keys of that model from [material.NAME].
// Throws UserError for an unknown model; in describe mode it declares the keys of all models and returns
// nullptr.
template <int Dim>
std::unique_ptr<Material<Dim>> make_material(Parameters& parameters, const std::string& name);

// What an effect or an integrator can ask of a material.
enum class MaterialAbility { split_energy, tangent };

// Throws UserError naming the models that would do; wanted_by reads like "effect.phase_field".
template <int Dim>
void require_ability(const Material<Dim>& material, MaterialAbility ability, const std::string& wanted_by);

}  // namespace mpm
