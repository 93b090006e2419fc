"""What every method of the comparison is given and gives back."""

from dataclasses import dataclass

from torch import Tensor, nn

from ..reference.geometry.camera import Camera


@dataclass(frozen=True)
class Photos:
    """V posed photos: images [3, Hs, Ws] in [0, 1] and their cameras, in the rig's order; `references` are the indices
    of those at whose place a method that is not target-centred builds its multiplane image (two for fusion)."""

    images: list[Tensor]
    cameras: list[Camera]
    references: tuple[int, ...]


@dataclass
class Rendering:
    """rgb [3, H, W] of the target, and valid [H, W]: the pixels that every plane could reach (all, unless a crop's
    multiplane image ends inside the target). alpha [D, h, w] of the planes and the camera that they are aligned with,
    for supervision by a known depth; None where a method has no such thing."""

    rgb: Tensor
    valid: Tensor
    alpha: Tensor | None = None
    camera: Camera | None = None


class Method(nn.Module):
    """A way to render a target view from posed photos. A method without weights is a Method without parameters.

    cover: whether a multiplane image that is not built at the target is made larger than the target, so that all of its
    planes reach all of the target's pixels; training on crops goes without and leaves out what is not reached."""

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        """The target's view on planes at these disparities [D] (1/scene unit), near to far."""
        raise NotImplementedError

    def batch(self, examples: list[tuple[Photos, Camera, Tensor]]) -> list[Rendering]:
        """Several crops at once, each with its planes, for training: networks with BatchNorm must see scenes mixed."""
        return [self(*example, cover=False) for example in examples]


class Predictor(nn.Module):
    """A network that makes a multiplane image from photos warped onto its planes, at whatever camera these are."""

    def forward(self, volume: Tensor, coverage: Tensor, distances: Tensor) -> tuple[Tensor, Tensor]:
        """volume [D, V, 3, H, W], coverage [D, V, H, W], distances [V] of the photos from the camera; H and W are
        multiples of 16 -> alpha [D, H, W], rgb [D, 3, H, W], near to far; the caller makes the farthest opaque."""
        raise NotImplementedError

    def batch(self, volumes: list[tuple[Tensor, Tensor, Tensor]]) -> list[tuple[Tensor, Tensor]]:
        """Several at once; a network with BatchNorm overrides this with one pass over all of them."""
        return [self(*volume) for volume in volumes]
