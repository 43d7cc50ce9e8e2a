"""Which instance is meant: ranks, sides, neighbours and what is in view, from where the command was given.

All distances are in metres on the map plane between cell centres; ties go to the smaller instance id. The exact
meaning of rank, side and between is that of ``primitives``.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from simaps_viz.errors import CommandError
from simaps_viz.language.words import Vocabulary, plural
from simaps_viz.structures import Instance, Pose2, SIMap

FIELD_OF_VIEW_RAD: Final = np.pi / 2.0
OPAQUE_HEIGHT_M: Final = 1.5
"""Cells at least this high, and all wall cells, hide what is behind them."""
_SIGHT_CELLS = 48
_BODY_M = 0.2  # what the map shows this near to the viewer is the viewer, or noise
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
        viewer: where the robot stood, and looked, when the command was given.
        field_of_view_rad: full horizontal angle of ``in_view``.
    """

    def __init__(self, simap: SIMap, viewer: Pose2, *, field_of_view_rad: float = FIELD_OF_VIEW_RAD) -> None:
        self.simap = simap
        self.viewer = viewer
        self.field_of_view_rad = field_of_view_rad
        self._vocabulary = Vocabulary(simap.counts())

    def label_of(self, name: str) -> str:
        """Give the map's class for a name (itself, its singular or a synonym), or raise CommandError naming all."""
        found = self._vocabulary.resolve(name)
        if found:
            return found[0]
        counts = ", ".join(f"{label} ({n})" for label, n in self.simap.counts().items())
        has = f"It has: {counts}" if counts else "It has no objects at all"
        near = self._vocabulary.suggest(name)
        raise CommandError(f"There is no {name} on this map. {has}.{f' Did you mean {near}?' if near else ''}")

    def candidates(self, name: str) -> tuple[Candidate, ...]:
        """Give all instances of a class, the closest first, with their distances."""
        members = self.simap.of_class(self.label_of(name))
        ranked = sorted((self.distance_m(i), i.id, i) for i in members)
        return tuple(Candidate(k, instance, d) for k, (d, _, instance) in enumerate(ranked, start=1))

    def instances(self, name: str) -> tuple[Instance, ...]:
        """Give all instances of a class, the closest first."""
        return tuple(candidate.instance for candidate in self.candidates(name))

    def pick(self, name: str, which: int | Instance = 1) -> Instance:
        """Give the instance of that rank, or the given one once its class is checked."""
        if isinstance(which, Instance):
            label = self.label_of(name)
            if which.label != label:
                raise CommandError(f"instance {which.id} is a {which.label}, but a {label} was asked for")
            return which
        ranked = self.instances(name)
        self._expect_rank(ranked, which)
        return ranked[which - 1]

    def object_of(self, other: str | Instance) -> Instance:
        """Give an instance as it is, or the closest of a class."""
        return other if isinstance(other, Instance) else self.pick(other, 1)

    def nth_from(self, name: str, side: str, n: int) -> Instance:
        """Give the n-th instance of a class counted from a side; left and right are the viewer's."""
        direction = self._direction_of(side)
        members = self.simap.of_class(self.label_of(name))
        ranked = sorted(members, key=lambda i: (-float(np.dot(i.centroid_m[:2], direction)), i.id))
        self._expect_rank(ranked, n)
        return ranked[n - 1]

    def closest_to(self, name: str, other: str | Instance, which: int | Instance = 1) -> Instance:
        """Give the instance of a class whose cells come nearest to another object's; that object itself left out."""
        label = self.label_of(name)
        target = other if isinstance(other, Instance) else self.pick(other, which)
        members = [i for i in self.simap.of_class(label) if i.id != target.id]
        if not members:
            raise CommandError(f"There is only 1 {label} on this map; none is left to be near it.")
        tree = KDTree(self.cells_of(target))
        return min(members, key=lambda i: (float(tree.query(self.cells_of(i))[0].min()), i.id))

    def between(self, name: str, other_a: str | Instance, other_b: str | Instance) -> Instance:
        """Give the instance of a class that lies between two objects, nearest to the line of their centroids."""
        label = self.label_of(name)
        a, b = self.pair(other_a, other_b)
        start, end = np.array(a.centroid_m[:2]), np.array(b.centroid_m[:2])
        along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
        found = []
        for instance in self.simap.of_class(label):
            centroid = np.array(instance.centroid_m[:2])
            # Thales: in the circle over the line a-b, both ends are seen more than a quarter turn apart
            if instance.id not in (a.id, b.id) and (centroid - start) @ (centroid - end) < 0.0:
                offset = centroid - start
                found.append((abs(float(along[0] * offset[1] - along[1] * offset[0])), instance.id, instance))
        if not found:
            raise CommandError(f"There is no {label} between the {a.label} and the {b.label} on this map.")
        return min(found)[2]

    def pair(self, other_a: str | Instance, other_b: str | Instance) -> tuple[Instance, Instance]:
        """Give two different instances for two names or instances; equal names mean the two closest."""
        a = self.object_of(other_a)
        if isinstance(other_b, Instance):
            b = other_b
        else:
            ranked = self.instances(other_b)
            b = next((i for i in ranked if i.id != a.id), None)
            if b is None:
                self._expect_rank(ranked, 2)
        if b is None or a.id == b.id:
            raise CommandError(f"between needs two different objects, but the same {a.label} was named twice")
        return a, b

    def in_view(self, name: str) -> tuple[Instance, ...]:
        """Give the instances of a class within the field of view that no wall hides, the closest first."""
        return tuple(instance for instance in self.instances(name) if self._is_seen(instance))

    def distance_m(self, instance: Instance) -> float:
        """Give the distance from the viewer to the centre of the instance's nearest cell."""
        offsets = self.cells_of(instance) - (self.viewer.x_m, self.viewer.y_m)
        return float(np.sqrt((offsets**2).sum(axis=1).min()).round(9))

    def cells_of(self, instance: Instance) -> NDArray:
        """Give the centres of the instance's cells, float64 [n, 2], map frame."""
        return self._cells[instance.id]

    def _direction_of(self, side: str) -> NDArray:
        if side in _COMPASS:
            return np.array(_COMPASS[side])
        left = np.array([-np.sin(self.viewer.yaw_rad), np.cos(self.viewer.yaw_rad)])
        return left if side == "left" else -left

    @staticmethod
    def _expect_rank(ranked: "tuple[Instance, ...] | list[Instance]", rank: int) -> None:
        if rank < 1:
            raise CommandError(f"ranks count from 1, the closest; {rank} was asked for")
        if rank > len(ranked):
            label, n = ranked[0].label, len(ranked)
            there = f"is only 1 {label}" if n == 1 else f"are only {n} {plural(label)}"
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
        """Which cells one cannot look over, bool [rows, cols]."""
        grid = self.simap.grid
        walls = [i for i, label in enumerate(grid.labels) if label.startswith("wall") or label == "column"]
        with np.errstate(invalid="ignore"):
            return (grid.height_m >= OPAQUE_HEIGHT_M) | np.isin(grid.label, walls)

    def _is_seen(self, instance: Instance) -> bool:
        """Tell whether a free line of sight within the field of view reaches one of (at most 48 of) its cells."""
        cells = self.cells_of(instance)
        cells = cells[:: max(1, len(cells) // _SIGHT_CELLS)]
        offsets = cells - (self.viewer.x_m, self.viewer.y_m)
        bearing = np.arctan2(offsets[:, 1], offsets[:, 0]) - self.viewer.yaw_rad
        ahead = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi) <= self.field_of_view_rad / 2.0 + 1e-9
        return any(self._sight_is_free(offset, instance.id) for offset in offsets[ahead])

    def _sight_is_free(self, offset: NDArray, instance_id: int) -> bool:
        spec = self.simap.spec
        length = float(np.linalg.norm(offset))
        along = np.arange(_BODY_M, length, spec.cell_size_m / 3.0)[:, None] / max(length, 1e-9)
        points = np.array([self.viewer.x_m, self.viewer.y_m]) + along * offset
        col = np.floor((points[:, 0] - spec.x0_m) / spec.cell_size_m).astype(np.int64)
        row = np.floor((points[:, 1] - spec.y0_m) / spec.cell_size_m).astype(np.int64)
        inside = (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
        row, col = row[inside], col[inside]
        return not bool((self.opaque[row, col] & (self.simap.instance[row, col] != instance_id)).any())


def ordinal(n: int) -> str:
    """Give "1st", "2nd", "3rd", "4th", "11th"."""
    ending = "th" if n % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(n % 10, "th")
    return f"{n}{ending}"
