"""Competing planes: the formula, the same picture as an MPI, and gradients."""

import numpy as np
import pytest
import torch

from liveview_ref.reference.composite import composite
from liveview_ref.reference.render.composite_competing import (
    alphas_of,
    best_layer,
    competing_weights,
    composite_competing,
)


def layers(count=7, size=(5, 6), seed=0, dtype=torch.float64):
    g = torch.Generator().manual_seed(seed)
    logit = torch.randn(count, *size, generator=g, dtype=dtype) * 4
    rgb = torch.rand(count, 3, *size, generator=g, dtype=dtype)
    covered = torch.rand(count, *size, generator=g) < 0.7
    covered[:, 0, 0] = False  # a pixel that no layer covers
    maps = torch.linspace(1, 0.1, count, dtype=dtype)[:, None, None].expand(-1, *size)
    return logit, rgb, covered, maps


@pytest.mark.parametrize("scale", [1.0, 2.5])
def test_weights_are_the_softmax_over_the_covered_layers(scale):
    logit, rgb, covered, maps = layers()
    found = composite_competing(logit, rgb, covered, maps, scale)
    for y in range(5):
        for x in range(6):
            terms = [
                np.exp(scale * float(a)) if c else 0.0 for a, c in zip(logit[:, y, x], covered[:, y, x], strict=True)
            ]
            weights = np.array(terms) / (sum(terms) or 1.0)
            np.testing.assert_allclose(found.weights[:, y, x].numpy(), weights, rtol=1e-12, atol=1e-300)
            np.testing.assert_allclose(found.rgb[:, y, x].numpy(), weights @ rgb[:, :, y, x].numpy(), rtol=1e-12)
            np.testing.assert_allclose(float(found.disparity[y, x]), weights @ maps[:, y, x].numpy(), rtol=1e-12)
            assert float(found.transmittance[y, x]) == (0.0 if sum(terms) else 1.0)


def test_alphas_give_the_same_picture_front_to_back():
    logit, rgb, covered, maps = layers()
    found = composite_competing(logit, rgb, covered, maps)
    # the background is opaque where covered, as in the composite: the alpha of the last covered
    # layer is 1 by itself
    mpi = composite(alphas_of(found.weights), rgb, torch.zeros_like(covered[0]), maps)
    torch.testing.assert_close(mpi.rgb, found.rgb, rtol=1e-12, atol=1e-13)
    torch.testing.assert_close(mpi.disparity, found.disparity, rtol=1e-12, atol=1e-13)
    torch.testing.assert_close(mpi.transmittance, found.transmittance, rtol=1e-12, atol=1e-12)


def test_extreme_logits_and_ties_give_finite_weights():
    covered = torch.ones(3, 1, 1, dtype=torch.bool)
    for values, expected in (
        ([3e38, -3e38, 0], [1, 0, 0]),
        ([torch.inf, torch.inf, -torch.inf], [0.5, 0.5, 0]),
        ([-3e38, -3e38, -3e38], [1 / 3] * 3),
    ):
        weights = competing_weights(torch.tensor(values)[:, None, None], covered, 4.0)
        torch.testing.assert_close(weights.flatten(), torch.tensor(expected, dtype=torch.float32))


def test_best_layer_has_the_largest_weight():
    logit, rgb, covered, maps = layers()
    found, weights = best_layer(logit, covered), competing_weights(logit, covered)
    assert torch.equal(found[covered.any(0)], weights.argmax(0)[covered.any(0)])
    assert found[0, 0] == -1
    tied = torch.tensor([1.0, 2.0, 2.0, torch.inf])[:, None, None]
    assert best_layer(tied, torch.tensor([True, True, True, False])[:, None, None]).item() == 1


def test_gradients_agree_with_finite_differences():
    logit, rgb, covered, maps = layers(4, (2, 3))
    logit.requires_grad_(), rgb.requires_grad_()
    assert torch.autograd.gradcheck(lambda a, c: composite_competing(a, c, covered, maps).rgb, (logit, rgb))
