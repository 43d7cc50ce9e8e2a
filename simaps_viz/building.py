"""Builds a map into a file such that nothing is lost: a log beside it while it grows, its history if wanted."""

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import Observer
from simaps_viz.mapping.build_log import (
    LogBusyError,
    frames_logged,
    keep_log,
    log_beside,
    set_aside_name,
    steps_beside,
)  # fmt: skip
from simaps_viz.mapping.history import MapHistory
from simaps_viz.mapping.mapfile import check_writable, save_map
from simaps_viz.methods import VARIANTS, Careful, build
from simaps_viz.pipeline import BuildConfig, Elsewhere
from simaps_viz.progress import BuildProgress, StageProgress, console
from simaps_viz.structures import SIMap

if TYPE_CHECKING:
    from simaps_viz.recorder.settings import RecorderSettings

COMMUNITIES_EVERY = 20
"""A recording shows the communities after every so many frames."""


def build_to_file(
    sequence: FrameSource,
    method: str,
    config: BuildConfig,
    output: Path,
    *,
    record: Path | None,
    progress: StageProgress,
    json_lines: bool = False,
    recorder_settings: "RecorderSettings | None" = None,
    observers: tuple[Observer, ...] = (),
    resume: bool = False,
    strict: bool = False,
    history: bool = False,
    logged: bool = True,
    cancel: threading.Event | None = None,
    elsewhere: Elsewhere | None = None,
) -> SIMap:
    """Build a map, write it, and record the build if asked; killed at any moment, it can go on.

    While it builds, a log grows beside the map (`log_beside`). It is removed when the map is there, or kept as its
    history (`steps_beside`). A recording is written anew when a build goes on: its pictures are not in the log.

    Args:
        sequence: what to build from.
        method: by name, see `methods.build`.
        config: everything but the method.
        output: the map file.
        record: also record the build in this file (.rrd).
        progress: told how far it is.
        json_lines: say on stdout what happens.
        recorder_settings: how much a recording keeps.
        observers: told too.
        resume: go on with the log of a build that did not finish, if there is one.
        strict: a frame that cannot be read is an error, not skipped.
        history: keep the log as ``.steps`` beside the map.
        logged: keep a log; without one a killed build cannot go on.
        cancel: set it to stop the build.
        elsewhere: who gathers the frames in place of this process, see `build_map`.

    Raises:
        InputError: as for `build_map`, or something cannot be written; an earlier map is left as it was.
        BuildCancelled: ``cancel`` was set.
    """
    check_writable(output)
    _check_method(method, resume=resume, history=history, recorded=record is not None, elsewhere=elsewhere is not None)
    logged, log = logged and method in VARIANTS, log_beside(output)
    if logged and not json_lines:
        _say_unfinished(log, output, len(sequence), resume=resume, recorded=record is not None)
    how: Careful = {"strict": strict, "cancel": cancel, "resume": resume, "log": log if logged else None,
                    "elsewhere": elsewhere}  # fmt: skip
    watching: list[Observer] = [BuildProgress(progress, json_lines=json_lines), *observers]
    if record is None:
        simap = build(sequence, method, config, watching, **how)
    else:  # rerun is slow to import
        from simaps_viz.recorder.recorder import RerunRecorder  # noqa: PLC0415
        from simaps_viz.recorder.repair import unfinished_recordings  # noqa: PLC0415
        from simaps_viz.recorder.settings import SMALL  # noqa: PLC0415

        with RerunRecorder(record, settings=recorder_settings or SMALL) as recorder:
            simap = build(sequence, method, config, [*watching, recorder], communities_every=COMMUNITIES_EVERY, **how)
        for left in unfinished_recordings(record):  # of builds that were killed
            left.unlink(missing_ok=True)
    save_map(simap, output)
    if logged:
        _finish(log, output, history=history)
    return simap


def _check_method(method: str, *, resume: bool, history: bool, recorded: bool, elsewhere: bool) -> None:
    if method not in VARIANTS and (resume or history):
        option = "--resume" if resume else "--history"
        raise InputError(f"{option}: expected a method that keeps a log ({', '.join(VARIANTS)}), found {method}")
    if elsewhere and (method not in VARIANTS or recorded):
        found = "--record, which shows every picture" if recorded else f"method {method}"
        raise InputError(f"--scheduler: expected method evidence, components or paper without --record, found {found}")


@contextmanager
def going_on(output: Path) -> Iterator[None]:
    """Tell who stops a build (Ctrl-C) how it goes on."""
    try:
        yield
    except KeyboardInterrupt:
        done = frames_logged(log_beside(output))
        if not done:
            raise
        raise KeyboardInterrupt(
            f"interrupted after {done} frames; go on with the same command and --resume; no file is half-written"
        ) from None


def is_whole(output: Path, record: Path, method: str) -> bool:
    """Tell whether a map is there with its recording, and with its history where its method keeps one."""
    return output.is_file() and record.is_file() and (method not in VARIANTS or steps_beside(output).is_file())


def build_whole(
    sequence: FrameSource, method: str, config: BuildConfig, output: Path, record: Path, progress: StageProgress
) -> SIMap:
    """Build a map with its recording, and its history where its method keeps one; several programs may do so at once.

    What goes in must follow from the file's name: a build that did not finish is gone on with.
    """
    try:
        return build_to_file(
            sequence, method, config, output, record=record, progress=progress,
            resume=frames_logged(log_beside(output)) > 0, history=method in VARIANTS,
        )  # fmt: skip
    except LogBusyError:
        return build_to_file(sequence, method, config, output, record=record, progress=progress, logged=False)


def history_beside(path: Path, simap: SIMap) -> MapHistory | None:
    """Open the history beside a map (or its recording, of the same name), if there is one and it is this map's."""
    steps = steps_beside(path)
    if not steps.is_file():
        return None
    try:
        history = MapHistory.open(steps)
    except InputError:
        return None
    return history if history.is_of(simap) else None


def _finish(log: Path, output: Path, *, history: bool) -> None:
    """The map is there: turn its log into history or remove it, with what earlier builds may have left."""
    steps = steps_beside(output)
    if history:
        keep_log(log, steps)
    else:
        if steps.is_file():
            steps.unlink()  # of the map that was there before
        log.unlink(missing_ok=True)
    set_aside_name(log).unlink(missing_ok=True)
    for saved in (output, steps):
        for left in output.parent.glob(f".{saved.name}.????????"):  # of builds killed while they saved
            if re.fullmatch(r"[a-z0-9_]{8}", left.name[-8:]) and left != log:
                left.unlink(missing_ok=True)


def _say_unfinished(log: Path, output: Path, frames: int, *, resume: bool, recorded: bool) -> None:
    done = max(frames_logged(log), frames_logged(set_aside_name(log)) if resume else 0)
    if done and resume and recorded:
        text = f"going on: {done} of {frames} frames are done; all are read again, as the recording shows them"
    elif done and resume:
        text = f"going on after {done} of {frames} frames"
    elif done:
        aside = set_aside_name(log).name
        text = f"{output}: an unfinished build of {done} frames was there; starting anew, it is kept as {aside} until "
        text += "this build is done (--resume goes on with whichever is farther)"
    elif resume:
        text = f"{output}: no unfinished build to go on with; starting at the first frame"
    else:
        return
    console.print(text, markup=False, soft_wrap=True)
