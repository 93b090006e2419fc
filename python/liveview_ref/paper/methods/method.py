"""The interface of every method of the comparison."""

from dataclasses import dataclass

from torch import Tensor, nn

from liveview_ref.reference.liveview import Camera


@dataclass(frozen=True)
class Photos:
    """V posed photos: images [3, Hs, Ws] in [0, 1] and their cameras, in the rig's order;
    `references` are the indices of the photos at which a method that is not target-centred builds
    its multiplane image (two for fusion)."""

    images: list[Tensor]
    cameras: list[Camera]
    references: tuple[int, ...]


@dataclass
class Rendering:
    """rgb [3, H, W] of the target, and valid [H, W]: the pixels that every plane covers (all,
    unless a crop's multiplane image ends inside the target). alpha [D, h, w] of the planes and the
    camera that they are aligned with, for supervision by a known depth; None if a method has
    none."""

    rgb: Tensor
    valid: Tensor
    alpha: Tensor | None = None
    camera: Camera | None = None


class Method(nn.Module):
    """A way to render a target view from posed photos. A method without weights is a
    Method without parameters.

    cover: whether a multiplane image that is not built at the target is enlarged until all of
    its planes cover all pixels of the target; training on crops does without, and leaves out
    the other pixels."""

    def forward(self, photos: Photos, target: Camera, disparities: Tensor, cover: bool = True) -> Rendering:
        """The target's view on planes at these disparities [D] (1/scene unit), near to far."""
        raise NotImplementedError

    def batch(self, examples: list[tuple[Photos, Camera, Tensor]]) -> list[Rendering]:
        """Several crops at once, each with its planes, for training: a batch of a network with
        BatchNorm must mix scenes."""
        return [self(*example, cover=False) for example in examples]


class Predictor(nn.Module):
    """A network that makes a multiplane image from photos warped onto its planes, at any camera."""

    def forward(self, volume: Tensor, coverage: Tensor, distances: Tensor) -> tuple[Tensor, Tensor]:
        """volume [D, V, 3, H, W], coverage [D, V, H, W], distances [V] of the photos from the
        camera; H and W are multiples of 16 -> alpha [D, H, W], rgb [D, 3, H, W], near to far; the
        caller makes the farthest plane opaque."""
        raise NotImplementedError

    def batch(self, volumes: list[tuple[Tensor, Tensor, Tensor]]) -> list[tuple[Tensor, Tensor]]:
        """Several volumes; a network with BatchNorm overrides this with one pass over all of
        them."""
        return [self(*volume) for volume in volumes]
