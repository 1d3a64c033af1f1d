"""The spatially partitioned renderer: Embree finds the hits, compiled kernels do the rest."""
