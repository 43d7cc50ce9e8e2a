"""What is tried, measured and shown leaves the checkout as it was, also when it is killed."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from attacks.files import CHECKOUT, user_folders
from browser import free_port
from toy_maps import toy_map
from waiting import until

from simaps_viz.mapping.file import save_map

MAP, PORT = "MAP", "PORT"
PROGRAMS = {"attack": [MAP, "--only", "requests_that_are_none"], "reference": []}
"""Programs of apps/ that are run to their end."""
KILLED = {
    "method_figures": [],
    "paper": [],
    "record_build": [],
    "screenshots": [],
    "workbench": [MAP, "--no-browser", "--port", PORT],
    "demo": ["--no-browser", "--port", PORT],
}
"""Programs of apps/, and the demo, that write files or serve pages and are killed at it."""
PRINTING = {
    "bench", "bench_building", "bench_cluster", "bench_live", "bench_networks", "bench_page", "bench_space",
    "fake_robot", "fuzz", "kill_builds", "load", "measure_masks",
}  # fmt: skip
"""Programs that only print, their files below the system's folder for temporary ones; tests call what they run."""


@pytest.fixture(scope="module")
def given(tmp_path_factory):
    folder = tmp_path_factory.mktemp("given")
    save_map(toy_map(), folder / "toy.npz")
    return {MAP: str(folder / "toy.npz"), PORT: str(free_port())}


def checkout():
    """Return git's account of the checkout: what is not committed, and how it differs."""
    if shutil.which("git") is None or not (CHECKOUT / ".git").exists():
        pytest.skip("this is no checkout")
    said = [("status", "--porcelain", "--untracked-files=all"), ("diff",)]
    return [subprocess.run(["git", *words], cwd=CHECKOUT, capture_output=True, check=True).stdout for words in said]


def start(name, options, given):
    """Start a program in the checkout, as somebody would, in a process group of its own."""
    words = ["-m", "simaps_viz", "demo"] if name == "demo" else [str(CHECKOUT / "apps" / f"{name}.py")]
    return subprocess.Popen(
        [sys.executable, *words, *(given.get(word, word) for word in options)],
        cwd=CHECKOUT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True, env={**os.environ, "PYTHONPATH": str(CHECKOUT), "SIMAPS_NO_BROWSER": "1"},
    )  # fmt: skip


def test_there_is_no_other_program():
    named = {*PROGRAMS, *KILLED, *PRINTING, "render_habitat"} - {"demo"}  # it runs where Habitat is, with own tests
    assert named == {path.stem for path in (CHECKOUT / "apps").glob("*.py")}


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_leave_a_checkout_as_it_was(given, name):
    before = checkout()
    with user_folders():
        process = start(name, PROGRAMS[name], given)
        said, _ = process.communicate(timeout=600)
    assert process.returncode == 0, said
    assert checkout() == before


WORKED_S = 2.0
"""Of a processor for each program: it has imported all that it needs then, and is at what it does."""


def worked_s(process):
    """Return how long a program that has not ended has had a processor."""
    if process.poll() is not None:
        return WORKED_S
    numbers = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(numbers[11]) + int(numbers[12])) / os.sysconf("SC_CLK_TCK")


def kill(process):
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.communicate()


def test_killed_programs_leave_a_checkout_as_it_was(given):
    """All at once, each on a port of its own, killed when all are at work."""
    before = checkout()
    with user_folders():
        processes = [start(name, KILLED[name], {**given, PORT: str(free_port())}) for name in KILLED]
        try:
            until(lambda: sum(map(worked_s, processes)) > WORKED_S * len(processes), 600.0)
        finally:
            for process in processes:
                kill(process)
    assert checkout() == before


def test_a_file_that_comes_or_changes_is_noticed():
    before, new = checkout(), CHECKOUT / "tests" / "left-behind.txt"
    try:
        new.touch()
        assert checkout() != before
    finally:
        new.unlink()


def test_figures_and_pictures_go_to_the_checkout_only_when_asked_to():
    """`make docs`, `make recordings` and `make screenshots` name the folder; the programs alone write to build/."""
    ignored = subprocess.run(["git", "check-ignore", "build/x"], cwd=CHECKOUT, capture_output=True, check=False)
    assert ignored.returncode == 0
    for name in ("record_build", "screenshots", "method_figures"):
        text = Path(CHECKOUT / "apps" / f"{name}.py").read_text(encoding="utf-8")
        assert '"build"' in text and '"assets"' not in text and '"recordings"' not in text
