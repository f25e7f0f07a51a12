// A crack that runs through a clamped strip (Rivlin and Thomas 1953): what it pays per length is W(u), the energy per length far
// ahead of it.
#include "support/clamped_strip.hpp"

#include "mpm_hpc/effects/phase_field/crack_cost.hpp"
#include "support/cracked_column.hpp"
#include "support/verification.hpp"

using namespace mpm;

namespace {

const std::string section = "6 fracture";

TEST(ClampedStrip, CorrectionOfTheToughness) {
  for (const KernelKind kind : {KernelKind::linear, KernelKind::quadratic, KernelKind::cubic})
    for (const bool lumped : {false, true})
      for (const Real length : {0.5, 1.0, 2.0}) {
        const Real cost = with_kernel(kind, [&](auto kernel) {
          return test::CrackedColumn<decltype(kernel)>(80, length, lumped, 2, 0.5, 1e-6).threshold().cost;
        });
        test::verify(
            section,
            fmt::format(
                "energy of a strip broken through over the corrected toughness, {} kernel, {}, l0/h = {}",
                kernel_names[static_cast<int>(kind)], lumped ? "lumped" : "consistent", length),
            cost / (1 + crack_cost(kind, lumped, CrackShape::running) / length), test::within(1, 0.07));
      }
}

// Below the load at which breaking the strip pays the crack stays; at 1.14 times it, it runs. Between the two the turns of
// displacements and c take ever more steps per cell.
TEST(ClampedStrip, RunsAtTheLoadThatPays) {
  for (const test::ClampedStrip& strip :
       {test::ClampedStrip{}, test::ClampedStrip{.length_scale = 1, .shift = 0.25}})
    test::check_load_of_running(section, strip);
}

}  // namespace
