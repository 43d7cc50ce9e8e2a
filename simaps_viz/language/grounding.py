"""Resolve references to instances by rank, side, neighbour and view, from the pose where the command was given.

All distances are in metres on the map plane between cell centres; ties go to the smaller instance id. The exact
meaning of rank, side and between is that of ``primitives``.

In view is what a ray reaches that goes from the camera to the top of one of an object's cells. It is stopped by a cell
of another object when it enters that cell's column between the floor and the column's top; a column whose lowest pixel
hangs over 1 m (a lamp, a lintel over a doorway) stops it only above that pixel. Walls and columns reach from floor to
ceiling.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.errors import CommandError
from simaps_viz.language.words import ANY, Vocabulary, plain, plural, singular
from simaps_viz.structures import Instance, Pose2, SIMap

FIELD_OF_VIEW_RAD: Final = np.pi / 2.0
EYE_HEIGHT_M: Final = 1.3
"""Height of the camera where the map does not record that of its own."""
OPAQUE_HEIGHT_M: Final = 1.5
"""Cells at least this high cannot be looked over by a robot that drives there."""
_EYE_RANGE_M: Final = (0.3, 1.9)
_HANGING_M: Final = 1.0
_SIGHT_CELLS: Final = 48
_BODY_M: Final = 0.2  # cells this near to the viewer show the viewer itself, or noise
_STEPS_PER_CELL: Final = 3.0
_COMPASS: Final = {"north": (0.0, 1.0), "south": (0.0, -1.0), "east": (1.0, 0.0), "west": (-1.0, 0.0)}


@dataclass(frozen=True)
class Candidate:
    """An instance that a phrase could mean."""

    rank: int
    """1 is the closest to where the command was given."""
    instance: Instance
    distance_m: float


class Grounding:
    """Answers which instance is meant, for one map and one viewer.

    Args:
        simap: the map.
        viewer: the robot's pose when the command was given.
        field_of_view_rad: full horizontal angle of ``in_view``.
        eye_height_m: height of the camera of ``in_view``; by default that of the map's recording.
    """

    def __init__(
        self,
        simap: SIMap,
        viewer: Pose2,
        *,
        field_of_view_rad: float = FIELD_OF_VIEW_RAD,
        eye_height_m: float | None = None,
    ) -> None:
        self.simap = simap
        self.viewer = viewer
        self.sight = Sight(simap, viewer, field_of_view_rad=field_of_view_rad, eye_height_m=eye_height_m)
        self._vocabulary = Vocabulary(simap.counts())

    def labels_of(self, name: str) -> tuple[str, ...]:
        """Return the map's classes a name takes together, or raise CommandError naming all.

        A class of that very name, or its singular, stands alone; a generic name ("seat", "any table") takes all
        classes of its kind, a synonym the most fitting one.
        """
        found = self._vocabulary.resolve(name)
        if found:
            return found.labels
        counts = ", ".join(f"{label} ({n})" for label, n in self.simap.counts().items())
        has = f"It has: {counts}" if counts else "It has no objects at all"
        near = self._vocabulary.suggest(name)
        said = name.removeprefix(ANY)
        raise CommandError(f"There is no {said} on this map. {has}.{f' Did you mean {near}?' if near else ''}")

    def label_of(self, name: str) -> str:
        """Return the first of the classes a name takes together, or raise CommandError naming all."""
        return self.labels_of(name)[0]

    def members(self, name: str) -> tuple[Instance, ...]:
        """Return all instances of the classes a name takes together, class by class."""
        return tuple(i for label in self.labels_of(name) for i in self.simap.of_class(label))

    def candidates(self, name: str) -> tuple[Candidate, ...]:
        """Return all instances a name may mean, the closest first, with their distances."""
        ranked = sorted((self.distance_m(i), i.id, i) for i in self.members(name))
        return tuple(Candidate(k, instance, d) for k, (d, _, instance) in enumerate(ranked, start=1))

    def instances(self, name: str) -> tuple[Instance, ...]:
        """Return all instances of a class, the closest first."""
        return tuple(candidate.instance for candidate in self.candidates(name))

    def pick(self, name: str, which: int | Instance = 1) -> Instance:
        """Return the instance of that rank, or the given one once its class is checked."""
        if isinstance(which, Instance):
            labels = self.labels_of(name)
            if which.label not in labels:
                wanted = labels[0] if len(labels) == 1 else name
                raise CommandError(f"instance {which.id} is a {which.label}, but a {wanted} was asked for")
            return which
        ranked = self.instances(name)
        self._expect_rank(name, len(ranked), which)
        return ranked[which - 1]

    def object_of(self, other: str | Instance) -> Instance:
        """Return an instance as it is, or the closest of a class."""
        return other if isinstance(other, Instance) else self.pick(other, 1)

    def nth_from(self, name: str, side: str, n: int) -> Instance:
        """Return the n-th instance of a class counted from a side; left and right are the viewer's."""
        direction = self._direction_of(side)
        ranked = sorted(self.members(name), key=lambda i: (-float(np.dot(i.centroid_m[:2], direction)), i.id))
        self._expect_rank(name, len(ranked), n)
        return ranked[n - 1]

    def closest_to(self, name: str, other: str | Instance, which: int | Instance = 1) -> Instance:
        """Return the instance of a class whose cells come nearest to another object's; that object itself left out."""
        all_members = self.members(name)
        target = other if isinstance(other, Instance) else self.pick(other, which)
        members = [i for i in all_members if i.id != target.id]
        if not members:
            raise CommandError(f"There is only 1 {self._called(name)} on this map; none is left to be near it.")
        tree = KDTree(self.cells_of(target))
        return min(members, key=lambda i: (float(tree.query(self.cells_of(i))[0].min()), i.id))

    def between(self, name: str, other_a: str | Instance, other_b: str | Instance) -> Instance:
        """Return the instance of a class that lies between two objects, nearest to the line of their centroids."""
        members = self.members(name)
        a, b = self.pair(other_a, other_b)
        start, end = np.array(a.centroid_m[:2]), np.array(b.centroid_m[:2])
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        found = []
        for instance in members:
            centroid = np.array(instance.centroid_m[:2])
            # Thales: in the circle over the line a-b, both ends are seen more than a quarter turn apart
            if instance.id not in (a.id, b.id) and (centroid - start) @ (centroid - end) < 0.0:
                offset = centroid - start
                found.append((abs(float(along[0] * offset[1] - along[1] * offset[0])), instance.id, instance))
        if not found:
            raise CommandError(f"There is no {self._called(name)} between the {a.label} and the {b.label} on this map.")
        return min(found)[2]

    def pair(self, other_a: str | Instance, other_b: str | Instance) -> tuple[Instance, Instance]:
        """Return two different instances for two names or instances; equal names mean the two closest."""
        a = self.object_of(other_a)
        if isinstance(other_b, Instance):
            b = other_b
        else:
            ranked = self.instances(other_b)
            b = next((i for i in ranked if i.id != a.id), None)
            if b is None:
                self._expect_rank(other_b, len(ranked), 2)
        if b is None or a.id == b.id:
            raise CommandError(f"between needs two different objects, but the same {a.label} was named twice")
        return a, b

    def in_view(self, name: str) -> tuple[Instance, ...]:
        """Return the instances of a class within the field of view that no wall hides, the closest first."""
        return tuple(
            instance for instance in self.instances(name) if self.sight.sees(instance, self.cells_of(instance))
        )

    def distance_m(self, instance: Instance) -> float:
        """Return the distance from the viewer to the centre of the instance's nearest cell."""
        offsets = self.cells_of(instance) - (self.viewer.x_m, self.viewer.y_m)
        return float(np.sqrt((offsets**2).sum(axis=1).min()).round(9))

    def cells_of(self, instance: Instance) -> NDArray:
        """Return the centres of the instance's cells, float64 [n, 2], map frame."""
        return self._cells[instance.id]

    def _direction_of(self, side: str) -> NDArray:
        if side in _COMPASS:
            return np.array(_COMPASS[side])
        left = np.array([-np.sin(self.viewer.yaw_rad), np.cos(self.viewer.yaw_rad)])
        return left if side == "left" else -left

    def _called(self, name: str) -> str:
        """Return the word for the things of a name in a sentence: the map's class, or the generic name."""
        labels = self.labels_of(name)
        return labels[0] if len(labels) == 1 else singular(plain(name.removeprefix(ANY)))

    def _expect_rank(self, name: str, n: int, rank: int) -> None:
        if rank < 1:
            raise CommandError(f"ranks count from 1, the closest; {rank} was asked for")
        if rank > n:
            called = self._called(name)
            there = f"is only 1 {called}" if n == 1 else f"are only {n} {plural(called)}"
            raise CommandError(f"There {there} on this map; the {ordinal(rank)} was asked for.")

    @cached_property
    def _cells(self) -> dict[int, NDArray]:
        spec, flat = self.simap.spec, self.simap.instance.ravel()
        order = np.flatnonzero(flat)
        order = order[np.argsort(flat[order], kind="stable")]
        ids, starts = np.unique(flat[order], return_index=True)
        row, col = np.divmod(order, spec.cols)
        centres = (np.column_stack([col, row]) + 0.5) * spec.cell_size_m + (spec.x0_m, spec.y0_m)
        return dict(zip(ids.tolist(), np.split(centres, starts[1:]), strict=False))

    @cached_property
    def opaque(self) -> NDArray:
        """The cells that cannot be looked over, bool [rows, cols]."""
        with np.errstate(invalid="ignore"):
            return (self.simap.grid.height_m >= OPAQUE_HEIGHT_M) | wall_cells(self.simap)


def ordinal(n: int) -> str:
    """Return "1st", "2nd", "3rd", "4th", "11th"."""
    ending = "th" if n % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{ending}"


class Sight:
    """Decides what can be seen on one map from one pose.

    Args:
        simap: the map.
        viewer: where the camera is, and where it looks.
        field_of_view_rad: full horizontal angle; the vertical one is taken to be wide enough.
        eye_height_m: height of the camera over the floor; by default the median of those the map was recorded from.
    """

    def __init__(
        self,
        simap: SIMap,
        viewer: Pose2,
        *,
        field_of_view_rad: float = FIELD_OF_VIEW_RAD,
        eye_height_m: float | None = None,
    ) -> None:
        self._simap, self._viewer = simap, viewer
        self.field_of_view_rad = field_of_view_rad
        self.eye_height_m = recorded_height_m(simap) if eye_height_m is None else eye_height_m

    def sees(self, instance: Instance, cells_m: NDArray) -> bool:
        """Return whether a free line of sight within the field of view reaches one of (at most 48 of) its cells.

        Args:
            instance: what is looked for.
            cells_m: float64 [n, 2], the centres of its cells, map frame.
        """
        cells = cells_m[:: max(1, len(cells_m) // _SIGHT_CELLS)]
        offsets = cells - (self._viewer.x_m, self._viewer.y_m)
        bearing = np.arctan2(offsets[:, 1], offsets[:, 0]) - self._viewer.yaw_rad
        ahead = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi) <= self.field_of_view_rad / 2.0 + 1e-9
        if not ahead.any():
            return False
        return bool(self._free(offsets[ahead], self._tops_m(cells[ahead]), instance.id).any())

    def _tops_m(self, cells_m: NDArray) -> NDArray:
        row, col = self._cells_of(cells_m[:, 0], cells_m[:, 1])
        return np.nan_to_num(self._simap.grid.height_m[row, col].astype(np.float64))

    def _free(self, offsets_m: NDArray, tops_m: NDArray, instance_id: int) -> NDArray:
        """Return which rays nothing else stops, bool [n], given where they end [n, 2] and how high [n]."""
        spec = self._simap.spec
        # Sample points along every ray, [n, samples], and the cells they lie in.
        length = np.linalg.norm(offsets_m, axis=1)
        along = np.arange(_BODY_M, float(length.max()), spec.cell_size_m / _STEPS_PER_CELL)[None, :]
        share = along / np.maximum(length, 1e-9)[:, None]
        x = self._viewer.x_m + share * offsets_m[:, :1]
        y = self._viewer.y_m + share * offsets_m[:, 1:]
        row, col = self._cells_of(x, y)
        inside = (share < 1.0) & (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
        row, col = np.where(inside, row, 0), np.where(inside, col, 0)
        # Compare the height of the ray at each point with the column of its cell.
        height = self.eye_height_m + share * (tops_m[:, None] - self.eye_height_m)
        low, high = self._column
        stopped = inside & (height >= low[row, col]) & (height <= high[row, col])
        return ~(stopped & (self._simap.instance[row, col] != instance_id)).any(axis=1)

    def _cells_of(self, x: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
        spec = self._simap.spec
        col = np.floor((x - spec.x0_m) / spec.cell_size_m).astype(np.int64)
        row = np.floor((y - spec.y0_m) / spec.cell_size_m).astype(np.int64)
        return row, col

    @cached_property
    def _column(self) -> tuple[NDArray, NDArray]:
        """The heights from and to which each cell's column stops rays, float [rows, cols]; NaN where it stops none."""
        grid = self._simap.grid
        walls = wall_cells(self._simap)
        hangs = np.nan_to_num(grid.lowest_m) > _HANGING_M
        low = np.where(walls | ~hangs, -1.0, grid.lowest_m)
        return low, np.where(walls, np.inf, grid.height_m)


def wall_cells(simap: SIMap) -> NDArray:
    """Return the cells whose class reaches from floor to ceiling, bool [rows, cols]."""
    names = simap.grid.labels
    walls = [i for i, name in enumerate(names) if name == "wall" or name.startswith("wall-") or name == "column"]
    return np.isin(simap.grid.label, walls)


def recorded_height_m(simap: SIMap) -> float:
    """Return the median height the map's camera had over the floor, kept to what a robot may carry."""
    heights = simap.T_map_camera[:, 2, 3] if len(simap.T_map_camera) else np.array([EYE_HEIGHT_M])
    return float(np.clip(np.median(heights), *_EYE_RANGE_M))
