#include "mpm_hpc/transfer/stencil_products.hpp"

#include <Eigen/Core>
#include <array>

#include "mpm_hpc/fields/particle_order.hpp"
#include "mpm_hpc/math/bspline.hpp"
#include "mpm_hpc/math/tensor.hpp"
#include "cell_tangent.hpp"

namespace mpm {

namespace {

// Particles that share their nodes are handled together, one per lane.
template <class Kernel, bool mls, int Dim>
class Products final : public StencilProducts<Dim> {
  using Chunk = typename StencilProducts<Dim>::Chunk;
  using S = Pack<Real>;
  static constexpr int lanes = pack_width<Real>;
  static constexpr int support = Kernel::support;
  static constexpr int nodes = CellTangent<Dim, support>::nodes;
  static constexpr int block = Dim * Dim;
  // Second differences of a stencil: along each direction, on each line, from each of its first nodes.
  static constexpr int lines = nodes / support, differences = Dim * lines * (support - 2);

  struct Batch {
    Index begin;
    int count;
    int nodes;  // place of its nodes' numbers in node_numbers_
  };
  // Row b * lanes + p holds g_ip[b], column i; rows of no particle are 0.
  using Gradients = Eigen::Matrix<Real, Dim * lanes, nodes>;

 public:
  int reach() const override { return support - 1; }

  void rebuild(const GridGeometry<Dim>& grid, const BlockTopology<Dim>& topology,
               const Body<Dim>& body) override {
    grid_ = &grid;
    for (int a = 0; a < Dim; ++a) x_[a] = body.particles.template data<Real>(core::position, a);
    batches_.clear();
    node_numbers_.clear();
    stiffness_.clear();
    for (const bool boundary : {true, false}) {
      std::vector<Chunk>& chunks = boundary ? this->boundary_ : this->interior_;
      chunks.clear();
      for (const int r : boundary ? body.boundary : body.interior) {
        const BlockRange& range = body.ranges[r];
        for (Index begin = range.begin; begin < range.end; begin += chunk_particles)
          add_chunk(topology, body, range, begin, chunks);
      }
    }
  }

  void gather(const Chunk& chunk, const Real* v, Real* const* gradient) const override {
    for (int c = 0; c < block; ++c) std::fill_n(gradient[c], chunk.end - chunk.begin, 0.0);
    for (int b = chunk.first_batch; b < chunk.last_batch; ++b) {
      const Batch& batch = batches_[b];
      const Gradients G = gradients(batch);
      Eigen::Matrix<Real, nodes, Dim> values;
      for (int i = 0; i < nodes; ++i)
        for (int a = 0; a < Dim; ++a) values(i, a) = v[node(batch, i) * Dim + a];
      Eigen::Matrix<Real, Dim * lanes, Dim> result;
      result.noalias() = G.lazyProduct(values);
      for (int a = 0; a < Dim; ++a)
        for (int c = 0; c < Dim; ++c)
          for (int p = 0; p < batch.count; ++p)
            gradient[a * Dim + c][batch.begin - chunk.begin + p] = result(c * lanes + p, a);
    }
  }

  void scatter(const Chunk& chunk, const Real* const* stress, Real* f) const override {
    for (int b = chunk.first_batch; b < chunk.last_batch; ++b) {
      const Batch& batch = batches_[b];
      const Gradients G = gradients(batch);
      Eigen::Matrix<Real, Dim * lanes, Dim> values;
      for (int a = 0; a < Dim; ++a)
        for (int c = 0; c < Dim; ++c)
          for (int p = 0; p < lanes; ++p)
            values(c * lanes + p, a) = stress[a * Dim + c][batch.begin - chunk.begin + p];
      Eigen::Matrix<Real, Dim, nodes> forces;
      forces.noalias() = values.transpose().lazyProduct(G);
      for (int i = 0; i < nodes; ++i)
        for (int a = 0; a < Dim; ++a) f[node(batch, i) * Dim + a] += forces(a, i);
    }
  }

  void set_stiffness(const Chunk& chunk, const Real* stiffness) override {
    stiffness_.resize(batches_.size() * differences, 0.0);
    for (int b = chunk.first_batch; b < chunk.last_batch; ++b) {
      const Batch& batch = batches_[b];
      S fx[Dim], w[Dim][support];
      places(batch, fx);
      for (int a = 0; a < Dim; ++a) Kernel::weights(fx[a], w[a]);
      const S s = S::NullaryExpr(
          [&](Eigen::Index l) { return l < batch.count ? stiffness[batch.begin - chunk.begin + l] : 0.0; });
      for (int n = 0; n < differences; ++n) {
        const auto [direction, at] = difference(n);
        S weight = s;
        for (int a = Dim - 1, rest = at[0]; a >= 0; --a, rest /= support)
          if (a != direction) weight *= w[a][rest % support];
        stiffness_[static_cast<std::size_t>(b) * differences + static_cast<std::size_t>(n)] = weight.sum();
      }
    }
  }

  Real stabilise(const Chunk& chunk, const Real* v, Real factor, Real* f) const override {
    Real energy = 0;
    for (int b = chunk.first_batch; b < chunk.last_batch; ++b) {
      const Batch& batch = batches_[b];
      for_differences(b, [&](Real s, const int(&at)[3]) {
        for (int a = 0; a < Dim; ++a) {
          Real d = 0;
          for (int k = 0; k < 3; ++k) d += second[k] * v[node(batch, at[k]) * Dim + a];
          energy += 0.5 * s * d * d;
          for (int k = 0; f && k < 3; ++k) f[node(batch, at[k]) * Dim + a] += factor * s * second[k] * d;
        }
      });
    }
    return energy;
  }

  void scatter_diagonal(const Chunk& chunk, const Real* const* tangent, Real* d) const override {
    for (int b = chunk.first_batch; b < chunk.last_batch; ++b) {
      const Batch& batch = batches_[b];
      const Gradients G = gradients(batch);
      for_differences(b, [&](Real s, const int(&at)[3]) {
        for (int k = 0; k < 3; ++k)
          for (int a = 0; a < Dim; ++a) d[node(batch, at[k]) * Dim + a] += s * second[k] * second[k];
      });
      for (int a = 0; a < Dim; ++a) {
        S A[Dim][Dim];
        for (int c = 0; c < Dim; ++c)
          for (int e = 0; e < Dim; ++e)
            A[c][e] = Eigen::Map<const S>(tangent[SymTensor<S, block>::index(a * Dim + c, a * Dim + e)] +
                                          (batch.begin - chunk.begin));
        for (int i = 0; i < nodes; ++i) {
          const Real* g = G.data() + i * Dim * lanes;
          S sum = S::Zero();
          for (int c = 0; c < Dim; ++c)
            for (int e = 0; e < Dim; ++e) sum += load<S>(g + c * lanes) * A[c][e] * load<S>(g + e * lanes);
          d[node(batch, i) * Dim + a] += sum.sum();
        }
      }
    }
  }

  void scatter_tangent(const Chunk& chunk, const Real* const* tangent, Real* blocks) const override {
    constexpr int per_node = tangent_blocks_of_node();
    CellTangent<Dim, support> cell;
    for (int b = chunk.first_batch; b < chunk.last_batch;) {
      const Batch& first = batches_[b];
      Real* of_node[nodes];
      for (int i = 0; i < nodes; ++i) of_node[i] = blocks + node(first, i) * per_node * block;
      cell.clear();
      for (; b < chunk.last_batch && batches_[b].nodes == first.nodes; ++b) {
        const Batch& batch = batches_[b];
        const Gradients G = gradients(batch);
        cell.add(G.data(), tangent, batch.begin - chunk.begin, batch.count, [&](int i, int end) {
          if (&batch != &first) return;
          for (; i < end; ++i)
            for (int j = i; j < nodes; j += support - j % support) {
              const Real* line = of_node[i] + (offset_numbers[j] - offset_numbers[i]) * block;
              for (int k = 0; k < (support - j % support) * block; k += 8) __builtin_prefetch(line + k, 1);
            }
        });
        for_differences(b, [&](Real s, const int(&at)[3]) {
          for (int k = 0; k < 3; ++k)
            for (int l = k; l < 3; ++l) {
              Real* out = of_node[at[k]] + (offset_numbers[at[l]] - offset_numbers[at[k]]) * block;
              for (int a = 0; a < Dim; ++a) out[a * (Dim + 1)] += s * second[k] * second[l];
            }
        });
      }
      for (int i = 0; i < nodes; ++i) {
        Real* start = of_node[i] - offset_numbers[i] * block;
        for (int j = i; j < nodes; ++j) cell.add_block(i, j, start + offset_numbers[j] * block);
      }
    }
  }

 private:
  static constexpr Real second[3] = {1, -2, 1};
  struct Difference {
    int direction;
    int at[3];  // stencil nodes
  };
  static constexpr Difference difference(int n) {
    const int direction = n / (lines * (support - 2)), line = n / (support - 2) % lines,
              start = n % (support - 2);
    int step = 1;
    for (int a = Dim - 1; a > direction; --a) step *= support;
    const int first = line / step * step * support + line % step + start * step;
    return {direction, {first, first + step, first + 2 * step}};
  }
  // Calls f(its stiffness, its nodes) for the second differences of a batch.
  template <class F>
  void for_differences(int b, F&& f) const {
    if (stiffness_.empty()) return;
    for (int n = 0; n < differences; ++n)
      f(stiffness_[static_cast<std::size_t>(b) * differences + static_cast<std::size_t>(n)],
        difference(n).at);
  }

  // Stencil node i in the numbering of offsets, whose rows are 2 reach + 1 long.
  static constexpr int offset_number(int i) {
    int number = 0;
    for (int a = Dim - 1, place = 1; a >= 0; --a, place *= 2 * support - 1, i /= support)
      number += i % support * place;
    return number;
  }
  static constexpr auto offset_numbers = [] {
    std::array<int, nodes> numbers{};
    for (int i = 0; i < nodes; ++i) numbers[static_cast<std::size_t>(i)] = offset_number(i);
    return numbers;
  }();
  static constexpr int tangent_blocks_of_node() { return offset_number(nodes - 1) + 1; }

  std::size_t node(const Batch& batch, int i) const {
    return static_cast<std::size_t>(node_numbers_[batch.nodes + i]);
  }

  void add_chunk(const BlockTopology<Dim>& topology, const Body<Dim>& body, const BlockRange& range,
                 Index begin, std::vector<Chunk>& chunks) {
    const Slot* around = topology.neighbours(range.slot);
    const IntVec<Dim> first = topology.first_node(range.slot);
    Chunk chunk{begin, std::min<Index>(begin + chunk_particles, range.end), static_cast<int>(batches_.size()),
                0};
    IntVec<Dim> last_base = IntVec<Dim>::Constant(-1);
    for (Index p = chunk.begin; p < chunk.end && !body.is_padding(p); ++p) {
      Vec<Dim> x;
      for (int a = 0; a < Dim; ++a) x[a] = x_[a][p];
      const IntVec<Dim> base = base_node(*grid_, x, Kernel::shift);
      const bool fresh = static_cast<int>(batches_.size()) == chunk.first_batch;
      if (!fresh && base == last_base && batches_.back().count < lanes) {
        ++batches_.back().count;
        continue;
      }
      // A full batch of the same cell shares its list of nodes.
      if (!fresh && base == last_base) {
        batches_.push_back({p, 1, batches_.back().nodes});
        continue;
      }
      batches_.push_back({p, 1, static_cast<int>(node_numbers_.size())});
      last_base = base;
      for (int i = 0; i < nodes; ++i) {
        IntVec<Dim> place = base - first;
        for (int a = Dim - 1, rest = i; a >= 0; --a, rest /= support) place[a] += rest % support;
        const std::size_t number = node_around<Dim>(around, place);
        debug_check(number != no_node, "a particle's stencil leaves the active blocks: it wasn't sorted");
        node_numbers_.push_back(static_cast<std::int32_t>(number));
      }
    }
    chunk.last_batch = static_cast<int>(batches_.size());
    chunks.push_back(chunk);
  }

  // Distances of the particles from their first node, in spacings; the first particle's stand in the lanes that have none.
  void places(const Batch& batch, S (&fx)[Dim]) const {
    for (int a = 0; a < Dim; ++a) {
      const S place =
          (S::NullaryExpr([&](Eigen::Index l) { return x_[a][batch.begin + (l < batch.count ? l : 0)]; }) -
           grid_->origin()[a]) *
          grid_->inverse_spacing();
      fx[a] = place - S((place - Kernel::shift).floor());
    }
  }

  Gradients gradients(const Batch& batch) const {
    S fx[Dim], w[Dim][support], d[Dim][support];
    const S mask = S::NullaryExpr([&](Eigen::Index l) { return l < batch.count ? 1.0 : 0.0; });
    places(batch, fx);
    for (int a = 0; a < Dim; ++a) {
      Kernel::weights(fx[a], w[a]);
      if constexpr (mls) {
        for (int n = 0; n < support; ++n)
          d[a][n] =
              w[a][n] * (static_cast<Real>(n) - fx[a]) * (Kernel::inverse_inertia * grid_->inverse_spacing());
      } else {
        Kernel::gradients(fx[a], d[a]);
        for (int n = 0; n < support; ++n) d[a][n] *= grid_->inverse_spacing();
      }
      if (a == 0)
        for (int n = 0; n < support; ++n) {
          w[0][n] *= mask;
          d[0][n] *= mask;
        }
    }
    Gradients G;
    for (int i = 0; i < nodes; ++i) {
      int at[Dim];
      for (int a = Dim - 1, rest = i; a >= 0; --a, rest /= support) at[a] = rest % support;
      for (int c = 0; c < Dim; ++c) {
        S g = c == 0 ? d[0][at[0]] : w[0][at[0]];
        for (int a = 1; a < Dim; ++a) g *= a == c ? d[a][at[a]] : w[a][at[a]];
        store(G.data() + (i * Dim + c) * lanes, g);
      }
    }
    return G;
  }

  const GridGeometry<Dim>* grid_ = nullptr;
  const Real* x_[Dim] = {};
  std::vector<Batch> batches_;
  std::vector<std::int32_t> node_numbers_;
  std::vector<Real> stiffness_;  // of all differences of each batch; empty: none
};

}  // namespace

template <int Dim>
std::unique_ptr<StencilProducts<Dim>> make_stencil_products(const TransferOptions& options) {
  return with_kernel(options.kernel, [&](auto kernel) -> std::unique_ptr<StencilProducts<Dim>> {
    using Kernel = decltype(kernel);
    if constexpr (Kernel::has_inertia)
      if (options.forces == Forces::mls) return std::make_unique<Products<Kernel, true, Dim>>();
    return std::make_unique<Products<Kernel, false, Dim>>();
  });
}

template std::unique_ptr<StencilProducts<2>> make_stencil_products<2>(const TransferOptions&);
template std::unique_ptr<StencilProducts<3>> make_stencil_products<3>(const TransferOptions&);

}  // namespace mpm
