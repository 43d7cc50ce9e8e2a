"""What all pages compute together: each partition and each picture of a map once, however many people ask for it."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import cv2
from numpy.typing import NDArray

from simaps_viz.drawing.frame_pictures import communities_unseen_until
from simaps_viz.drawing.texture import ColorMode, map_image, pixels_per_cell
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.page.services import Services
from simaps_viz.viewer.server.host import Host

V = TypeVar("V")

MOST_SIDE = 4096
"""Pixels of a map's picture a side: what WebGL takes everywhere, and a browser decodes in a second."""
MOST_PARTITIONS = 16
"""Maps as the sliders cut them: some steps of dragging one there and back, on a few pages."""
MOST_PICTURES = 24
"""Of a few maps in some colour modes, selections and frames; of large maps fewer, see MOST_PICTURE_BYTES."""
MOST_LOOKS = 6
"""Maps as they were after a frame: each takes as much memory as a map, and is soon computed anew."""
MOST_TIMELINES = 4
"""One for each map that is cut otherwise; pages mostly share one."""
MOST_PICTURE_BYTES = 64_000_000
"""So much memory all pictures (PNG) take at most; a single larger one is kept all the same."""
AT_ONCE = 2
"""Computations that may run at the same time; more would only slow each other down."""


class Once(Generic[V]):
    """Remembers the latest results by key; who asks for one that is being computed waits for it."""

    def __init__(self, most: int, *, size: Callable[[V], int] = lambda value: 0, most_size: int = 0) -> None:
        """Take how many results to keep, and how large all of them may be together (0 = whatever)."""
        self._most, self._size, self._most_size = most, size, most_size
        self._found: OrderedDict[Hashable, V] = OrderedDict()
        self._under_way: dict[Hashable, threading.Event] = {}
        self._lock = threading.Lock()
        self.computed = 0
        """How often something had to be computed."""

    def get(self, key: Hashable, compute: Callable[[], V]) -> V:
        """Return the result for a key. What ``compute`` raises goes to the one who ran it; the next tries anew."""
        while True:
            with self._lock:
                if key in self._found:
                    self._found.move_to_end(key)
                    return self._found[key]
                waiting = self._under_way.get(key)
                if waiting is None:
                    mine = self._under_way[key] = threading.Event()
                    break
            waiting.wait()
        try:
            value = compute()
            with self._lock:
                self.computed += 1
                self._found[key] = value
                self._trim()
            return value
        finally:
            with self._lock:
                del self._under_way[key]
            mine.set()

    def forget(self, unless: Callable[[Hashable], bool]) -> None:
        """Drop the results whose keys do not pass."""
        with self._lock:
            for key in [key for key in self._found if not unless(key)]:
                del self._found[key]

    def _trim(self) -> None:
        total = sum(map(self._size, self._found.values())) if self._most_size else 0
        while len(self._found) > self._most or (total > self._most_size and len(self._found) > 1):
            _, dropped = self._found.popitem(last=False)
            total -= self._size(dropped) if self._most_size else 0


class Shared:
    """The computing that pages have in common. Maps are told apart by identity: they never change."""

    def __init__(self, services: Services) -> None:
        """Take what computes."""
        self._services = services
        self._turn = threading.BoundedSemaphore(AT_ONCE)
        self.partitions: Once[SIMap] = Once(MOST_PARTITIONS)
        self.looks: Once[SIMap | None] = Once(MOST_LOOKS)
        self.timelines: Once[Timeline] = Once(MOST_TIMELINES)
        self._timeline: Timeline | None = None
        self.pictures: Once[bytes] = Once(MOST_PICTURES, size=len, most_size=MOST_PICTURE_BYTES)

    def partition(self, base: SIMap, percent: float, resolution: float) -> SIMap:
        """Return a map cut into instances anew.

        Args:
            base: as it was built.
            percent: K, or 100 x the affinity.
            resolution: of Louvain; the base's own needs no new communities.
        """
        services = self._services
        cut = base
        if resolution != float(base.parameters.get("resolution", resolution)) and services.recommunity is not None:
            find = services.recommunity
            cut = self.partitions.get(
                (base, "resolution", resolution), lambda: self._in_turn(lambda: find(base, resolution, percent))
            )
        if services.repartition is None:
            return cut
        join = services.repartition
        return self.partitions.get((cut, percent), lambda: self._in_turn(lambda: join(cut, percent)))

    def look_back(self, simap: SIMap, frame: int) -> SIMap | None:
        """Return what a map looked like after a frame; None when nobody knows."""
        look = self._services.look_back
        if look is None:
            return None
        return self.looks.get((simap, frame), lambda: self._in_turn(lambda: look(simap, frame)))

    def timeline(self, simap: SIMap) -> Timeline:
        """Return the steps in which the objects of a map came about."""
        self._timeline = made = self.timelines.get((simap,), lambda: Timeline(simap, like=self._timeline))
        return made

    def picture(
        self,
        simap: SIMap,
        mode: ColorMode,
        lit: frozenset[int] | None,
        until: int | None,
        theme: Theme = LIGHT,
    ) -> bytes:
        """Return a map's picture as PNG; ``until``: without what no frame up to this one had named (None = all)."""
        key = (simap, mode, lit, until, theme)
        return self.pictures.get(key, lambda: self._in_turn(lambda: png(paint(simap, mode, lit, until, theme))))

    def prepare(self, simap: SIMap) -> None:
        """Compute what a page that is opened wants first, while its browser is still loading it."""
        self.picture(simap, "instance", None, None)

    def forget_maps(self, kept: Callable[[SIMap], bool]) -> None:
        """Drop what was computed from maps that no page shows any more."""
        self._timeline = None
        for store in (self.partitions, self.looks, self.timelines, self.pictures):
            store.forget(lambda key: isinstance(key, tuple) and kept(key[0]))

    def _in_turn(self, compute: Callable[[], V]) -> V:
        with self._turn:
            return compute()


def paint(
    simap: SIMap, mode: ColorMode, lit: frozenset[int] | None, until: int | None, theme: Theme = LIGHT
) -> NDArray:
    """Paint a map, uint8 [rows * scale, cols * scale, 3], RGB, row 0 at the south; arguments as in `Shared.picture`.

    Above `MOST_SIDE` cells a side it is smaller than that.
    """
    hidden = () if until is None else tuple(communities_unseen_until(simap, until).tolist())
    image = map_image(simap, mode, lit=lit, hidden=hidden, scale=pixels_per_cell(simap), theme=theme)
    shrink = MOST_SIDE / max(image.shape[:2])
    if shrink >= 1.0:
        return image
    rows, cols = (max(1, round(side * shrink)) for side in image.shape[:2])
    return cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA)


def png(image: NDArray) -> bytes:
    """Encode a picture, uint8 [H, W, 3 or 4], RGB or RGBA."""
    order = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return cv2.imencode(".png", cv2.cvtColor(image, order))[1].tobytes()


@dataclass(frozen=True, eq=False)
class Common:
    """Handed to every session by its workbench."""

    services: Services
    shared: Shared
    recording: Host | None
    """Serves the recorded build."""
    tabs: Host
    """Serves the hidden frame that tells which tab a page is in."""
    recorded: SIMap
    """The map whose build was recorded."""
    building: bool
    """The map is still being built: the recording runs ahead of the page, and nothing ties them."""
    published: Callable[[], SIMap]
    """The map that a new page shows."""
    publish: Callable[[SIMap], None]
    """Show a map on all pages, cut as each page's sliders are."""
    start: Pose2 | None
    robot_radius_m: float
    judging: AbstractContextManager[object] = field(default_factory=threading.RLock)
    """Held while an answer of a judge is saved."""
