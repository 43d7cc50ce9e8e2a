"""The data structures that a user holds: frames, grids, maps, poses. All are frozen; arrays are not copied."""

import functools
import math
import threading
import weakref
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.geometry import heading_to_yaw, turned, turned_pose, yaw_to_heading

if TYPE_CHECKING:
    import pandas as pd

    from simaps_viz.api import Answer, Place, RobotShape
    from simaps_viz.appearance import Appearance
    from simaps_viz.embedding.search import Found
    from simaps_viz.mapping.floor_plan import FloorPlan
    from simaps_viz.mapping.surface import Surface


Point = tuple[float, float]
"""x and y in metres, map frame."""

FRAMES_TO_COUNT, FRAMES_PER_GLANCE = 3, 50
"""What a glance or two made is doubtful, where there are many frames."""
SURE_SCORE, OFTEN, SLIVER_SHARE = 0.5, 5, 0.1
"""What no cell shows, and was seen with less confidence or in fewer frames, is doubtful; beside what is shown of its
class it has this share of the usual cells."""


def _expect(name: str, array: NDArray, shape: tuple[int, ...], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        wanted = f"{np.dtype(dtype).name} {list(shape)}"
        raise InputError(f"{name}: expected {wanted}, found {array.dtype.name} {list(array.shape)}")


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole camera without distortion; pixel centres at whole numbers."""

    width: int
    height: int
    fx: float
    """Focal length along u, pixels."""
    fy: float
    """Focal length along v, pixels."""
    cx: float
    """Principal point, pixels from the centre of the leftmost column."""
    cy: float
    """Principal point, pixels from the centre of the top row."""

    def turned(self, turns: int) -> "Intrinsics":
        """Return the camera of pictures after quarter turns counter-clockwise."""
        if turns % 4 == 0:
            return self
        once = Intrinsics(self.height, self.width, self.fy, self.fx, self.cy, self.width - 1 - self.cx)
        return once.turned(turns % 4 - 1)

    def matrix(self) -> NDArray:
        """Return K, float64 [3, 3]."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Frame:
    """One posed RGB-D image."""

    index: int
    """Position in the sequence, from 0."""
    name: str
    depth_m: NDArray
    """float32 [H, W], metres along the optical axis, 0 = invalid."""
    T_world_camera: NDArray
    """float64 [4, 4], camera (OpenCV axes) to world, metres."""
    intrinsics: Intrinsics
    color: NDArray | None = None
    """uint8 [H, W, 3], RGB; None unless it was asked for."""

    def __post_init__(self) -> None:
        shape = (self.intrinsics.height, self.intrinsics.width)
        _expect(f"frame {self.name}: depth", self.depth_m, shape, np.float32)
        if self.color is not None:
            _expect(f"frame {self.name}: color", self.color, (*shape, 3), np.uint8)

    def turned(self, turns: int) -> "Frame":
        """Return the frame as its camera would have taken it after quarter turns counter-clockwise."""
        if turns % 4 == 0:
            return self
        color = None if self.color is None else turned(self.color, turns)
        pose = turned_pose(self.T_world_camera, turns)
        return Frame(self.index, self.name, turned(self.depth_m, turns), pose, self.intrinsics.turned(turns), color)


@dataclass(frozen=True)
class Segment:
    """One segment of one frame."""

    id: int
    """Pixel value in ``Segmentation.ids``, >= 1. Valid in this frame only."""
    label: str
    score: float = 1.0
    """Confidence in [0, 1]."""
    is_thing: bool = True
    """Countable (chair), not stuff (floor)."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """The panoptic segmentation of one frame."""

    ids: NDArray
    """int32 [H, W], 0 = nothing; every other value is the id of one of ``segments``."""
    segments: tuple[Segment, ...]
    segmented: bool = True
    """False: no objects were looked for in this frame, which adds geometry only; all ids are 0."""

    def __post_init__(self) -> None:
        _expect("segmentation: ids", self.ids, self.ids.shape[:2], np.int32)

    def turned(self, turns: int) -> "Segmentation":
        """Return the segmentation of the frame after quarter turns counter-clockwise."""
        return replace(self, ids=turned(self.ids, turns)) if turns % 4 else self


@dataclass(frozen=True)
class GridSpec:
    """Position and size of the grid: cell (row, col) covers x in [x0 + col s, x0 + (col+1) s), y likewise by row."""

    rows: int
    cols: int
    cell_size_m: float
    x0_m: float
    y0_m: float

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the (row, col) that holds a point of the map frame; may lie outside the grid."""
        return (
            int(np.floor((y_m - self.y0_m) / self.cell_size_m)),
            int(np.floor((x_m - self.x0_m) / self.cell_size_m)),
        )

    def centre_of(self, row: float, col: float) -> tuple[float, float]:
        """Return the map-frame (x, y) of a cell's centre, metres."""
        return (self.x0_m + (col + 0.5) * self.cell_size_m, self.y0_m + (row + 0.5) * self.cell_size_m)

    def cells_of(self, points_m: NDArray) -> tuple[NDArray, NDArray]:
        """Return rows and cols, int64 [n] each, of the cells that hold points, float [n, 2], as `cell_of` does."""
        cells = np.floor((points_m - (self.x0_m, self.y0_m)) / self.cell_size_m).astype(np.int64)
        return cells[:, 1], cells[:, 0]

    def centres_of(self, rows: NDArray, cols: NDArray) -> NDArray:
        """Return the map-frame (x, y) of cells' centres, float64 [..., 2], metres, as `centre_of` does."""
        return (np.stack([cols, rows], axis=-1) + 0.5) * self.cell_size_m + (self.x0_m, self.y0_m)

    def contains(self, row: int, col: int) -> bool:
        """Return whether (row, col) is a cell of the grid."""
        return 0 <= row < self.rows and 0 <= col < self.cols

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols)."""
        return (self.rows, self.cols)

    @property
    def origin_cell(self) -> tuple[int, int]:
        """(row, col) of the grid's cell (0, 0), counted from the map's origin."""
        return round(self.y0_m / self.cell_size_m), round(self.x0_m / self.cell_size_m)

    @property
    def extent_m(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the grid, metres."""
        s = self.cell_size_m
        return (self.x0_m, self.y0_m, self.x0_m + self.cols * s, self.y0_m + self.rows * s)


@dataclass(frozen=True, eq=False)
class Grid:
    """The top-down map before instances are told apart: the class and height of each cell."""

    spec: GridSpec
    labels: tuple[str, ...]
    """Class names; ``labels[0]`` is "none"."""
    is_thing: tuple[bool, ...]
    """Aligned with ``labels``: countable classes."""
    label: NDArray
    """int16 [rows, cols], index into ``labels``, 0 = none."""
    height_m: NDArray
    """float32 [rows, cols], height of the highest pixel over the floor, NaN = never seen."""
    lowest_m: NDArray
    """float32 [rows, cols], lowest pixel at least 0.1 m over the floor, NaN = none, so the cell is free to drive on."""
    observations: NDArray
    """int32 [rows, cols], number of frames that saw the cell."""

    def __post_init__(self) -> None:
        for name, dtype in (("label", np.int16), ("height_m", np.float32), ("lowest_m", np.float32)):
            _expect(f"grid: {name}", getattr(self, name), self.spec.shape, dtype)
        _expect("grid: observations", self.observations, self.spec.shape, np.int32)


@dataclass(frozen=True, eq=False)
class CellGraph:
    """The weighted graph over the cells of one class."""

    label: int
    """Index of the class."""
    cells: NDArray
    """int64 [n], flat cell numbers (row * cols + col), ascending."""
    edges: NDArray
    """int32 [m, 2], positions in ``cells``, first < second, sorted, no duplicates."""
    counts: NDArray
    """int32 or int64 [m]. Method paper: pixel pairs of one segment that fell in the two cells, over all frames. Method
    evidence: frames that saw the two cells in the same segment."""
    different: NDArray
    """int32 or int64 [m], frames that saw the two cells in two different segments of the class; zeros with method
    paper."""
    seen: NDArray | None
    """int32 [n], number of frames that saw each cell; None with method evidence, whose weights do not need it."""

    @property
    def weights(self) -> NDArray:
        """float64 [m], computed at each access. Method paper: counts / mean number of frames that saw the two cells.

        Method evidence: affinity, same / (same + different + 1).
        """
        if self.seen is None:
            return self.counts / (self.different + 1.0 + self.counts)
        seen = self.seen.astype(np.float64)
        return self.counts / ((seen[self.edges[:, 0]] + seen[self.edges[:, 1]]) / 2.0)


@dataclass(frozen=True, eq=False)
class MergeLog:
    """The merges of communities, in their order, class by class."""

    label: NDArray
    """int16 [steps], index of the class."""
    source: NDArray
    """int32 [steps], community that was joined to another."""
    target: NDArray
    """int32 [steps], community that it was joined to."""
    score: NDArray
    """float32 [steps]: share of the source's cells that neighbour the target (method paper), or the pooled affinity of
    the two (method evidence)."""

    def __len__(self) -> int:
        return len(self.source)


@dataclass(frozen=True, eq=False)
class Views:
    """How many cells of each finest community each segment of each frame named."""

    community: NDArray
    """int32 [v]."""
    frame: NDArray
    """int32 [v], index into ``SIMap.frame_names``."""
    segment: NDArray
    """int32 [v], id in that frame's segmentation."""
    cells: NDArray
    """int32 [v], number of the community's cells whose highest pixel of that frame lies in the segment."""
    score: NDArray
    """float32 [v], confidence of the segment."""


@dataclass(frozen=True, eq=False)
class Points:
    """The surface of a map, as points: one for each voxel in which frames saw something. Arrays aligned."""

    positions: NDArray
    """float32 [n, 3], metres, map frame: centres of voxels of 5 cm, or as wide as a cell where cells are smaller."""
    colors: NDArray
    """uint8 [n, 3], red, green, blue as seen; grey where no colour was at hand."""
    classes: NDArray
    """int16 [n], index into ``SIMap.grid.labels``, -1 = none."""
    instances: NDArray
    """int32 [n], id of an instance, shown or hidden, 0 = none."""

    def __len__(self) -> int:
        return len(self.positions)


@dataclass(frozen=True)
class Box:
    """An upright box in the map frame, turned about the vertical only."""

    center_m: tuple[float, float, float]
    """Its middle."""
    size_m: tuple[float, float, float]
    """Length, width and height; the length is the longer side."""
    yaw_rad: float
    """Direction of the length, counter-clockwise from +x, in [-pi/2, pi/2)."""

    @property
    def corners_m(self) -> NDArray:
        """float64 [8, 3], the four lower corners counter-clockwise, then those above them."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        ring = (signs * self.size_m[:2]) @ np.array([[c, s], [-s, c]]) + self.center_m[:2]
        ends = [self.center_m[2] + sign * self.size_m[2] / 2 for sign in (-1, 1)]
        return np.concatenate([np.column_stack([ring, np.full(4, z)]) for z in ends])

    @property
    def edges_m(self) -> NDArray:
        """float64 [12, 2, 3], its edges."""
        c = self.corners_m
        ring = np.array([0, 1, 2, 3])
        pairs = np.concatenate(
            [np.stack([r, np.roll(r, -1)], 1) for r in (ring, ring + 4)] + [np.stack([ring, ring + 4], 1)]
        )
        return c[pairs]


@dataclass(frozen=True)
class InSpace:
    """Where an object is in space, from the voxels of its surface."""

    box: Box
    on: Mapping[int, float]
    """{object it stands on: share of its own cells over that one's surface}, the largest share first."""
    under: Mapping[int, float]
    """{object above it: share of its own cells}, the largest share first."""
    inside: Mapping[int, float]
    """{object both above and below it: share of its own cells}, the largest share first."""
    voxels: int
    """Number of its surface voxels of 5 cm."""
    color: tuple[int, int, int]
    """Median colour of its surface, red, green, blue, 0 to 255."""


@dataclass(frozen=True)
class Instance:
    """One object on the map."""

    id: int
    """Value in ``SIMap.instance``, >= 1; the smallest of its communities, so it stays the same while K changes."""
    label: str
    cells: int
    centroid_m: tuple[float, float, float]
    """Mean of its cells' centres and of their heights, map frame."""
    aabb_m: tuple[tuple[float, float, float], tuple[float, float, float]]
    """Lowest and highest corner of its cells; z from the lowest to the highest cell top. Map frame."""
    frames: int
    """Number of frames in which a segment of its class named one of its cells."""
    score: float
    """Mean confidence of the segments that named its cells, weighted by cells."""
    _map: ClassVar["weakref.ref[SIMap] | None"] = None
    """The map it is on, set by that map; no field, so neither compared nor written, and no circle of references."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_map"}

    @property
    def in_space(self) -> InSpace | None:
        """Where it is in space; None for an object of no map, without a voxel, or a sliver.

        Raises:
            InputError: its map is no longer in memory.
        """
        if self._map is None:
            return None
        simap = self._map()
        if simap is None:
            raise InputError(f"{self.label} {self.id}: expected its map to be in use, found it gone; keep the map too")
        return simap.in_space.get(self.id)

    @property
    def box(self) -> Box | None:
        """The upright box round its surface; None where `in_space` is."""
        return None if self.in_space is None else self.in_space.box

    @property
    def on(self) -> Mapping[int, float]:
        """{id of what it stands on: share of its cells over that surface}, the largest share first."""
        return {} if self.in_space is None else self.in_space.on

    @property
    def under(self) -> Mapping[int, float]:
        """{id of what is above it: share of its cells}, the largest share first."""
        return {} if self.in_space is None else self.in_space.under

    @property
    def inside(self) -> Mapping[int, float]:
        """{id of what is both above and below it: share of its cells}, the largest share first."""
        return {} if self.in_space is None else self.in_space.inside

    @property
    def name(self) -> str:
        """Its name, "chair 18": class and id, which no other object of its map has, and which it keeps."""
        return f"{self.label} {self.id}"

    def area_m2(self, cell_size_m: float) -> float:
        """Return the area its cells cover, square metres."""
        return self.cells * cell_size_m**2


@dataclass(frozen=True)
class Door:
    """An opening from one room to another."""

    room: int
    """Id of the room beyond."""
    point_m: tuple[float, float]
    """Middle of the opening, map frame."""
    width_m: float


@dataclass(frozen=True)
class Room:
    """One room of a map."""

    id: int
    """Value in ``SIMap.room_cells``, >= 1; 1 is the largest, unless rooms were joined or cut by hand."""
    name: str
    """What a person called it, else its kind, else "room 3"; "kitchen 1" and "kitchen 2" where there are two."""
    kind: str
    """What its objects make it, such as "kitchen"; "" when that is not sure."""
    words: tuple[str, ...]
    """Other names of that kind, lower case."""
    area_m2: float
    """Of its cells: floor, and what stands on it."""
    polygon_m: tuple[tuple[float, float], ...]
    """Its outline, to about a cell, counter-clockwise, map frame; the last point is joined to the first."""
    centre_m: tuple[float, float]
    """The point in it that is farthest from its walls, map frame."""
    objects: tuple[int, ...]
    """Ids of the instances in it."""
    doors: tuple[Door, ...]


if TYPE_CHECKING:
    from functools import cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801 - in the place of Python's
        """A property that is computed once; other threads that ask for one of the same object wait.

        In `functools`, those that ask for another object's wait, too, before Python 3.12, and none from then on.
        """

        _locks: ClassVar = weakref.WeakKeyDictionary()
        _of_locks = threading.Lock()

        def __get__(self, instance: Any, owner: type | None = None) -> Any:
            """Return the value, from the object's dictionary as soon as it is there."""
            if instance is None:
                return self
            known = vars(instance)
            if self.attrname not in known:
                with self._of_locks:
                    lock = self._locks.setdefault(instance, threading.RLock())
                with lock:
                    if self.attrname not in known:
                        known[self.attrname] = self.func(instance)
            return known[self.attrname]


@dataclass(frozen=True, eq=False)
class SIMap:
    """A Semantic Instance Map, with all that is needed to explain it and to partition it again."""

    grid: Grid
    instance: NDArray
    """int32 [rows, cols], unique over the whole map, 0 = none (nothing, or stuff)."""
    instances: tuple[Instance, ...]
    """Sorted by class, then id."""
    T_map_world: NDArray
    """float64 [4, 4], world to map frame."""
    method: str
    parameters: Mapping[str, Any]
    """JSON-able. Holds at least ``resolution``, and ``k_percent`` (method paper) or ``affinity`` (method evidence). A
    built map holds all its settings, such as ``seed``, ``min_cells`` and, method evidence, ``pooling`` (what is
    assumed before any evidence)."""
    provenance: Mapping[str, Any]
    """JSON-able: the origin of the map (``sequence`` path, ``segmentation`` source, ``simulated``, versions)."""
    community: NDArray
    """int32 [rows, cols], finest communities before any merge, unique over the map, 0 = none."""
    merges: MergeLog
    graphs: tuple[CellGraph, ...]
    """One for each thing class that has cells."""
    views: Views
    frame_names: tuple[str, ...]
    T_map_camera: NDArray
    """float64 [frames, 4, 4], camera to map frame."""
    appearance: "Appearance | None" = None
    """Colours of the objects, and vectors where they were described; None where no colour was at hand."""
    room: NDArray | None = None
    """int32 [rows, cols], the room of each cell as it was saved or edited, 0 = none; None = see `room_cells`."""
    room_names: Mapping[int, str] = field(default_factory=dict)
    """{id of a room: what a person called it}."""
    surface: "Surface | None" = None
    """Where frames saw something, at any height; None for a map that knows only its tops."""
    hidden: tuple[Instance, ...] = ()
    """The objects that no cell shows, as they lie under, in or on other things: sorted by class, then id. They are in
    none of the layers; ``cells`` is their footprint, and their points carry their ids (`points`)."""

    def __post_init__(self) -> None:
        _expect("map: instance", self.instance, self.grid.spec.shape, np.int32)
        _expect("map: community", self.community, self.grid.spec.shape, np.int32)
        self._bind_instances()

    def _bind_instances(self) -> None:
        """Make the instances know their map; those that know another are copied first."""
        for name in ("instances", "hidden"):
            own = tuple(replace(one) if one._map is not None else one for one in getattr(self, name))
            for one in own:
                object.__setattr__(one, "_map", weakref.ref(self))
            object.__setattr__(self, name, own)

    @property
    def spec(self) -> GridSpec:
        """Position and size of the grid."""
        return self.grid.spec

    def by_id(self, instance_id: int) -> Instance:
        """Return the instance with that id, hidden ones too, or raise InputError, which names how many there are."""
        for instance in (*self.instances, *self.hidden):
            if instance.id == instance_id:
                return instance
        raise InputError(f"instance {instance_id}: not on this map, which has {len(self.instances)} instances")

    def at(self, x_m: float, y_m: float) -> Instance | None:
        """Return the instance whose cell holds the map-frame point, or None; InputError unless both are numbers."""
        if not all(isinstance(value, Real) and math.isfinite(value) for value in (x_m, y_m)):
            raise InputError(f"place: expected x and y in metres, found {x_m!r} and {y_m!r}")
        row, col = self.spec.cell_of(x_m, y_m)
        if not self.spec.contains(row, col) or self.instance[row, col] == 0:
            return None
        return self.by_id(int(self.instance[row, col]))

    def of_class(self, label: str) -> tuple[Instance, ...]:
        """Return the instances of a class that the map shows, by id; empty when there is none."""
        return tuple(i for i in self.instances if i.label == label)

    @cached_property
    def objects(self) -> tuple[Instance, ...]:
        """What names mean and counts count: the instances, then the `hidden` ones that are no part of them.

        Where the map shows others of its class, a hidden one that is `doubtful`, far smaller than these (a sliver at an
        edge) or meets one of them (that one, seen again) is left out.
        """
        return (*self.instances, *(one for one in self.hidden if one.id not in self.left_out))

    @cached_property
    def left_out(self) -> dict[int, str]:
        """Why each of the `hidden` ones that are none of the `objects` is not, in words."""
        shown: dict[str, list[Instance]] = defaultdict(list)
        for one in self.instances:
            shown[one.label].append(one)
        usual = {label: float(np.median([one.cells for one in ones])) for label, ones in shown.items()}

        def why(one: Instance) -> str:
            met = next((other.name for other in shown[one.label] if _meet(one, other)), "")
            if met:
                return f"may be a part of {met}"
            if _hardly_known(one):
                return "below others, and seen too little"
            return "far smaller than others of its class" * (one.cells < SLIVER_SHARE * usual[one.label])

        reasons = {one.id: why(one) for one in self.hidden if one.label in shown}
        return {number: reason for number, reason in reasons.items() if reason}

    @cached_property
    def doubtful(self) -> frozenset[int]:
        """Ids of `objects` that were seen too little to count; of those that no cell shows more is asked."""
        frames, hidden = self.frames_to_count, {one.id for one in self.hidden}
        seen = ((one.id, one.frames < frames or (one.id in hidden and _hardly_known(one))) for one in self.objects)
        return frozenset(number for number, little in seen if little)

    @property
    def frames_to_count(self) -> int:
        """In how many frames an object has to be seen to count: in one where there are few frames."""
        return min(FRAMES_TO_COUNT, len(self.frame_names) // FRAMES_PER_GLANCE)

    def counts(self, *, hidden: bool = False) -> dict[str, int]:
        """Return {class name: number of instances}, most first, then by name.

        Args:
            hidden: with the classes that only `hidden` objects have.
        """
        counts = Counter(i.label for i in self.instances)
        counts += Counter(i.label for i in self.hidden if hidden and i.label not in counts)
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))

    def color_of(self, instance: Instance | int) -> tuple[int, int, int] | None:
        """Return the median colour of an object as cameras saw it, red, green, blue, 0 to 255; None if unknown."""
        wanted = instance if isinstance(instance, int) else instance.id
        table = self.appearance.colors(self) if self.appearance is not None else np.zeros((0, 4), np.int32)
        at = int(np.searchsorted(table[:, 0], wanted))
        if at == len(table) or table[at, 0] != wanted:  # of what no cell shows its surface has a colour
            below = next((one.in_space for one in self.hidden if one.id == wanted), None)
            return None if below is None or self.appearance is None else below.color
        red, green, blue = table[at, 1:].tolist()
        return red, green, blue

    def points(self) -> Points:
        """Return the surface of the map as points, computed once.

        A map without a stored surface (methods paper and components, the VLMaps pair, files of earlier versions) gets
        its columns in place of it: each cell filled from the floor to its top.
        """
        return self._points

    @cached_property
    def _points(self) -> Points:
        import simaps_viz  # noqa: PLC0415 - see below

        return simaps_viz.surface_points(self)

    @cached_property
    def in_space(self) -> Mapping[int, InSpace]:
        """{id: where the object is in space}, found when first asked for; from columns on a map without voxels."""
        import simaps_viz  # noqa: PLC0415 - see below

        return simaps_viz.objects_in_space(self)

    @cached_property
    def _plan(self) -> "FloorPlan":
        import simaps_viz  # noqa: PLC0415 - see below

        return simaps_viz.floor_plan(self)

    @property
    def rooms(self) -> tuple[Room, ...]:
        """The rooms by id, found when first asked for; none on a map without floor."""
        return self._plan.rooms

    @property
    def room_cells(self) -> NDArray:
        """The room of each cell, int32 [rows, cols], 0 = none: rooms hold floor and what stands on it, but no wall."""
        return self._plan.cells

    def room_at(self, x_m: float, y_m: float) -> Room | None:
        """Return the room that holds a map-frame point, or the nearest one within 0.5 m; None when there is none."""
        reach = int(0.5 / self.spec.cell_size_m)
        row, col = self.spec.cell_of(x_m, y_m)
        top, left = max(row - reach, 0), max(col - reach, 0)
        near = self.room_cells[top : max(row + reach + 1, 0), left : max(col + reach + 1, 0)]
        rows, cols = np.nonzero(near)
        if len(rows) == 0:
            return None
        nearest = int(((rows + top - row) ** 2 + (cols + left - col) ** 2).argmin())
        wanted = int(near[rows[nearest], cols[nearest]])
        return next(room for room in self.rooms if room.id == wanted)

    def room_of(self, instance_id: int) -> Room | None:
        """Return the room that an instance is in, or None."""
        return next((room for room in self.rooms if instance_id in room.objects), None)

    def rooms_named(self, name: str) -> tuple[Room, ...]:
        """Return the rooms a name means, by id: "kitchen", "the loo", "bedrooms", "room 3"; none where none fits."""
        said = " ".join(name.casefold().split()).removeprefix("the ")
        exactly = tuple(room for room in self.rooms if room.name.casefold() == said)
        if exactly:
            return exactly
        forms = {said, said.removesuffix("s"), said.removesuffix("es"), said.removesuffix("ies") + "y"}
        if "room" in forms:
            return self.rooms
        return tuple(room for room in self.rooms if forms & {room.kind, *room.words, f"room {room.id}"} - {""})

    @property
    def described(self) -> bool:
        """Whether the map has vectors of its objects, so that `search` understands free words."""
        return self.appearance is not None and self.appearance.described

    # Shortcuts to the functions of that name, which hold the code. Their modules lie above this one, so it is
    # imported when a method is called; these five methods are the only such exception.

    def find(self, name: str, *, near: "Place | str | None" = None) -> "tuple[Instance, ...]":
        """Find the instances a name means, the closest to ``near`` first; see `simaps_viz.find`."""
        import simaps_viz  # noqa: PLC0415 - see above

        return simaps_viz.find(self, name, near=near)

    def search(self, words: str, k: int = 5) -> "tuple[Found, ...]":
        """Find the objects that free words describe, the best first; see `simaps_viz.search`."""
        import simaps_viz  # noqa: PLC0415 - see above

        return simaps_viz.search(self, words, k)

    def plan(self, start: "Place", goal: "Place | str", *, robot: "RobotShape | None" = None) -> "Path":
        """Plan the cheapest path for a robot over free floor; see `simaps_viz.plan`."""
        import simaps_viz  # noqa: PLC0415 - see above

        return simaps_viz.plan(self, start, goal, robot=robot)

    def ask(self, command: str, *, pose: "Pose2 | None" = None, robot: "RobotShape | None" = None) -> "Answer":
        """Carry out a command in English, or a program, with a simulated robot; see `simaps_viz.ask`."""
        import simaps_viz  # noqa: PLC0415 - see above

        return simaps_viz.ask(self, command, pose=pose, robot=robot)

    def to_pandas(self) -> "pd.DataFrame":
        """Return the instances as a pandas frame, one row each, indexed by id; see `simaps_viz.to_pandas`."""
        import simaps_viz  # noqa: PLC0415 - see above

        return simaps_viz.to_pandas(self)


COMPASS = ("north", "northeast", "east", "southeast", "south", "southwest", "west", "northwest")


def _hardly_known(one: Instance) -> bool:
    """Whether a thing that no cell shows was seen a few times only, or not surely."""
    return one.score < SURE_SCORE or one.frames < OFTEN


def _meet(a: Instance, b: Instance) -> bool:
    """Whether the boxes of two things have a part in common."""
    return all(a.aabb_m[0][k] <= b.aabb_m[1][k] and b.aabb_m[0][k] <= a.aabb_m[1][k] for k in range(3))


@dataclass(frozen=True)
class Pose2:
    """Pose of the robot on the map."""

    x_m: float
    y_m: float
    yaw_rad: float
    """Counter-clockwise from +x."""

    @classmethod
    def from_heading(cls, x_m: float, y_m: float, heading_deg: float) -> "Pose2":
        """Make a pose from a compass heading, degrees clockwise from north."""
        return cls(float(x_m), float(y_m), heading_to_yaw(heading_deg))

    @property
    def heading_deg(self) -> float:
        """Compass heading, degrees clockwise from north, [0, 360)."""
        return yaw_to_heading(self.yaw_rad)

    @property
    def looks(self) -> str:
        """Where it looks, as one of eight words: "north", "northeast", ..."""
        return COMPASS[round(self.heading_deg / 45.0) % 8]


@dataclass(frozen=True, eq=False)
class Path:
    """A path over free cells."""

    points_m: NDArray
    """float64 [n, 2], map frame, from start to goal."""
    cost_m: float = field(default=0.0)
    """Octile cost of the grid path it was smoothed from, metres."""

    @property
    def length_m(self) -> float:
        """Length of the polyline, metres."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum()) if len(self.points_m) > 1 else 0.0
