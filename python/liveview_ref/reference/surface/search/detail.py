"""How large the finest detail of a photo is: an enlarged or soft photo has none of one pixel."""

from torch import Tensor

from liveview_ref.reference.layers.guided.matching_cost import shrink

SOFT_SHARE = 0.22  # of the detail at half the size, below which that size has all the detail
MIN_SIDE = 240  # pixels; shorter side of the smallest photo


def detail_pixels(photo: Tensor) -> int:
    """Pixels a side of the finest detail of a photo [3, h, w]: a power of two.

    While a photo's detail is below SOFT_SHARE of that of the photo at half its size, the smaller
    one takes its place.
    """
    pixels, half = 1, shrink(photo, 2)
    while min(half.shape[1:]) >= MIN_SIDE and mean_square_detail(photo) < SOFT_SHARE * mean_square_detail(half):
        pixels, photo, half = 2 * pixels, half, shrink(half, 2)
    return pixels


def mean_square_detail(photo: Tensor) -> Tensor:
    """Mean square, over the inner pixels, of 4 times a pixel's grey less its four neighbours."""
    grey = photo.mean(0)
    inner = 4 * grey[1:-1, 1:-1]
    detail = inner - grey[1:-1, :-2] - grey[1:-1, 2:] - grey[:-2, 1:-1] - grey[2:, 1:-1]
    return (detail**2).mean()
