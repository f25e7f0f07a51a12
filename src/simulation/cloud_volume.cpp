#include "mpm_hpc/simulation/cloud_volume.hpp"

#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/transfer/reference_transfer.hpp"

namespace mpm {

template <int Dim>
void volumes_from_grid_density(State<Dim>& state, std::size_t body_number) {
  Body<Dim>& body = state.bodies[body_number];
  const GridGeometry<Dim>& geometry = state.geometry();
  const BlockTopology<Dim>& topology = state.topology();
  // Done once per run, so the plain stencil loop serves.
  const auto estimate = [&](auto zero, auto kernel) {
    using Kernel = decltype(kernel);
    using T = decltype(zero);
    state.fields.zero(state.nodes);
    T* nodes = state.fields.template data<T>(state.nodes);
    auto number_density = [&](const IntVec<Dim>& node) -> T& {
      IntVec<Dim> block;
      int in_block = 0;
      for (int a = 0; a < Dim; ++a) {
        block[a] = node[a] / block_side;
        in_block = block_side * in_block + node[a] % block_side;
      }
      const std::size_t slot =
          static_cast<std::size_t>(topology.find(block_key<Dim>(geometry.same_block(block))));
      return nodes[(slot * nodes_per_block<Dim> + in_block) * node_values];
    };
    auto for_real_particles = [&](auto&& f) {
      for (Index p = 0; p < body.particles.size(); ++p) {
        if (body.is_padding(p)) continue;
        Vec<Dim> x;
        for (int a = 0; a < Dim; ++a) x[a] = body.particles.template data<Real>(core::position, a)[p];
        f(p, x);
      }
    };
    for_real_particles([&](Index, const Vec<Dim>& x) {
      for_each_node<Kernel>(geometry, x, [&](const IntVec<Dim>& node, Real w, const Vec<Dim>&) {
        number_density(node) += static_cast<T>(w);
      });
    });
    state.halo().sum(state.fields, {state.nodes});
    state.halo().fill(state.fields, {state.nodes});
    const Real cell = std::pow(geometry.spacing(), Dim), density = state.material_of(body_number).density();
    for_real_particles([&](Index p, const Vec<Dim>& x) {
      Real around = 0;
      for_each_node<Kernel>(geometry, x, [&](const IntVec<Dim>& node, Real w, const Vec<Dim>&) {
        around += w * number_density(node);
      });
      body.particles.template data<T>(core::volume)[p] = static_cast<T>(cell / around);
      body.particles.template data<T>(core::mass)[p] = static_cast<T>(density * cell / around);
    });
  };
  with_precision(state.precision, [&](auto zero) {
    with_kernel(state.transfer.kernel, [&](auto kernel) { estimate(zero, kernel); });
  });
}

template void volumes_from_grid_density<2>(State<2>&, std::size_t);
template void volumes_from_grid_density<3>(State<3>&, std::size_t);

}  // namespace mpm
