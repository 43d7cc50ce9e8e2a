"""Build a map into a file, or a building: a map for each floor of a recording, and the file that holds them together.

A log in the map's folder lets a killed build resume, and can be kept as the map's history.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from simaps_viz.build import METHOD_NAMES
from simaps_viz.build.build_log import (  # fmt: skip
    BuildLog,
    LogBusyError,
    frames_logged,
    history_path,
    log_path,
    set_aside_name,
)
from simaps_viz.build.methods import build, config_of, keeps_log
from simaps_viz.build.pipeline import BuildConfig, BuildControl, RemoteGatherer, fingerprint
from simaps_viz.build.seen_colors import with_colors
from simaps_viz.console.progress import BuildProgress, StageProgress
from simaps_viz.console.terminal import note
from simaps_viz.datasets.source import FrameSource
from simaps_viz.drawing.legend import counted
from simaps_viz.errors import InputError
from simaps_viz.events import Observer
from simaps_viz.io.files import left_beside
from simaps_viz.mapping.file import check_writable, save_map
from simaps_viz.mapping.floor_plan import with_rooms
from simaps_viz.mapping.history import MapHistory
from simaps_viz.mapping.steps import is_step_file
from simaps_viz.structures import SIMap

if TYPE_CHECKING:
    from simaps_viz.recorder.settings import RecorderSettings
import hashlib
import json
from collections.abc import Callable
from contextlib import suppress

from simaps_viz.datasets.floors import find_floors, find_stairs, split_floors
from simaps_viz.io.files import write_whole
from simaps_viz.mapping.building import MAX_NAME, Building, Floor, Stairs, floor_path, is_building, save_building
from simaps_viz.mapping.file import load_map

COMMUNITIES_EVERY = 20
"""A recording shows the communities after every so many frames."""


@dataclass(frozen=True, eq=False)
class BuildRequest:
    """What is built, how, and into which files."""

    method: str
    """By name, see `methods.build`."""
    config: BuildConfig
    """Everything but the method."""
    output: Path
    """The map file."""
    record: Path | None = None
    """Also record the build in this file (.rrd)."""
    recorder_settings: "RecorderSettings | None" = None
    """What a recording keeps."""
    resume: bool = False
    """Resume from the log of a build that did not finish, if there is one."""
    strict: bool = False
    """A frame that cannot be read is an error, not skipped."""
    history: bool = False
    """Keep the log as the history of the map, ``.steps``."""
    logged: bool = True
    """Keep a log; without one a killed build cannot resume."""


class RecordingFault(InputError):  # noqa: N818 - as people read it
    """The map is built and saved, but its recording could not be written."""

    def __init__(self, fault: InputError, simap: SIMap) -> None:
        super().__init__(str(fault))
        self.simap = simap


def build_to_file(
    sequence: FrameSource,
    request: BuildRequest,
    progress: StageProgress,
    *,
    json_lines: bool = False,
    observers: tuple[Observer, ...] = (),
    cancel: threading.Event | None = None,
    gatherer: RemoteGatherer | None = None,
) -> SIMap:
    """Build a map, write it, and record the build if asked; killed at any time, it can resume.

    While it builds, a log grows in the map's folder (`log_path`). It is removed when the map is written, or kept as its
    history (`history_path`). A recording is written anew when a build resumes: its pictures are not in the log.

    Args:
        sequence: what to build from.
        request: what to make of it.
        progress: shows how far the build is.
        json_lines: print events on stdout.
        observers: notified of every event.
        cancel: set it to stop the build.
        gatherer: gathers the frames in place of this process, see `build_map`.

    Raises:
        InputError: as for `build_map`, or something cannot be written; an earlier map is left as it was.
        RecordingFault: the recording could not be written; the map is saved.
        BuildCancelled: ``cancel`` was set.
    """
    output, record = request.output, request.record
    check_writable(output)
    _check_steps(output, history=request.history)
    _check_method(request, remote=gatherer is not None)
    logged = request.logged and keeps_log(request.method)
    if logged and not json_lines:
        _report_unfinished(log_path(output), output, len(sequence), resume=request.resume, recorded=record is not None)
    watching = [BuildProgress(progress, json_lines=json_lines), *observers]
    facts = fingerprint(sequence, config_of(request.method, request.config)) if logged else {}
    # While the log is open, no other process builds this map.
    with BuildLog(log_path(output), facts, resume=request.resume) if logged else nullcontext() as log:
        # Left by builds that were killed while saving; found later, they may be of one that is saving now.
        left = [*left_beside(output), *left_beside(history_path(output))] if log is not None else []
        every = COMMUNITIES_EVERY if record is not None else 0
        control = BuildControl(request.strict, log, cancel=cancel, gatherer=gatherer, communities_every=every)
        fault = None
        if record is None:
            simap = build(sequence, request.method, request.config, watching, control)
        else:
            simap, fault = _build_recorded(sequence, request, record, watching, control)
        progress("looking at colours", 0, 1)
        simap = with_colors(simap, sequence)
        progress("looking at colours", 1, 1)
        progress.clock.begin("writing")
        simap = with_rooms(simap)
        save_map(simap, output)
        if log is not None:
            _finish(log, output, left, history=request.history)
    if fault is not None:
        raise RecordingFault(fault, simap)
    return simap


def _build_recorded(
    sequence: FrameSource, request: BuildRequest, record: Path, watching: list[Observer], control: BuildControl
) -> tuple[SIMap, InputError | None]:
    """Build a map and its recording; return the fault of the recording, if any, as the map is not lost with it."""
    from simaps_viz.recorder.library import unfinished_recordings  # noqa: PLC0415 - rerun is slow to import
    from simaps_viz.recorder.recorder import RerunRecorder  # noqa: PLC0415 - as above
    from simaps_viz.recorder.settings import SMALL  # noqa: PLC0415 - as above

    simap = None
    try:
        with RerunRecorder(record, settings=request.recorder_settings or SMALL) as recorder:
            simap = build(sequence, request.method, request.config, [*watching, recorder], control)
    except InputError as fault:
        if simap is None:
            raise
        return simap, fault
    for left in unfinished_recordings(record):  # of builds that were killed
        left.unlink(missing_ok=True)
    return simap, None


def _check_method(request: BuildRequest, *, remote: bool) -> None:
    """Raise InputError for a method or a recording that the options of the build do not go with."""
    able, method = [name for name in METHOD_NAMES if keeps_log(name)], request.method
    if not keeps_log(method) and (request.resume or request.history):
        option = "--resume" if request.resume else "--history"
        raise InputError(f"{option}: expected a method that keeps a log ({', '.join(able)}), found {method}")
    recorded = request.record is not None
    if remote and (not keeps_log(method) or recorded):
        found = "--record, which shows every picture" if recorded else f"method {method}"
        names = f"{', '.join(able[:-1])} or {able[-1]}"
        raise InputError(f"--scheduler: expected method {names} without --record, found {found}")


def _check_steps(output: Path, *, history: bool) -> None:
    """Raise InputError where the history would replace something other than an earlier history."""
    steps = history_path(output)
    if history and steps.exists() and not is_step_file(steps):
        raise InputError(f"{steps}: expected the history of an earlier map or nothing, found another file")


@contextmanager
def resume_hint(output: Path) -> Iterator[None]:
    """Print how to resume when a build is interrupted (Ctrl-C)."""
    try:
        yield
    except KeyboardInterrupt:
        done = frames_logged(log_path(output))
        if not done:
            raise
        raise KeyboardInterrupt(
            f"interrupted after {done} frames; the same command with --resume continues; no file is half-written"
        ) from None


def is_complete(output: Path, record: Path, method: str) -> bool:
    """Return whether a map exists with its recording, and with its history where its method keeps one."""
    return output.is_file() and record.is_file() and (not keeps_log(method) or history_path(output).is_file())


def build_complete(
    sequence: FrameSource, method: str, config: BuildConfig, output: Path, record: Path, progress: StageProgress
) -> SIMap:
    """Build a map with its recording, and its history where its method keeps one; several processes may do so at once.

    The file's name must determine the build, as an unfinished one is resumed.
    """
    resume, history = frames_logged(log_path(output)) > 0, keeps_log(method)
    request = BuildRequest(method, config, output, record, resume=resume, history=history)
    try:
        return build_to_file(sequence, request, progress)
    except LogBusyError:
        return build_to_file(sequence, replace(request, resume=False, history=False, logged=False), progress)


def open_history(path: Path, simap: SIMap) -> MapHistory | None:
    """Open the history of a map, given the path of the map or of its recording; None if there is none of this map."""
    steps = history_path(path)
    if not steps.is_file():
        return None
    try:
        history = MapHistory.open(steps)
    except InputError:
        return None
    return history if history.is_of(simap) else None


def _finish(log: BuildLog, output: Path, left: list[Path], *, history: bool) -> None:
    """Keep the log as history or remove it, now that the map is written; remove what earlier builds have left."""
    steps = history_path(output)
    if history:
        log.keep(steps)
    else:
        if is_step_file(steps):
            steps.unlink()  # of the map that was there before
        log.remove()
    for one in left:
        if one != log.path:
            one.unlink(missing_ok=True)


def _report_unfinished(log: Path, output: Path, frames: int, *, resume: bool, recorded: bool) -> None:
    done = max(frames_logged(log), frames_logged(set_aside_name(log)))
    if done and resume and recorded:
        text = f"resuming: {done} of {frames} frames are done; all are read again, as the recording shows them"
    elif done and resume:
        text = f"resuming after {done} of {frames} frames"
    elif done:
        aside = set_aside_name(log).name
        text = f"{output}: an unfinished build of {done} frames was there; starting anew, it is kept as {aside} until "
        text += "this build is done (--resume continues the one with more frames)"
    elif resume:
        text = f"{output}: no unfinished build to resume; starting at the first frame"
    else:
        return
    note(text)


def build_building(
    sequence: FrameSource,
    request: BuildRequest,
    progress: StageProgress,
    *,
    json_lines: bool = False,
    finish: Callable[[SIMap, FrameSource, Path], SIMap] = lambda simap, part, path: simap,
) -> tuple[Building, list[dict[str, int]]]:
    """Build a map for each floor of a recording, beside the building file, which is written last.

    A recording of one floor makes a building of one floor, whose map is that of `build_to_file`. A killed build can
    resume: maps that are done stay, and the one that was begun goes on.

    Args:
        sequence: what to build from.
        request: what to make of it; its output is the building file, recordings and histories are of its floors.
        progress: shows how far the build is.
        json_lines: print events on stdout.
        finish: called with each map, its frames and its path, once it is written; returns the map.

    Returns:
        The building, and of each floor {class: objects that count}.

    Raises:
        InputError: as for `build_to_file`.
        BuildCancelled: as for `build_to_file`.
    """
    output = request.output
    check_writable(output)
    if output.exists() and not is_building(output):
        raise InputError(f"{output}: expected the building file of an earlier build or nothing, found another file")
    progress("looking for floors", 0, 1)
    heights = find_floors(sequence)
    stairs = find_stairs(sequence, heights)
    parts = split_floors(sequence, heights) if len(heights) > 1 else [sequence]
    progress("looking for floors", 1, 1)
    # An earlier building's file goes before its maps do: what there is must not name maps of another one.
    output.unlink(missing_ok=True)
    begun = output.with_name(f".{output.name}.building")
    done: dict[str, str] = {}
    if request.resume and begun.is_file():
        with suppress(OSError, ValueError):
            done = dict(json.loads(begun.read_bytes()))
    counts, maps = [], [floor_path(output.with_suffix(".npz"), i) for i in range(1, len(parts) + 1)]
    for number, (part, path) in enumerate(zip(parts, maps, strict=True), start=1):
        key = _key(part, request)
        if key and done.get(path.name) == key and path.is_file() and not frames_logged(log_path(path)):
            simap = load_map(path)
        else:
            record = request.record and (floor_path(request.record, number) if len(parts) > 1 else request.record)
            with resume_hint(path):
                simap = build_to_file(
                    part, replace(request, output=path, record=record), progress, json_lines=json_lines
                )
            simap = finish(simap, part, path)
            done[path.name] = key
            write_whole(begun, json.dumps(done).encode(), "the state of the build")
        counts.append(counted(simap))
    name = "".join(c for c in sequence.name if c.isprintable())[:MAX_NAME]
    building = Building(
        name,
        tuple(Floor(i, path, h) for i, (path, h) in enumerate(zip(maps, heights, strict=True), start=1)),
        tuple(
            Stairs(lower + 1, (float(foot[0]), float(foot[1])), (float(head[0]), float(head[1])))
            for lower, foot, head in stairs
        ),
    )
    save_building(building, output)
    begun.unlink(missing_ok=True)
    return building, counts


def _key(part: FrameSource, request: BuildRequest) -> str:
    """Hash all that a floor's map depends on; "" where its method cannot resume."""
    if not keeps_log(request.method):
        return ""
    facts = [fingerprint(part, config_of(request.method, request.config)), request.history, str(request.record)]
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
