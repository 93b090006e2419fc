"""Stiff and extreme cases in torch, kornia and onnxruntime, for `liveview stability SCENE
--reference "python -m liveview_ref.parity.stability"`.

One JSON object per line, in and out:

    out  {"ready": true}
    in   {"case": FILE.npz, "stage": NAME, "model": FILE.onnx, "bound": 1e-6}
    out  {"torch": {"largest": x, "doubtful": y}, "kornia": ..., "onnxruntime": ..., "oracle": z}

`largest` is the largest error against the case's float64 truth outside doubtful pixels, null if any
value is not finite; `doubtful` the share of the doubtful pixels whose error exceeds the bound. An
implementation without this stage is left out. `oracle`: the error of the truth itself against 50
digits, at some pixels. The truth of the network is computed here, so its reply has `rust` as well,
and whether Rust's logits are bit by bit `equal` to onnxruntime's.
"""

import functools
import json
import sys
from pathlib import Path
from typing import TextIO

import numpy as np
import torch

from ..checkpoint import exported_network
from ..json_lines import run
from ..onnx_session import session
from ..reference.composite import composite
from ..reference.layers.histogram import plane_histogram, select_planes
from ..reference.render.blend import blend
from ..reference.render.composite_competing import composite_competing
from ..reference.warp import warp_maps
from ..rig_arrays import Arrays, cameras_of, images_of
from . import fifty_digits, stability_graphs
from .kornia_warp import kornia_samples

CHECKED_PIXELS = 12  # of each case, computed in 50 digits

Outputs = dict[str, np.ndarray]


def errors(found: Outputs, data: Arrays, bound: float) -> dict:
    doubtful = data["doubtful"]
    off = np.zeros(len(doubtful), bool)
    largest = 0.0
    for name, values in found.items():
        truth = data[f"truth.{name}"]
        scale = data[f"scale.{name}"][0]
        error = (np.abs(values.astype(np.float64).ravel() - truth) / scale).reshape(-1, len(doubtful))
        if not np.isfinite(error).all():
            largest = None
            break
        largest = max(largest, float(error[:, ~doubtful].max(initial=0.0)))
        off |= (error > bound).any(0) & doubtful
    return {"largest": largest, "doubtful": float(off.sum() / max(doubtful.sum(), 1))}


def warp(data: Arrays, model: str) -> dict[str, Outputs]:
    (source,), target = cameras_of(data)
    (image,) = images_of(data, torch.float32)
    disparity = float(data["disparities"][0])
    size = target.height, target.width
    colour, coverage = warp_maps(image, source, target, torch.full((1, *size), disparity))
    kornia = kornia_samples(image, source, target, disparity, size).numpy()
    graph = stability_graphs.warp(image, source, target, disparity)
    rgbc = {"torch": (colour.numpy(), coverage.numpy()), "kornia": (kornia[:3], kornia[3]), "onnxruntime": graph}
    return {name: {"colour": colour, "coverage": coverage} for name, (colour, coverage) in rgbc.items()}


def blended(data: Arrays, model: str) -> dict[str, Outputs]:
    inputs = stability_graphs.blend_inputs(data)
    found = {"torch": blend(*inputs), "onnxruntime": stability_graphs.blend(inputs)}
    return {name: {"alpha": np.asarray(alpha), "rgb": np.asarray(rgb)} for name, (alpha, rgb) in found.items()}


def composited(data: Arrays, model: str) -> dict[str, Outputs]:
    alpha, rgb, maps = (torch.from_numpy(data[name])[..., None, :] for name in ("alpha", "rgb", "maps"))
    covered = torch.full(alpha.shape[1:], bool(data["background"][0]))
    out = composite(alpha, rgb, covered, maps)
    found = {
        "torch": (out.rgb, out.disparity, out.transmittance),
        "onnxruntime": stability_graphs.composite(alpha, rgb, covered, maps),
    }
    names = ("frame", "disparity", "transmittance")
    return {who: {n: np.asarray(x) for n, x in zip(names, parts, strict=True)} for who, parts in found.items()}


def composited_competing(data: Arrays, model: str) -> dict[str, Outputs]:
    names = ("logits", "rgb", "covered", "maps")
    logits, rgb, covered, maps = (torch.from_numpy(data[name])[..., None, :] for name in names)
    out = composite_competing(logits, rgb, covered > 0, maps, float(data["alpha_scale"][0]))
    parts = {"frame": out.rgb, "disparity": out.disparity, "transmittance": out.transmittance}
    return {"torch": {name: values.numpy() for name, values in parts.items()}}


def selected(data: Arrays, model: str) -> dict[str, Outputs]:
    histogram = plane_histogram(torch.from_numpy(data["alpha"])[:, None])
    chosen = np.zeros(len(histogram))
    chosen[select_planes(histogram, int(data["count"][0]))] = 1
    return {"torch": {"histogram": histogram.numpy(), "selected": chosen}}


@functools.cache
def network(model: str):
    """The network in torch and in onnxruntime."""
    return exported_network(Path(model)), session(Path(model), 1)


@torch.inference_mode()
def inferred(data: Arrays, model: str) -> dict[str, Outputs]:
    net, in_graph = network(model)
    hwv = torch.from_numpy(data["colour"])
    truth = net.double()(hwv.double()).numpy()
    data |= {"truth.logits": truth.ravel(), "scale.logits": np.abs(truth).max(keepdims=True).ravel()}
    data |= {"doubtful": np.zeros(truth[0, 0].size, bool)}
    found = {
        "torch": net.float()(hwv).numpy(),
        "onnxruntime": in_graph.run(["logits"], {"hwv": data["colour"]})[0],
        "rust": data["rust.logits"].reshape(truth.shape),
    }
    return {name: {"logits": logits} for name, logits in found.items()}


def oracle_error(data: Arrays, pixel_of, names: tuple[str, ...]) -> float | None:
    """Largest error of the truth against 50 digits over some pixels that are not doubtful: half of
    them random, half random among those with a value other than 0. None if there are no such
    pixels, or the truth is that of other cameras."""
    doubtful = data["doubtful"]
    sure = np.flatnonzero(~doubtful)
    if not len(sure) or "meant" in data:
        return None
    parts = [data[f"truth.{name}"].reshape(-1, len(doubtful)) for name in names]
    scale = np.concatenate([np.full(len(part), data[f"scale.{n}"][0]) for n, part in zip(names, parts, strict=True)])
    truth = np.concatenate(parts)
    lit = sure[truth[:, sure].any(0)]
    rng = np.random.default_rng(0)
    picked = [rng.choice(some, min(CHECKED_PIXELS // 2, len(some)), replace=False) for some in (sure, lit)]
    worst = 0.0
    for pixel in np.concatenate(picked):
        digits = pixel_of(data, int(pixel))
        pairs = zip(digits, truth[:, pixel], scale, strict=True)
        worst = max(worst, *(float(abs(exact - float(found))) / top for exact, found, top in pairs))
    return worst


STAGES = {
    "warp": (warp, fifty_digits.warp, ("colour", "coverage")),
    "blend": (blended, fifty_digits.blend, ("alpha", "rgb")),
    "composite": (composited, fifty_digits.composite, ("frame", "disparity", "transmittance")),
    "composite_competing": (
        composited_competing,
        fifty_digits.composite_competing,
        ("frame", "disparity", "transmittance"),
    ),
    "select": (selected, None, ()),
    "network": (inferred, None, ()),
}


def answer(request: dict) -> dict:
    with np.load(request["case"]) as arrays:
        data = dict(arrays)
    implementations, pixel_of, names = STAGES[request["stage"]]
    found = implementations(data, request["model"])
    reply = {who: errors(outputs, data, request["bound"]) for who, outputs in found.items()}
    if "rust" in found:
        reply["equal"] = np.array_equal(found["rust"]["logits"], found["onnxruntime"]["logits"])
    return reply | ({"oracle": oracle_error(data, pixel_of, names)} if pixel_of else {})


def serve(requests: TextIO, replies: TextIO) -> None:
    torch.set_num_threads(1)
    print(json.dumps({"ready": True}), file=replies, flush=True)
    for line in requests:
        print(json.dumps(answer(json.loads(line))), file=replies, flush=True)


if __name__ == "__main__":
    sys.exit(run(serve))
