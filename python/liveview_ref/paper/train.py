"""Train all methods on the same samples.

    python -m liveview_ref.paper.train --scenes FOLDER --textures FOLDER --out RUNS

Methods take turns, so that at any time all have had the same number of samples (within one turn).
Training can be stopped and continues when started again. Sample n is the same for every method, as
are loss, optimiser and rates."""

import argparse
import copy
import json
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from ..checkpoint import load_state
from ..data.held_out import INNER
from ..reference.liveview import uniform_disparities
from ..reference.metrics import psnr
from ..training.fine_tune import save
from ..training.precision import reduced_precision
from ..training.train import alpha_loss, image_loss
from .data.rig import FAR, FOCAL, NEAR, SIDE
from .data.samples import SEED, RealSamples, RigSamples, Sample
from .data.scenes import Scenes
from .files import write
from .methods.method import Method
from .methods.registry import ENTRIES, Entry

BATCH = 2  # crops a step
# Adam's rate, constant after the warm-up steps: training may end at any time, so weights are
# averaged.
RATE, WARM_UP = 5e-4, 100
AVERAGE = 0.997
ALPHA_WEIGHT = 0.05  # of the supervision of alpha by the known depth
TURN = 50  # steps
VALIDATE_EVERY = 500
STATISTICS = 12  # batches for the estimate of BatchNorm's statistics

Samples = Callable[[int, int], Sample]  # by the number of views and the sample's number


def loss_of(method: Method, samples: list[Sample], count: int) -> Tensor:
    """The mean loss over samples on `count` planes: of the image, and of alpha if the
    method has one."""
    planes = [uniform_disparities(s.near, s.far, count) for s in samples]
    renderings = method.batch([(s.photos, s.target, d) for s, d in zip(samples, planes, strict=True)])
    total = torch.zeros(())
    for s, r, disparities in zip(samples, renderings, planes, strict=True):
        # image_loss is a mean over all pixels: divided by the share that is valid
        total = total + image_loss(r.rgb, s.truth, r.valid) / r.valid.float().mean().clamp(min=0.1)
        if r.alpha is not None:
            offset = (disparities.float()[:, None, None] - s.disparity_at(r.camera)) * (SIDE * FOCAL)
            total = total + ALPHA_WEIGHT * alpha_loss(r.alpha, offset)
    return total / len(samples)


@dataclass
class Trainee:
    """A method in training; `average` are the averaged weights. ValueError for a checkpoint of a
    training on another number of planes."""

    entry: Entry
    folder: Path
    start: Path | None = None  # another training's folder, whose averaged weights are the initial ones
    most: int | None = None  # planes of its training, unless the method is made for a number of planes
    step: int = 0
    seconds: float = 0.0  # of all cores
    history: list[dict] = field(default_factory=list)

    def __post_init__(self):
        torch.manual_seed(SEED)
        self.method = self.entry.build(self.entry.views)
        if self.start:
            self.method.load_state_dict(load_state(self.start / "checkpoint.pt")["average"])
        self.average = copy.deepcopy(self.method)
        self.optimiser = torch.optim.Adam(self.method.parameters(), lr=RATE)
        self.planes = self.entry.training_planes
        if self.most and len(self.entry.planes) > 1:
            self.planes = min(self.planes, self.most)
        self.checkpoint = self.folder / "checkpoint.pt"
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.checkpoint.exists():
            state = load_state(self.checkpoint)
            if (before := self.entry.planes_of(state)) != self.planes:
                raise ValueError(f"{self.checkpoint}: planes: {before}; expected {self.planes} (--planes)")
            for name in ("method", "average", "optimiser"):
                getattr(self, name).load_state_dict(state[name])
            self.step, self.seconds, self.history = state["step"], state["seconds"], state["history"]

    def turn(self, samples: Samples, validation: Scenes) -> None:
        """TURN steps, a validation if it is due, and a checkpoint."""
        began, running = time.process_time(), 0.0
        self.method.train()
        for _ in range(TURN):
            for group in self.optimiser.param_groups:
                group["lr"] = RATE * min(1.0, (self.step + 1) / WARM_UP)
            numbers = range(self.step * BATCH, (self.step + 1) * BATCH)
            drawn = [samples(self.entry.views, n) for n in numbers]
            with reduced_precision():
                loss = loss_of(self.method, drawn, self.planes)
            self.optimiser.zero_grad()
            loss.backward()
            norm = torch.nn.utils.clip_grad_norm_(self.method.parameters(), 1.0)
            if bool(torch.isfinite(norm)):
                self.optimiser.step()
            else:
                print(f"{self.entry.key}: step {self.step}: a gradient is not finite; step skipped", flush=True)
            self.step += 1
            decay = min(AVERAGE, (1 + self.step) / (10 + self.step))
            with torch.no_grad():
                for a, b in zip(self.average.parameters(), self.method.parameters(), strict=True):
                    a.lerp_(b, 1 - decay)
            running += float(loss.detach())
        self.seconds += time.process_time() - began
        each = (time.process_time() - began) / TURN
        print(f"{self.entry.key} step {self.step} loss {running / TURN:.4f}, {each:.2f} core s/step", flush=True)
        if self.step % VALIDATE_EVERY == 0:
            self.validate(samples, validation)
        state = {name: getattr(self, name).state_dict() for name in ("method", "average", "optimiser")}
        about = {"step": self.step, "seconds": self.seconds, "history": self.history, "key": self.entry.key}
        about["planes"] = self.planes
        save(self.checkpoint, **state, **about)

    def validate(self, samples: Samples, validation: Scenes) -> None:
        """PSNR of the averaged weights on the middle of the first target of each validation
        scene."""
        estimate_statistics(self.average, [self.some(samples, i) for i in range(STATISTICS)], self.planes)
        scores = []
        for number in range(len(validation)):
            scene = validation[number]
            camera, image, _ = scene.target(0)
            inner = camera.with_window(124, 80, 256, 192)
            with torch.inference_mode():
                rendering = self.average(
                    scene.photos(self.entry.views), inner, uniform_disparities(NEAR, FAR, self.planes)
                )
            scores.append(psnr(rendering.rgb[INNER], image[:, 80:272, 124:380][INNER]))
        self.history.append(
            {
                "step": self.step,
                "samples": self.step * BATCH,
                "core_seconds": round(self.seconds),
                "psnr": round(float(np.mean(scores)), 3),
            }
        )
        print(self.entry.key, json.dumps(self.history[-1]), flush=True)
        write(self.folder / "history.json", self.history)

    def some(self, samples: Samples, number: int) -> list[Sample]:
        """A batch of the most recent samples."""
        last = self.step * BATCH
        numbers = range(number * BATCH, (number + 1) * BATCH)
        return [samples(self.entry.views, (last - 1 - n) % last) for n in numbers]


def estimate_statistics(method: Method, batches: list[list[Sample]], count: int) -> None:
    """Estimate BatchNorm's statistics again, if the method has any: the mean over batches
    of mixed scenes."""
    norms = [m for m in method.modules() if isinstance(m, nn.modules.batchnorm._BatchNorm)]
    for norm in norms:
        norm.reset_running_stats()
        norm.momentum = None
    if norms:
        method.train()
        with torch.no_grad():
            for batch in batches:
                loss_of(method, batch, count)
    method.eval()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=Path, required=True, help="folder of the rig's scenes")
    parser.add_argument("--textures", type=Path, required=True, help="folder of photos to paint the scenes with")
    parser.add_argument("--out", type=Path, required=True, help="a folder for each method: checkpoint, history.json")
    parser.add_argument("--data", type=Path, help="train on the real photos in this folder (train/)")
    parser.add_argument("--start", type=Path, help="the --out of another training, for the initial weights")
    parser.add_argument("--only", nargs="+", metavar="METHOD", help="these methods alone, such as liveview_v4")
    parser.add_argument("--planes", type=int, help="train on at most that many planes")
    parser.add_argument("--steps", type=int, default=500, help="of each method; default: as the page's first table")
    parser.add_argument("--threads", type=int, default=2)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    train, validation = (Scenes(args.scenes, args.textures, split) for split in ("train", "validation"))
    samples = RealSamples(args.data) if args.data else RigSamples(train)
    chosen = [e for e in ENTRIES if e.trained and (not args.only or e.key in args.only)]
    if not chosen:
        parser.error(f"--only {' '.join(args.only)}: expected some of {', '.join(e.key for e in ENTRIES if e.trained)}")
    try:
        trainees = [Trainee(e, args.out / e.key, args.start and args.start / e.key, args.planes) for e in chosen]
    except ValueError as error:
        parser.error(str(error))
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))  # the turn ends with its checkpoint
    while not stopped and (behind := min(trainees, key=lambda t: t.step)).step < args.steps:
        behind.turn(samples, validation)


if __name__ == "__main__":
    main()
