"""What the search and the surface are tuned by: the one place of every number of mvs that is not a stage's own."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Names and defaults as in the library."""

    neighbours: int = 5
    extra: int = 2
    spacing: float = 1.0
    parts: int = 2
    step: float = 0.01
    jump: float = 0.12
    edge: float = 0.05
    agree: float = 2.0
    past: float = 4.0
    fuse: float = 3.0
    search_holes: float = 0.05
    hides: float = 4.0
