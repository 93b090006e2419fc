"""Training for uniform planes that compete: what train.py runs where a config says "alpha": "competing".

One process, one thread: it makes a shard of examples when it first needs it.
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

from ..checkpoint import load_state, trained_network
from ..data.shards import Photos, Shards
from ..reference.unet import UNet, fold_batchnorm, unfold_batchnorm
from .planes_loss import example_loss
from .validate import validate_competing


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
    """Examples to draw from: a window of shards that moves on by one every "shard_every" steps."""

    def __init__(self, shards: Shards, config: dict):
        self.shards, self.config, self.loaded = shards, config, {}

    def at(self, step: int) -> list[Photos]:
        first, seconds = step // self.config["shard_every"], time.perf_counter()
        wanted = {(first + i) % self.config["shards"] for i in range(self.config["shards_at_once"])}
        self.loaded = {n: self.loaded[n] if n in self.loaded else self.shards[n] for n in sorted(wanted)}
        self.seconds = time.perf_counter() - seconds
        return [p for shard in self.loaded.values() for p in shard]


def start_of(state: dict, scale: float) -> UNet:
    """The network of a state, BatchNorm folded, its logit 0 times `scale`, ready to be trained."""
    net = fold_batchnorm(trained_network(state))
    with torch.no_grad():  # competing planes want logits further apart: the scale goes into the last layer
        net.conv9.weight[0] *= scale
        net.conv9.bias[0] *= scale
    for p in net.parameters():
        p.requires_grad_(True)
    return net.to(memory_format=torch.channels_last)


def save(path: Path, **state) -> None:
    torch.save(state, path.with_suffix(".tmp"))
    path.with_suffix(".tmp").rename(path)


def train(config: dict, data: Path, out: Path, start: dict, shards: Path) -> None:
    """Train from the weights of the state `start`, or go on from the checkpoint in `out`; examples lie in `shards`."""
    torch.set_num_threads(1)
    checkpoint = out / "checkpoint.pt"
    net = start_of(start, config["start_scale"])
    earlier = [*start.get("earlier", []), (start["views"], start["step"], round(start["seconds"]))]
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), lr=config["learning_rate"], weight_decay=1e-4)
    step, seconds, history = 0, 0.0, []
    if checkpoint.exists():
        state = load_state(checkpoint)
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
            full = unfold_batchnorm(average)
            scores = validate_competing(full, config["validation"], data, out / "validation.png")
            history.append({"step": step, "seconds": round(seconds), **scores})
            print(json.dumps(history[-1]), flush=True)
            (out / "history.json").write_text(json.dumps(history, indent=1))
            began += time.perf_counter() - paused
        if over or stopped or step % config["validate_every"] == 0 or time.perf_counter() - saved > 600:
            save(
                checkpoint, net=net.state_dict(), folded_average=average.state_dict(), optimiser=optimiser.state_dict(),
                average=unfold_batchnorm(average).state_dict(), step=step, seconds=seconds, history=history,
                views=config["views"], config=config, earlier=earlier,
            )  # fmt: skip
            saved = time.perf_counter()
