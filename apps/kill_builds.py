"""Kill builds at random moments, resume each, and print how many maps were lost. See docs/RELIABILITY.md.

A resumed build must end in the same files, byte for byte. It runs in a child process, which does all that
``simaps build`` does and is ended by SIGKILL: nothing of it runs after that. The child is forked from this process,
which has everything loaded, so that a hundred kills take minutes.

Builds run as a new user. Beyond the folder that a build writes to no file may change: those of this user, of the
sequence and of this checkout are looked at after each.
"""

import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tyro
from attacks.files import CHECKOUT, Watched, user_folders

from simaps_viz import open_sequence
from simaps_viz.app.workbench import cache_folder
from simaps_viz.build.build_log import frames_logged, history_path, log_path
from simaps_viz.cli.main import main as simaps
from simaps_viz.console.progress import stage_progress
from simaps_viz.datasets.convert import write_posed_frames
from simaps_viz.errors import InputError
from simaps_viz.scenes.demo import ensure_demo

Build = Callable[[Sequence[str]], int]
"""Runs ``simaps`` with these arguments; returns the exit status."""

EARLIER = b"an earlier map, which must not be harmed"
NEAR_THE_END = 0.4
"""Share of the kills near the end of a build, where maps are written."""
END = 0.75
"""Share of the build time after which the end begins."""
PHASES = ("before the first frame", "mapping frames", "finding instances or saving", "done")
"""What a build was doing when it was killed."""


@dataclass(frozen=True)
class KilledBuild:
    """One build that was killed once or twice, and resumed."""

    method: str
    history: bool
    after_s: float
    """Seconds from its start to the first kill."""
    phase: str
    """One of `PHASES`."""
    frames: int
    """Frames in the log at that time."""
    faults: tuple[str, ...]
    """Descriptions of what was lost or left behind; empty when all is well."""


def kill_builds(
    build: Build, sequence: Path, folder: Path, *, frames: int, kills: int = 100, seed: int = 0
) -> Iterator[KilledBuild]:
    """Kill builds at random moments and resume them.

    Args:
        build: runs the command line.
        sequence: the sequence to build.
        folder: an empty folder to work in.
        frames: the number of frames of the sequence.
        kills: the number of builds to kill; every fifth is killed a second time after it resumed.
        seed: seed of the random moments.

    Raises:
        InputError: a build that nobody kills fails.
    """
    dice = random.Random(seed)
    kinds = [("evidence", False), ("paper", True)]
    wanted: dict[tuple[str, bool], tuple[dict[str, bytes], float]] = {}
    for method, history in kinds:
        where = folder / f"complete-{method}"
        where.mkdir()
        arguments = _arguments(sequence, where, method, history=history)
        _run(build, arguments, kill_after_s=None)  # compiles and fills caches
        start = time.monotonic()
        if _run(build, arguments, kill_after_s=None) != 0:
            raise InputError(f"{sequence}: expected a sequence that can be built, found a build that fails")
        wanted[method, history] = _files(where), time.monotonic() - start
    killed = number = 0
    while killed < kills:
        method, history = kinds[number % len(kinds)]
        files, build_s = wanted[method, history]
        where = folder / f"{number}"
        where.mkdir()
        one = _one(build, sequence, where, dice, method, files, build_s, frames, twice=number % 5 == 4, history=history)
        shutil.rmtree(where)
        number += 1
        if one.phase != PHASES[3] or one.faults:  # a build that was done before its moment came was not killed
            killed += 1
            yield one


def table(done: Sequence[KilledBuild]) -> str:
    """Return a Markdown table of the builds killed in each phase, and the maps lost."""
    tried, lost = Counter(one.phase for one in done), Counter(one.phase for one in done if one.faults)
    lines = ["| killed while | builds killed | maps lost |", "|---|---|---|"]
    lines += [f"| {phase} | {tried[phase]} | {lost[phase]} |" for phase in PHASES if tried[phase]]
    lines.append(f"| **all** | **{len(done)}** | **{sum(lost.values())}** |")
    lines += [f"{one.method}, {one.phase}, after {one.after_s:.3f} s: {f}" for one in done for f in one.faults]
    return "\n".join(lines)


def _one(
    build: Build, sequence: Path, where: Path, dice: random.Random, method: str, wanted: dict[str, bytes],
    build_s: float, frames: int, *, twice: bool, history: bool,
) -> KilledBuild:  # fmt: skip
    output = where / "map.npz"
    output.write_bytes(EARLIER)
    arguments = _arguments(sequence, where, method, history=history)
    after_s = build_s * (dice.uniform(END, 1.1) if dice.random() < NEAR_THE_END else dice.random())
    faults: list[str] = []
    killed = _run(build, arguments, kill_after_s=after_s) is None
    logged = frames_logged(log_path(output))
    phase = PHASES[3] if not killed else PHASES[0 if logged == 0 else 1 if logged < frames else 2]
    if output.read_bytes() not in (EARLIER, wanted["map.npz"]):
        faults.append("the map file was half-written")
    if twice and killed:
        _run(build, [*arguments, "--resume"], kill_after_s=dice.random() * build_s)
    if _run(build, [*arguments, "--resume"], kill_after_s=None) != 0:
        faults.append("--resume failed")
    found = _files(where)
    faults += [f"{name} is not the same" for name in wanted if found.get(name) != wanted[name]]
    faults += [f"{name} was left behind" for name in found if name not in wanted]
    return KilledBuild(method, history, after_s, phase, logged, tuple(faults))


def _arguments(sequence: Path, where: Path, method: str, *, history: bool) -> list[str]:
    kept = ["--history"] if history else []
    return ["build", str(sequence), "-o", str(where / "map.npz"), "--method", method, "--json", *kept]


def _files(folder: Path) -> dict[str, bytes]:
    names = {history_path(folder / "map.npz").name, "map.npz"}
    return {path.name: path.read_bytes() if path.name in names else b"" for path in sorted(folder.iterdir())}


def _run(build: Build, arguments: Sequence[str], *, kill_after_s: float | None) -> int | None:
    """Run a build in a child; returns its exit status, None when it was killed."""
    child = os.fork()
    if child == 0:
        status = 70
        try:
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            status = build(arguments)
        finally:
            os._exit(status)
    if kill_after_s is not None:
        time.sleep(kill_after_s)
        os.kill(child, signal.SIGKILL)  # a finished child keeps its process id until it is waited for
    _, status = os.waitpid(child, 0)
    return None if os.WIFSIGNALED(status) else os.waitstatus_to_exitcode(status)


@dataclass(frozen=True)
class KillBuilds:
    """Options of the command line."""

    sequence: Path | None = None
    """Sequence to build; by default the embedded café."""
    every: int = 5
    """Take every so many frames of it."""
    kills: int = 100
    """Number of builds to kill."""
    seed: int = 0
    """Seed of the random moments."""


def main(config: KillBuilds) -> int:
    """Kill, resume, compare, print; the exit status is 0 when nothing was lost."""
    with stage_progress() as progress:
        path = config.sequence or ensure_demo(cache_dir=cache_folder(), progress=progress)
    done: list[KilledBuild] = []
    with user_folders() as folder, tempfile.TemporaryDirectory() as work:
        manifest = write_posed_frames(open_sequence(path), folder / "work", every=config.every)
        frames, watched = len(open_sequence(manifest)), Watched([folder, CHECKOUT, path.absolute().parent])
        before = watched.files()
        for one in kill_builds(simaps, manifest, Path(work), frames=frames, kills=config.kills, seed=config.seed):
            done.append(replace(one, faults=(*one.faults, *watched.changes(before))))
            before = watched.files()
    sys.stdout.write(table(done) + "\n")
    return int(any(one.faults for one in done))


if __name__ == "__main__":
    sys.exit(main(tyro.cli(KillBuilds)))
