"""Guided layers: a coarse-to-fine search gives each pixel its own range of disparities, which the
layers divide."""
