"""The median of each cell's 3x3 neighbourhood, edges held."""

from ..guided import median3

__all__ = ["median3"]
