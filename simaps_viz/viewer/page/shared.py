"""Computations shared by all pages: each cut and each picture of a map is computed once, however many pages need it."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

import cv2
from numpy.typing import NDArray

from simaps_viz.drawing.frame_pictures import communities_unseen_until
from simaps_viz.drawing.texture import TINT, ColorMode, map_image, pixels_per_cell
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.services import Services

V = TypeVar("V")

MAX_SIDE = 4096
"""Pixels of a map's picture a side: what WebGL takes everywhere, and a browser decodes in a second."""
MAX_PARTITIONS = 16
"""Maps as the sliders cut them: enough for dragging a slider there and back on a few pages."""
MAX_PICTURES = 24
"""Pictures kept: a few maps in some colour modes, selections and frames; fewer of large maps, see below."""
MAX_LOOKS = 6
"""Maps as they were after a frame: each takes as much memory as a map, and is quickly computed again."""
MAX_TIMELINES = 4
"""One for each map that is cut differently; most pages share one."""
MAX_PICTURE_BYTES = 64_000_000
"""Memory that all kept pictures (PNG) may take; a single larger one is kept anyway."""
AT_ONCE = 2
"""Computations that may run at the same time; more would only slow each other down."""


class Once(Generic[V]):
    """A cache of the latest results by key. Threads that ask for a result that is being computed wait for it."""

    def __init__(self, most: int, *, size: Callable[[V], int] = lambda value: 0, most_size: int = 0) -> None:
        """Keep ``most`` results, of at most ``most_size`` in total (0 = no limit) as ``size`` measures each."""
        self._most, self._size, self._most_size = most, size, most_size
        self._found: OrderedDict[Hashable, V] = OrderedDict()
        self._under_way: dict[Hashable, threading.Event] = {}
        self._lock = threading.Lock()
        self.computed = 0
        """How many results were computed."""

    def get(self, key: Hashable, compute: Callable[[], V]) -> V:
        """Return the result for a key. An error of ``compute`` reaches only its caller; the next one tries again."""
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
        """Drop the results of all keys but those for which ``unless`` is true."""
        with self._lock:
            for key in [key for key in self._found if not unless(key)]:
                del self._found[key]

    def _trim(self) -> None:
        total = sum(map(self._size, self._found.values())) if self._most_size else 0
        while len(self._found) > self._most or (total > self._most_size and len(self._found) > 1):
            _, dropped = self._found.popitem(last=False)
            total -= self._size(dropped) if self._most_size else 0


class Shared:
    """Computations that all pages share. Maps are distinguished by identity, as they never change."""

    def __init__(self, services: Services) -> None:
        """Take the functions that compute."""
        self._services = services
        self._turn = threading.BoundedSemaphore(AT_ONCE)
        self.partitions: Once[SIMap] = Once(MAX_PARTITIONS)
        self.looks: Once[SIMap | None] = Once(MAX_LOOKS)
        self.timelines: Once[Timeline] = Once(MAX_TIMELINES)
        self._timeline: Timeline | None = None
        self._names: Once[str] = Once(MAX_PARTITIONS)
        self.pictures: Once[bytes] = Once(MAX_PICTURES, size=len, most_size=MAX_PICTURE_BYTES)

    def cut_map(self, base: SIMap, percent: float, resolution: float) -> SIMap:
        """Cut a map into instances.

        Args:
            base: the map as it was built.
            percent: K, or 100 x the affinity.
            resolution: Louvain resolution; new communities are found only if it differs from that of the base.
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
        """Return the map as it was after a frame; None when no history is at hand."""
        look = self._services.look_back
        if look is None:
            return None
        return self.looks.get((simap, frame), lambda: self._in_turn(lambda: look(simap, frame)))

    def timeline(self, simap: SIMap) -> Timeline:
        """Return the steps in which the objects of a map were joined."""
        self._timeline = made = self.timelines.get((simap,), lambda: Timeline(simap, like=self._timeline))
        return made

    def picture(
        self,
        simap: SIMap,
        mode: ColorMode,
        lit: frozenset[int] | None,
        until: int | None,
        theme: Theme = LIGHT,
        tint: float = TINT,
    ) -> bytes:
        """Return a map's picture as PNG.

        Args:
            simap: the map.
            mode: what its colours mean.
            lit: the instances that are not dimmed; None = all.
            until: hide what no frame up to that one had named; None = nothing.
            theme: of the page.
            tint: share of its object's colour in a cell of a photo, 0 to 1.
        """
        key = (simap, mode, lit, until, theme, tint)
        return self.pictures.get(key, lambda: self._in_turn(lambda: png(paint(*key))))

    def names(self, simap: SIMap, write: Callable[[SIMap], str]) -> str:
        """Return what pages need to name the objects of a map, as ``write`` writes it."""
        return self._names.get((simap,), lambda: self._in_turn(lambda: write(simap)))

    def forget_maps(self, kept: Callable[[SIMap], bool]) -> None:
        """Drop what was computed from maps other than the kept ones."""
        self._timeline = None
        for store in (self.partitions, self.looks, self.timelines, self._names, self.pictures):
            store.forget(lambda key: isinstance(key, tuple) and kept(key[0]))

    def _in_turn(self, compute: Callable[[], V]) -> V:
        with self._turn:
            return compute()


def paint(
    simap: SIMap,
    mode: ColorMode,
    lit: frozenset[int] | None,
    until: int | None,
    theme: Theme = LIGHT,
    tint: float = TINT,
) -> NDArray:
    """Paint a map, uint8 [rows * scale, cols * scale, 3], RGB, row 0 at the south; arguments as in `Shared.picture`.

    A map with more than `MAX_SIDE` cells a side is scaled down to that.
    """
    hidden = () if until is None else tuple(communities_unseen_until(simap, until).tolist())
    image = map_image(simap, mode, lit=lit, hidden=hidden, scale=pixels_per_cell(simap), theme=theme, tint=tint)
    shrink = MAX_SIDE / max(image.shape[:2])
    if shrink >= 1.0:
        return image
    rows, cols = (max(1, round(side * shrink)) for side in image.shape[:2])
    return cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA)


def png(image: NDArray) -> bytes:
    """Encode a picture, uint8 [H, W, 3 or 4], RGB or RGBA."""
    order = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return cv2.imencode(".png", cv2.cvtColor(image, order))[1].tobytes()
