"""Photos of noise, to test the paper's comparison on."""

import torch

from liveview_ref.paper.data.shots import Shot
from liveview_ref.paper.methods.method import Photos
from liveview_ref.reference.liveview import Camera, uniform_disparities

WIDTH, HEIGHT = 64, 48


def camera(x: float, y: float = 0.0) -> Camera:
    k = torch.tensor([[60.0, 0, WIDTH / 2], [0, 60.0, HEIGHT / 2], [0, 0, 1]], dtype=torch.float64)
    return Camera(k, torch.eye(3).double(), torch.tensor([-x, -y, 0]).double(), WIDTH, HEIGHT)


def toy(views: int = 4, seed: int = 0, name: str = "0000") -> Shot:
    """A target among photos of noise."""
    generator = torch.Generator().manual_seed(seed)
    places = [(-0.1, -0.1), (-0.1, 0.1), (0.1, -0.1), (0.1, 0.1), (0.0, 0.0)][:views]
    images = [torch.rand(3, HEIGHT, WIDTH, generator=generator) for _ in places]
    truth = torch.rand(3, HEIGHT, WIDTH, generator=generator)
    photos = Photos(images, [camera(*place) for place in places], (0,))
    disparity = torch.full((HEIGHT, WIDTH), 0.2)
    disparity[20:30, 40:] = 0.9
    return Shot(name, "0", photos, camera(0.02, 0.01), truth, lambda n: uniform_disparities(1, 10, n), disparity)
