"""One method, timed in a process of its own. The weights are random: no time depends on them.

warp: photos onto planes. network: modules with weights. render: blending, compositing, warping to
the target, and everything else."""

import functools
import resource
import sys
import time

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

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


class Timed:
    """A method on a number of planes."""

    def __init__(self, key: str, count: int, threads: int):
        torch.set_num_threads(threads)
        torch.manual_seed(0)
        own = entry(key)
        self.method, self.planes = own.build(own.views).eval(), rig.planes(count)
        for module in self.method.modules():
            if isinstance(module, nn.Conv2d):
                module.to(memory_format=torch.channels_last)
        self.stages, self.scene = Stages(), scene(own.views)
        watch(self.method, self.stages)
        parameters = sum(p.numel() for p in self.method.parameters())
        self.known = {"parameters": parameters, "memory_before": peak_memory()}

    @torch.no_grad()
    def run(self) -> dict:
        """Seconds of each stage and of the processor, memory so far, what is known of the method:
        among it the multiply-adds, counted in the first run."""
        if "multiply_adds" not in self.known:
            self.known["multiply_adds"] = multiply_adds(self.method, *self.scene, self.planes)
        self.stages.start()
        began = time.process_time()
        self.method(*self.scene, self.planes)
        self.stages.switch()
        spent = time.process_time() - began
        return {"seconds": self.stages.seconds, "cpu_seconds": spent, "peak_memory": peak_memory(), **self.known}


def start(*args) -> None:
    """The method of this process."""
    global own
    own = Timed(*args)


def run() -> dict:
    return own.run()
