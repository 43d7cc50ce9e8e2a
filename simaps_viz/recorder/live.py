"""Streams a build to viewers while it runs: the frames that it is asked to show."""

from collections.abc import Callable
from dataclasses import replace

from numpy.typing import NDArray

from simaps_viz.colors.instances import instance_colors, take_over
from simaps_viz.errors import SIMapsError
from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, Event, FrameProjected, MergesFound
from simaps_viz.recorder.recorder import RerunRecorder
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.structures import Grid, SIMap

SETTINGS = RecorderSettings(color_every=1, depth_every=1, merge_pictures=40)


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
        self._recorder = RerunRecorder(None, live=True, settings=SETTINGS)
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
