"""PSNR and SSIM of images [3, H, W] in [0, 1]."""

import torch
import torch.nn.functional as F
from torch import Tensor


def psnr(image: Tensor, truth: Tensor) -> float:
    """Peak signal-to-noise ratio in dB over all channels."""
    return float(-10 * torch.log10(((image - truth) ** 2).mean()))


def ssim(image: Tensor, truth: Tensor) -> float:
    """Mean SSIM per channel (Wang 2004): Gaussian window of sigma 1.5 and 11x11 pixels,
    only where the window fits; equal to skimage's
    structural_similarity(gaussian_weights=True, sigma=1.5, use_sample_covariance=False)."""
    x = torch.arange(-5, 6, dtype=torch.float64)
    g = torch.exp(-(x**2) / (2 * 1.5**2))
    g = (g / g.sum()).to(image.dtype)

    def blur(t: Tensor) -> Tensor:
        t = F.conv2d(t[:, None], g[None, None, :, None])
        return F.conv2d(t, g[None, None, None, :])[:, 0]

    mx, my = blur(image), blur(truth)
    vx, vy, cov = blur(image**2) - mx**2, blur(truth**2) - my**2, blur(image * truth) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    return float((((2 * mx * my + c1) * (2 * cov + c2)) / ((mx**2 + my**2 + c1) * (vx + vy + c2))).mean())
