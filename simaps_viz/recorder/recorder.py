"""Records a build for rerun, to a file, to a live viewer, or both; and what the recording looks like when opened.

After the frames come two more timelines: Louvain level by level, and the merge log step by step. While a page shows a
build, a viewer beside it is streamed the frames that it is asked to show.
"""

import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from types import TracebackType

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from simaps_viz.colors.classes import plural
from simaps_viz.colors.instances import instance_colors, take_over
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, Event, FrameProjected, MergesFound
from simaps_viz.geometry import turned_pose, upright_turns
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.recorder.facts import LEVELS, finished_facts, read_facts, send_facts, started_facts
from simaps_viz.recorder.map_log import (
    SURFACE,
    CameraLog,
    MapLog,
    Merging,
    markdown,
    markdown_table,
    merge_order,
    on_picture,
    shown_steps,
)
from simaps_viz.recorder.settings import SMALL, RecorderSettings
from simaps_viz.recorder.web_viewer import free_port
from simaps_viz.structures import Grid, GridSpec, SIMap

MARK_COLOR = (20, 20, 20)
MARK_MARGIN_M = 0.15
"""Between the cells of two groups that join and the rectangle around them."""


def log_louvain(stream: rr.RecordingStream, map_log: MapLog, event: CommunitiesFound, simap: SIMap | None) -> int:
    """Log timeline "louvain": 0 = classes only, then its levels, the last of which are the final communities.

    Args:
        stream: where to.
        map_log: draws the maps.
        event: the final communities.
        simap: the finished map; without it only the last level is known.

    Returns:
        Number of levels.
    """
    found = [] if simap is None else _levels_between(simap)
    levels = len(found) + 1
    stream.reset_time()
    stream.set_time("louvain", sequence=0)
    map_log.log_grid(event.grid)
    map_log.log_things(event.grid)
    stream.log("/now", markdown("**Before**: the map knows classes, not objects."))
    for position, level in enumerate(found, 1):
        stream.set_time("louvain", sequence=position)
        map_log.log_objects(event.grid, level.community, instance_colors(level))
        count = np.count_nonzero(np.unique(level.community))
        stream.log("/now", markdown(f"**Louvain, level {position} of {levels}**: {count} communities."))
    stream.set_time("louvain", sequence=levels)
    map_log.log_objects(event.grid, event.community)
    count = np.count_nonzero(np.unique(event.community))
    stream.log("/now", markdown(f"**Louvain** found {count} communities: pieces of objects, or whole ones."))
    stream.reset_time()
    return levels


def _levels_between(simap: SIMap) -> list[SIMap]:
    """Return the maps of Louvain's intermediate levels, in colours like those of the map."""
    steps = Timeline(simap)
    found = [steps.map_at(position) for position in range(1, steps.levels)]
    for level in found:
        take_over(level, simap)
    return found


def log_merges(
    stream: rr.RecordingStream, map_log: MapLog, event: MergesFound, settings: RecorderSettings, simap: SIMap | None
) -> None:
    """Log timeline "merge": 0 = the finest communities, n = after n merges.

    The steps the chosen K takes come first, in the order of the log, so that the map after them is the finished one
    (but for specks too small for an instance); those that only a smaller K would take follow. Not every
    step gets a picture, but each is told in words.
    """
    log, grid = event.log, event.grid
    order = merge_order(event.applied)
    applied = int(event.applied.sum())
    pictures = set(shown_steps(len(log), applied, settings.merge_pictures).tolist())
    merging = Merging(log, order, int(event.community.max(initial=0)))
    places = _Places(grid, event.community)
    stream.reset_time()
    stream.set_time("merge", sequence=0)
    map_log.log_grid(grid)
    map_log.log_objects(grid, event.community)
    stream.log("/now", markdown(f"**Merge log**: {len(log)} steps, {applied} of them taken{_chosen(simap)}."))
    for position in range(len(log)):
        stream.set_time("merge", sequence=position + 1)
        before = merging.name_of.copy()
        source, target = merging.step(position)
        stream.log("/map/merge", _mark(places, before == source, before == target))
        at = int(order[position])
        name, share = grid.labels[int(log.label[at])], float(log.score[at])
        taken = f"taken{_chosen(simap)}" if position < applied else f"**not** taken{_chosen(simap)}"
        text = f"{name}: community {source} joins {target}, {_score(share, simap)}"
        stream.log("/now", markdown(f"**Step {position + 1} of {len(log)}**, {taken}. {text}."))
        stream.log("/log", rr.TextLog(f"{position + 1}: {text}", level="INFO" if position < applied else "DEBUG"))
        if position + 1 in pictures:
            map_log.log_object_ids(grid, merging.name_of[event.community])
    stream.reset_time()


class _Places:
    """Where groups of communities lie. A group is given as bool [communities + 1]."""

    def __init__(self, grid: Grid, community: NDArray) -> None:
        rows, cols = np.nonzero(community)
        of_cell = community[rows, cols]
        xy = grid.spec.centres_of(rows, cols)
        size = int(community.max(initial=0)) + 1
        self._cells = np.bincount(of_cell, minlength=size)
        self._sums = np.stack([np.bincount(of_cell, weights=xy[:, axis], minlength=size) for axis in (0, 1)], axis=-1)
        self._low, self._high = np.full((size, 2), np.inf), np.full((size, 2), -np.inf)
        np.minimum.at(self._low, of_cell, xy)
        np.maximum.at(self._high, of_cell, xy)

    def centre(self, group: NDArray) -> NDArray:
        """Return the mean of the group's cells, float64 [2], map frame, metres."""
        return self._sums[group].sum(axis=0) / max(int(self._cells[group].sum()), 1)

    def frame(self, group: NDArray) -> NDArray:
        """Return the corners of a rectangle around the group, closed, float64 [5, 2], map frame, metres."""
        (x0, y0), (x1, y1) = self._low[group].min(axis=0) - MARK_MARGIN_M, self._high[group].max(axis=0) + MARK_MARGIN_M
        return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)])


def _mark(places: _Places, source: NDArray, target: NDArray) -> rr.LineStrips2D:
    """Draw a rectangle around two groups that join, and a line from the middle of one to that of the other."""
    link = np.stack([places.centre(source), places.centre(target)])
    strips = [on_picture(link), on_picture(places.frame(source | target))]
    return rr.LineStrips2D(strips, colors=MARK_COLOR, radii=0.025, draw_order=30.0)


def _chosen(simap: SIMap | None) -> str:
    if simap is None:
        return ""
    slider = method_of(simap.method).slider
    value = simap.parameters.get(slider.parameter) if slider is not None else None
    return f" at {slider.setting.format(value)}" if slider is not None and isinstance(value, int | float) else ""


def _score(score: float, simap: SIMap | None) -> str:
    slider = method_of(simap.method).slider if simap is not None else None
    if slider is not None:
        return slider.reason.format(100 * score)
    return f"score {score:.2f}"


MARGIN_M = 0.3
POINTS_FRAMES = 10
"""The 3-D view shows the points of so many frames up to this one; without a graphics card more are slow."""
PLAYBACK_FPS = 10.0

MAP_VIEWS = {
    "Objects": ("/map/ground", "/map/objects", "/map/camera", "/map/names", "/map/merge"),
    "Classes": ("/map/classes", "/map/camera"),
    "New edges": ("/map/ground", "/map/edges", "/map/camera"),
    "Heights": ("/map/heights", "/map/camera"),
}
"""The views of the map by their names, with the entities they show."""

Extent = tuple[float, float, float, float]
"""xmin, ymin, xmax, ymax, map frame, metres."""


def build_blueprint(extent_m: Extent | None = None) -> rrb.Blueprint:
    """Lay the views out so that they can be read at 640 pixels of width too: what is seen above, the map below.

    Args:
        extent_m: what the map views show; None while nobody knows.
    """
    names = {"color": "Camera", "segmentation": "Segments", "depth": "Depth"}
    cameras = [rrb.Spatial2DView(origin=f"/world/camera/{path}", name=name) for path, name in names.items()]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(rrb.Tabs(*cameras, active_tab=0), _room_and_counts()),
            map_views(extent_m, MAP_VIEWS),
            rrb.TextDocumentView(origin="/now", name="Now", titlebar=False),
            row_shares=[0.38, 0.50, 0.12],  # the last: two lines on a page of 720 pixels
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="frame", fps=PLAYBACK_FPS, play_state="paused"),
        auto_views=False,
    )


def _room_and_counts() -> rrb.Tabs:
    recent = rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            "frame",
            start=rrb.TimeRangeBoundary.cursor_relative(seq=-POINTS_FRAMES),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
    )
    so_far = rrb.VisibleTimeRanges(
        rrb.VisibleTimeRange(
            "frame", start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
        )
    )
    unseen = ["- /world/camera/depth", "- /world/camera/segmentation"]
    room = rrb.Spatial3DView(
        origin="/world",
        name="3-D",
        contents=["+ /world/**", f"- {SURFACE}", *unseen],
        overrides={"/world/points": [recent]},
    )
    surface = rrb.Spatial3DView(
        origin="/world",
        name="Surface",
        contents=["+ /world/**", "- /world/points", "- /world/cells", *unseen],
        overrides={SURFACE: [so_far]},
    )
    counts = rrb.Vertical(
        rrb.TimeSeriesView(origin="/counts", name="Cells and edges", contents=["/counts/cells/**", "/counts/edges"]),
        rrb.TimeSeriesView(origin="/counts/few", name="Classes and communities"),
        name="Counts",
    )
    about = rrb.TextDocumentView(origin="/about", name="About")
    log = rrb.TextLogView(origin="/log", name="Log")
    return rrb.Tabs(room, surface, counts, about, log, active_tab=0)


def map_views(extent_m: Extent | None, shown: Mapping[str, Sequence[str]]) -> rrb.Tabs:
    """Return tabs with views of the map, {name: entities}; without an extent rerun chooses what they show."""
    bounds = None
    if extent_m is not None:
        xmin, ymin, xmax, ymax = extent_m
        bounds = rrb.VisualBounds2D(
            x_range=(xmin - MARGIN_M, xmax + MARGIN_M), y_range=(-ymax - MARGIN_M, -ymin + MARGIN_M)
        )
    views = [
        rrb.Spatial2DView(origin="/map", name=name, contents=[*contents], visual_bounds=bounds)
        for name, contents in shown.items()
    ]
    return rrb.Tabs(*views, active_tab=0)


_AT_ONCE = 1 << 20


class FilePipe:
    """A file behind a pipe. Everything put in is taken out, written or, after a failure, dropped.

    rerun itself would wait for ever on a full disk, and report nothing.
    """

    def __init__(self, path: Path) -> None:
        """Make both; raises OSError when the file cannot be made. Where pipes cannot, the file is its own entrance."""
        self.path = path
        self.entrance = path
        """Where to write: a pipe that is read from now on, or the file itself."""
        self._file = path.open("wb", buffering=0)
        self._folder: Path | None = None
        self._thread: threading.Thread | None = None
        self._failure: OSError | None = None
        if hasattr(os, "mkfifo"):  # not on Windows
            with suppress(OSError):
                self._dig()

    def opened(self) -> None:
        """Remove the pipe from the file system, once the writer has opened it."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def finish(self) -> None:
        """Wait until all is on the disk, once the writer has closed the entrance; raises OSError when it is not."""
        if self._thread is not None:
            self._thread.join()
        with self._file:
            if self._failure is not None:
                raise self._failure
            os.fsync(self._file.fileno())

    def _dig(self) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="simaps-recording-"))
        pipe = self._folder / self.path.name
        try:
            os.mkfifo(pipe, 0o600)
        except OSError:
            self.opened()
            raise
        self.entrance = pipe
        self._thread = threading.Thread(target=self._pass_on, name="recording", daemon=True)
        self._thread.start()

    def _pass_on(self) -> None:
        with self.entrance.open("rb", buffering=0) as pipe:
            while data := pipe.read(_AT_ONCE):
                if self._failure is None:
                    self._write(memoryview(data))

    def _write(self, data: memoryview) -> None:
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError as error:
            self._failure = error


APPLICATION = "simaps"
"""Recordings of one application share their layout in the viewer."""
MAX_BURST_BYTES = 64_000_000


class RerunRecorder:
    """An observer of builds that writes their events to a recording (``.rrd``).

    The file is written under a temporary name beside ``path`` and takes its name when the build is finished (or, when
    it also streams live, on closing). After an error or Ctrl-C inside the ``with`` block there is no file. A file that
    cannot be written, e.g. because the disk is full, never stops the build: `close` raises it.
    """

    wants_color = True
    """The build decodes the colour of its frames for it."""

    def __init__(
        self,
        path: Path | None = None,
        *,
        settings: RecorderSettings = SMALL,
        live: bool = False,
    ) -> None:
        """Open the recording.

        Args:
            path: the file to write, ending in ".rrd"; one that is there is replaced.
            settings: how much is kept.
            live: serve the recording to viewers on a free port of 127.0.0.1 while it is made, at ``live_url``.

        Raises:
            InputError: neither file nor live, or the file cannot be written.
        """
        if path is None and not live:
            raise InputError("recorder: expected a file to write or a live stream, found neither")
        self.path = path
        self.live_url: str | None = None
        self._pipe = _open_beside(path) if path is not None else None
        self._partial = self._pipe.path if self._pipe is not None else None
        bursts = rr.ChunkBatcherConfig()
        bursts.flush_tick, bursts.flush_num_bytes = timedelta(days=1), MAX_BURST_BYTES
        self._stream = rr.RecordingStream(APPLICATION, batcher_config=bursts if path is None else None)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._stream.set_sinks(*self._sinks(live))
        if self._pipe is not None:
            self._pipe.opened()
        self._stream.send_blueprint(build_blueprint())  # once more at the end, when the map's extent is known
        self._open = True
        self._camera_log, self._map_log = CameraLog(self._stream, settings), MapLog(self._stream, settings)
        self._settings = settings
        self._started: BuildStarted | None = None
        self._communities: CommunitiesFound | None = None
        self._merges: MergesFound | None = None
        self._finished = False
        self._fault: InputError | None = None

    def __enter__(self) -> "RerunRecorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def on_event(self, event: Event) -> None:
        """Write one event; nothing is written after the file has got its name."""
        if not self._open:
            return
        if isinstance(event, BuildStarted):
            self._on_started(event)
        elif isinstance(event, FrameProjected):
            if event.kept:
                self._on_frame(event)
        elif isinstance(event, CommunitiesFound) and event.final:
            self._communities = event  # in colours that only the finished map knows
        elif isinstance(event, CommunitiesFound):
            self._show_objects(event, None)
        elif isinstance(event, MergesFound):
            self._merges = event  # told in words that only the finished map knows
        elif isinstance(event, BuildFinished):
            self._on_finished(event.simap)

    def flush(self) -> None:
        """Send the data logged so far; without this, a live stream without a file sends it late and in bursts."""
        if self._open:
            self._stream.flush()

    def close(self) -> None:
        """End the recording; the file gets its name. Doing it twice does nothing.

        Raises:
            InputError: the file could not be written whole; there is none, an earlier one is left as it was.
        """
        self._end()
        if self._fault is not None:
            raise self._fault

    def discard(self) -> None:
        """End the recording and remove its partial file; a finished recording stays."""
        if not self._open:
            return
        with suppress(OSError):  # an error of writing does not matter: the file is removed
            self._disconnect()
        if self._partial is not None:
            self._partial.unlink(missing_ok=True)

    def _end(self) -> None:
        if not self._open:
            return
        if not self._finished:
            self._write_steps(None)
        try:
            self._disconnect()
            if self._partial is not None and self.path is not None:
                read_facts(self._partial)  # it has its end
                os.replace(self._partial, self.path)
        except (OSError, InputError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            self._fault = InputError(f"{self.path}: could not write the recording: {reason}")
            if self._partial is not None:
                self._partial.unlink(missing_ok=True)

    def _disconnect(self) -> None:
        self._open = False
        self._stream.flush()
        self._stream.disconnect()
        if self._pipe is not None:
            self._pipe.finish()

    def _sinks(self, live: bool) -> list[rr.GrpcServerSink | rr.FileSink]:
        sinks: list[rr.GrpcServerSink | rr.FileSink] = []
        if live:
            port = free_port()
            self.live_url = f"rerun+http://127.0.0.1:{port}/proxy"
            sinks.append(rr.GrpcServerSink(bind_ip="127.0.0.1", port=port))
        if self._pipe is not None:
            sinks.append(rr.FileSink(str(self._pipe.entrance)))
        return sinks

    def _on_started(self, event: BuildStarted) -> None:
        self._started = event
        self._stream.send_recording_name(event.name)
        send_facts(self._stream, started_facts(event))
        self._stream.log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log("/about", markdown(about(event, None)), static=True)
        self._map_log.log_start()

    def _on_frame(self, event: FrameProjected) -> None:
        names = self._started.frame_names if self._started is not None else ()
        index = event.frame.index
        self._stream.reset_time()
        self._stream.set_time("frame", sequence=index)
        self._camera_log.log(_upright(event))
        self._map_log.log_frame(event, last=index == len(names) - 1)
        simulated = ", simulated" if self._started is not None and self._started.simulated else ""
        last = f", the last is {len(names) - 1}" if names else ""
        self._stream.log(
            "/now",
            markdown(
                f"**Frame {index}{last}** ({event.frame.name}{simulated}):"
                f" {plural(len(event.segmentation.segments), 'segment')}, {plural(len(event.new_edges), 'new edge')}."
            ),
        )

    def show_objects(self, simap: SIMap, colors: NDArray) -> None:
        """Show the objects of the frames so far, in the colours they have elsewhere, uint8 [n, 3]."""
        known = max(len(simap.frame_names) - 1, 0)
        if self._open:
            found = CommunitiesFound(simap.grid, simap.community, known, final=False, instance=simap.instance)
            self._show_objects(found, colors)

    def _show_objects(self, event: CommunitiesFound, colors: NDArray | None) -> None:
        self._stream.reset_time()
        self._stream.set_time("frame", sequence=event.frame_index)
        count = self._map_log.log_communities(event, colors)
        self._stream.log("/log", rr.TextLog(f"Louvain after frame {event.frame_index + 1}: {count} communities"))

    def _write_steps(self, simap: SIMap | None) -> None:
        if simap is not None:
            self._map_log.wear_colors_of(simap)
        if self._communities is not None:
            levels = log_louvain(self._stream, self._map_log, self._communities, simap)
            send_facts(self._stream, {LEVELS: levels})
            self._communities = None
        if self._merges is not None:
            log_merges(self._stream, self._map_log, self._merges, self._settings, simap)
            self._merges = None

    def _on_finished(self, simap: SIMap) -> None:
        self._write_steps(simap)
        self._stream.reset_time()
        self._stream.set_time("frame", sequence=max(len(simap.frame_names) - 1, 0))
        self._map_log.log_instances(simap)
        self._stream.log("/log", rr.TextLog(f"Finished: {plural(len(simap.instances), 'instance')}"))
        send_facts(self._stream, finished_facts(simap))
        if self._started is not None:
            self._stream.log("/about", markdown(about(self._started, simap)), static=True)
        self._stream.send_blueprint(build_blueprint(extent_of(simap.spec)))
        self._finished = True
        if self.live_url is None:
            self._end()
        else:
            self._stream.flush()


def about(event: BuildStarted, simap: SIMap | None) -> str:
    """Describe in Markdown what a recording shows, and what was found once it is known."""
    simulated = "\n\n**Simulated**: these are not pictures or masks of a real place." if event.simulated else ""
    text = (
        f"# {event.name}\n\nA Semantic Instance Map being built from {len(event.frame_names) or 'live'} frames."
        f" Segmentation: {event.segmentation_source}.{simulated}\n\n"
        "North is up. Sand: named, not told apart yet. Timelines: *frame* (the build), *louvain* (0 classes,"
        " then level by level), *merge* (one step per merge).\n"
    )
    if simap is None:
        return text
    rows = [(name, count) for name, count in simap.counts().items()]
    settings = ", ".join(
        f"{k} {v}" for k, v in simap.parameters.items() if k in ("k_percent", "affinity", "resolution")
    )
    found = f"\nMethod **{simap.method}**{f' ({settings})' if settings else ''}: {len(simap.instances)} instances.\n\n"
    return text + found + markdown_table(("class", "instances"), rows)


def extent_of(spec: GridSpec) -> Extent | None:
    """Return the extent of a grid; None where it has no cells."""
    return spec.extent_m if spec.rows and spec.cols else None


def _open_beside(path: Path) -> FilePipe:
    """Open the file that a recording is written to, beside the one it becomes."""
    if path.suffix != ".rrd":
        raise InputError(f"{path}: expected a name ending in .rrd for a recording")
    if path.is_dir():
        raise InputError(f"{path}: expected a file to write the recording to, found a folder")
    try:
        return FilePipe(path.with_name(f".{path.stem}.{os.getpid()}.partial.rrd"))
    except OSError as error:
        raise InputError(f"{path}: expected a place where a recording can be written ({error.strerror})") from error


def _upright(event: FrameProjected) -> FrameProjected:
    """Return the frame as a camera held upright would have taken it, for a person to look at."""
    turns = upright_turns(event.T_map_camera)
    if not turns:
        return event
    frame, masks = event.frame.turned(turns), event.segmentation.turned(turns)
    return replace(event, frame=frame, segmentation=masks, T_map_camera=turned_pose(event.T_map_camera, turns))


STREAMED = RecorderSettings(color_every=1, depth_every=1, merge_pictures=40)


class LiveStream:
    """An observer of builds. A build that is stopped and resumed stays one recording.

    What is shown together arrives together: a viewer draws anew whenever anything arrives, which on a machine without
    a graphics card takes longer than making it.
    """

    wants_color = False

    def __init__(self, color: Callable[[int], NDArray | None]) -> None:
        """Begin to serve.

        Args:
            color: frame index -> RGB, or None where it cannot be read.
        """
        self._color = color
        self._recorder = RerunRecorder(None, live=True, settings=STREAMED)
        assert self._recorder.live_url is not None
        self.url = self._recorder.live_url
        self.frames: list[int] = []
        """Indices of the frames that were streamed."""
        self._shown: SIMap | None = None
        self._started, self._total = False, 0  # frames; 0 = they come live
        self._last: FrameProjected | None = None
        self._end: list[Event] = []

    def open(self, started: BuildStarted, first: FrameProjected | None) -> None:
        """Show the start of the build before it begins: viewers take seconds to get ready for their first frame.

        Args:
            started: the event the build will begin with.
            first: its first frame, of which nothing is on the map yet; None where it cannot be read.
        """
        self.on_event(started)
        if first is not None:
            self.show(first, None)

    def on_event(self, event: Event) -> None:
        """Record one event; the end of the build is left to ``finish``, so that the build need not wait for it."""
        if isinstance(event, BuildStarted) and not self._started:
            self._started, self._total = True, len(event.frame_names)
            self._recorder.on_event(event)
            self._recorder.flush()
        elif isinstance(event, FrameProjected) and event.frame.index == self._total - 1:
            self._last = replace(event, snapshot=self._finished_grid, map_so_far=None)  # lets go of the build's
        elif isinstance(event, MergesFound | BuildFinished) or (isinstance(event, CommunitiesFound) and event.final):
            self._end.append(event)

    def show(self, event: FrameProjected, simap: SIMap | None) -> None:
        """Show a frame, and the objects found so far where they are new, at the last frame that they know."""
        if self.frames and event.frame.index <= self.frames[-1]:
            return
        if simap is not None:
            if self._shown is not None:
                take_over(simap, self._shown)  # as the page does
            self._shown = simap
            self._recorder.show_objects(simap, instance_colors(simap))
        self._stream(event)
        self._recorder.flush()

    def finish(self) -> None:
        """Stream the last frame, and how the finished map came about; the stream stays open."""
        last, self._last = self._last, None
        finished = any(isinstance(event, BuildFinished) for event in self._end)
        if last is not None and finished and last.frame.index not in self.frames:
            self._stream(last)
        for event in self._end:
            self._recorder.on_event(event)
        self._end = []
        self._recorder.flush()

    def close(self) -> None:
        """End the stream."""
        self._recorder.close()

    def _finished_grid(self) -> Grid:
        return next(event.simap.grid for event in self._end if isinstance(event, BuildFinished))

    def _stream(self, event: FrameProjected) -> None:
        color = event.frame.color
        if color is None:
            try:
                color = self._color(event.frame.index)
            except SIMapsError:
                color = None
        self._recorder.on_event(replace(event, frame=replace(event.frame, color=color)))
        self.frames.append(event.frame.index)
