"""README.md and docs/: their commands run as printed, their links exist."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import urllib.request
from functools import cache
from pathlib import Path

import pytest

from liveview_ref.paths import ROOT

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *ROOT.glob("*/README.md"),
]
COMMAND_PAGES = ["README.md", "docs/usage.md", "docs/viewer.md", "docs/live-video.md"]
COMMAND_PAGES += ["docs/benchmarks.md"]
NEEDS_FFMPEG = ".mp4", "ffplay"


def commands(page: str) -> list[str]:
    """The commands in the page's ```sh blocks, with continued lines joined."""
    blocks = re.findall(r"^```sh\n(.*?)^```", (ROOT / page).read_text(), re.DOTALL | re.MULTILINE)
    return [line for block in blocks for line in block.replace("\\\n", " ").splitlines() if line]


@pytest.fixture(scope="module")
def clone(tmp_path_factory) -> Path:
    """A reader's working directory: the repository, with a separate `out` and
    the program installed."""
    folder = tmp_path_factory.mktemp("clone")
    for name in ("tests", "models", ".venv"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def environment(clone: Path) -> dict[str, str]:
    """The environment without variables of this project; `cargo install` writes into the clone, not
    the home folder."""
    kept = {name: value for name, value in os.environ.items() if name not in ("LIVEVIEW_MODELS", "ORT_DYLIB_PATH")}
    installed = clone / "installed"
    return kept | {"CARGO_INSTALL_ROOT": str(installed), "PATH": f"{installed / 'bin'}:{kept['PATH']}"}


@pytest.fixture(scope="module")
def installed(clone) -> Path:
    """The program, installed by the README's commands."""
    for command in commands("README.md"):
        if command.startswith(("make ", "cargo ")):
            subprocess.run(shlex.split(command), cwd=ROOT, env=environment(clone), check=True, capture_output=True)
    return clone


@pytest.mark.skipif(not (ROOT / "target/release/liveview").is_file(), reason="the program is not built (make build)")
@pytest.mark.parametrize("page", COMMAND_PAGES)
def test_commands_of_a_page_run(page, installed):
    found = [command for command in commands(page) if command.startswith("liveview ")]
    assert found and all(line.startswith(("liveview ", "make ", "cargo ")) for line in commands(page))
    for command in found:
        if not shutil.which("ffmpeg") and any(word in command for word in NEEDS_FFMPEG):
            continue
        if command.startswith("liveview view "):
            answers_over_http(command, installed)
            continue
        run = subprocess.run(
            shlex.split(command), cwd=installed, env=environment(installed), capture_output=True, text=True
        )
        assert run.returncode == 0, f"{page}: {command}\n{run.stderr}"
        if " -o " in command:
            assert (installed / shlex.split(command)[shlex.split(command).index("-o") + 1]).exists(), command


def answers_over_http(command: str, clone: Path) -> None:
    """`liveview view` runs until it is interrupted; the link it prints leads to a page. On
    any free port."""
    words = [*shlex.split(command), "--port", "0"]
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(words, cwd=clone, env=environment(clone), **output) as server:
        try:
            link = next((match[0] for line in server.stdout if (match := re.search(r"http://\S+", line))), None)
            assert link, f"{command}: it ended without a link"
            with urllib.request.urlopen(link, timeout=30) as answer:
                assert answer.status == 200 and b"<html" in answer.read().lower()
        finally:
            server.send_signal(signal.SIGINT)
            server.wait(30)


@cache
def anchors(page: Path) -> set[str]:
    """Anchors of the page's headings, in GitHub's form."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_of_a_page_exist(page):
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith(("http://", "https://")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{page.relative_to(ROOT)}: {link}"
        assert not anchor or anchor in anchors(target), f"{page.relative_to(ROOT)}: {link}"
