"""The parts of mpm_view: frames, quantities, projections, pages, curves."""
