"""Train a model.

    python -m liveview_ref.training.train configs/v4.json --data DATA --out runs/v4

Seeded and resumable (run the same command again). Scenes are mixed within a batch, because
BatchNorm statistics of one scene do not fit another; they are estimated again over many
batches before the averaged weights are used. If a config has "shards" or "frames",
fine_tune.py trains instead.
"""

import argparse
import copy
import json
import math
import time
from collections import deque
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor, multiprocessing

from ..checkpoint import load_state
from ..config import read_config
from ..data.examples import Example, maker
from ..reference.liveview import UNet, blend, composite
from ..weights import adapt_views, contiguous_gradients, start_from_agreement
from .fine_tune import CHECKPOINT_SECONDS, fine_tune, save
from .precision import reduced_precision
from .train_planes import Planes
from .train_surface import Surface
from .validate import validate


def forward(net: UNet, batch: list[Example], device: torch.device) -> list[tuple[Tensor, Tensor]]:
    """(rendered [3, H, W], alpha [L, H, W]) of each example; all layers of all scenes in one pass
    of the network."""
    hwv = torch.cat([e.hwv for e in batch]).to(device).float().contiguous(memory_format=torch.channels_last)
    with reduced_precision(device.type):
        logits = net(hwv)
    results, at = [], 0
    for e in batch:
        n, views = len(e.hwv), net.views
        coverage = e.coverage.to(device).float()
        colour = hwv[at : at + n].contiguous().reshape(n, views, 3, *hwv.shape[2:])
        alpha, rgb = blend(logits[at : at + n].float(), colour, coverage, e.distances.to(device))
        covered = (coverage[-1] > 0).any(0)
        results.append((composite(alpha, rgb, covered, e.maps.to(device)).rgb, alpha))
        at += n
    return results


def image_loss(image: Tensor, truth: Tensor, seen: Tensor) -> Tensor:
    """L1 plus half of the L1 of the image gradients, over the pixels that any view covers."""
    difference = (image - truth) * seen
    dx = difference[..., 1:] - difference[..., :-1]
    dy = difference[..., 1:, :] - difference[..., :-1, :]
    return difference.abs().mean() + 0.5 * (dx.abs().mean() + dy.abs().mean())


def alpha_loss(alpha: Tensor, offset: Tensor) -> Tensor:
    """Cross entropy of alpha [L, H, W], given the distance of each layer in front of the true
    surface in pixels of parallax: 1 on the surface, 0 in front of it. Layers between these and
    layers behind, which are occluded, are left out. The mean is over all others, so that where
    layers cannot be distinguished alpha is one over their number."""
    on, front = offset.abs() < 0.5, offset > 2
    judged = on | front
    loss = F.binary_cross_entropy(alpha.clamp(1e-5, 1 - 1e-5), on.float(), reduction="none")
    return (loss * judged).sum() / judged.sum().clamp(min=1)


def batch_loss(net: UNet, batch: list[Example], alpha_weight: float, device: torch.device) -> Tensor:
    loss = torch.zeros((), device=device)
    for e, (image, alpha) in zip(batch, forward(net, batch, device), strict=True):
        seen = (e.coverage.to(device) > 0).flatten(0, 1).any(0)
        loss = loss + image_loss(image, e.target.to(device), seen)
        if alpha_weight > 0 and bool(torch.isfinite(e.disparity).any()):
            loss = loss + alpha_weight * alpha_loss(alpha, (e.maps - e.disparity).to(device) * e.parallax)
    return loss / len(batch)


def estimate_statistics(net: UNet, batches: list[list[Example]], device: torch.device) -> None:
    """Estimate BatchNorm statistics of `net` again: the mean over many mixed batches."""
    norms = [m for m in net.modules() if isinstance(m, torch.nn.BatchNorm2d)]
    for norm in norms:
        norm.reset_running_stats()
        norm.momentum = None  # cumulative average
    net.train()
    with torch.no_grad():
        for batch in batches:
            forward(net, batch, device)
    for norm in norms:
        norm.momentum = 0.1
    net.eval()


def rate(step: int, config: dict) -> float:
    """Warm-up, then a cosine to 2 % of the learning rate."""
    warm = min(1.0, (step + 1) / config["warm_up"])
    return warm * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * min(1.0, step / config["steps"]))))


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("config", type=Path)
    parser.add_argument("--data", type=Path, required=True, help="folder with train/, dev/ and textures/")
    parser.add_argument("--out", type=Path, required=True, help="checkpoints, log and validation images")
    parser.add_argument("--start", type=Path, help="initial weights, of any V")
    parser.add_argument("--shards", type=Path, help="folder of examples, for fine-tuning")
    parser.add_argument("--steps", type=int, help="overrides the config")
    args = parser.parse_args(arguments)
    config = read_config(args.config)
    config["steps"] = args.steps or config["steps"]
    alpha = config.get("alpha", "independent")
    if alpha not in ("independent", "competing"):
        parser.error(f'{args.config}: alpha is "{alpha}"; expected "independent" or "competing"')
    if alpha == "competing" and "shards" not in config:
        parser.error(f'{args.config}: alpha is "competing"; expected "shards" and the other fields of v4_planes.json')
    if "shards" in config or "frames" in config:
        if not (args.start and args.shards):
            parser.error(f"{args.config}: expected --start, the initial weights, and --shards, a folder for examples")
        start = load_state(args.start)
        args.out.mkdir(parents=True, exist_ok=True)
        if "frames" in config:
            return fine_tune(config, Surface(config, args.shards), args.out, start)
        return fine_tune(config, Planes(config, args.data, args.shards), args.out, start)
    args.out.mkdir(parents=True, exist_ok=True)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.set_num_threads(config["threads"])
    torch.manual_seed(config["seed"])

    net = contiguous_gradients(UNet(config["views"]))
    start_from_agreement(net)
    earlier = []  # (views, steps, seconds) of the earlier trainings of these weights
    if args.start:
        start = load_state(args.start)
        adapt_views(start["average"], net)
        earlier = [*start.get("earlier", []), (start["views"], start["step"], round(start["seconds"]))]
    net = net.to(device, memory_format=torch.channels_last)
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), lr=config["learning_rate"], weight_decay=1e-4)
    step, seconds, history = 0, 0.0, []
    checkpoint = args.out / "checkpoint.pt"
    if checkpoint.exists():
        state = load_state(checkpoint, device)
        net.load_state_dict(state["net"])
        average.load_state_dict(state["average"])
        optimiser.load_state_dict(state["optimiser"])
        step, seconds, history = state["step"], state["seconds"], state["history"]

    spawn = multiprocessing.get_context("spawn")
    queues = [spawn.Queue(4) for _ in range(config["makers"])]
    for worker, queue in enumerate(queues):
        start = -(-(step - worker) // config["makers"])
        spawn.Process(target=maker, args=(queue, config, args.data, worker, start), daemon=True).start()
    recent: deque[list[Example]] | list = deque(maxlen=48)
    began, since, running, waited = time.perf_counter(), 0.0, 0.0, 0.0
    saved = began
    while step < config["steps"]:
        t = time.perf_counter()
        batch = queues[step % config["makers"]].get()
        waited += time.perf_counter() - t
        recent.append(batch)
        for group in optimiser.param_groups:
            group["lr"] = config["learning_rate"] * rate(step, config)
        net.train()
        fade = max(0.0, 1 - step / config["alpha_fade"])
        loss = batch_loss(net, batch, config["alpha_weight"] * (0.1 + 0.9 * fade), device)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), config["clip"])
        optimiser.step()
        step += 1
        decay = min(config["average"], (1 + step) / (10 + step))
        with torch.no_grad():
            for a, b in zip(average.parameters(), net.parameters(), strict=True):
                a.lerp_(b, 1 - decay)
        running += float(loss.detach())
        if step % 100 == 0:
            now = time.perf_counter()
            seconds, since = seconds + now - began, since + now - began
            print(f"step {step} loss {running / 100:.4f} {since * 10:.0f} ms/step, waited {waited:.0f} s", flush=True)
            began, since, running, waited = now, 0.0, 0.0, 0.0
        if step % config["validate_every"] == 0 or step == config["steps"]:
            passed = time.perf_counter() - began  # the time of validation is not counted
            seconds, since = seconds + passed, since + passed
            if step == config["steps"]:  # more than 48 batches for the statistics of the final weights
                recent = [*recent, *(queues[(step + i) % config["makers"]].get() for i in range(80))]
            estimate_statistics(average, list(recent), device)
            scores = validate(average, config["validation"], args.data, args.out / "validation.png", device)
            history.append({"step": step, "seconds": round(seconds), **scores})
            print(json.dumps(history[-1]), flush=True)
            (args.out / "history.json").write_text(json.dumps(history, indent=1))
            began = time.perf_counter()
        judged = bool(history) and history[-1]["step"] == step
        if judged or time.perf_counter() - saved > CHECKPOINT_SECONDS:
            save(
                checkpoint, net=net.state_dict(), average=average.state_dict(), optimiser=optimiser.state_dict(),
                step=step, seconds=seconds + time.perf_counter() - began, history=history, views=config["views"],
                config=config, earlier=earlier,
            )  # fmt: skip
            saved = time.perf_counter()


if __name__ == "__main__":
    main()
