"""Render a path, held-out photos or a list of targets on the machines of a Ray cluster, in shards.

Every shard is a separate `liveview render --shard I/N --resume`: if its machine fails, it continues
on another one, with the pictures rendered so far. All machines must share the output folder under
the same name. A failing command is not repeated. Exit code 2 if a shard failed.

Usage, in python/, in the environment of `make setup WITH=ray`:
    python -m tools.render_on_ray SCENE -o FOLDER --shards N [--address auto] [--cpus 1]
        [--retries 3] [--join FILE] [--liveview PROGRAM] -- OPTIONS OF liveview render
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

import ray
from ray.exceptions import RayError, RayTaskError

ROOT = Path(__file__).resolve().parents[2]
STARTS = 5


class ShardFailed(Exception):
    """The program failed to render a shard."""


def render_shard(command: list[str]) -> str:
    """Run one shard on the machine that Ray chose; returns the program's one-line summary."""
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise ShardFailed(done.stderr.strip() or f"exit code {done.returncode}")
    return next(line for line in done.stdout.splitlines() if line.startswith("shard")).removeprefix("shard").strip()


def start(address: str, log) -> None:
    """Connect to a cluster, or start one on this machine; a busy machine may need longer than Ray's
    30 s."""
    for tries in range(STARTS):
        try:
            ray.init(address=address, log_to_driver=False, include_dashboard=False, logging_level="warning")
            return
        except Exception as error:  # Ray has no separate class for it
            if "timed out during startup" not in str(error) or tries + 1 == STARTS:
                raise
            log("Ray did not start in time; trying again")
            ray.shutdown()


def render(args, log) -> list[str]:
    """Render all shards; returns a line for each failure."""
    start(args.address, log)
    # Resubmitted here rather than by Ray, so that it can be reported.
    remote = ray.remote(num_cpus=args.cpus, max_retries=0)(render_shard)
    base = [args.liveview, "render", str(args.scene), "-o", str(args.output), "--resume", f"--threads={args.cpus}"]

    def submit(shard: int):
        return remote.remote([*base, f"--shard={shard}/{args.shards}", *args.options])

    started = time.monotonic()
    running = {submit(shard): shard for shard in range(1, args.shards + 1)}
    tries, failed, ended = dict.fromkeys(running.values(), 0), [], 0
    while running:
        [ready], _ = ray.wait(list(running), num_returns=1)
        shard = running.pop(ready)
        try:
            result = ray.get(ready)
        except RayTaskError as error:
            result = f"{shard}/{args.shards}: failed: {error.cause}"
            failed.append(result)
        except RayError as error:
            tries[shard] += 1
            if tries[shard] <= args.retries:
                log(f"shard {shard}/{args.shards}: its machine or process died; try {tries[shard]} of {args.retries}")
                running[submit(shard)] = shard
                continue
            result = f"{shard}/{args.shards}: died {tries[shard]} times: {str(error).splitlines()[0]}"
            failed.append(result)
        ended += 1
        log(f"shard {result} ({ended} of {args.shards} shards, {time.monotonic() - started:.0f} s)")
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="folder of the pictures, shared by all machines"
    )
    parser.add_argument("--shards", type=int, required=True, help="number of shards")
    parser.add_argument("--address", default="local", help="the cluster; auto: the running one, local: this machine")
    parser.add_argument("--cpus", type=int, default=1, help="cores of each shard")
    parser.add_argument("--retries", type=int, default=3, help="repetitions of a shard whose machine died")
    parser.add_argument("--join", metavar="FILE", help="then join the shards: .mp4, .gif or .json")
    parser.add_argument("--liveview", default=str(ROOT / "target" / "release" / "liveview"), help="the program")
    words = sys.argv[1:]
    own = words.index("--") if "--" in words else len(words)
    args = parser.parse_args(words[:own])
    args.options = words[own + 1 :]  # options of `liveview render`
    if min(args.shards, args.cpus) < 1 or args.retries < 0:
        parser.error("--shards and --cpus: expected 1 or more; --retries: 0 or more")
    args.scene, args.output = args.scene.resolve(), args.output.resolve()

    def log(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    failed = render(args, log)
    if failed:
        log(f"error: {len(failed)} of {args.shards} shards failed: {failed[0]}")
        return 2
    target = ["-o", args.join] if args.join else []
    return subprocess.run([args.liveview, "join", str(args.output), *target]).returncode


if __name__ == "__main__":
    sys.exit(main())
