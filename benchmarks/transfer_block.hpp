// The sorted particles that bench_transfer moves between particles and grid, on the program's kernels and on the plain ones.
#pragma once

#include "elastic_block.hpp"
#include "mpm_hpc/time/material_access.hpp"
#include "mpm_hpc/transfer/grid_to_particle.hpp"
#include "mpm_hpc/transfer/particle_to_grid.hpp"

namespace mpm {

// Costs next to nothing, but reads what a law reads: the law itself is for bench_materials.
template <int Dim, class T>
class StandInStress final : public StressSource<Dim, T> {
 public:
  explicit StandInStress(const FieldSet& fields) {
    for (int c = 0; c < Dim * Dim; ++c) F_[c] = fields.template data<T>(core::deformation_gradient, c);
  }
  void kirchhoff_stress(Index begin, Index end, T* const* tau) const override {
    using S = Pack<T>;
    for (Index p = begin; p < end; p += pack_width<T>) {
      const Tensor<S, Dim> F = load_tensor<S, Dim>(F_, p);
      SymTensor<S, Dim> stress;
      for (int i = 0; i < Dim; ++i)
        for (int j = i; j < Dim; ++j) stress(i, j) = broadcast<S>(youngs_modulus) * (F(i, j) + F(j, i));
      store_tensor(tau, p - begin, stress);
    }
  }

 private:
  const T* F_[Dim * Dim];
};

template <class Kernel, class Form, int Dim, class T>
class TransferBlock {
 public:
  // The plain twin of APIC with MLS forces is the leaner one.
  static constexpr bool usual = std::is_same_v<Form, ApicMls>;
  using Plain = std::conditional_t<usual, ReferenceParticle<Dim>, ModalParticle<Dim>>;
  static constexpr Precision precision =
      std::is_same_v<T, float> ? Precision::single_precision : Precision::double_precision;
  static constexpr Real dt =
      1e-9;  // [s] so short that thousands of transfers leave the particles where they are

  TransferBlock(const Communicator& communicator, int cells) {
    Parameters parameters = Parameters::read_text(
        scene_text<Dim>({.single = precision == Precision::single_precision, .cells = cells}),
        "transfer block", {});
    read_dimension(parameters);
    scene_ = read_scene<Dim>(parameters);
    declare_state(communicator, scene_, state_);
    DistributionOptions options = state_.distribution.options();
    options.kernel_shift = Kernel::shift;
    options.kernel_support = Kernel::support;
    state_.distribution = Distribution<Dim>(communicator, scene_.geometry(), options);
    create_particles(scene_, state_);
    shift(0.5);  // as far as they are on the average between two sorts
    for_particles(state_, [](const FieldSet& f, Index p) {
      for (int a = 0; a < Dim; ++a)
        for (int b = 0; b < Dim; ++b)
          f.template data<T>(core::velocity_gradient, Dim * a + b)[p] = static_cast<T>(gradient(a, b));
    });
    velocities_to_nodes();
    std::vector<ReferenceParticle<Dim>> plain = reference_particles(state_);
    for (ReferenceParticle<Dim>& p : plain) p.tau = youngs_modulus * (p.F + p.F.transpose());
    geometry_ = reference_geometry(state_, plain);
    particles_.resize(plain.size());
    for (std::size_t p = 0; p < plain.size(); ++p)
      static_cast<ReferenceParticle<Dim>&>(particles_[p]) = plain[p];
    grid_ = std::make_unique<ReferenceGrid<Dim>>(geometry_);
    for (std::size_t i = 0; i < grid_->momentum.size(); ++i) grid_->momentum[i] = Vec<Dim>::Constant(1.0);
  }

  void to_grid() {
    state_.fields.zero(state_.nodes);
    Body<Dim>& body = state_.bodies[0];
    const StandInStress<Dim, T> stress(body.particles);
    for (const auto* ranges : {&body.boundary, &body.interior})
      particle_to_grid<Kernel, Form>(transfer_grid(), body, *ranges, stress, dt);
  }
  void to_particles() {
    Body<Dim>& body = state_.bodies[0];
    for (const auto* ranges : {&body.boundary, &body.interior})
      grid_to_particle<Kernel, Form>(transfer_grid(), body, *ranges, dt, sink_);
  }
  // A step's G2P and the next one's P2G onto other nodes, with the law and its update: one after the other over all
  // particles, or over some ranges at a time, so that P2G finds the columns in the cache as if the two were one kernel.
  void to_particles_and_grid(std::size_t ranges_at_once) {
    next_nodes_.assign(
        static_cast<std::size_t>(state_.topology().size()) * nodes_per_block<Dim> * node_values +
            row_nodes * node_values,
        T(0));
    Body<Dim>& body = state_.bodies[0];
    TransferGrid<Dim, T> next = transfer_grid();
    next.nodes = next_nodes_.data();
    state_.dt = dt;
    const MaterialStress<Dim, T> stress(state_, 0);
    MaterialAdvance<Dim, T> advance(state_, 0);
    std::vector<int> part;
    for (const auto* ranges : {&body.boundary, &body.interior})
      for (std::size_t first = 0; first < ranges->size(); first += ranges_at_once) {
        const std::size_t last = std::min(ranges->size() - first, ranges_at_once) + first;
        part.assign(ranges->begin() + first, ranges->begin() + last);
        grid_to_particle<Kernel, Form>(transfer_grid(), body, part, dt, advance);
        if (ranges_at_once < body.ranges.size()) particle_to_grid<Kernel, Form>(next, body, part, stress, dt);
      }
    if (ranges_at_once >= body.ranges.size())
      for (const auto* ranges : {&body.boundary, &body.interior})
        particle_to_grid<Kernel, Form>(next, body, *ranges, stress, dt);
  }
  // Ranges with so many particles as stay in the second cache next to their nodes.
  std::size_t ranges_in_cache() const {
    constexpr std::size_t cache = std::size_t{1} << 19;
    const FieldSet& f = columns();
    const std::size_t all = static_cast<std::size_t>(f.size()) * f.bytes_per_particle();
    return std::max<std::size_t>(1, state_.bodies[0].ranges.size() * cache / all);
  }
  std::size_t all_ranges() const { return state_.bodies[0].ranges.size(); }

  // As between two sorts, there and back in turns.
  void drift_and_sort() {
    shift(direction_);
    direction_ = -direction_;
    sort_particles(state_, OrderWithinCell::stable);
  }

  void reference_to_grid() {
    grid_->clear();
    if constexpr (usual) {
      reference_particle_to_grid<Kernel>(geometry_, particles_, dt, *grid_);
    } else {
      reference_form_to_grid<Kernel, Form>(geometry_, particles_, dt, *grid_);
    }
  }
  void reference_to_particles() {
    if constexpr (usual) {
      reference_grid_to_particle<Kernel>(geometry_, *grid_, dt, particles_);
    } else {
      reference_form_to_particle<Kernel, Form>(geometry_, *grid_, dt, particles_);
    }
  }
  // The particles, moved like production's, by the number of their cell.
  void reference_drift_and_sort() {
    std::vector<std::pair<std::size_t, std::size_t>> order(particles_.size());
    for (std::size_t p = 0; p < particles_.size(); ++p) {
      particles_[p].x += reference_direction_ * flight_path();
      order[p] = {grid_->index(base_node(geometry_, particles_[p].x, Kernel::shift)), p};
    }
    reference_direction_ = -reference_direction_;
    std::sort(order.begin(), order.end());
    std::vector<Plain> sorted(particles_.size());
    for (std::size_t p = 0; p < order.size(); ++p) sorted[p] = particles_[order[p].second];
    particles_ = std::move(sorted);
  }

  const State<Dim>& state() const { return state_; }
  const FieldSet& columns() const { return state_.bodies[0].particles; }
  double particles_per_core() const {
    return static_cast<double>(count_particles(state_)) / state_.communicator().size();
  }

 private:
  // A velocity gradient of the size that the elastic block has [1/s].
  static Real gradient(int a, int b) { return a == b ? 10 - 8 * a : 1 + a - b; }
  // One cell in the fastest direction.
  static Vec<Dim> flight_path() { return spacing * Eigen::Vector3d(0.9, 0.63, 0.36).template head<Dim>(); }

  TransferGrid<Dim, T> transfer_grid() {
    return {state_.geometry(), state_.topology(), state_.fields.template data<T>(state_.nodes)};
  }
  void shift(Real cells) {
    const Vec<Dim> path = cells * flight_path();
    for (int a = 0; a < Dim; ++a) {
      Real* x = columns().template data<Real>(core::position, a);
      for (Index p = 0; p < columns().size(); ++p) x[p] += path[a];
    }
  }
  // So that G2P gives the particles what they have.
  void velocities_to_nodes() {
    T* node = state_.fields.template data<T>(state_.nodes);
    for (Slot s = 0; s < state_.topology().size(); ++s)
      for (int n = 0; n < nodes_per_block<Dim>; ++n, node += node_values) {
        const Vec<Dim> x =
            state_.geometry().node_position(state_.topology().first_node(s) + node_in_block<Dim>(n));
        for (int c = 0; c < node_values; ++c) node[c] = 1;
        for (int a = 0; a < Dim; ++a)
          for (int b = 0; b < Dim; ++b) node[a] += static_cast<T>(gradient(a, b) * x[b]);
      }
  }

  // G2P's limits, kept like the step keeps them.
  struct Sink final : UpdateSink<Dim, T> {
    KinematicLimits limits;
    void updated(Index, Index, const KinematicLimits& chunk, const T* const*) override {
      limits.include(chunk);
    }
  };

  Scene<Dim> scene_;
  State<Dim> state_;
  Sink sink_;
  std::vector<T> next_nodes_;
  std::vector<Plain> particles_;
  GridGeometry<Dim> geometry_;
  std::unique_ptr<ReferenceGrid<Dim>> grid_;
  Real direction_ = -1, reference_direction_ = -1;
};

}  // namespace mpm
