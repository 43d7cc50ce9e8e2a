"""Builds are killed at random moments and gone on with: is the map the same, byte for byte, and is nothing lost?

Killed is a child process (SIGKILL: nothing of it runs after that). It is forked from one that has everything loaded, so
that a hundred kills take minutes, and does all that ``simaps build`` does.
"""

import os
import random
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from simaps_viz.build.build_log import frames_logged, log_beside, steps_beside
from simaps_viz.errors import InputError

Build = Callable[[Sequence[str]], int]
"""Runs ``simaps`` with these arguments; returns the exit status."""

EARLIER = b"an earlier map, which must not be harmed"
NEAR_THE_END = 0.4
"""This share of the kills falls into the end of a build, where maps are written."""
END = 0.75
"""Where the end begins, as a share of a whole build's time."""


@dataclass(frozen=True)
class KilledBuild:
    """One build that was killed once or more, and gone on with."""

    method: str
    history: bool
    after_s: float
    """From its start to the first kill."""
    phase: str
    """What it was doing: "before the first frame", "mapping frames", "finding instances or saving", "done"."""
    frames: int
    """In the log then."""
    faults: tuple[str, ...]
    """What was lost or left over, in words; none = all is well."""


def kill_builds(
    build: Build, sequence: Path, folder: Path, *, frames: int, kills: int = 100, seed: int = 0
) -> Iterator[KilledBuild]:
    """Kill builds at random moments and go on with them.

    Args:
        build: runs the command line.
        sequence: what is built.
        folder: an empty one to work in.
        frames: of the sequence.
        kills: number of builds to be killed; every fifth is killed a second time while going on.
        seed: of the moments.

    Raises:
        InputError: a build that nobody kills fails.
    """
    dice = random.Random(seed)
    kinds = [("evidence", False), ("paper", True)]
    wanted: dict[tuple[str, bool], tuple[dict[str, bytes], float]] = {}
    for method, history in kinds:
        where = folder / f"whole-{method}"
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
        files, whole_s = wanted[method, history]
        where = folder / f"{number}"
        where.mkdir()
        one = _one(build, sequence, where, dice, method, files, whole_s, frames, twice=number % 5 == 4, history=history)
        shutil.rmtree(where)
        number += 1
        if one.phase != PHASES[3] or one.faults:  # a build that was done before its moment came was not killed
            killed += 1
            yield one


def table(done: Sequence[KilledBuild]) -> str:
    """Describe how many builds were killed when, and how many maps were lost."""
    tried, lost = Counter(one.phase for one in done), Counter(one.phase for one in done if one.faults)
    lines = ["| killed while | builds killed | maps lost |", "|---|---|---|"]
    lines += [f"| {phase} | {tried[phase]} | {lost[phase]} |" for phase in PHASES if tried[phase]]
    lines.append(f"| **all** | **{len(done)}** | **{sum(lost.values())}** |")
    lines += [f"{one.method}, {one.phase}, after {one.after_s:.3f} s: {f}" for one in done for f in one.faults]
    return "\n".join(lines)


PHASES = ("before the first frame", "mapping frames", "finding instances or saving", "done")


def _one(
    build: Build, sequence: Path, where: Path, dice: random.Random, method: str, wanted: dict[str, bytes],
    whole_s: float, frames: int, *, twice: bool, history: bool,
) -> KilledBuild:  # fmt: skip
    output = where / "map.npz"
    output.write_bytes(EARLIER)
    arguments = _arguments(sequence, where, method, history=history)
    after_s = whole_s * (dice.uniform(END, 1.1) if dice.random() < NEAR_THE_END else dice.random())
    faults: list[str] = []
    killed = _run(build, arguments, kill_after_s=after_s) is None
    logged = frames_logged(log_beside(output))
    phase = PHASES[3] if not killed else PHASES[0 if logged == 0 else 1 if logged < frames else 2]
    if output.read_bytes() not in (EARLIER, wanted["map.npz"]):
        faults.append("the map file was half-written")
    if twice and killed:
        _run(build, [*arguments, "--resume"], kill_after_s=dice.random() * whole_s)
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
    names = {steps_beside(folder / "map.npz").name, "map.npz"}
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
        os.kill(child, signal.SIGKILL)  # a child that is done waits to be asked for its status: never another process
    _, status = os.waitpid(child, 0)
    return None if os.WIFSIGNALED(status) else os.waitstatus_to_exitcode(status)
