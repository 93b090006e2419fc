"""Fine-tuning from given weights, one example at a time: the loop shared by
train_planes.py and train_surface.py.

One process, one thread. BatchNorm is folded into the convolutions first: its statistics over one
scene at a time would be wrong, and it would take a third of the time.
"""

import copy
import json
import signal
import time
from pathlib import Path
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from ..checkpoint import load_state, trained_network
from ..reference.liveview import UNet
from ..reference.view_agreement import AgreementUNet
from ..weights import contiguous_gradients, fold_batchnorm, unfold_batchnorm, with_views

CHECKPOINT_SECONDS = 600  # between checkpoints, at most


class Task(Protocol):
    """The examples, the loss and the validation of a training."""

    def examples(self, step: int) -> list:
        """The examples to draw from at this step."""

    def loss(self, net: UNet, example, rng: np.random.Generator) -> tuple[Tensor, dict[str, float]]:
        """The loss with its gradient graph, and figures for the log."""

    def summary(self, figures: list[dict[str, float]]) -> str:
        """A line of the log."""

    def validate(self, net: UNet, file: Path) -> dict[str, float]:
        """Scores on held-out photos; `file`: a picture to inspect."""


def rate(step: int, config: dict) -> float:
    """Warm-up, then constant, then falling to 2 % over the last part."""
    left = (config["steps"] - step) / (config["falling"] * config["steps"])
    return min(1.0, (step + 1) / config["warm_up"]) * max(0.02, min(1.0, left))


def start_of(state: dict, config: dict) -> UNet:
    """The network of a state for the config's "views", BatchNorm folded, ready to be trained: its
    logit 0 times the config's "start_scale" plus its "start_shift"; if it is to be added to the
    views' agreement, all its logits are 0."""
    net = with_views(fold_batchnorm(trained_network(state)), config["views"])
    with torch.no_grad():  # competing planes need larger differences of logits than independent ones
        if config.get("agreement") and not isinstance(net, AgreementUNet):
            start, net = net, fold_batchnorm(AgreementUNet(net.views).eval())
            net.load_state_dict(start.state_dict())
            net.conv9.weight.zero_(), net.conv9.bias.zero_()
        net.conv9.weight[0] *= config["start_scale"]
        net.conv9.bias[0] = net.conv9.bias[0] * config["start_scale"] + config.get("start_shift", 0.0)
    for p in net.parameters():
        p.requires_grad_(True)
    return contiguous_gradients(net).to(memory_format=torch.channels_last)


def save(path: Path, **state) -> None:
    torch.save(state, path.with_suffix(".tmp"))
    path.with_suffix(".tmp").rename(path)


def fine_tune(config: dict, task: Task, out: Path, start: dict) -> None:
    """Train from the weights of the state `start`, or continue from the checkpoint in `out`."""
    torch.set_num_threads(1)
    checkpoint = out / "checkpoint.pt"
    net = start_of(start, config)
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
        print(f"continues from step {step}", flush=True)
    figures, spent = [], {"examples": 0.0, "network": 0.0}
    began, saved = time.process_time(), time.perf_counter()  # training is beside other work: its processor time counts
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))  # save before ending

    def keep() -> None:
        save(
            checkpoint, net=net.state_dict(), folded_average=average.state_dict(), optimiser=optimiser.state_dict(),
            average=unfold_batchnorm(average).state_dict(), step=step, history=history, views=config["views"],
            seconds=seconds + time.process_time() - began, config=config, earlier=earlier,
        )  # fmt: skip

    while step < config["steps"] and not stopped:
        rng = np.random.default_rng([config["seed"], 1, step])
        started = time.process_time()
        examples = task.examples(step)
        began_step = time.process_time()
        spent["examples"] += began_step - started
        for group in optimiser.param_groups:
            group["lr"] = config["learning_rate"] * rate(step, config)
        optimiser.zero_grad()
        for i in rng.choice(len(examples), config["batch"], replace=False):
            if stopped:  # the step is begun again later
                return keep()
            loss, found = task.loss(net, examples[i], rng)
            (loss / config["batch"]).backward()
            figures.append(found)
        norm = torch.nn.utils.clip_grad_norm_(net.parameters(), config["clip"])
        if bool(torch.isfinite(norm)):
            optimiser.step()
        else:
            print(f"step {step}: a gradient is not finite; step skipped", flush=True)
        step += 1
        decay = min(config["average"], (1 + step) / (10 + step))
        with torch.no_grad():
            for a, b in zip(average.parameters(), net.parameters(), strict=True):
                a.lerp_(b, 1 - decay)
        spent["network"] += time.process_time() - began_step
        if step % 50 == 0:
            now = time.process_time()
            seconds, passed, began = seconds + now - began, now - began, now
            each = ", ".join(f"{key} {value / 50 * 1e3:.0f}" for key, value in spent.items())
            speed = f"{60 * len(figures) / passed:.0f} samples per minute of processor (ms/step: {each})"
            print(f"step {step} {task.summary(figures)}; gradient {float(norm):.2f}; {speed}", flush=True)
            figures, spent = [], dict.fromkeys(spent, 0.0)
        over = step == config["steps"]
        if step % config["validate_every"] == 0 or over:
            paused = time.process_time()
            scores = task.validate(unfold_batchnorm(average), out / "validation.png")
            history.append({"step": step, "seconds": round(seconds), **scores})
            print(json.dumps(history[-1]), flush=True)
            (out / "history.json").write_text(json.dumps(history, indent=1))
            began += time.process_time() - paused
        if over or stopped or step % config["validate_every"] == 0 or time.perf_counter() - saved > CHECKPOINT_SECONDS:
            keep()
            saved = time.perf_counter()
