#include "mpm_hpc/time/failure.hpp"

#include <cmath>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

template <int Dim>
void report_failed_particle(const State<Dim>& state) {
  std::string failure;
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (const Body<Dim>& body : state.bodies) {
      const FieldSet& fields = body.particles;
      for (Index p = 0; p < fields.size() && failure.empty(); ++p) {
        if (body.is_padding(p)) continue;
        Mat<Dim> F;
        bool finite = true;
        std::string place;
        for (int a = 0; a < Dim; ++a) {
          const Real x = fields.template data<Real>(core::position, a)[p];
          place += fmt::format("{}{:.6g}", a ? ", " : "", x);
          finite = finite && std::isfinite(x) && std::isfinite(fields.template data<T>(core::velocity, a)[p]);
          for (int b = 0; b < Dim; ++b) {
            F(a, b) = fields.template data<T>(core::deformation_gradient, a * Dim + b)[p];
            finite = finite && std::isfinite(fields.template data<T>(core::velocity_gradient, a * Dim + b)[p]);
          }
        }
        Real J = F(0, 0) * F(1, 1) - F(0, 1) * F(1, 0);
        if constexpr (Dim == 3)
          J = F(0, 0) * (F(1, 1) * F(2, 2) - F(1, 2) * F(2, 1)) - F(0, 1) * (F(1, 0) * F(2, 2) - F(1, 2) * F(2, 0)) +
              F(0, 2) * (F(1, 0) * F(2, 1) - F(1, 1) * F(2, 0));
        if (finite && J > 0) continue;
        failure = fmt::format(
            "step {}, t = {:.6g} s: particle {} of body \"{}\" at ({}) m {} (det F = {:.4g}); try a smaller time.cfl, a "
            "finer grid.spacing, more particles_per_cell, or a softer load",
            state.step, state.time, fields.template data<GlobalIndex>(core::id)[p], body.name, place,
            finite ? "is inverted" : "has a value that is not a number", J);
      }
    }
  });
  state.communicator().fail_together(failure);
  throw NumericalFailure(fmt::format("step {}: the step limits are not finite, yet no particle is", state.step));
}

template void report_failed_particle<2>(const State<2>&);
template void report_failed_particle<3>(const State<3>&);

}  // namespace mpm
