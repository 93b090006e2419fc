"""The methods of the comparison: what is trained, for how many views."""

from collections.abc import Callable
from dataclasses import dataclass

from .method import Method
from .methods.liveview import from_agreement, input_centred, liveview


@dataclass(frozen=True)
class Entry:
    """`planes`: the numbers that it can render with; the largest is what it is trained on."""

    name: str
    views: int
    build: Callable[[int], Method]  # by the number of views
    planes: tuple[int, ...] = (8, 16, 32, 64)
    trained: bool = True

    @property
    def key(self) -> str:
        """Names its folder and its files."""
        return f"{self.name}_v{self.views}"


ENTRIES = [
    Entry("liveview", 4, liveview),
    Entry("liveview", 5, liveview),
    Entry("input_centred", 5, input_centred),
    Entry("liveview_from_agreement", 4, from_agreement),
    Entry("liveview", 10, liveview),
]


def entry(key: str) -> Entry:
    """The entry of that key, such as `liveview_v4`."""
    return {e.key: e for e in ENTRIES}[key]
