// Products of the stencils' gradients with values on the nodes, for the implicit integrator, which visits every stencil many
// times while no particle moves: gradients of velocities, nodal forces, and the blocks of the tangent.
#pragma once

#include <memory>
#include <vector>

#include "mpm_hpc/fields/body.hpp"
#include "mpm_hpc/fields/grid_geometry.hpp"
#include "mpm_hpc/transfer/transfer_form.hpp"

namespace mpm {

// With g_ip = D_p^-1 w_ip (x_i - x_p) for MLS forces and grad w_ip for classical ones, so that grad v_p = sum_i v_i g_ip^T.
// Values on nodes are double, Dim (or blocks of Dim x Dim) per node, node by node.
template <int Dim>
class StencilProducts {
 public:
  // Particles [begin, end) that one call handles; the numbers of their batches.
  struct Chunk {
    Index begin, end;
    int first_batch, last_batch;
  };
  // Room that arrays [p - begin] of a chunk must have; what is behind its particles must be finite.
  static constexpr int room = chunk_particles + pack_width<double>;

  virtual ~StencilProducts() = default;

  // Finds the stencils of a body's particles, which must be sorted. They stay good while no particle moves.
  virtual void rebuild(const GridGeometry<Dim>& grid, const BlockTopology<Dim>& topology,
                       const Body<Dim>& body) = 0;
  // Of the body's boundary or interior ranges.
  const std::vector<Chunk>& chunks(bool boundary) const { return boundary ? boundary_ : interior_; }

  // gradient[a * Dim + b][p - begin] = sum_i v_i[a] g_ip[b]
  virtual void gather(const Chunk& chunk, const Real* v, Real* const* gradient) const = 0;
  // f_i[a] += sum_p sum_b S_p[a][b] g_ip[b] with S_p[a][b] at stress[a * Dim + b][p - begin]
  virtual void scatter(const Chunk& chunk, const Real* const* stress, Real* f) const = 0;
  // K_ij[a][b] += sum_p sum_cd g_ip[c] A_p[ac][bd] g_jp[d] for j = i or behind it in lexicographic order (K is symmetric),
  // with A_p as in TrialColumns. The block of i and j is number tangent_block(j - i) of node i's tangent_blocks().
  virtual void scatter_tangent(const Chunk& chunk, const Real* const* tangent, Real* blocks) const = 0;
  // d_i[a] += K_ii[a][a]. Both with the second derivative of E_s.
  virtual void scatter_diagonal(const Chunk& chunk, const Real* const* tangent, Real* d) const = 0;

  // A node at the edge of a body may have next to no weight: what it does to the particles is then hardly held by their
  // stress, it moves far, and leaves strains behind that are out of balance on the next grid. Second differences
  // d = v_0 - 2 v_1 + v_2 along the lines of each stencil, which vanish for any affine motion, hold it to its neighbours:
  //   E_s(v) = 1/2 sum_p s_p sum_lines w_line |d_line|^2,  w_line = product of the weights across the line
  // (a penalty on ghosts in the manner of Burman 2010, as particles see it). None for the linear kernel, which has no second
  // difference. Sets s_p at [p - begin]; without it s_p = 0.
  virtual void set_stiffness(const Chunk& chunk, const Real* s) = 0;
  // Returns E_s(v) of the chunk and adds factor times its gradient to f, if there is one.
  virtual Real stabilise(const Chunk& chunk, const Real* v, Real factor, Real* f) const = 0;

  virtual int reach() const = 0;  // support - 1: nodes further apart are not coupled
  int tangent_blocks() const;
  int tangent_block(const IntVec<Dim>& offset) const;

 protected:
  std::vector<Chunk> boundary_, interior_;
};

template <int Dim>
std::unique_ptr<StencilProducts<Dim>> make_stencil_products(const TransferOptions& options);

template <int Dim>
int StencilProducts<Dim>::tangent_block(const IntVec<Dim>& offset) const {
  int number = 0;
  for (int a = 0; a < Dim; ++a) number = number * (2 * reach() + 1) + offset[a];
  return number;
}
template <int Dim>
int StencilProducts<Dim>::tangent_blocks() const {
  return tangent_block(IntVec<Dim>::Constant(reach())) + 1;
}

}  // namespace mpm
