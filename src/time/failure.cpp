#include "mpm_hpc/time/failure.hpp"

#include <cmath>
#include <limits>

#include "mpm_hpc/base/error.hpp"

namespace mpm {

template <int Dim>
void report_failed_particle(const State<Dim>& state) {
  std::string failure;
  Real smallest = std::numeric_limits<Real>::infinity();
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    for (const Body<Dim>& body : state.bodies) {
      const FieldSet& fields = body.particles;
      for (Index p = 0; p < fields.size(); ++p) {
        if (body.is_padding(p)) continue;
        Tensor<Real, Dim> F;
        bool finite = true;
        std::string place;
        for (int a = 0; a < Dim; ++a) {
          const Real x = fields.template data<Real>(core::position, a)[p];
          place += fmt::format("{}{:.6g}", a ? ", " : "", x);
          finite = finite && std::isfinite(x) && std::isfinite(fields.template data<T>(core::velocity, a)[p]);
          for (int b = 0; b < Dim; ++b) {
            F(a, b) = fields.template data<T>(core::deformation_gradient, a * Dim + b)[p];
            if (fields.has(core::velocity_gradient))
              finite = finite && std::isfinite(fields.template data<T>(core::velocity_gradient, a * Dim + b)[p]);
          }
        }
        const Real J = determinant(F);
        if (finite && J > smallest) continue;
        smallest = finite ? J : -std::numeric_limits<Real>::infinity();
        failure = fmt::format(
            "particle {} of body \"{}\" at ({}) m {} (det F = {:.4g}); try a smaller time.cfl, a "
            "finer grid.spacing, more particles_per_cell, or a softer load",
            fields.template data<GlobalIndex>(core::id)[p], body.name, place,
            !finite ? "has a value that is not a number" : J > 0 ? "is crushed" : "is inverted", J);
      }
    }
  });
  // The rank of the worst one speaks.
  if (smallest > state.communicator().min(smallest)) failure.clear();
  state.communicator().fail_together(failure);
  throw LogicError("a step failed without particles");
}

template void report_failed_particle<2>(const State<2>&);
template void report_failed_particle<3>(const State<3>&);

}  // namespace mpm
