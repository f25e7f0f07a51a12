// Newton's iteration of implicit steps: its tangent's assembly against a plain one, the share of its parts, and what
// preconditioners pay.
#include <petscsys.h>

#include "elastic_block.hpp"
#include "harness.hpp"
#include "mpm_hpc/time/implicit_integrator.hpp"
#include "plain_tangent.hpp"
#include "stage_shares.hpp"

namespace {

using namespace mpm;

struct Case {
  int dimension = 3, cells = 30;  // per direction
  Real step = 10;                 // over the explicit one
  Real poisson = poisson_ratio;
  bool matrix_free = false;
  bool clamped = true;  // at the lower side
};

// A block that is pulled, pressed and sheared from a clamped side, with speeds that change over its length.
template <int Dim>
std::string scene_text(const Case& c, Real dt) {
  const Elasticity usual;
  const Real lower = free_cells * spacing, upper = lower + c.cells * spacing,
             end = upper + free_cells * spacing;
  const Real speed = stretching * usual.wave_speed / (c.cells * spacing);
  const std::string height = fmt::format("{}*(y-{})", speed, lower);
  const std::string velocity = Dim == 2 ? fmt::format("[\"0.5*{0}\", \"{0}\"]", height)
                                        : fmt::format("[\"0.5*{0}\", \"{0}\", \"-0.3*{0}\"]", height);
  return fmt::format(
             "dimension = {}\n[domain]\nlower = {}\nupper = {}\n[grid]\nspacing = {}\n[time]\nend = 1\n"
             "integrator = \"implicit\"\ndt = {}\n[newton]\noperator = \"{}\"\n"
             "[material.block]\nmodel = \"neo_hookean\"\ndensity = {}\nyoungs_modulus = {}\npoisson_ratio = "
             "{}\n"
             "[[body]]\nmaterial = \"block\"\nparticles_per_cell = {}\njitter = 0.25\nvelocity = {}\n"
             "shape = {{type = \"box\", lower = {}, upper = {}}}\n",
             Dim, in_each_direction<Dim>(0), in_each_direction<Dim>(end), spacing, dt,
             c.matrix_free ? "matrix_free" : "assembled", density, youngs_modulus, c.poisson,
             particles_per_cell<Dim>, velocity, in_each_direction<Dim>(lower),
             in_each_direction<Dim>(upper)) +
         (c.clamped
              ? fmt::format(
                    "[[effect.obstacle]]\ncondition = \"sticky\"\nshape = {{type = \"box\", lower = {}, "
                    "upper = {}}}\n",
                    in_each_direction<Dim>(-1), in_each_direction<Dim>(end + 1, lower + spacing / 2, end + 1))
              : "");
}

// One implicit step of it, which can be solved again and again.
template <int Dim>
class ImplicitBlock {
 public:
  ImplicitBlock(const Communicator& communicator, const Case& c) {
    const Real modulus = youngs_modulus * (1 - c.poisson) / ((1 + c.poisson) * (1 - 2 * c.poisson));
    const Real dt = c.step * cfl * spacing / std::sqrt(modulus / density);
    Parameters parameters = Parameters::read_text(scene_text<Dim>(c, dt), "implicit block", {});
    read_dimension(parameters);
    scene_ = read_scene<Dim>(parameters);
    declare_state(communicator, scene_, state_);
    integrator_ = make_integrator(scene_, state_, join_effects(scene_));
    create_particles(scene_, state_);
    integrator_->initialise(state_);
    state_.dt = dt;
  }

  State<Dim>& state() { return state_; }
  ImplicitSystem<Dim>& system() { return implicit().system(); }
  void prepare() { implicit().prepare(state_); }
  NewtonResult solve() { return system().solve(state_); }
  Real unknowns() { return static_cast<Real>(Dim * system().global_rows()); }

 private:
  ImplicitIntegrator<Dim>& implicit() { return dynamic_cast<ImplicitIntegrator<Dim>&>(*integrator_); }
  Scene<Dim> scene_;
  State<Dim> state_;
  std::unique_ptr<Integrator<Dim>> integrator_;
};

// Rows and velocities of the nodes as plain code keeps them: on every rank, in a box.
template <int Dim>
PlainRows<Dim> plain_rows(ImplicitBlock<Dim>& block) {
  const State<Dim>& state = block.state();
  const ImplicitSystem<Dim>& system = block.system();
  PlainRows<Dim> plain{ReferenceGrid<Dim>(state.geometry()), {}, system.rows()};
  std::vector<Real> values((Dim + 1) * plain.grid.mass.size(), 0.0);
  for (int r = 0; r < system.rows(); ++r) {
    const std::size_t node = system.node(r);
    const IntVec<Dim> place = state.topology().first_node(static_cast<Slot>(node / nodes_per_block<Dim>)) +
                              node_in_block<Dim>(static_cast<int>(node % nodes_per_block<Dim>));
    Real* out = values.data() + (Dim + 1) * plain.grid.index(place);
    out[Dim] = static_cast<Real>(system.first_row() + r + 1);
    for (int a = 0; a < Dim; ++a) out[a] = system.velocity(r)[a];
  }
  state.communicator().sum(values);
  for (std::size_t i = 0; i < plain.grid.mass.size(); ++i) {
    const Real* in = values.data() + (Dim + 1) * i;
    plain.numbers.push_back(static_cast<PetscInt>(in[Dim]) - 1);
    plain.grid.momentum[i] = Eigen::Map<const mpm::Vec<Dim>>(in);
  }
  return plain;
}

// Largest difference of products with the program's matrix and a plain one, over the largest product.
template <int Dim>
Real difference(const Communicator& communicator, ImplicitSystem<Dim>& system,
                const PlainTangent<QuadraticKernel, Dim>& plain) {
  Real most = 0, size = 0;
  for (int seed = 1; seed <= 3; ++seed) {
    std::vector<Real> d(static_cast<std::size_t>(Dim * system.rows())), y;
    for (std::size_t k = 0; k < d.size(); ++k)
      d[k] = std::sin(seed * 12.9898 *
                      static_cast<Real>(Dim * system.first_row() + static_cast<GlobalIndex>(k)));
    system.multiply(d, y);
    const std::vector<Real> expected = plain.multiply(d);
    for (std::size_t k = 0; k < d.size(); ++k) {
      most = std::max(most, std::abs(y[k] - expected[k]));
      size = std::max(size, std::abs(expected[k]));
    }
  }
  return communicator.max(most) / communicator.max(size);
}

template <int Dim>
void bench_assembly(benchmark::State& bench, const Communicator& communicator, Case c) {
  c.clamped = false;
  ImplicitBlock<Dim> block(communicator, c);
  block.prepare();
  ImplicitSystem<Dim>& system = block.system();
  const std::vector<Real> v = system.unknowns();
  const PlainRows<Dim> rows = plain_rows(block);
  const std::vector<ReferenceParticle<Dim>> particles = reference_particles(block.state());
  const Elasticity elasticity;
  using Plain = PlainTangent<QuadraticKernel, Dim>;
  const ReferenceMaterial material{elasticity.mu, elasticity.lambda, PlainLaw::neo_hookean};
  Plain entries(communicator, block.state().geometry(), rows, particles, material, Plain::Insertion::entries),
      blocks(communicator, block.state().geometry(), rows, particles, material, Plain::Insertion::blocks);
  const Real dt = block.state().dt;
  const std::vector<std::function<void()>> variants = {
      [&] { system.linearise(block.state(), v.data(), false); }, [&] { entries.assemble(dt); },
      [&] { blocks.assemble(dt); }, [&] { system.linearise(block.state(), v.data(), true); }};
  for (auto unused : bench) {
    (void)unused;
    const auto times = time_in_turns(communicator, 3, variants);
    system.linearise(block.state(), v.data(), false);
    const double unknowns = block.unknowns(), per_core = unknowns / communicator.size();
    bench.SetIterationTime(median(times[0]));
    bench.counters["ranks"] = communicator.size();
    bench.counters["unknowns"] = unknowns;
    bench.counters["ns_per_unknown"] = 1e9 * median(times[0]) / per_core;
    bench.counters["plain_ns_per_unknown"] = 1e9 * median(times[1]) / per_core;
    bench.counters["ratio"] = median_ratio(times, 1, 0);
    bench.counters["blocks_ratio"] = median_ratio(times, 2, 0);
    bench.counters["projected_over_exact"] = median_ratio(times, 3, 0);
    bench.counters["difference"] =
        std::max(difference(communicator, system, entries), difference(communicator, system, blocks));
  }
}

template <int Dim>
void bench_iteration(benchmark::State& bench, const Communicator& communicator, const Case& c) {
  ImplicitBlock<Dim> block(communicator, c);
  StageShares shares;
  NewtonResult result;
  for (auto unused : bench) {
    (void)unused;
    std::vector<double> seconds;
    const auto run = [&] {
      block.prepare();
      communicator.barrier();
      seconds.push_back(communicator.max(
          seconds_of([&] { shares.measure(block.state().timers, [&] { result = block.solve(); }); })));
    };
    for (int round = 0; round < 4; ++round) run();
    const double iterations = std::max(1, result.iterations);
    const auto share = [&](const char* stage) { return shares.of(communicator, {stage}); };
    const double assembly = share("Newton assembly"), residual = share("Newton residual"),
                 potential = share("Newton potential");
    bench.SetIterationTime(median(seconds));
    bench.counters["ranks"] = communicator.size();
    bench.counters["unknowns"] = block.unknowns();
    bench.counters["ns_per_unknown"] =
        1e9 * median(seconds) * communicator.size() / (iterations * block.unknowns());
    bench.counters["assembly_share"] = assembly;
    bench.counters["residual_share"] = residual;
    bench.counters["line_search_share"] = potential;
    bench.counters["sweep_share"] = share("Newton sweep");
    bench.counters["rows_share"] = share("Newton rows");
    bench.counters["matrix_share"] = share("Newton matrix");
    bench.counters["Krylov_share"] = 1 - assembly - residual - potential;
    bench.counters["newton_iterations"] = iterations;
    bench.counters["krylov_per_newton"] = result.krylov_iterations / iterations;
  }
}

// PETSc's options for as long as it lives.
class Options {
 public:
  explicit Options(const std::string& text) : text_(text) {
    PetscCallAbort(PETSC_COMM_WORLD, PetscOptionsInsertString(nullptr, text.c_str()));
  }
  ~Options() {
    std::istringstream words(text_);
    for (std::string word; words >> word;)
      if (word[0] == '-') PetscOptionsClearValue(nullptr, word.c_str());
  }
  Options(const Options&) = delete;
  Options& operator=(const Options&) = delete;

 private:
  std::string text_;
};

struct Preconditioner {
  const char* name;
  std::string options;
  bool matrix_free = false;
};

// A whole solve with a preconditioner against that with Jacobi's, in turns.
template <int Dim>
void bench_preconditioner(benchmark::State& bench, const Communicator& communicator, Case c,
                          const Preconditioner& preconditioner) {
  ImplicitBlock<Dim> usual(communicator, c);
  c.matrix_free = preconditioner.matrix_free;
  std::unique_ptr<ImplicitBlock<Dim>> block;
  {
    const Options options(preconditioner.options);
    block = std::make_unique<ImplicitBlock<Dim>>(communicator, c);
  }
  NewtonResult result, with_jacobi;
  for (auto unused : bench) {
    (void)unused;
    block->prepare();
    usual.prepare();
    const auto times = time_in_turns(communicator, 1,
                                     {[&] {
                                        const Options options(preconditioner.options);
                                        block->prepare();
                                        result = block->solve();
                                      },
                                      [&] {
                                        usual.prepare();
                                        with_jacobi = usual.solve();
                                      }});
    bench.SetIterationTime(median(times[0]));
    bench.counters["ranks"] = communicator.size();
    bench.counters["unknowns"] = usual.unknowns();
    bench.counters["newton_iterations"] = result.iterations;
    bench.counters["krylov_iterations"] = result.krylov_iterations;
    bench.counters["jacobi_krylov_iterations"] = with_jacobi.krylov_iterations;
    bench.counters["ns_per_unknown"] = 1e9 * median(times[0]) * communicator.size() / usual.unknowns();
    bench.counters["speed_over_jacobi"] = median_ratio(times, 1, 0);
    for (const auto& [name, of] : {std::pair{preconditioner.name, &result}, {"jacobi", &with_jacobi}})
      if (!of->converged)
        bench.SkipWithError(fmt::format("with {} Newton's method ends after {} iterations: {}", name,
                                        of->iterations, of->reason)
                                .c_str());
  }
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  struct Size {
    const char* name;
    int dimension, cells;
  };
  const std::vector<Size> sizes =
      options.small
          ? std::vector<Size>{{"3d_2k", 3, 6}, {"2d_1k", 2, 20}}
          : std::vector<Size>{{"3d_15k", 3, 14}, {"2d_13k", 2, 78}, {"3d_108k", 3, 30}, {"2d_103k", 2, 224}};
  for (const Size& size : sizes) {
    if (!options.small && size.cells < (size.dimension == 3 ? 30 : 224)) continue;
    const Case c{size.dimension, size.cells};
    add_case(fmt::format("assembly/{}", size.name), [&communicator, c](benchmark::State& bench) {
      with_dimension(c.dimension, [&](auto dim) { bench_assembly<dim>(bench, communicator, c); });
    });
    for (const bool matrix_free : {false, true})
      for (const Real step : {10.0, 100.0}) {
        if (step > 10 && (options.small || matrix_free)) continue;
        Case other = c;
        other.matrix_free = matrix_free;
        other.step = step;
        add_case(fmt::format("iteration/{}/{}/step_{}", matrix_free ? "matrix_free" : "assembled", size.name,
                             step),
                 [&communicator, other](benchmark::State& bench) {
                   with_dimension(other.dimension,
                                  [&](auto dim) { bench_iteration<dim>(bench, communicator, other); });
                 });
      }
  }
  const std::vector<Preconditioner> preconditioners = {
      {"jacobi", ""},
      {"pbjacobi", "-newton_pc_type pbjacobi"},
      {"bjacobi_icc", "-newton_pc_type bjacobi -newton_sub_pc_type icc"},
      {"gamg", "-newton_pc_type gamg"},
      {"matrix_free", "", true}};
  for (const Preconditioner& p : preconditioners)
    for (const Size& size : sizes)
      for (const Real step : {1.0, 10.0, 100.0})
        for (const Real poisson : {0.3, 0.49}) {
          const Case c{size.dimension, size.cells, step, poisson};
          add_case(fmt::format("preconditioner/{}/{}/nu_{}/step_{}", p.name, size.name, poisson, step),
                   [&communicator, c, p](benchmark::State& bench) {
                     with_dimension(c.dimension,
                                    [&](auto dim) { bench_preconditioner<dim>(bench, communicator, c, p); });
                   });
        }
}

}  // namespace

int main(int argc, char** argv) { return run_benchmarks(argc, argv, register_cases); }
