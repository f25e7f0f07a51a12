// The material laws, plasticity rules and decompositions by themselves: packs of particles against one particle at a time, and
// every material against neo-Hookean.
#include <Eigen/Eigenvalues>
#include <random>

#include "counted.hpp"
#include "elastic_block.hpp"
#include "material_keys.hpp"
#include "mpm_hpc/effects/material_columns.hpp"
#include "mpm_hpc/materials/material_list.hpp"
#include "mpm_hpc/materials/material_loops.hpp"
#include "roofline.hpp"

namespace {

using namespace mpm;

constexpr int rounds = 7, repeats = 5;
constexpr Real distortion = 0.1;  // largest change of an entry of F

// Random deformation gradients: as columns, and one behind the other.
template <int Dim, class T>
class Deformations {
 public:
  static constexpr Precision precision =
      std::is_same_v<T, float> ? Precision::single_precision : Precision::double_precision;

  // A share of them is turned inside out.
  explicit Deformations(int count, Real inverted = 0) : body_("", 0, precision), plain_(count) {
    std::mt19937_64 generator(1);
    std::uniform_real_distribution<Real> entry(-distortion, distortion), lot(0, 1);
    body_.particles.resize(count);
    for (int c = 0; c < Dim * Dim; ++c)
      columns_.F[c] = body_.particles.template data<T>(core::deformation_gradient, c);
    for (Index p = 0; p < count; ++p) {
      Mat<Dim>& F = plain_[p].F;
      F = Mat<Dim>::Identity() + Mat<Dim>::NullaryExpr([&] { return entry(generator); });
      if (lot(generator) < inverted) F.col(0) *= -1;
      for (int c = 0; c < Dim * Dim; ++c) columns_.F[c][p] = static_cast<T>(F(c / Dim, c % Dim));
    }
  }

  const MaterialColumns<Dim, T>& columns() const { return columns_; }
  std::vector<ReferenceParticle<Dim>>& particles() { return plain_; }
  double count() const { return static_cast<double>(plain_.size()); }
  double bytes() const { return column_bytes(body_.particles, {core::deformation_gradient}); }

  // f(begin, end, out) for each chunk, with `Components` columns that stay in L1, as in P2G.
  template <int Components, class F>
  void for_chunks(F&& f) const {
    alignas(64) T storage[Components][chunk_particles];
    T* out[Components];
    for (int c = 0; c < Components; ++c) out[c] = storage[c];
    for (Index begin = 0; begin < body_.particles.size(); begin += chunk_particles) {
      f(begin, std::min<Index>(begin + chunk_particles, body_.particles.size()), out);
      asm volatile("" : : "r"(out) : "memory");
    }
  }
  // The mean number of operations that f(F) takes with counted numbers.
  template <class F>
  double operations(F&& f) const {
    constexpr int samples = 1000;
    double sum = 0;
    for (int p = 0; p < samples; ++p) {
      Tensor<Counted, Dim> deformation;
      for (int c = 0; c < Dim * Dim; ++c) deformation.m[c] = plain_[p].F(c / Dim, c % Dim);
      sum += static_cast<double>(count_operations([&] { f(deformation); }));
    }
    return sum / samples;
  }

 private:
  Body<Dim> body_;
  std::vector<ReferenceParticle<Dim>> plain_;
  MaterialColumns<Dim, T> columns_;
};

// The law with the block's elastic constants; a law that asks for more keys gets them here.
template <class Law>
Law make_law() {
  Law law;
  Parameters keys = Parameters::read_text(
      fmt::format("youngs_modulus = {}\npoisson_ratio = {}\n", youngs_modulus, poisson_ratio), Law::name, {});
  law.declare(keys);
  return law;
}

template <class Law, int Dim>
std::unique_ptr<const Material<Dim>> make_loops() {
  return std::make_unique<MaterialLoops<Law, Dim>>(
      typename Material<Dim>::Common{.name = Law::name, .density = density}, make_law<Law>());
}

// The law one particle at a time: written with Eigen where the plain step has it, else as it is, with plain numbers.
template <class Law, int Dim>
std::function<Mat<Dim>(const Mat<Dim>&)> plain_law() {
  for (const PlainLaw law : {PlainLaw::neo_hookean, PlainLaw::split_neo_hookean, PlainLaw::fixed_corotated})
    if (std::string_view(name_of(law)) == Law::name) {
      const ReferenceMaterial material{Elasticity().mu, Elasticity().lambda, law};
      return [material](const Mat<Dim>& F) { return material.kirchhoff_stress<Dim>(F); };
    }
  return [law = make_law<Law>()](const Mat<Dim>& F) {
    Tensor<Real, Dim> deformation;
    for (int c = 0; c < Dim * Dim; ++c) deformation.m[c] = F(c / Dim, c % Dim);
    const SymTensor<Real, Dim> stress = law.kirchhoff_stress(deformation);
    return Mat<Dim>::NullaryExpr([&stress](int i, int j) { return stress(i, j); }).eval();
  };
}

template <class Law, int Dim, class T>
void bench_stress(benchmark::State& bench, const Communicator& communicator, int count) {
  Deformations<Dim, T> deformations(count);
  const auto law = make_loops<Law, Dim>(), neo_hookean = make_loops<NeoHookean<Dim>, Dim>();
  const auto plain = plain_law<Law, Dim>();
  const auto stress = [&deformations](const Material<Dim>& material) {
    for (int i = 0; i < repeats; ++i)
      deformations.template for_chunks<SymTensor<T, Dim>::size>([&](Index begin, Index end, T* const* tau) {
        material.stress(deformations.columns(), begin, end, tau);
      });
  };
  const Work work{deformations.bytes(), deformations.operations([law = make_law<Law>()](const auto& F) {
                    law.kirchhoff_stress(F);
                  })};
  for (auto unused : bench) {
    (void)unused;
    const auto times = time_in_turns(communicator, rounds,
                                     {[&] { stress(*law); },
                                      [&] {
                                        for (ReferenceParticle<Dim>& p : deformations.particles())
                                          p.tau = plain(p.F);
                                      },
                                      [&] { stress(*neo_hookean); }});
    report_kernel(bench, communicator, times, repeats, deformations.count(), deformations.precision, work);
    bench.counters["cost_to_neo_hookean"] = median_ratio(times, 0, 2);
  }
}

// A material of the scene with particles of its own, which a step stretches to and fro.
template <int Dim, class T>
class MaterialBlock {
 public:
  MaterialBlock(const std::string& keys, int count) : body_("", 0, Deformations<Dim, T>::precision), gradient_(Dim * Dim) {
    Parameters parameters = Parameters::read_text("density = 1000\n" + keys, "material", {});
    material_ = make_material<Dim>(parameters, "block");
    const std::vector<OwnColumn> own = material_->own_columns();
    add_own_columns(*material_, Deformations<Dim, T>::precision, body_.particles);
    FieldSet& fields = body_.particles;
    fields.resize(count);
    std::mt19937_64 generator(1);
    std::uniform_real_distribution<Real> entry(-distortion, distortion);
    for (int c = 0; c < Dim * Dim; ++c) {
      columns_.F[c] = fields.template data<T>(core::deformation_gradient, c);
      columns_.velocity_gradient[c] = fields.template data<T>(core::velocity_gradient, c);
      for (Index p = 0; p < count; ++p) {
        columns_.F[c][p] = static_cast<T>((c % (Dim + 1) == 0) + strain * entry(generator));
        fields.template data<T>(core::velocity_gradient, c)[p] = static_cast<T>(strain * entry(generator));
      }
    }
    for (std::size_t k = 0; k < own.size(); ++k) {
      columns_.own[k] = fields.template data<T>(core::count + static_cast<int>(k));
      std::fill_n(columns_.own[k], count, static_cast<T>(own[k].initial));
    }
    columns_.volume = fields.template data<T>(core::volume);
    std::fill_n(fields.template data<T>(core::volume), count, T(1));
  }

  void stress() {
    alignas(64) T storage[SymTensor<T, Dim>::size][chunk_particles];
    T* tau[SymTensor<T, Dim>::size];
    for (int c = 0; c < SymTensor<T, Dim>::size; ++c) tau[c] = storage[c];
    for_chunks([&](Index begin, Index end) {
      material_->stress(columns_, begin, end, tau);
      asm volatile("" : : "r"(tau) : "memory");
    });
  }
  void advance() {
    const DeformationStep step{.dt = direction_ * Real(1)};
    direction_ = -direction_;
    for_chunks([&](Index begin, Index end) {
      for (int c = 0; c < Dim * Dim; ++c) gradient_[c] = columns_.velocity_gradient[c] + begin;
      work_ += material_->advance(columns_, gradient_.data(), step, begin, end).plastic_work;
    });
  }

 private:
  static constexpr Real strain = 0.2;  // of the distortion: some yield strains
  void for_chunks(auto&& f) {
    for (Index begin = 0; begin < body_.particles.size(); begin += chunk_particles)
      f(begin, std::min<Index>(begin + chunk_particles, body_.particles.size()));
  }

  Body<Dim> body_;
  std::unique_ptr<Material<Dim>> material_;
  MaterialColumns<Dim, T> columns_;
  std::vector<const T*> gradient_;
  Real direction_ = 1, work_ = 0;
};

// What a step asks of a material, stress and advance, over what it asks of neo-Hookean.
template <int Dim, class T>
void bench_material(benchmark::State& bench, const Communicator& communicator, int count, const std::string& keys) {
  MaterialBlock<Dim, T> block(keys, count), neo_hookean(material_keys().front().keys, count);
  for (auto unused : bench) {
    (void)unused;
    const auto times = time_in_turns(communicator, rounds,
                                     {[&] { block.stress(); }, [&] { block.advance(); }, [&] { neo_hookean.stress(); },
                                      [&] { neo_hookean.advance(); },
                                      [&] {
                                        block.stress();
                                        block.advance();
                                      },
                                      [&] {
                                        neo_hookean.stress();
                                        neo_hookean.advance();
                                      }});
    bench.counters["stress_to_neo_hookean"] = median_ratio(times, 0, 2);
    bench.counters["advance_to_neo_hookean"] = median_ratio(times, 1, 3);
    bench.counters["both_to_neo_hookean"] = median_ratio(times, 4, 5);
    const double fastest = *std::min_element(times[4].begin(), times[4].end());
    bench.counters["ns_per_particle"] = 1e9 * fastest / count;
    bench.SetIterationTime(fastest);
  }
}

template <int Dim, class T>
void bench_polar(benchmark::State& bench, const Communicator& communicator, int count, Real inverted) {
  using S = Pack<T>;
  Deformations<Dim, T> deformations(count, inverted);
  const Work work{deformations.bytes(), deformations.operations([](const auto& F) { rotation_of(F); })};
  for (auto unused : bench) {
    (void)unused;
    const auto times = time_in_turns(
        communicator, rounds,
        {[&] {
           for (int i = 0; i < repeats; ++i)
             deformations.template for_chunks<Dim * Dim>([&](Index begin, Index end, T* const* out) {
               for (Index p = begin; p < end; p += pack_width<T>) {
                 const Tensor<S, Dim> R = rotation_of(load_tensor<S, Dim>(deformations.columns().F, p));
                 for (int c = 0; c < Dim * Dim; ++c) store(out[c] + (p - begin), R.m[c]);
               }
             });
         },
         [&] {
           for (ReferenceParticle<Dim>& p : deformations.particles()) {
             const Eigen::JacobiSVD<Mat<Dim>> svd(p.F, Eigen::ComputeFullU | Eigen::ComputeFullV);
             p.tau = svd.matrixU() * svd.matrixV().transpose();
           }
         }});
    report_kernel(bench, communicator, times, repeats, deformations.count(), deformations.precision, work);
  }
}

template <int Dim, class T>
void bench_eigen(benchmark::State& bench, const Communicator& communicator, int count) {
  using S = Pack<T>;
  Deformations<Dim, T> deformations(count);
  const Work work{deformations.bytes(), deformations.operations([](const auto& F) { symmetric_eigen(left_cauchy_green(F)); })};
  for (auto unused : bench) {
    (void)unused;
    const auto times = time_in_turns(
        communicator, rounds,
        {[&] {
           for (int i = 0; i < repeats; ++i)
             deformations.template for_chunks<Dim>([&](Index begin, Index end, T* const* out) {
               for (Index p = begin; p < end; p += pack_width<T>) {
                 const auto eigen = symmetric_eigen(left_cauchy_green(load_tensor<S, Dim>(deformations.columns().F, p)));
                 for (int c = 0; c < Dim; ++c) store(out[c] + (p - begin), S(eigen.values[c] * eigen.vectors(0, c)));
               }
             });
         },
         [&] {
           for (ReferenceParticle<Dim>& p : deformations.particles()) {
             const Eigen::SelfAdjointEigenSolver<Mat<Dim>> eigen(p.F * p.F.transpose());
             p.tau = eigen.eigenvectors() * eigen.eigenvalues().asDiagonal();
           }
         }});
    report_kernel(bench, communicator, times, repeats, deformations.count(), deformations.precision, work);
  }
}

template <int Dim, class T>
void register_scalar(const Communicator& communicator, const char* size, int count) {
  const std::string place =
      fmt::format("{}/{}d_{}", std::is_same_v<T, float> ? "single" : "double", Dim, size);
  [&]<class... Law>(LawList<Law...>) {
    const auto add = [&]<class L>() {
      if constexpr (SolidLaw<L, Dim> && requires(L law) { law.mu; })
        add_case(fmt::format("stress/{}/{}", L::name, place), [&communicator, count](benchmark::State& bench) {
          bench_stress<L, Dim, T>(bench, communicator, count);
        });
    };
    (add.template operator()<Law>(), ...);
  }(MaterialList<Dim>{});
  for (const auto& [name, keys] : material_keys())
    add_case(fmt::format("material/{}/{}", name, place), [&communicator, count, keys = keys](benchmark::State& bench) {
      bench_material<Dim, T>(bench, communicator, count, keys);
    });
  add_case(fmt::format("eigen/{}", place),
           [&communicator, count](benchmark::State& bench) { bench_eigen<Dim, T>(bench, communicator, count); });
  // In 2D the rotation has a closed form for every F.
  for (const int percent : {0, 1})
    if (Dim == 3 || percent == 0)
      add_case(fmt::format("polar/{}_percent_inverted/{}", percent, place),
               [&communicator, count, percent](benchmark::State& bench) {
                 bench_polar<Dim, T>(bench, communicator, count, 0.01 * percent);
               });
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  using Size = std::pair<const char*, int>;
  for (const auto& [name, count] : options.small ? std::vector<Size>{{"2k", 2048}}
                                                 : std::vector<Size>{{"64k", 65536}, {"512k", 524288}}) {
    register_scalar<3, double>(communicator, name, count);
    register_scalar<3, float>(communicator, name, count);
    register_scalar<2, double>(communicator, name, count);
    register_scalar<2, float>(communicator, name, count);
  }
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
