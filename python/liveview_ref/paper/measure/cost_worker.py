"""One method in its own process, timed on request.

    python -m liveview_ref.paper.measure.cost_worker KEY PLANES THREADS

One JSON object per line, in and out. The weights are random, because no time depends on them.

    out  {"ready": true, "parameters": N, "memory_before": bytes}
    in   {"run": true}
    out  {"seconds": {"warp": s, "network": s, "render": s}, "cpu_seconds": s,
          "peak_memory": bytes so far,
          "multiply_adds": of convolutions and matrix products, counted in the first run only}

warp: photos onto planes. network: modules with weights. render: blending, compositing, warping to
the target, and everything else."""

import functools
import json
import resource
import sys
import time
from typing import TextIO

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from liveview_ref.json_lines import run
from liveview_ref.reference.liveview import Camera

from ..data import rig
from ..methods.method import Method, Photos, Predictor
from ..methods.registry import entry

FUNCTIONS = {"warp_views": "warp", "volume_at": "warp", "warp_maps": "warp", "blend": "render", "view_of": "render"}
PLACE = 0.2, -0.13  # of the target, in sides


class Stages:
    """Time of each stage, without that of the stages within it."""

    def __init__(self):
        self.seconds: dict[str, float] = {}
        self.stack = ["render"]
        self.since = time.perf_counter()

    def switch(self) -> None:
        now = time.perf_counter()
        self.seconds[self.stack[-1]] = self.seconds.get(self.stack[-1], 0.0) + now - self.since
        self.since = now

    def enter(self, stage: str) -> None:
        self.switch()
        self.stack.append(stage)

    def leave(self) -> None:
        self.switch()
        self.stack.pop()

    def start(self) -> None:
        self.seconds, self.stack, self.since = dict.fromkeys(("warp", "network", "render"), 0.0), ["render"], 0.0
        self.since = time.perf_counter()

    def wrapped(self, function, stage: str):
        @functools.wraps(function)
        def timed(*args, **kwargs):
            self.enter(stage)
            try:
                return function(*args, **kwargs)
            finally:
                self.leave()

        return timed


def watch(method: Method, stages: Stages) -> None:
    """Time the networks, and FUNCTIONS wherever the modules of the comparison call them."""
    for name, module in list(sys.modules.items()):
        if name.startswith(("liveview_ref.paper", "liveview_ref.reference")):
            for function, stage in FUNCTIONS.items():
                if callable(found := getattr(module, function, None)) and not hasattr(found, "__wrapped__"):
                    setattr(module, function, stages.wrapped(found, stage))
    for module in networks(method):
        module.register_forward_pre_hook(lambda *_: stages.enter("network"))
        module.register_forward_hook(lambda *_: stages.leave())


def networks(module: nn.Module) -> list[nn.Module]:
    """The outermost modules that are Predictors, or have weights and are not a Method."""
    found = []
    for child in module.children():
        if isinstance(child, Predictor) or (not isinstance(child, Method) and any(True for _ in child.parameters())):
            found.append(child)
        else:
            found += networks(child)
    return found


def scene(views: int) -> tuple[Photos, Camera]:
    """Photos of noise at the rig's places, and a target between them."""
    ids = rig.VIEWS[views]
    generator = torch.Generator().manual_seed(views)
    images = [torch.rand(3, rig.HEIGHT, rig.WIDTH, generator=generator) for _ in ids]
    return Photos(images, [rig.camera(*rig.CENTRES[i]) for i in ids], rig.REFERENCES[views]), rig.camera(*PLACE)


def multiply_adds(method: Method, photos: Photos, target: Camera, disparities: Tensor) -> int:
    """Multiply-adds of convolutions and matrix products, counted as they run; torch counts two
    operations for each."""
    with FlopCounterMode(display=False) as counter:
        method(photos, target, disparities)
    return counter.get_total_flops() // 2


def peak_memory() -> int:
    """Largest resident memory of this process so far, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def serve(key: str, count: int, requests: TextIO, replies: TextIO) -> None:
    torch.manual_seed(0)
    own = entry(key)
    method = own.build(own.views).eval()
    for module in method.modules():
        if isinstance(module, nn.Conv2d):
            module.to(memory_format=torch.channels_last)
    stages, (photos, target) = Stages(), scene(own.views)
    watch(method, stages)

    def reply(**message) -> None:
        print(json.dumps(message), file=replies, flush=True)

    reply(ready=True, parameters=sum(p.numel() for p in method.parameters()), memory_before=peak_memory())
    first = True
    for line in requests:
        if not json.loads(line).get("run"):
            raise ValueError(f'{line.strip()}: expected {{"run": true}}')
        with torch.no_grad():
            counted = {"multiply_adds": multiply_adds(method, photos, target, rig.planes(count))} if first else {}
            first = False
            stages.start()
            began = time.process_time()
            method(photos, target, rig.planes(count))
            stages.switch()
        seconds = time.process_time() - began
        reply(seconds=stages.seconds, cpu_seconds=seconds, peak_memory=peak_memory(), **counted)


if __name__ == "__main__":
    torch.set_num_threads(int(sys.argv[3]))
    sys.exit(run(functools.partial(serve, sys.argv[1], int(sys.argv[2]))))
