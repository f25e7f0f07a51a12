// Frames and checkpoints: speed over the disk's plain write and read of as many bytes, and over HDF5 on rank 0 alone.
#include "elastic_block.hpp"
#include "harness.hpp"
#include "mpm_hpc/io/checkpoint.hpp"
#include "plain_files.hpp"

namespace {

using namespace mpm;

int rounds_of(const BenchOptions& options) { return options.small ? 1 : 5; }

// A folder for the files, which goes with its owner. Collective.
class Folder {
 public:
  Folder(const Communicator& communicator, const BenchOptions& options)
      : communicator_(communicator), path_(std::filesystem::path(options.directory) / "bench_io_files") {
    if (communicator_.root()) std::filesystem::create_directories(path_);
    communicator_.barrier();
  }
  ~Folder() {
    communicator_.barrier();
    std::error_code ignored;
    if (communicator_.root()) std::filesystem::remove_all(path_, ignored);
  }
  const std::filesystem::path& path() const { return path_; }

 private:
  const Communicator& communicator_;
  std::filesystem::path path_;
};

// The datasets of a frame, made in a simple way.
std::vector<GatheredColumn> simple_frame(const State<3>& state, const std::vector<DerivedField>& derived) {
  const Body<3>& body = state.bodies[0];
  const FieldSet& f = body.particles;
  std::vector<GatheredColumn> columns = {
      {"Points", H5T_NATIVE_DOUBLE, 3,
       [&body, &f] {
         return rows_of<double>(body, 3, [&](Index p, int c) { return f.data<Real>(core::position, c)[p]; });
       }},
      {"Connectivity", H5T_NATIVE_INT64, 1,
       [&body, &f] { return rows_of<std::int64_t>(body, 1, [n = 0](Index, int) mutable { return n++; }); }},
      {"Offsets", H5T_NATIVE_INT64, 1,
       [&body, &f] { return rows_of<std::int64_t>(body, 1, [n = 0](Index, int) mutable { return n++; }); }},
      {"Types", H5T_NATIVE_UINT8, 1,
       [&body, &f] { return rows_of<std::uint8_t>(body, 1, [](Index, int) { return 1; }); }},
      {"body", H5T_NATIVE_INT32, 1,
       [&body, &f] { return rows_of<std::int32_t>(body, 1, [](Index, int) { return 0; }); }},
      {"id", H5T_NATIVE_INT64, 1,
       [&body, &f] {
         return rows_of<std::int64_t>(body, 1,
                                      [&](Index p, int) { return f.data<GlobalIndex>(core::id)[p]; });
       }},
      {"velocity", H5T_NATIVE_FLOAT, 3, [&body, &f] {
         return rows_of<float>(body, 3, [&](Index p, int c) { return f.data<Real>(core::velocity, c)[p]; });
       }}};
  for (const DerivedField& field : derived)
    columns.push_back({field.name, H5T_NATIVE_FLOAT, 1, [&body, &f, &field] {
                         std::vector<Real> values(static_cast<std::size_t>(f.size()));
                         field.fill(0, 0, f.size(), values.data());
                         return rows_of<float>(body, 1, [&](Index p, int) { return values[p]; });
                       }});
  return columns;
}

// The columns of a checkpoint, made in a simple way: in the order of the ranks, without checksums.
std::vector<GatheredColumn> simple_checkpoint(const State<3>& state) {
  const Body<3>& body = state.bodies[0];
  const FieldSet& f = body.particles;
  std::vector<GatheredColumn> columns;
  for (FieldId id = 0; id < f.count(); ++id) {
    const int components = f.traits(id).components;
    if (id == core::id) {
      columns.push_back({"id", H5T_NATIVE_INT64, 1, [&body, &f] {
                           return rows_of<GlobalIndex>(
                               body, 1, [&f](Index p, int) { return f.data<GlobalIndex>(core::id)[p]; });
                         }});
    } else {
      columns.push_back({f.traits(id).name, H5T_NATIVE_DOUBLE, components, [&body, &f, id, components] {
                           return rows_of<double>(
                               body, components, [&f, id](Index p, int c) { return f.data<Real>(id, c)[p]; });
                         }});
    }
  }
  return columns;
}

// times[0] is the program's, times[1] the disk's, times[2], if there, that of HDF5 on rank 0.
void report(benchmark::State& bench, const Communicator& communicator, const State<3>& state,
            std::uint64_t bytes, const std::vector<std::vector<double>>& times) {
  bench.counters["particles"] = static_cast<double>(count_particles(state));
  bench.counters["ranks"] = communicator.size();
  bench.counters["mb"] = 1e-6 * static_cast<double>(bytes);
  bench.counters["gb_per_s"] = 1e-9 * static_cast<double>(bytes) / median(times[0]);
  bench.counters["plain_gb_per_s"] = 1e-9 * static_cast<double>(bytes) / median(times[1]);
  bench.counters["over_plain"] = median_ratio(times, 1, 0);
  if (times.size() > 2) bench.counters["over_gathered"] = median_ratio(times, 2, 0);
  bench.SetIterationTime(median(times[0]));
}

void bench_frame(benchmark::State& bench, const Communicator& communicator, const BenchOptions& options,
                 int cells, bool sync) {
  const Folder folder(communicator, options);
  ElasticBlock<3> block(communicator, {.cells = cells});
  block.steps(2);
  State<3>& state = block.state();
  const std::vector<DerivedField> derived = derived_fields(state);
  FrameWriter<3> writer(communicator, folder.path(), {});
  writer.write(0, 0, state.bodies, derived);
  const std::uint64_t bytes = std::filesystem::file_size(writer.last());
  const std::vector<GatheredColumn> simple = simple_frame(state, derived);
  for (auto unused : bench) {
    (void)unused;
    report(
        bench, communicator, state, bytes,
        time_in_turns(communicator, rounds_of(options),
                      {[&] {
                         writer.write(0, 0, state.bodies, derived);  // replaces the frame of the same time
                         if (sync) PlainFile(writer.last(), O_WRONLY).sync();
                       },
                       [&] { write_plainly(communicator, folder.path() / "plain", bytes, sync); },
                       [&] { write_gathered(communicator, folder.path() / "gathered.h5", simple, sync); }}));
  }
}

void bench_checkpoint(benchmark::State& bench, const Communicator& communicator, const BenchOptions& options,
                      int cells, bool reads) {
  const Folder folder(communicator, options);
  ElasticBlock<3> block(communicator, {.cells = cells});
  State<3>& state = block.state();
  CheckpointState saved;
  saved.owners = state.distribution.decomposition().owners();
  const std::filesystem::path file =
      write_checkpoint(communicator, folder.path(), saved, state.bodies, state.precision);
  const std::uint64_t bytes = std::filesystem::file_size(file);
  const std::vector<GatheredColumn> simple = simple_checkpoint(state);
  std::vector<std::function<void()>> variants;
  std::vector<Body<3>> bodies;  // where it is read into
  if (reads) {
    bodies.emplace_back(state.bodies[0].name, 0, state.precision);
    variants = {[&] { read_checkpoint(communicator, file, bodies, state.precision); },
                [&] { read_plainly(communicator, file); }};
  } else {
    variants = {[&] { write_checkpoint(communicator, folder.path(), saved, state.bodies, state.precision); },
                [&] { write_plainly(communicator, folder.path() / "plain", bytes, true); },
                [&] { write_gathered(communicator, folder.path() / "gathered.h5", simple, true); }};
  }
  for (auto unused : bench) {
    (void)unused;
    report(bench, communicator, state, bytes, time_in_turns(communicator, rounds_of(options), variants));
  }
}

void register_cases(const Communicator& communicator, const BenchOptions& options) {
  struct Size {
    const char* name;
    int cells;
  };
  std::vector<Size> sizes = {{"512k", 40}};
  if (options.small) sizes = {{"8k", 10}};
  if (options.large) sizes.push_back({"4M", 80});
  for (const Size& size : sizes) {
    for (const bool sync : {false, true})
      add_case(fmt::format("frame/{}/{}", sync ? "synced" : "cached", size.name),
               [=, &communicator](benchmark::State& bench) {
                 bench_frame(bench, communicator, options, size.cells, sync);
               });
    for (const bool reads : {false, true})
      add_case(fmt::format("checkpoint/{}/{}", reads ? "read" : "write", size.name),
               [=, &communicator](benchmark::State& bench) {
                 bench_checkpoint(bench, communicator, options, size.cells, reads);
               });
  }
}

}  // namespace

int main(int argc, char** argv) { return mpm::run_benchmarks(argc, argv, register_cases); }
