"""8-bit pictures."""

import numpy as np
from PIL import Image


def to_u8(colours: np.ndarray) -> np.ndarray:
    """Values in [0, 1] (clamped) -> 0 to 255, rounding halves up like the Rust crate's PNG
    writer."""
    return (np.clip(colours, 0, 1) * 255 + 0.5).astype(np.uint8)


def picture(image) -> Image.Image:
    """A tensor [3, H, W] in [0, 1] as a picture."""
    return Image.fromarray(to_u8(image.permute(1, 2, 0).numpy()))
