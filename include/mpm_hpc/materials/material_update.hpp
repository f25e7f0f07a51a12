// What the rest of the code sees of a material law: loops over particle columns behind one virtual call per
// block.
#pragma once

#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "mpm_hpc/materials/deformation_update.hpp"
#include "mpm_hpc/materials/material_columns.hpp"
#include "mpm_hpc/materials/trial_columns.hpp"

namespace mpm {

class Parameters;

// What the step-size rules need of a set of particles. A NaN counts as +infinity in the maxima and as
// -infinity in the minimum, so that neither std::max nor a reduction over ranks can lose it. The maxima are
// never negative.
struct MaterialLimits {
  Real stiffness = 0;     // max over particles of a bound of lambda_max(d tau_a / d ln s_b) [Pa]
  Real wave_modulus = 0;  // max over particles of a bound of max_a d tau_a / d ln s_a [Pa]; c^2 = this / rho0
  Real min_jacobian = std::numeric_limits<Real>::infinity();  // min over particles of det F [-]
  Real viscosity = 0;     // max over particles of J times the shear viscosity [Pa s]
};

// A step, as a material knows it.
struct DeformationStep {
  Real dt = 0;  // [s]
  DeformationUpdate update = DeformationUpdate::first_order;
};

// What a step did to a run of particles.
struct MaterialUpdate {
  MaterialLimits limits;
  // Plastic work of the return mappings: V0 tau : (ln s_trial - ln s) with the returned stress tau and the stretches s before
  // and after, summed over the particles [J]. It is what the next step's stress would have done, so that a step's own excess
  // over the yield surface, which no force has seen, doesn't count.
  Real plastic_work = 0;
  GlobalIndex guards[max_material_guards] = {};  // how often each of Material::guards() acted
};

// One material of the scene. begin and end are multiples of pack_width<T>, and padding particles hold finite
// values of no volume. Outputs start at particle `begin`: out[i - begin].
template <int Dim>
class Material {
 public:
  struct Common {
    std::string name;              // as in [material.NAME]
    Real density = 0;              // [kg/m^3], undeformed
    Real fracture_toughness = -1;  // [J/m^2], negative: can't fracture
    std::string where = {};        // place of `model` in the scene, for messages
  };
  template <class T>
  using Columns = MaterialColumns<Dim, T>;

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
  virtual const char* plasticity() const = 0;  // name of the plasticity rule; null: none
  virtual bool splits_energy() const = 0;
  virtual bool has_tangent() const = 0;

  // What the body's FieldSet must hold for this material.
  virtual bool needs_deformation_gradient() const = 0;
  virtual bool needs_velocity_gradient() const = 0;  // for the stress, beyond the step
  virtual std::vector<OwnColumn> own_columns() const = 0;
  // Names of the guards, in the order of MaterialUpdate::guards.
  virtual std::vector<const char*> guards() const = 0;

  // Kirchhoff stress [Pa] into tau[SymTensor::index(i, j)][p - begin]. With a phase column the part that
  // drives cracks is scaled by g. Throws LogicError for a phase column and a law that doesn't split its
  // energy.
  virtual void stress(const Columns<double>& columns, Index begin, Index end, double* const* tau) const = 0;
  virtual void stress(const Columns<float>& columns, Index begin, Index end, float* const* tau) const = 0;

  // Deforms the particles by one step with gradient[i * Dim + j][p - begin] = d v_i / d x_j [1/s], returns
  // them to the yield surface, and measures what they have become.
  virtual MaterialUpdate advance(const Columns<double>& columns, const double* const* gradient,
                                 const DeformationStep& step, Index begin, Index end) const = 0;
  virtual MaterialUpdate advance(const Columns<float>& columns, const float* const* gradient,
                                 const DeformationStep& step, Index begin, Index end) const = 0;

  // Energy, stress and tangent that a step with these gradients of velocity would give, F <- (I + dt grad v) F, of the elastic
  // law alone: a plasticity rule returns the particles in advance(). Throws LogicError without has_tangent().
  virtual TrialSums trial(const Columns<double>& columns, const double* const* gradient, Real dt, Index begin, Index end,
                          const TrialColumns<Dim>& out) const = 0;

  virtual MaterialLimits limits(const Columns<double>& columns, Index begin, Index end) const = 0;
  virtual MaterialLimits limits(const Columns<float>& columns, Index begin, Index end) const = 0;

  // Energy per undeformed volume [J/m^3], degraded like the stress when there is a phase column.
  virtual void energy_density(const Columns<double>& columns, Index begin, Index end, double* out) const = 0;
  virtual void energy_density(const Columns<float>& columns, Index begin, Index end, float* out) const = 0;

  // Psi+, the undegraded part that drives cracks [J/m^3]; throws LogicError if the law doesn't split its
  // energy.
  virtual void energy_plus(const Columns<double>& columns, Index begin, Index end, double* out) const = 0;
  virtual void energy_plus(const Columns<float>& columns, Index begin, Index end, float* out) const = 0;

  // J, the volume over V0.
  virtual void jacobian(const Columns<double>& columns, Index begin, Index end, double* out) const = 0;
  virtual void jacobian(const Columns<float>& columns, Index begin, Index end, float* out) const = 0;

 private:
  Common common_;
};

// Reads `model`, `density`, optional `fracture_toughness`, the keys of that model and the table `plasticity` from
// [material.NAME]. Throws UserError for an unknown model and for plasticity that doesn't suit it; in describe mode it declares the keys of all models and returns
// nullptr.
template <int Dim>
std::unique_ptr<Material<Dim>> make_material(Parameters& parameters, const std::string& name);
template <>
std::unique_ptr<Material<2>> make_material<2>(Parameters& parameters, const std::string& name);
template <>
std::unique_ptr<Material<3>> make_material<3>(Parameters& parameters, const std::string& name);

// What an effect or an integrator can ask of a material.
enum class MaterialAbility { split_energy, tangent };

// Throws UserError naming the models that would do; wanted_by reads like "effect.phase_field".
template <int Dim>
void require_ability(const Material<Dim>& material, MaterialAbility ability, const std::string& wanted_by);
template <>
void require_ability<2>(const Material<2>& material, MaterialAbility ability, const std::string& wanted_by);
template <>
void require_ability<3>(const Material<3>& material, MaterialAbility ability, const std::string& wanted_by);

}  // namespace mpm
