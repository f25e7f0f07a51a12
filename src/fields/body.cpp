#include "mpm_hpc/fields/body.hpp"

namespace mpm {

template <int Dim>
Body<Dim>::Body(std::string body_name, int material_number, Precision precision, const BodyColumns& columns)
    : name(std::move(body_name)), material(material_number) {
  const ScalarType real = real_type(precision);
  particles.add({.name = "id", .units = "1", .type = ScalarType::int64, .in_output = true});
  particles.add({.name = "position", .units = "m", .components = Dim});
  particles.add({.name = "velocity", .units = "m/s", .type = real, .components = Dim, .in_output = true});
  particles.add({.name = "velocity_gradient",
                 .units = "1/s",
                 .type = real,
                 .components = columns.velocity_gradient ? Dim * Dim : 0});
  particles.add({.name = "deformation_gradient",
                 .units = "1",
                 .type = real,
                 .components = columns.deformation_gradient ? Dim * Dim : 0,
                 .identity = true});
  particles.add({.name = "mass", .units = "kg", .type = real});
  particles.add({.name = "volume", .units = "m^3", .type = real});
}

template <int Dim>
Index Body<Dim>::real_particles() const {
  const GlobalIndex* ids = particles.template data<GlobalIndex>(core::id);
  Index count = 0;
  for (Index p = 0; p < particles.size(); ++p) count += ids[p] >= 0;
  return count;
}

template struct Body<2>;
template struct Body<3>;

}  // namespace mpm
