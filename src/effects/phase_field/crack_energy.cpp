// The energy of the cracks, for history.csv.
#include "mpm_hpc/effects/phase_field/phase_field.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/transfer/scalar_transfer.hpp"

namespace mpm {

// Only the sums that project_phase needs, by the undeformed volume, over which the energy is summed.
template <int Dim>
template <class T>
class PhaseField<Dim>::PhaseOnly final : public ValueSource<T> {
 public:
  PhaseOnly(const FieldSet& f, const BodyPart& part)
      : volume_(f.template data<T>(core::volume)), phase_(f.template data<T>(part.phase)) {}
  void values(Index begin, Index end, T* const* q, T* conductivity, T* reaction) override {
    using System = PhaseSystem<Dim>;
    for (Index p = begin; p < end; ++p) {
      q[System::volume][p - begin] = volume_[p];
      q[System::phase][p - begin] = volume_[p] * phase_[p];
      q[System::drive][p - begin] = conductivity[p - begin] = reaction[p - begin] = 0;
    }
  }

 private:
  const T *volume_, *phase_;
};

namespace {

template <class T, int Dim>
struct CrackEnergy final : ValueSink<T> {
  const PhaseLaw& law;
  const T *volume, *phase;
  Real energy = 0;
  CrackEnergy(const PhaseLaw& l, const T* v, const T* c) : law(l), volume(v), phase(c) {}
  void values(Index begin, Index end, const T*, const T* const* gradient) override {
    energy += law.template energy<Dim>(end - begin, volume + begin, phase + begin, gradient);
  }
};

}  // namespace

// c of the particles to values().
template <int Dim>
void PhaseField<Dim>::sum_phase(State<Dim>& state) {
  const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
  GridFields& fields = state.fields;
  fields.zero(system_->values());
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (const BodyPart& part : parts_) {
      const Body<Dim>& body = state.bodies[part.body];
      PhaseOnly<T> source(body.particles, part);
      with_kernel(state.transfer.kernel, [&](auto kernel) {
        system_->with_values([&](auto count) {
          for (const auto* ranges : {&body.boundary, &body.interior})
            scatter_values<decltype(kernel), count>(grid, body, *ranges, source, fields.template data<T>(system_->values()),
                                                    fields.template data<T>(system_->diagonal()));
        });
      });
    }
  });
  state.halo().sum(fields, {system_->values()});
}

// sum_p V0_p G_c ((c - 1)^2 / 4 l0 + l0 |grad c|^2) of this rank. The gradient is that of the last solve, if this gave a value
// and somebody was known to look.
template <int Dim>
Real PhaseField<Dim>::crack_energy(State<Dim>& state) {
  std::vector<Real> unknown = {crack_energy_known_ ? 0.0 : 1.0};
  state.communicator().max(unknown);
  return unknown[0] > 0 ? projected_crack_energy(state) : crack_energy_;
}

// The same from c projected to the grid, which smooths it once more and so makes the energy a few per cent low.
template <int Dim>
Real PhaseField<Dim>::projected_crack_energy(State<Dim>& state) {
  sort_if_drifted(state);
  sum_phase(state);
  system_->project_phase(state);
  const ScalarGrid<Dim> grid{state.geometry(), state.topology()};
  return with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    Real energy = 0;
    for (const BodyPart& part : parts_) {
      const Body<Dim>& body = state.bodies[part.body];
      CrackEnergy<T, Dim> sink(part.law, body.particles.template data<T>(core::volume),
                               body.particles.template data<T>(part.phase));
      with_kernel(state.transfer.kernel, [&](auto kernel) {
        for (const auto* ranges : {&body.boundary, &body.interior})
          gather_scalar<decltype(kernel)>(grid, body, *ranges, state.fields.template data<T>(system_->result()), sink);
      });
      energy += sink.energy;
    }
    return energy;
  });
}

template void PhaseField<2>::sum_phase(State<2>&);
template void PhaseField<3>::sum_phase(State<3>&);
template Real PhaseField<2>::crack_energy(State<2>&);
template Real PhaseField<3>::crack_energy(State<3>&);

}  // namespace mpm
