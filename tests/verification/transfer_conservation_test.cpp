// The conservation laws and the fields that each scheme keeps (verification.md section 1), with the production kernels.
#include <gtest/gtest.h>

#include <map>

#include "mpm_hpc/transfer/transfer_kernels.hpp"
#include "support/serial_grid.hpp"
#include "support/verification.hpp"

using namespace mpm;
using namespace mpm::test;

namespace {

template <int Dim>
struct NoStress final : StressSource<Dim, double> {
  void kirchhoff_stress(Index begin, Index end, double* const* tau) const override {
    for (int c = 0; c < SymTensor<double, Dim>::size; ++c) std::fill_n(tau[c], end - begin, 0.0);
  }
};
template <int Dim>
struct NoSink final : UpdateSink<Dim, double> {
  void updated(Index, Index, const KinematicLimits&, const double* const*) override {}
};

// A cloud of particles and its grid, without time or stress: what transfers alone do.
template <int Dim>
class Cloud {
 public:
  Cloud(const TransferOptions& options, std::vector<ModalParticle<Dim>> particles)
      : options_(options),
        kernels_(transfer_kernels<Dim, double>(options)),
        body_(make_body<Dim, double>(particles, Precision::double_precision, options.scheme)),
        topology_(with_kernel(options.kernel,
                              [&](auto kernel) {
                                return order_and_activate(body_, geometry, Precision::double_precision,
                                                          kernel.shift);
                              })),
        nodes_(fields_.add({.name = "node", .units = "1", .components = 4, .halo_components = Dim + 1})),
        changes_(fields_.add({.name = "change", .units = "1", .components = 4, .halo_components = Dim})) {
    fields_.resize(static_cast<std::size_t>(topology_.size()) * nodes_per_block<Dim>);
  }

  void to_grid() {
    fields_.zero(nodes_);
    fields_.zero(changes_);
    kernels_.to_grid(grid(), body_, all_ranges(body_), NoStress<Dim>(), 0.0);
    for (std::size_t i = 0; i < fields_.nodes(); ++i) {
      double* node = fields_.data<double>(nodes_) + node_values * i;
      for (int a = 0; a < Dim; ++a) node[a] = node[Dim] > 0 ? node[a] / node[Dim] : 0;
    }
  }
  void to_particles() {
    NoSink<Dim> sink;
    kernels_.to_particles(grid(), body_, all_ranges(body_), 0.0, sink);
  }
  // f(position, velocity and mass) of each node, or of those with mass.
  template <class F>
  void for_nodes(bool all, F&& f) {
    for (Slot s = 0; s < topology_.size(); ++s)
      for (int n = 0; n < nodes_per_block<Dim>; ++n) {
        double* node = fields_.data<double>(nodes_) +
                       (static_cast<std::size_t>(s) * nodes_per_block<Dim> + n) * node_values;
        if (all || node[Dim] > 0)
          f(geometry.node_position(topology_.first_node(s) + node_in_block<Dim>(n)), node);
      }
  }
  std::vector<ModalParticle<Dim>> particles() const {
    std::vector<ModalParticle<Dim>> all;
    for (Index p = 0; p < body_.particles.size(); ++p)
      if (!body_.is_padding(p)) all.push_back(read_particle<Dim, double>(body_, p));
    return all;
  }
  Vec<Dim> momentum() const {
    Vec<Dim> sum = Vec<Dim>::Zero();
    for (const auto& p : particles()) sum += p.mass * p.v;
    return sum;
  }
  // L = sum x x m v + m (B^T : eps), B = C D with the kernel's D_p at the particle.
  Eigen::Vector3d angular_momentum() const {
    Eigen::Vector3d total = Eigen::Vector3d::Zero();
    for (const auto& p : particles()) {
      Eigen::Vector3d x = Eigen::Vector3d::Zero(), v = x;
      Eigen::Matrix3d B = Eigen::Matrix3d::Zero();
      x.head<Dim>() = p.x;
      v.head<Dim>() = p.v;
      if (options_.affine())
        for (int b = 0; b < Dim; ++b) {
          const Real D = with_kernel(options_.kernel, [&](auto kernel) {
            const Real xi = (p.x[b] - geometry.origin()[b]) * geometry.inverse_spacing();
            return static_cast<Real>(kernel.inertia(xi - std::floor(xi - kernel.shift)));
          });
          B.col(b).template head<Dim>() = p.C.col(b) * D * geometry.spacing() * geometry.spacing();
        }
      total +=
          p.mass * (x.cross(v) + Eigen::Vector3d(B(2, 1) - B(1, 2), B(0, 2) - B(2, 0), B(1, 0) - B(0, 1)));
    }
    return total;
  }

  const GridGeometry<Dim> geometry = unit_box();
  static GridGeometry<Dim> unit_box() { return {Vec<Dim>::Constant(-0.3), Vec<Dim>::Constant(0.9), 0.1}; }

 private:
  TransferGrid<Dim, double> grid() {
    return {geometry, topology_, fields_.data<double>(nodes_), fields_.data<double>(changes_), 1.0};
  }
  TransferOptions options_;
  TransferKernels<Dim, double> kernels_;
  Body<Dim> body_;
  BlockTopology<Dim> topology_;
  GridFields fields_;
  FieldId nodes_, changes_;
};

std::vector<TransferOptions> all_transfers() {
  std::vector<TransferOptions> all;
  for (const KernelKind kernel : {KernelKind::linear, KernelKind::quadratic, KernelKind::cubic})
    for (const Forces forces : {Forces::mls, Forces::classical})
      for (const Scheme scheme : {Scheme::pic, Scheme::rpic, Scheme::flip, Scheme::apic, Scheme::polypic}) {
        const TransferOptions options{kernel, scheme, forces};
        if (why_undefined(options).empty()) all.push_back(options);
      }
  return all;
}

// Particles in a rotation with some strain, on nodes, faces and between.
template <int Dim>
std::vector<ModalParticle<Dim>> moving(const Vec<Dim>& v, const Mat<Dim>& A, int count) {
  auto particles = random_particles(Cloud<Dim>::unit_box(), count, 11);
  for (auto& p : particles) {
    p.tau.setZero();
    p.C = A;
    p.v = v + A * p.x;
    for (auto& mode : p.modes) mode.setZero();
  }
  return particles;
}

// The worst number of each row, over kernels and forms of the forces.
class Worst {
 public:
  void add(const std::string& name, Real value, const Band& band) {
    const auto [row, fresh] = rows_.try_emplace(name, value, band);
    // The least counts where a loss must be seen.
    const bool least = std::isinf(band.upper);
    if (!fresh)
      row->second.first = least ? std::min(row->second.first, value) : std::max(row->second.first, value);
  }
  void verify(int dim) const {
    for (const auto& [name, row] : rows_)
      test::verify("1 transfers", fmt::format("{}, {}D", name, dim), row.first, row.second);
  }

 private:
  std::map<std::string, std::pair<Real, Band>> rows_;
};

template <int Dim>
void check_conservation() {
  Mat<Dim> A = Mat<Dim>::Zero();
  A(0, 1) = -1;
  A(1, 0) = 1;
  A(0, 0) = 0.2;
  Worst worst;
  for (const TransferOptions& options : all_transfers()) {
    // The linear kernel's D_p isn't isotropic, and the skew part of C alone isn't all of the angular momentum.
    const bool nearly = options.scheme == Scheme::rpic && options.kernel == KernelKind::linear;
    const bool keeps = options.affine() || options.increments();
    const int transfers = options.scheme == Scheme::apic ? 1000 : 50;
    Cloud<Dim> cloud(options, moving<Dim>(Vec<Dim>::Constant(0.3), A, 300));
    const Vec<Dim> momentum = cloud.momentum();
    const Eigen::Vector3d angular = cloud.angular_momentum();
    for (int n = 0; n < transfers; ++n) {
      cloud.to_grid();
      cloud.to_particles();
    }
    const std::string after =
        fmt::format("{}{} after {} transfers", nearly ? "linear " : "", options.scheme_name(), transfers);
    worst.add(after + ": drift of the momentum", (cloud.momentum() - momentum).norm() / momentum.norm(),
              at_most(1e-12));
    worst.add(after + ": drift of the angular momentum",
              (cloud.angular_momentum() - angular).norm() / angular.norm(),
              nearly  ? at_most(1e-3)
              : keeps ? at_most(1e-12)
                      : at_least(1e-2));
  }
  worst.verify(Dim);
}

TEST(TransferConservation, MomentumOfAllSchemesAndAngularMomentumOfAllButPic) {
  check_conservation<2>();
  check_conservation<3>();
}

// v = a + A x (+ products of coordinates, times B) with what the particles know of it: the grid takes it over, and gives it
// back.
template <int Dim>
void check_field(const std::string& field, const TransferOptions& options, const Mat<Dim>& A,
                 const Vec<Dim>& B, bool kept, Worst& worst) {
  const Vec<Dim> a = Vec<Dim>::Constant(0.2);
  const auto product = [](const Vec<Dim>& x) { return x.prod(); };
  auto particles = moving<Dim>(a, A, 500);
  const Real h = Cloud<Dim>::unit_box().spacing();
  for (auto& p : particles) {
    p.v += B * product(p.x);
    for (int b = 0; b < Dim; ++b) {
      Vec<Dim> others = p.x;
      others[b] = 1;
      p.C.col(b) += B * others.prod();
    }
    // d^k prod(x) / dx_a dx_b ... is the product of the coordinates that are left.
    for (int set = 0; set < 1 << Dim; ++set) {
      const int order = __builtin_popcount(static_cast<unsigned>(set));
      if (order < 2) continue;
      Vec<Dim> others = p.x;
      for (int b = 0; b < Dim; ++b)
        if (set >> b & 1) others[b] = 1;
      p.modes[set] = B * others.prod() * std::pow(h, order);
    }
  }
  Cloud<Dim> cloud(options, particles);
  cloud.to_grid();
  Real on_grid = 0, on_particles = 0;
  cloud.for_nodes(false, [&](const Vec<Dim>& x, const double* node) {
    const Vec<Dim> want = a + A * x + B * product(x);
    for (int c = 0; c < Dim; ++c) on_grid = std::max(on_grid, std::abs(node[c] - want[c]));
  });
  // All nodes: the linear kernel's gradient on a node takes neighbours whose weight is 0.
  cloud.for_nodes(true, [&](const Vec<Dim>& x, double* node) {
    const Vec<Dim> want = a + A * x + B * product(x);
    for (int c = 0; c < Dim; ++c) node[c] = want[c];
  });
  cloud.to_particles();
  for (const auto& p : cloud.particles()) {
    const Vec<Dim> want = a + A * p.x + B * product(p.x);
    on_particles = std::max(on_particles, (p.v - want).norm());
    Mat<Dim> C = A;
    for (int b = 0; b < Dim; ++b) {
      Vec<Dim> others = p.x;
      others[b] = 1;
      C.col(b) += B * others.prod();
    }
    if (options.affine()) on_particles = std::max(on_particles, h * (p.C - C).norm());
  }
  const std::string name = fmt::format("{}, {}: largest error", options.scheme_name(), field);
  worst.add(name + " on the grid", on_grid, kept ? at_most(1e-13) : at_least(1e-3));
  // B-splines are exact for the values and gradients of what is linear in each direction.
  if (!options.increments())
    worst.add(
        options.scheme_name() + ": largest error of values and gradients from a grid that is multilinear",
        on_particles, at_most(1e-13));
}

template <int Dim>
void check_fields() {
  Mat<Dim> strain = Mat<Dim>::Zero(), spin = strain;
  spin(0, 1) = -1.2;
  spin(1, 0) = 1.2;
  strain.diagonal().setLinSpaced(0.4, -0.7);
  strain(0, 1) = strain(1, 0) = 0.3;
  const Vec<Dim> none = Vec<Dim>::Zero(), some = Vec<Dim>::LinSpaced(0.8, -0.5);
  Worst worst;
  for (const TransferOptions& options : all_transfers()) {
    const bool poly = options.scheme == Scheme::polypic, affine = options.scheme == Scheme::apic || poly;
    check_field<Dim>("rotation", options, spin, none, options.affine(), worst);
    check_field<Dim>("affine field", options, strain + spin, none, affine, worst);
    check_field<Dim>("field with products", options, strain, some, poly, worst);
  }
  worst.verify(Dim);
}

// RPIC keeps rigid motion and loses strain, APIC keeps affine fields, PolyPIC products too; PIC and FLIP none of them.
TEST(TransferConservation, FieldsThatEachSchemeKeeps) {
  check_fields<2>();
  check_fields<3>();
}

}  // namespace
