"""Plants each fault of faults.toml in a copy of the repository: the test named there must fail."""

import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[2]
COPY = ROOT / "target/mutants/tree"
"""A copy: an interrupted run leaves no fault behind."""


def copy_sources() -> None:
    """Brings the copy up to date; equal files stay, so that they are not compiled again."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        source, copy = ROOT / name, COPY / name
        if source.is_file() and not (copy.is_file() and copy.read_bytes() == source.read_bytes()):
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, copy)


def run_tests(target: str, names: list[str]) -> str:
    """The output of these tests of a package's target, such as `liveview --lib`."""
    cargo = ["cargo", "test", "--locked", "--target-dir", str(ROOT / "target"), "-p", *target.split()]
    found = subprocess.run([*cargo, "--", "--exact", *names], cwd=COPY, capture_output=True, text=True, timeout=900)
    return found.stdout + found.stderr


def result(fault: dict[str, str]) -> str:
    """`found`, or what is wrong."""
    path, (target, test) = COPY / fault["file"], fault["test"].rsplit(" ", 1)
    text = path.read_text()
    if text.count(fault["old"]) != 1:
        return f"`old` stands {text.count(fault['old'])} times in {fault['file']}; expected once"
    path.write_text(text.replace(fault["old"], fault["new"]))
    try:
        output = run_tests(target, [test])
    finally:
        path.write_text(text)
    if f"test {test} ... FAILED" in output:
        return "found"
    return "NOT FOUND" if "test result: ok. 1 passed" in output else output[-2000:]


def main() -> int:
    """Prints a line for each fault whose name matches the argument; 1 if one was not found."""
    wanted = re.compile(sys.argv[1] if len(sys.argv) > 1 else "")
    faults = tomllib.loads((Path(__file__).parent / "faults.toml").read_text())["fault"]
    faults = [fault for fault in faults if wanted.search(fault["name"])]
    copy_sources()
    tests = defaultdict(set)
    for fault in faults:
        target, test = fault["test"].rsplit(" ", 1)
        tests[target].add(test)
    for target, names in tests.items():
        output = run_tests(target, sorted(names))
        if f"test result: ok. {len(names)} passed" not in output:
            print(f"{target} fails without a fault:\n{output[-4000:]}")
            return 1
    missed = 0
    for fault in faults:
        begun = time.monotonic()
        found = result(fault)
        missed += found != "found"
        print(f"{found}  {time.monotonic() - begun:.0f} s  {fault['name']}", flush=True)
    print(f"{len(faults) - missed} of {len(faults)} faults found")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
