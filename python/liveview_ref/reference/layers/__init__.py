"""Layers: disparity per target pixel, near -> far, and the ways to choose them."""
