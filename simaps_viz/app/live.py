"""The page of a map that is still being built: it grows there, and in the docked recording, as it is computed."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from simaps_viz.app import workbench
from simaps_viz.app.live_build import BEGINS_ANEW, STOPPED, Audience, LiveBuild, Run
from simaps_viz.app.share import look_back
from simaps_viz.build.methods import config_of, keeps_log
from simaps_viz.build.pipeline import BuildConfig, facts_of, started
from simaps_viz.build.to_file import BuildRequest, RecordingFault, build_to_file, going_on
from simaps_viz.console.progress import StageProgress, stage_progress
from simaps_viz.console.terminal import console
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.events import FrameProjected, Observer
from simaps_viz.mapping.mending import Mending, open_mending
from simaps_viz.mapping.partition import empty_log
from simaps_viz.mapping.simap import Origin, assemble
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import Grid, GridSpec, SIMap, Views

if TYPE_CHECKING:
    from simaps_viz.viewer.workbench import Workbench

AROUND_M = 2.0
"""Floor that is shown around the cameras' way before anything was seen."""
MOST_CELLS = 4_000_000


@dataclass(frozen=True, eq=False)
class LiveSettings:
    """What is built, and where it is shown."""

    request: BuildRequest
    """Its history is kept, asked for or not, where its method keeps a log."""
    port: int = 8080
    """Where to serve the page; the next free one when it is taken."""


def watch_build(sequence: FrameSource, settings: LiveSettings, *, browser: bool) -> None:
    """Build a map and show it while it grows, until Ctrl-C; at any moment that leaves a log to go on with."""
    with stage_progress() as progress, live_workbench(sequence, settings, progress) as (page, build):
        workbench.tell_where(page, browser=browser)
        build.start(resume=settings.request.resume)
        try:
            with going_on(settings.request.output):
                _wait(build)
            page.wait()
        finally:
            build.stop(show=False)
            build.wait(10.0)


@contextmanager
def live_workbench(
    sequence: FrameSource, settings: LiveSettings, progress: StageProgress
) -> "Iterator[tuple[Workbench, LiveBuild]]":
    """Serve the page of a build that has not begun; begin with ``start`` of what this gives.

    Raises:
        InputError: the port is taken, or rerun's viewer is missing.
    """
    from simaps_viz.drawing.texture import sketch_png  # noqa: PLC0415 - so that nothing slow comes with it
    from simaps_viz.recorder.live import LiveStream  # noqa: PLC0415 - rerun is slow to import

    color: Any = getattr(sequence, "color", None)
    request = settings.request
    waiting = waiting_map(sequence, config_of(request.method, request.config))
    stream = LiveStream(color or (lambda index: None))
    stream.open(started(sequence), first_look(sequence, waiting))
    pages: list[Workbench] = []
    ended = threading.Event()

    def done(simap: SIMap) -> str:
        try:
            edits.append(open_mending(request.output, simap))
        except InputError as fault:  # edits of an earlier build: this one is there nevertheless
            faults.append(str(fault))
        mending = edits[0] if edits else None
        recorded = request.record if request.record is not None and request.record.is_file() else None
        panels = workbench.panels_of(simap, recorded, mending, beside=True)
        pages[0].finish(simap if mending is None else mending.simap(), panels, recorded)
        if not ended.is_set():
            stream.finish()
        for text in (f"{request.output}: {workbench.counts_in_words(simap.counts())}", *faults):
            console.print(text, markup=False, soft_wrap=True)
        return " ".join((f"Saved as {request.output}.", *faults))

    faults: list[str] = []
    edits: list[Mending] = []
    audience = Audience(
        show=lambda simap: pages[0].publish(simap, growing=True),
        watches=lambda: bool(pages[0].sessions),
        done=done,
        stream=stream,
        sketch=lambda event: sketch_png(event.snapshot(), event.T_map_camera[:2, 3]),
        stopped=STOPPED if keeps_log(request.method) else BEGINS_ANEW,
    )
    build = LiveBuild(_runner(sequence, request, progress, faults), len(sequence), audience)
    try:
        with _serve(sequence, settings, build, waiting, stream.url, lambda: edits[0] if edits else None) as page:
            pages.append(page)
            yield page, build
            ended.set()
            build.stop(show=False)
            build.wait(10.0)
    finally:
        stream.close()


def _runner(sequence: FrameSource, request: BuildRequest, progress: StageProgress, faults: list[str]) -> Run:
    """Return what builds; that its recording was lost goes to ``faults``, for the map is there."""
    logged = keeps_log(request.method)

    def run(observers: Sequence[Observer], cancel: threading.Event, resume: bool) -> SIMap:
        now = replace(request, resume=resume and logged, history=request.history or logged)
        try:
            return build_to_file(sequence, now, progress, observers=tuple(observers), cancel=cancel)
        except RecordingFault as fault:
            faults.append(str(fault))
            return fault.simap

    return run


def _serve(
    sequence: FrameSource,
    settings: LiveSettings,
    build: LiveBuild,
    waiting: SIMap,
    stream: str,
    mending: Callable[[], Mending | None],
) -> "Workbench":
    from simaps_viz.recorder.web_viewer import (  # noqa: PLC0415 - rerun is slow to import
        CONTENT_SECURITY_POLICY,
        rerun_page,
        viewer_assets,
    )  # fmt: skip
    from simaps_viz.viewer.panels.live import LiveServices, live_panel  # noqa: PLC0415 - viser is slow to import
    from simaps_viz.viewer.workbench import Workbench  # noqa: PLC0415 - as above

    services = replace(
        workbench.bare_services(waiting, mending),
        panels=(live_panel(LiveServices(build.state, build.stop, build.go_on)),),
        rerun_page=rerun_page,
        rerun_assets=viewer_assets(),
        csp=CONTENT_SECURITY_POLICY,
        stream=stream,
        building=True,
        look_back=look_back(lambda: None if mending() is None else settings.request.output),
    )
    start = workbench.start_pose(replace(waiting, T_map_camera=_cameras(sequence)))
    return Workbench(waiting, services=services, port=settings.port, start=start, robot_radius_m=RobotShape().radius_m)


def waiting_map(sequence: FrameSource, config: BuildConfig) -> SIMap:
    """Return a map on which nothing has been seen yet, of the floor around the cameras' way."""
    facts, size = facts_of(sequence), config.projection.cell_size_m
    at = _cameras(sequence)[:, :2, 3]
    low = np.floor((at.min(axis=0) - AROUND_M) / size)
    cells = np.ceil((at.max(axis=0) + AROUND_M) / size) - low
    rows, cols = (int(cells[1]), int(cells[0])) if cells.prod() <= MOST_CELLS else (1, 1)
    spec = GridSpec(rows, cols, cell_size_m=size, x0_m=float(low[0] * size), y0_m=float(low[1] * size))
    nothing, zero = np.full(spec.shape, np.nan, np.float32), np.zeros(spec.shape, np.int32)
    grid = Grid(spec, facts.labels, facts.is_thing, zero.astype(np.int16), nothing, nothing.copy(), zero)
    none = np.zeros(0, np.int32)
    origin = Origin(
        T_map_world=facts.T_map_world,
        method=config.method,
        parameters=config.parameters(),
        provenance={"sequence": facts.path, "name": facts.name, "segmentation": facts.segmentation_source,
                    "simulated": facts.simulated, "frames": 0},
        frame_names=(),
        T_map_camera=np.zeros((0, 4, 4)),
    )  # fmt: skip
    return assemble(grid, (), zero.copy(), empty_log(), Views(none, none, none, none, np.zeros(0, np.float32)), origin)


def first_look(sequence: FrameSource, waiting: SIMap) -> FrameProjected | None:
    """Return the first frame as it is before anything of it is on the map; None when it cannot be read."""
    try:
        frame, segmentation = sequence.read(0), sequence.segmentation(0)
    except InputError:
        return None  # the build says so
    nothing = np.zeros((0, 4), np.int32)
    return FrameProjected(
        frame=frame,
        segmentation=segmentation,
        T_map_camera=np.asarray(sequence.T_map_world @ sequence.poses[0]),
        cells=nothing[:, :2],
        new_edges=nothing,
        new_edge_labels=np.zeros(0, np.int16),
        snapshot=lambda: waiting.grid,
    )


def _cameras(sequence: FrameSource) -> np.ndarray:
    """Return the cameras' poses in the map frame, float64 [frames, 4, 4]."""
    return np.asarray(sequence.T_map_world @ sequence.poses)


def _wait(build: LiveBuild) -> None:
    """Wait until the map is done, however often it is stopped and gone on with on the page."""
    pause, before = threading.Event(), build.state()
    while (state := build.state()).status != "done":
        if state.status != before.status and state.status in ("stopped", "failed"):
            console.print(f"{state.status}: {state.error or state.said}", markup=False, soft_wrap=True)
        before = state
        pause.wait(0.2)
