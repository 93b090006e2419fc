"""Training for uniform planes that compete: what train.py runs where a config says "alpha": "competing".

One process, one thread: it makes a shard of examples when it first needs it. All planes of an example go through the
network without gradients; the softmax and the picture of all of them give the loss and its gradient for each plane's
logit 0 and colour. Those go back through the network for some planes alone, drawn by how large they are and weighted by
one over the chance to be drawn, so that in the mean they are the gradients of all.
BatchNorm is folded into the convolutions first: over one scene at a time its statistics would be wrong, and it takes
a third of the time.
"""

import copy
import json
import signal
import time
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from .blend import blend, distance_bias
from .compete import compete, draw_layers
from .layers import uniform_planes
from .render import view_distances
from .select import plane_histogram, select_planes
from .shards import Photos, Shards
from .sweep import sweep_terms
from .unet import UNet, fold_batchnorm
from .validate import validate_competing
from .visible import SEEN, UNKNOWN, partly_hidden, weight_on_seen

CHUNK = 16  # planes at a time without gradients: what fits the cache


def unfolded(net: UNet) -> UNet:
    """A folded network with BatchNorms that change nothing, as checkpoints have them."""
    full = UNet(net.views).eval()
    full.conv9.load_state_dict(net.conv9.state_dict())
    for index in range(1, 9):
        convolution, norm = getattr(full, f"conv{index}")[:2]
        folded = getattr(net, f"conv{index}")[0]
        convolution.weight.data.copy_(folded.weight.data)
        norm.bias.data.copy_(folded.bias.data)
        norm.running_var.fill_(1 - norm.eps)
    return full


def warp_layers(photos: Photos, maps: Tensor) -> tuple[Tensor, Tensor]:
    """maps [L, H, W] (or [L, 1, 1]: planes) -> colour [L, V, 3, H, W], coverage [L, V, H, W]; as warp_views,
    from 8 bit."""
    height, width = photos.camera.height, photos.camera.width
    layers = len(maps)
    x, y = (torch.arange(n, dtype=torch.float64) + 0.5 for n in (width, height))
    colour, grid = torch.empty(layers, len(photos.views), 4, height, width), torch.empty(layers, height, width, 2)
    for v, (view, camera) in enumerate(zip(photos.views, photos.cameras, strict=True)):
        normal = torch.tensor([[2 / camera.width, 0, -1], [0, 2 / camera.height, -1], [0, 0, 1]], dtype=torch.float64)
        base, e = (normal @ term for term in sweep_terms(camera, photos.camera))
        rays = (base[:, 0, None, None] * x + base[:, 1, None, None] * y[:, None] + base[:, 2, None, None]).float()
        e = e.float()
        w = rays[2] + maps * e[2]
        w = torch.where(w > 0, w, torch.full_like(w, 1e-9))  # far outside
        torch.div(rays[0] + maps * e[0], w, out=grid[..., 0])
        torch.div(rays[1] + maps * e[1], w, out=grid[..., 1])
        image = torch.cat([view.float() / 255, torch.ones(1, *view.shape[1:])])[None]
        sampled = torch.nn.functional.grid_sample(image, grid.reshape(1, -1, width, 2), align_corners=False)
        colour[:, v] = sampled.reshape(4, layers, height, width).transpose(0, 1)
    return colour[:, :, :3], colour[:, :, 3]


def logits_of(net: UNet, colour: Tensor) -> Tensor:
    hwv = colour.flatten(1, 2).contiguous(memory_format=torch.channels_last)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        return net(hwv).float().contiguous()


def image_loss(image: Tensor, truth: Tensor, counted: Tensor, square: float) -> Tensor:
    """L1 plus half of the L1 of the image gradients, and `square` times the squared error, which is what PSNR looks at;
    [3, H, W], over the pixels that count [H, W]."""
    difference = (image - truth) * counted
    dx = difference[..., 1:] - difference[..., :-1]
    dy = difference[..., 1:, :] - difference[..., :-1, :]
    return difference.abs().mean() + 0.5 * (dx.abs().mean() + dy.abs().mean()) + square * (difference**2).mean()


def view_weights(logits: Tensor, coverage: Tensor, distances: Tensor) -> Tensor:
    """The blend's weights times coverage, normalised, [L, V, H, W]."""
    scores = torch.cat([torch.zeros_like(logits[:, :1]), logits[:, 1:]], 1)
    scores = scores + distance_bias(distances)[0].float()[:, None, None]
    return torch.softmax(scores.masked_fill(coverage <= 0, -1e4), 1)


def planes_for(rng: np.random.Generator, photos: Photos, config: dict) -> Tensor:
    near, far = photos.near * np.exp(rng.uniform(-0.2, 0.05)), photos.far * np.exp(rng.uniform(-0.05, 0.2))
    return uniform_planes(near, far, int(rng.choice(config["uniform_planes"]))).float()[:, None, None]


def example_loss(net: UNet, photos: Photos, rng: np.random.Generator, config: dict) -> tuple[Tensor, dict[str, float]]:
    """Loss with its gradient graph (where planes were drawn, a number with the gradient of the loss, not its value),
    and what the log tells of it."""
    distances = view_distances(photos.cameras, photos.camera).float()
    planes = planes_for(rng, photos, config)
    colour, coverage = warp_layers(photos, planes)
    # All planes with gradients cost less than some of them after a pass without, if there are few.
    drawn, selected = len(planes) > config["all_of"], False
    ids = torch.arange(len(planes))
    if drawn:
        selected = rng.random() < config["selected"]
        with torch.no_grad():
            logits = torch.cat([logits_of(net, part) for part in colour.split(CHUNK)])
            parts = zip(*(x.split(CHUNK) for x in (logits, colour, coverage)), strict=True)
            rgb = torch.cat([blend(*part, distances)[1] for part in parts])
            covered = (coverage > 0).any(1)
            if selected:  # as the renderer selects: the fullest bins, which compete anew
                weights = compete(logits[:, 0], rgb, covered, planes.expand_as(covered)).weights
                kept = select_planes(plane_histogram(weights), int(rng.choice(config["selected_planes"])))
                planes, colour, coverage, logits, rgb, covered = (
                    x[kept] for x in (planes, colour, coverage, logits, rgb, covered)
                )
        logit0, rgb = logits[:, 0].clone().requires_grad_(), rgb.requires_grad_()
        loss, image, told = outcome(logit0, rgb, covered, planes, photos, config, not selected)
        gradients = torch.autograd.grad(loss, (logit0, rgb))
        # What a plane's logits do to the loss: by its alpha, and by its colour, where views differ by some 0.2.
        mass = sum(w * g.flatten(1).norm(dim=1) for w, g in zip((1.0, 0.2), gradients, strict=True))
        ids, chance = draw_layers(mass, config["gradient_planes"], rng)
    own, extra = colour[ids], None
    if photos.disparity is not None:  # one more layer, along the true surface
        extra = warp_layers(photos, photos.disparity[None])
        own = torch.cat([own, extra[0]])
    found = logits_of(net, own)
    logit0, rgb = found[: len(ids), 0], blend(found[: len(ids)], colour[ids], coverage[ids], distances)[1]
    if drawn:
        loss = torch.zeros(())
        for x, gradient in zip((logit0, rgb), gradients, strict=True):
            loss = loss + (x * gradient[ids] / chance.reshape(-1, *[1] * (x.dim() - 1))).sum()
    else:
        loss, image, told = outcome(logit0, rgb, (coverage > 0).any(1), planes, photos, config, True)
    if extra is not None:
        more, known = view_loss(found[-1:], *extra, photos, image, distances)
        loss, told = loss + config["visible_weight"] * more, told | known
    return loss, told


def outcome(logit0, rgb, covered, planes, photos: Photos, config: dict, whole: bool):
    """(loss, image [3, H, W] without gradients, what the log tells) of planes [L, 1, 1]; `whole`: none was left out."""
    maps = planes.expand_as(covered)
    shown = compete(logit0, rgb, covered, maps)
    loss = image_loss(shown.rgb, photos.target.float() / 255, covered.any(0), config["square_weight"])
    told = {"loss": float(loss.detach())}
    if whole and photos.disparity is not None:
        more, share = depth_loss(shown.weights, maps, photos)
        loss, told = loss + config["depth_weight"] * more, told | {"on surface": share, "surfaces": 1.0}
    return loss, shown.rgb.detach(), told


def depth_loss(weights: Tensor, maps: Tensor, photos: Photos) -> tuple[Tensor, float]:
    """Minus log of the weight of the planes next to the true surface, or within a pixel of parallax of it, where two
    views at least see it: the picture alone hardly moves a plane that has no weight. And that weight in the mean."""
    parallax = max(float(sweep_terms(camera, photos.camera)[1][:2].norm()) for camera in photos.cameras)
    reach = max(1.0 / parallax, 1.01 * float(maps[0, 0, 0] - maps[1, 0, 0]))
    near_by = (maps - photos.disparity).abs() <= reach
    where = (photos.seen == SEEN).sum(0) >= 2
    share = (weights * near_by).sum(0)
    mean = float(share.detach()[where].mean()) if bool(where.any()) else 0.0
    return -(torch.log(share.clamp(min=1e-4)) * where).mean(), mean


def view_loss(logits, colour, coverage, photos: Photos, image, distances) -> tuple[Tensor, dict[str, float]]:
    """On the true surface: minus log of the weight on the views that see it, where some covering view does not; and
    there, what the log tells."""
    seen = photos.seen.masked_fill(coverage[0] < 0.5, UNKNOWN)
    where = partly_hidden(seen)
    count = where.sum().clamp(min=64)
    share = weight_on_seen(view_weights(logits, coverage, distances)[0], seen)
    by_distance = weight_on_seen(view_weights(torch.zeros_like(logits), coverage, distances)[0], seen)
    told = {}
    if bool(where.any()):
        error = ((image - photos.target.float() / 255) ** 2).mean(0)[where]
        told = {
            "hidden pixels": float(where.sum()),
            "seen weight": float(share.detach()[where].sum()),
            "seen weight by distance": float(by_distance[where].sum()),
            "hidden error": float(error.sum()),
        }
    return -(torch.log(share.clamp(min=1e-6)) * where).sum() / count, told


def rate(step: int, config: dict) -> float:
    """Warm-up, then constant, then falling to 2 % over the last part."""
    left = (config["steps"] - step) / (config["falling"] * config["steps"])
    return min(1.0, (step + 1) / config["warm_up"]) * max(0.02, min(1.0, left))


def summary(told: list[dict[str, float]]) -> str:
    def total(key: str) -> float:
        return sum(t.get(key, 0.0) for t in told)

    hidden = max(total("hidden pixels"), 1.0)
    psnr = -10 * np.log10(max(total("hidden error") / hidden, 1e-9))
    seen, by_distance = total("seen weight") / hidden, total("seen weight by distance") / hidden
    text = f"loss {total('loss') / len(told):.4f}; weight near the surface "
    text += f"{total('on surface') / max(total('surfaces'), 1):.3f}; where views are hidden: "
    return text + f"seen weight {seen:.3f} (by distance {by_distance:.3f}), {psnr:.2f} dB"


class Pool:
    """Examples to draw from: a window of shards that moves on by one every `every` steps."""

    def __init__(self, shards: Shards, config: dict):
        self.shards, self.config, self.loaded = shards, config, {}

    def at(self, step: int) -> list[Photos]:
        first, seconds = step // self.config["shard_every"], time.perf_counter()
        wanted = {(first + i) % self.config["shards"] for i in range(self.config["shards_at_once"])}
        self.loaded = {n: self.loaded[n] if n in self.loaded else self.shards[n] for n in sorted(wanted)}
        self.seconds = time.perf_counter() - seconds
        return [p for shard in self.loaded.values() for p in shard]


def start_of(path: Path, scale: float) -> UNet:
    net = UNet(torch.load(path, weights_only=True)["views"]).eval()
    net.load_state_dict(torch.load(path, weights_only=True)["average"])
    net = fold_batchnorm(net)
    with torch.no_grad():  # competing planes want logits further apart: the scale goes into the last layer
        net.conv9.weight[0] *= scale
        net.conv9.bias[0] *= scale
    for p in net.parameters():
        p.requires_grad_(True)
    return net.to(memory_format=torch.channels_last)


def save(path: Path, **state) -> None:
    torch.save(state, path.with_suffix(".tmp"))
    path.with_suffix(".tmp").rename(path)


def train(config: dict, data: Path, out: Path, start: Path, shards: Path) -> None:
    torch.set_num_threads(1)
    checkpoint = out / "checkpoint.pt"
    net = start_of(start, config["start_scale"])
    before = torch.load(start, weights_only=True)
    earlier = [*before.get("earlier", []), (before["views"], before["step"], round(before["seconds"]))]
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), lr=config["learning_rate"], weight_decay=1e-4)
    step, seconds, history = 0, 0.0, []
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        net.load_state_dict(state["net"])
        average.load_state_dict(state["folded_average"])
        optimiser.load_state_dict(state["optimiser"])
        step, seconds, history = state["step"], state["seconds"], state["history"]
        print(f"goes on from step {step}", flush=True)
    pool, told, spent = Pool(Shards(shards, config, data), config), [], {"examples": 0.0, "network": 0.0}
    began = saved = time.perf_counter()
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))  # save first, then end
    while step < config["steps"] and not stopped:
        rng = np.random.default_rng([config["seed"], 1, step])
        examples = pool.at(step)
        spent["examples"] += pool.seconds
        began_step = time.perf_counter()
        for group in optimiser.param_groups:
            group["lr"] = config["learning_rate"] * rate(step, config)
        optimiser.zero_grad()
        for i in rng.choice(len(examples), config["batch"], replace=False):
            loss, found = example_loss(net, examples[i], rng, config)
            (loss / config["batch"]).backward()
            told.append(found)
        norm = torch.nn.utils.clip_grad_norm_(net.parameters(), config["clip"])
        if bool(torch.isfinite(norm)):
            optimiser.step()
        else:
            print(f"step {step}: a gradient is not finite; left out", flush=True)
        step += 1
        decay = min(config["average"], (1 + step) / (10 + step))
        with torch.no_grad():
            for a, b in zip(average.parameters(), net.parameters(), strict=True):
                a.lerp_(b, 1 - decay)
        spent["network"] += time.perf_counter() - began_step
        if step % 50 == 0:
            now = time.perf_counter()
            seconds, passed, began = seconds + now - began, now - began, now
            each = ", ".join(f"{key} {value / 50 * 1e3:.0f}" for key, value in spent.items())
            speed = f"{len(told) / passed:.2f} samples/s (ms/step: {each})"
            print(f"step {step} {summary(told)}; gradient {float(norm):.2f}; {speed}", flush=True)
            told, spent = [], dict.fromkeys(spent, 0.0)
        over = step == config["steps"]
        if step % config["validate_every"] == 0 or over:
            paused = time.perf_counter()
            full = unfolded(average)
            scores = validate_competing(full, config["validation"], data, out / "validation.png")
            history.append({"step": step, "seconds": round(seconds), **scores})
            print(json.dumps(history[-1]), flush=True)
            (out / "history.json").write_text(json.dumps(history, indent=1))
            began += time.perf_counter() - paused
        if over or stopped or step % config["validate_every"] == 0 or time.perf_counter() - saved > 600:
            save(
                checkpoint, net=net.state_dict(), folded_average=average.state_dict(), optimiser=optimiser.state_dict(),
                average=unfolded(average).state_dict(), step=step, seconds=seconds, history=history,
                views=config["views"], config=config, earlier=earlier,
            )  # fmt: skip
            saved = time.perf_counter()
