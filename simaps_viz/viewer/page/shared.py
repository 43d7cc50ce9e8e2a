"""What all pages share: the services behind them, and what these computed, once for however many pages need it."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.instances import keep_classes, take_over
from simaps_viz.drawing.frame_pictures import communities_unseen_until
from simaps_viz.drawing.legend import counts_text
from simaps_viz.drawing.texture import TINT, ColorMode, fade_objects, map_image, pixels_per_cell
from simaps_viz.drawing.theme import LIGHT, Theme
from simaps_viz.evaluation.judging import JudgingSession
from simaps_viz.geometry import shared_cells
from simaps_viz.language.grounding import Candidate
from simaps_viz.mapping.timeline import CLASSES, Timeline
from simaps_viz.navigation.agent import Answer
from simaps_viz.recorder.web_viewer import rerun_page
from simaps_viz.structures import Pose2, SIMap

if TYPE_CHECKING:
    from simaps_viz.viewer.page.panel import PanelSpec


@dataclass(frozen=True)
class LanguageModel:
    """A language model that can read the commands."""

    name: str
    """Name of the model, and where it runs."""
    ask: Callable[..., Answer]
    """(map, command, pose of the robot, event that ends the wait, called with what was sent and received,
    robot=RobotShape) -> answer."""


@dataclass(frozen=True)
class Services:
    """Plain functions behind the page; what is None is greyed out or reported as missing."""

    repartition: Callable[[SIMap, float], SIMap] | None = None
    """(map, percent) -> the map with another K (method paper) or affinity (method evidence); fast."""
    recommunity: Callable[[SIMap, float, float], SIMap] | None = None
    """(map, resolution, percent) -> the map with communities found anew."""
    ask: Callable[..., Answer] | None = None
    """(map, command, pose of the robot, robot=RobotShape) -> answer. May raise SIMapsError."""
    candidates: Callable[[SIMap, str, Pose2], Sequence[Candidate]] | None = None
    """(map, class, pose where the command is given) -> all objects of the class, the closest first, to number them."""
    model: LanguageModel | None = None
    """Reads commands instead of ``ask`` while it is switched on."""
    judging: JudgingSession | None = None
    """Runs for a person to judge, in a tab in front of all others."""
    view: Callable[[int], tuple[NDArray, NDArray] | None] | None = None
    """frame index -> (RGB uint8 [H, W, 3], segment ids int32 [H, W]); None when the sequence is not at hand."""
    look_back: Callable[[SIMap, int], SIMap | None] | None = None
    """(map, frame) -> the map as it was after that frame; None when the history of this map is not at hand."""
    recordings: tuple[Path, ...] = ()
    """The .rrd files of the build, which the page docks."""
    rerun_page: Callable[[Sequence[str]], str] = rerun_page
    """(addresses of the recordings) -> HTML of the page that shows them."""
    recorded_levels: int | None = None
    """Time on timeline "louvain" at which the recording has the final communities; None = after the last level."""
    panels: "Sequence[PanelSpec]" = ()
    """Panels besides those that are always there, in their order."""
    stream: str = ""
    """Address of a live recording to show, ``rerun+http://127.0.0.1:9876/proxy``; empty = none."""
    building: bool = False
    """The map is still being built; `Workbench.finish` ends that."""


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


class SharedCache(Generic[V]):
    """A cache of the latest results by key. Threads that ask for a result that is being computed wait for it."""

    def __init__(self, max_count: int, *, size: Callable[[V], int] = lambda value: 0, max_size: int = 0) -> None:
        """Keep ``max_count`` results, of at most ``max_size`` in total (0 = no limit) as ``size`` measures each."""
        self._max_count, self._size, self._max_size = max_count, size, max_size
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
        total = sum(map(self._size, self._found.values())) if self._max_size else 0
        while len(self._found) > self._max_count or (total > self._max_size and len(self._found) > 1):
            _, dropped = self._found.popitem(last=False)
            total -= self._size(dropped) if self._max_size else 0


class Shared:
    """Computations that all pages share. Maps are distinguished by identity, as they never change."""

    def __init__(self, services: Services) -> None:
        """Take the functions that compute."""
        self._services = services
        self._turn = threading.BoundedSemaphore(AT_ONCE)
        self.partitions: SharedCache[SIMap] = SharedCache(MAX_PARTITIONS)
        self.looks: SharedCache[SIMap | None] = SharedCache(MAX_LOOKS)
        self.timelines: SharedCache[Timeline] = SharedCache(MAX_TIMELINES)
        self._timeline: Timeline | None = None
        self._names: SharedCache[str] = SharedCache(MAX_PARTITIONS)
        self.pictures: SharedCache[bytes] = SharedCache(MAX_PICTURES, size=len, max_size=MAX_PICTURE_BYTES)

    def cut_map(self, base: SIMap, percent: float, resolution: float, *, lasting: bool = True) -> SIMap:
        """Cut a map into instances.

        Args:
            base: the map as it was built.
            percent: K, or 100 x the affinity.
            resolution: Louvain resolution; new communities are found only if it differs from that of the base.
            lasting: let instances that stay the same keep their numbers.
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
        joined = self.partitions.get((cut, percent), lambda: self._in_turn(lambda: join(cut, percent)))
        if not lasting:
            return joined
        return self.partitions.get((cut, base, percent), lambda: keep_numbers(joined, base))

    def look_back(self, simap: SIMap, frame: int) -> SIMap | None:
        """Return the map as it was after a frame; None as long as no history is at hand."""
        look = self._services.look_back
        if look is None:
            return None
        then = self.looks.get((simap, frame), lambda: self._in_turn(lambda: look(simap, frame)))
        if then is None:
            self.looks.forget(lambda key: key != (simap, frame))
        return then

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
        faint: frozenset[int] = frozenset(),
    ) -> bytes:
        """Return a map's picture as PNG.

        Args:
            simap: the map.
            mode: what its colours mean.
            lit: the instances that are not dimmed; None = all.
            until: hide what no frame up to that one had named; None = nothing.
            theme: of the page.
            tint: share of its object's colour in a cell of a photo, 0 to 1.
            faint: the instances that keep a quarter of their colour.
        """
        key = (simap, mode, lit, until, theme, tint, faint)
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
    faint: frozenset[int] = frozenset(),
) -> NDArray:
    """Paint a map, uint8 [rows * scale, cols * scale, 3], RGB, row 0 at the south; arguments as in `Shared.picture`.

    A map with more than `MAX_SIDE` cells a side is scaled down to that.
    """
    hidden = () if until is None else tuple(communities_unseen_until(simap, until).tolist())
    image = map_image(simap, mode, lit=lit, hidden=hidden, scale=pixels_per_cell(simap), theme=theme, tint=tint)
    fade_objects(image, simap, faint, theme)
    shrink = MAX_SIDE / max(image.shape[:2])
    if shrink >= 1.0:
        return image
    rows, cols = (max(1, round(side * shrink)) for side in image.shape[:2])
    return cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA)


def png(image: NDArray) -> bytes:
    """Encode a picture, uint8 [H, W, 3 or 4], RGB or RGBA."""
    order = cv2.COLOR_RGBA2BGRA if image.shape[2] == 4 else cv2.COLOR_RGB2BGR
    return cv2.imencode(".png", cv2.cvtColor(image, order))[1].tobytes()


NO_HISTORY = (
    "No history of this map is at hand: at an earlier frame the map is the finished one, less the objects that no frame"
    " had named by then; colours of photos stay. It is there after building with --history, or once a build that is"
    " watched is done."
)


@dataclass(frozen=True)
class TimeStep:
    """Where the page is on its two timelines."""

    frame: int
    """Index of the frame of the build."""
    step: int | None = None
    """Position on the `Timeline` of joining, of the finished map; None = the finished map."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A map at a time step, to be painted."""

    simap: SIMap
    until: int | None = None
    """Hide what no frame up to this one had named; used where no history is at hand."""
    classes_only: bool = False
    words: str = ""
    """Describes what the map showed then; empty for the finished map."""
    badge: str = ""
    """Marks a map that is not the finished one: "as of frame 178 of 200 · …"; empty for the finished map."""


def snapshot_at(shared: Shared, simap: SIMap, *, frame: int | None, step: int | None) -> Snapshot:
    """Return a map as it was after a frame, or after a step of joining; the frame counts where both are given.

    Args:
        shared: computes earlier maps and timelines.
        simap: the finished map.
        frame: None = the last one.
        step: position on its `Timeline`; None = the finished map.
    """
    if frame is not None:
        badge = f"as of frame {frame}, the last is {len(simap.frame_names) - 1} · back with slider Frame in tab Build"
        look = shared.look_back(simap, frame)
        if look is None:
            return Snapshot(simap, until=frame, words=NO_HISTORY, badge=badge)
        keep_classes(look, simap)
        return Snapshot(look, words=then_text(look), badge=badge)
    if step is None:
        return Snapshot(simap)
    timeline = shared.timeline(simap)
    then = timeline.map_at(step)
    if then is not simap and then.community is not simap.community:
        take_over(then, simap)
    badge = "" if then is simap else timeline.name(step)
    return Snapshot(then, classes_only=step == CLASSES, badge=badge)


def ids_then(then: SIMap, now: SIMap, ids: frozenset[int]) -> frozenset[int]:
    """Return the instances of an earlier map that lie for the most part on given instances of the map of now."""
    if then.instance is now.instance or not ids:
        return ids if then.instance is now.instance else frozenset()
    size = np.bincount(then.instance.ravel())
    on_them = np.bincount(then.instance[np.isin(now.instance, sorted(ids))], minlength=len(size))
    size[0] = 0
    return frozenset(np.flatnonzero((2 * on_them > size) & (size > 0)).tolist())


def then_text(look: SIMap) -> str:
    """Describe an earlier map: its objects, and the area that was seen."""
    seen = float((~np.isnan(look.grid.height_m)).sum()) * look.spec.cell_size_m**2
    found = counts_text(look, doubtful=()) if look.instances else "no instances yet"
    return f"{found} · {seen:.1f} m² seen"


def keep_numbers(simap: SIMap, before: SIMap) -> SIMap:
    """Return a map whose instances have the numbers of those of another map of the same grid that they still are.

    An instance is still the same where its cells and the other's overlap by more than half (IoU), which no second one
    can. One whose number is taken by that gets the number which became free.
    """
    kept = same_instances(before, simap)
    taken = set(kept.values())
    number = {one.id: one.id for one in simap.instances} | {now: then for then, now in kept.items()}
    for one in simap.instances:
        if one.id in taken:
            continue
        while number[one.id] in kept:  # whose number is another's now: what that one was called is free
            number[one.id] = kept[number[one.id]]
    if all(now == then for now, then in number.items()):
        return simap
    of_id = np.arange(int(simap.instance.max(initial=0)) + 1, dtype=simap.instance.dtype)
    of_id[list(number)] = list(number.values())
    ones = (one if number[one.id] == one.id else replace(one, id=number[one.id]) for one in simap.instances)
    return replace(
        simap, instance=of_id[simap.instance], instances=tuple(sorted(ones, key=lambda one: (one.label, one.id)))
    )


def cells_by_id(simap: SIMap) -> NDArray:
    """Return how many cells show each instance, int64 [n], indexed by id."""
    cells = np.zeros(1 + max((one.id for one in simap.instances), default=0), np.int64)
    for one in simap.instances:
        cells[one.id] = one.cells
    return cells


def same_instances(before: SIMap, after: SIMap) -> dict[int, int]:
    """Return {id on one map: id on another of the same grid} of the instances that overlap by more than half (IoU)."""
    areas = [cells_by_id(one) for one in (before, after)]
    then, now, shared = shared_cells(before.instance, after.instance)
    same = 2 * shared > areas[0][then] + areas[1][now] - shared
    return dict(zip(then[same].tolist(), now[same].tolist(), strict=True))
