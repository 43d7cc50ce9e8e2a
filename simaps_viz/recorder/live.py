"""Streams a build to viewers on this machine while it goes on: as many of its frames as there is time for."""

import time
from collections.abc import Callable
from dataclasses import replace

from numpy.typing import NDArray

from simaps_viz.errors import SIMapsError
from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, Event, FrameProjected, MergesFound
from simaps_viz.recorder.recorder import RerunRecorder
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.structures import SIMap

SHARE = 0.04
"""Of the processor time since the build began that may go into the stream."""
SETTINGS = RecorderSettings(color_every=1, depth_every=1, merge_pictures=40)


class LiveStream:
    """An observer of builds. A build that is stopped and gone on with stays one recording."""

    wants_color = False

    def __init__(self, color: Callable[[int], NDArray | None], *, share: float = SHARE) -> None:
        """Begin to serve.

        Args:
            color: frame index -> RGB, or None where it cannot be read.
            share: of the build's processor time that may be used.
        """
        self._color, self._share = color, share
        self._recorder = RerunRecorder(None, live=True, settings=SETTINGS)
        assert self._recorder.live_url is not None
        self.url = self._recorder.live_url
        self.frames: list[int] = []
        """Those that were streamed."""
        self._total = 0
        self._began_s = self._spent_s = 0.0
        self._end: list[Event] = []

    def on_event(self, event: Event) -> None:
        """Take one event; the end of the build is kept for ``finish``, so that it holds up nobody."""
        if isinstance(event, BuildStarted):
            if not self._total:
                self._total = len(event.frame_names)
                self._recorder.on_event(event)
            self._began_s, self._spent_s = time.process_time(), 0.0
        elif isinstance(event, FrameProjected):
            self._on_frame(event)
        elif isinstance(event, MergesFound | BuildFinished) or (isinstance(event, CommunitiesFound) and event.final):
            self._end.append(event)

    def show_map(self, simap: SIMap) -> None:
        """Show the objects found so far, at the last frame of that map."""
        last = len(simap.frame_names) - 1
        self._timed(lambda: self._recorder.on_event(CommunitiesFound(simap.grid, simap.instance, last, final=False)))

    def finish(self) -> None:
        """Stream how the finished map came about; the stream stays open."""
        for event in self._end:
            self._recorder.on_event(event)
        self._end = []

    def close(self) -> None:
        """End the stream."""
        self._recorder.close()

    def _on_frame(self, event: FrameProjected) -> None:
        index = event.frame.index
        wanted = index in (0, self._total - 1)
        if (wanted or self._has_time()) and (not self.frames or index > self.frames[-1]):
            self._timed(lambda: self._stream(event))
            self.frames.append(index)

    def _has_time(self) -> bool:
        return self._spent_s <= self._share * (time.process_time() - self._began_s)

    def _stream(self, event: FrameProjected) -> None:
        color = event.frame.color
        if color is None:
            try:
                color = self._color(event.frame.index)
            except SIMapsError:
                color = None
        self._recorder.on_event(replace(event, frame=replace(event.frame, color=color)))

    def _timed(self, do: Callable[[], None]) -> None:
        start = time.process_time()
        do()
        self._spent_s += time.process_time() - start
