"""The methods of the comparison: which networks are trained, for how many views."""

from collections.abc import Callable
from dataclasses import dataclass

from .deepview import deepview
from .light_field_fusion import light_field_fusion
from .liveview import competing, from_agreement, input_centred, liveview
from .local_light_field import local_light_field, target_centred
from .method import Method
from .program import surface, surface_without_network
from .soft3d import soft3d
from .stereo_magnification import stereo_magnification

PLANES = (8, 16, 32, 64)


@dataclass(frozen=True)
class Entry:
    """A method for one number of views; `planes`: the numbers of planes that it can render with."""

    name: str
    views: int
    build: Callable[[int], Method]  # by the number of views
    planes: tuple[int, ...] = PLANES
    weights: str | None = None  # the entry whose weights it renders with; its own if None
    trained: bool = True
    fewer: int | None = None  # planes of its training, if not the most that it can render with

    @property
    def training_planes(self) -> int:
        return self.fewer or max(self.planes)

    def planes_of(self, training: dict) -> int:
        """Planes of a training of it, by its checkpoint; the oldest lack them."""
        return training.get("planes", self.training_planes)

    @property
    def key(self) -> str:
        """The name of its folder and its results."""
        return f"{self.name}_v{self.views}"

    @property
    def weights_key(self) -> str:
        """The entry whose weights it renders with."""
        return self.weights or self.key


ENTRIES = [
    Entry("liveview", 4, liveview),
    Entry("liveview", 5, liveview),
    Entry("liveview", 10, liveview),
    Entry("local_light_field", 5, local_light_field),
    Entry("stereo_magnification", 5, stereo_magnification, planes=(64,)),
    Entry("input_centred", 5, input_centred),
    Entry("local_light_field_at_target", 5, target_centred),
    Entry("deepview", 4, deepview, planes=PLANES[:3]),
    Entry("input_centred", 4, input_centred),
    Entry("input_centred", 10, input_centred),
    Entry("local_light_field", 4, local_light_field),
    Entry("local_light_field", 10, local_light_field),
    Entry("local_light_field_at_target", 4, target_centred),
    Entry("local_light_field_at_target", 10, target_centred),
    Entry("liveview_on_16", 5, liveview, fewer=16),
    Entry("liveview_on_32", 5, liveview, fewer=32),
    Entry("local_light_field_at_target_on_16", 5, target_centred, fewer=16),
    Entry("local_light_field_at_target_on_32", 5, target_centred, fewer=32),
    Entry("liveview_from_agreement", 4, from_agreement),
    Entry("liveview_competing", 4, competing),
    Entry("soft3d", 4, soft3d, trained=False),
    Entry("liveview_surface", 4, surface, planes=(2,), trained=False),
    Entry("liveview_no_network", 4, surface_without_network, planes=(3,), trained=False),
    Entry("light_field_fusion", 10, light_field_fusion, weights="local_light_field_v5", trained=False),
]


def entry(key: str) -> Entry:
    """The entry of that key, such as `liveview_v4`."""
    return {e.key: e for e in ENTRIES}[key]
