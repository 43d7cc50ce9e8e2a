"""Takes shots from a source until it ends, and puts them on a map: with masks where they come in time."""

import threading
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.seen_colors import with_colors
from simaps_viz.errors import InputError
from simaps_viz.events import BuildStarted, Observer, notify
from simaps_viz.live.growing import GrowingMap, warm_up
from simaps_viz.live.source import Shot, Source, Traffic
from simaps_viz.mapping.file import check_writable, save_map
from simaps_viz.mapping.floor_plan import with_rooms
from simaps_viz.segmentation.geometry_stuff import add_stuff
from simaps_viz.segmentation.protocol import Network
from simaps_viz.segmentation.sequences import needs_stuff
from simaps_viz.structures import SIMap

TAKE_S = 0.1
"""Every so often it is looked whether to stop."""
CORRECT_S = 2.0
"""Frames are placed again at most so often."""


@dataclass(frozen=True, eq=False)
class LiveRequest:
    """What a live map is made of, and into which file."""

    source: Source
    config: BuildConfig
    output: Path
    idle_stop_s: float | None = None
    """End when nothing has come for so long; None = wait for as long as it takes."""
    network: Network | None = None
    """Makes the masks of the newest picture whenever it is free."""
    every_frame: bool = False
    """Wait for the network at each frame, for sources that can wait."""
    observers: tuple[Observer, ...] = ()
    """Notified of every event, in addition to those of the run."""
    earlier: SIMap | None = None
    """A map of the same place, to go on with."""
    traffic: Traffic = field(default_factory=Traffic)
    """Counts what comes and what is left out."""


class LiveRun:
    """One run; `words` may be asked from any thread."""

    def __init__(self, request: LiveRequest) -> None:
        self.request, self.traffic = request, request.traffic
        self.moved = 0
        """Frames that were placed again."""
        self.growing = GrowingMap(request.source, request.config, request.earlier)
        self._last_s = self._corrected_s = time.monotonic()

    def words(self) -> str:
        """Describe the connection and what comes, in one line."""
        again = f"{self.moved} placed again" if self.moved else ""
        kinds = Counter(one.kind for one in self.growing.changes())
        changes = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        parts = self.request.source.words(), self.traffic.words(), again, self.place_words(), changes
        return " · ".join(filter(None, parts))

    def place_words(self) -> str:
        """Describe whether the map goes on with the earlier one; "" where there is none."""
        best, growing = self.growing.placement, self.growing
        if growing.earlier is None:
            return ""
        score = "" if best is None else f" (agreement {best.score:.2f}, elsewhere {best.second:.2f})"
        return f"on the earlier map{score}" if growing.is_placed else f"not found on the earlier map{score}"

    def started(self) -> BuildStarted:
        """Return the event that the run begins with; it names no frames, as none is known."""
        source = self.request.source
        return BuildStarted(source.name, (), np.eye(4), source.segmentation_source, source.simulated)

    def run(self, observers: Sequence[Observer], cancel: threading.Event) -> SIMap:
        """Take shots until the source ends, falls silent, or ``cancel`` is set; return the map, which is saved.

        Raises:
            InputError: nothing came, or the map cannot be written.
        """
        request, growing = self.request, self.growing
        observers = (*observers, *request.observers)
        check_writable(request.output)
        source = request.source
        notify(observers, self.started())
        warm_up(request.config)
        self._last_s = time.monotonic()
        with ThreadPoolExecutor(1, "live-masks") as pool:
            masks = _Masks(request.network, pool) if request.network is not None else None
            while not (cancel.is_set() or source.ended or self._silent()):
                shot = source.take(TAKE_S)
                self._correct()
                for one in [shot] if masks is None else masks.through(shot, growing, wait=request.every_frame):
                    self._put(one, observers)
                if shot is not None:
                    self._last_s = time.monotonic()  # what comes while a shot takes long is no silence
            for one in masks.rest(growing) if masks is not None else ():
                self._put(one, observers)
        for event in growing.finish_waiting():
            notify(observers, event)
        return self._save(observers)

    def _put(self, shot: Shot | None, observers: Sequence[Observer]) -> None:
        if shot is None:
            return
        left_out = self.growing.contradicting
        try:
            events = self.growing.add(shot)
        except InputError:  # it would become larger than a map may be
            self.traffic.drop("too far away")
            return
        if self.growing.contradicting > left_out:
            self.traffic.drop("contradicts the map")
            return
        self.traffic.place(shot)
        for event in events:
            notify(observers, event)

    def _silent(self) -> bool:
        limit_s = self.request.idle_stop_s
        return limit_s is not None and time.monotonic() - self._last_s > limit_s

    def _correct(self) -> None:
        now_s = time.monotonic()
        if now_s - self._corrected_s >= CORRECT_S and (correction := self.request.source.correction()) is not None:
            self.moved += self.growing.place_again(correction)
            self._corrected_s = time.monotonic()

    def _save(self, observers: Sequence[Observer]) -> SIMap:
        request, growing = self.request, self.growing
        if not self.traffic.placed:
            found = request.source.words()
            raise InputError(f"{request.source.name}: expected frames, found none{f' ({found})' if found else ''}")
        simap = growing.finished(observers)
        live = {"shots": self.traffic.placed, "dropped": dict(self.traffic.dropped), "moved": self.moved}
        if growing.earlier is not None:
            live["earlier"] = {
                "name": growing.earlier.provenance.get("name"), "found": growing.is_placed,
                "agreement": None if growing.placement is None else round(growing.placement.score, 3),
            }  # fmt: skip
        simap = replace(simap, provenance={**simap.provenance, "live": live})
        sequence = getattr(request.source, "sequence", None)
        simap = with_rooms(simap if sequence is None else with_colors(simap, sequence))
        save_map(simap, request.output)
        return simap


class _Masks:
    """A network in a thread of its own: it looks at the newest picture whenever it is free; others go on without."""

    def __init__(self, network: Network, pool: ThreadPoolExecutor) -> None:
        self._network, self._pool, self._by_geometry = network, pool, needs_stuff(network)
        self._busy: Future[Shot] | None = None

    def through(self, shot: Shot | None, growing: GrowingMap, *, wait: bool) -> list[Shot]:
        """Return the shots that are ready to be placed, after one more has come."""
        ready = []
        if self._busy is not None and (self._busy.done() or (wait and shot is not None)):
            ready, self._busy = [self._busy.result()], None
        if shot is not None and self._busy is None and shot.frame.color is not None:
            self._busy = self._pool.submit(self._segment, shot, growing)
        elif shot is not None:
            ready.append(shot)
        return ready

    def rest(self, growing: GrowingMap) -> list[Shot]:
        """Return the shot that the network is busy with, once it is done."""
        busy, self._busy = self._busy, None
        return [] if busy is None else [busy.result()]

    def _segment(self, shot: Shot, growing: GrowingMap) -> Shot:
        color, network = shot.frame.color, self._network
        assert color is not None
        found = network.decode(network.infer(network.prepare(color)), *color.shape[:2])
        if self._by_geometry and growing.T_map_world is not None:
            found = add_stuff(shot.frame, found, growing.T_map_world @ shot.frame.T_world_camera)
        return replace(shot, segmentation=found)
