#include "mpm_hpc/time/failure.hpp"

#include <cmath>
#include <limits>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/effects/material_columns.hpp"

namespace mpm {

template <int Dim>
void report_failed_particle(const State<Dim>& state) {
  std::string failure;
  Real smallest = std::numeric_limits<Real>::infinity();
  with_precision(state.precision, [&](auto zero) {
    using T = decltype(zero);
    constexpr int W = pack_width<T>;
    alignas(64) T jacobians[W];
    for (std::size_t b = 0; b < state.bodies.size(); ++b) {
      const Body<Dim>& body = state.bodies[b];
      const FieldSet& fields = body.particles;
      const MaterialColumns<Dim, T> columns = material_columns<T>(state, b);
      for (Index p = 0; p < fields.size(); ++p) {
        if (p % W == 0) state.material_of(b).jacobian(columns, p, p + W, jacobians);
        if (body.is_padding(p)) continue;
        bool finite = true;
        std::string place;
        for (int a = 0; a < Dim; ++a) {
          const Real x = fields.template data<Real>(core::position, a)[p];
          place += fmt::format("{}{:.6g}", a ? ", " : "", x);
          finite = finite && std::isfinite(x) && std::isfinite(fields.template data<T>(core::velocity, a)[p]);
          for (int c = a * Dim; c < (a + 1) * Dim; ++c)
            if (columns.velocity_gradient[c]) finite = finite && std::isfinite(columns.velocity_gradient[c][p]);
        }
        const Real J = jacobians[p % W];
        finite = finite && std::isfinite(J);
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
