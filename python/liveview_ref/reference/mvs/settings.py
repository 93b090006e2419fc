"""What the search and the surface are tuned by: the one place of every number of mvs that is not a stage's own."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Names and defaults as in the library."""

    neighbours: int = 4
    extra: int = 2
    further: int = 0
    judges: int = 6
    spacing: float = 1.0
    radius: int = 0
    fine_radius: int = 0
    full: bool = True
    parts: int = 2
    step: float = 0.01
    jump: float = 0.12
    edge: float = 0.05
    agree: float = 2.0
    past: float = 4.0
    hides: float = 4.0
    second: bool = True
    searched: bool = True
    fuse: float = 2.0
    votes: float = 1.0
    refine: int = 1
    refine_radius: int = 1
    stay: float = 2e-5
