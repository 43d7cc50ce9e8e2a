"""The true world in which a run is judged: which object is where, from exact ids and depth, and where a robot fits.

Nothing here knows the map being judged. The world is seen on two grids of one frame: whose top every cell is, on cells
like a map's; and what a robot would touch, on cells half as wide.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.evaluation.truth import Truth, truth_map
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.structures import GridSpec

TOLERANCE_M: Final = 0.025
"""The disc may overlap what is occupied by this much: half a map cell, as a map's edges are rounded to whole cells."""
ELBOW_ROOM_M: Final = 0.1
"""Runs start at least this much further from everything than the radius."""
CELL_M: Final = 0.05
"""Of the cells objects are made of; obstacles are kept on cells half as wide."""
SPECK_CELLS: Final = 4
"""As ``BuildConfig.min_cells``: what covers less is not called an instance."""
OPAQUE_HEIGHT_M: Final = 1.5
"""What is this high, and every wall, hides what is behind it from a robot that looks for a place to stand."""
_LOW_EYE_M, _HIGH_EYE_M, _HANGING_M = 1.2, 1.9, 1.0


@dataclass(frozen=True, eq=False)
class TrueObject:
    """One countable thing of the world, as far as it can be seen from above."""

    id: int
    """World-wide."""
    label: str
    cells_m: NDArray
    """float64 [n, 2], centres of the cells whose top it is, map frame."""

    @cached_property
    def centroid_m(self) -> NDArray:
        """Mean of its cells' centres, float64 [2]."""
        return self.cells_m.mean(axis=0)

    @cached_property
    def tree(self) -> KDTree:
        """Its cells, for nearest-neighbour questions."""
        return KDTree(self.cells_m)

    def distance_m(self, point_m: Sequence[float] | NDArray) -> float:
        """Return the distance from a point (x, y in metres, map frame) to the centre of its nearest cell, metres."""
        return float(self.tree.query(np.asarray(point_m, np.float64))[0])


@dataclass(frozen=True, eq=False)
class World:
    """The true world."""

    name: str
    tops: Truth
    """Whose top every cell is, on cells like a map's."""
    objects: tuple[TrueObject, ...]
    """Things with at least one cell, by id."""
    fine: GridSpec
    """The grid of ``occupied`` and ``seen``."""
    occupied: NDArray
    """bool [fine rows, fine cols], something between 0.1 m over the floor and the robot's height."""
    seen: NDArray
    """bool [fine rows, fine cols]."""
    robot: RobotShape

    @property
    def spec(self) -> GridSpec:
        """The grid of ``tops``."""
        return self.tops.spec

    @property
    def ids(self) -> NDArray:
        """int32 [rows, cols], world-wide id of the thing on top, 0 = none."""
        return self.tops.instance

    def of_class(self, label: str) -> tuple[TrueObject, ...]:
        """Return the objects of a class, by id."""
        return tuple(o for o in self.objects if o.label == label)

    def by_id(self, object_id: int) -> TrueObject:
        """Return the object with that world-wide id."""
        return next(o for o in self.objects if o.id == object_id)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Classes of the objects, in alphabetical order."""
        return tuple(sorted({o.label for o in self.objects}))

    @cached_property
    def _obstacles(self) -> KDTree | None:
        rows, cols = np.nonzero(self.occupied)
        return KDTree(self.fine.centres_of(rows, cols)) if len(rows) else None

    def clearance_m(self, points_m: NDArray) -> NDArray:
        """Return each point's distance to what is occupied, float64 [n], metres; 0 inside.

        Measured to the centre of the nearest occupied cell, less half a (fine) cell.
        """
        if self._obstacles is None:
            return np.full(len(points_m), np.inf)
        return np.maximum(self._obstacles.query(points_m)[0] - self.fine.cell_size_m / 2.0, 0.0)

    @cached_property
    def roomy(self) -> NDArray:
        """Where a run can start: float64 [n, 2], seen points with elbow room in the largest connected area."""
        room = ndimage.distance_transform_edt(~self.occupied) if self.occupied.any() else np.full(self.seen.shape, 1e9)
        needed = (self.robot.radius_m + ELBOW_ROOM_M) / self.fine.cell_size_m + 0.5
        areas, count = ndimage.label(self.seen & (np.asarray(room) >= needed))  # pyright: ignore[reportGeneralTypeIssues]
        if not count:
            raise InputError(f"{self.name}: expected floor wide enough for the robot, found none")
        largest = np.bincount(areas.ravel())[1:].argmax() + 1
        return self.fine.centres_of(*np.nonzero(areas == largest))

    @cached_property
    def roomy_tree(self) -> KDTree:
        """The points of ``roomy``."""
        return KDTree(self.roomy)

    @cached_property
    def _walls(self) -> NDArray:
        names = enumerate(self.tops.labels)
        walls = [i for i, name in names if name in ("wall", "column") or name.startswith("wall-")]
        return np.isin(self.tops.label, walls)

    def sight_is_free(self, eye_m: NDArray, target_m: NDArray, target_id: int) -> bool:
        """Return whether no wall and nothing at least 1.5 m high but the target is between two points.

        Args:
            eye_m: float [2], where the camera is, map frame.
            target_m: float [2], a point of what is looked for.
            target_id: of what is looked for, which hides nothing of itself.
        """
        row, col, _ = self._ray(eye_m, target_m)
        with np.errstate(invalid="ignore"):
            hides = self._walls[row, col] | (self.tops.grid.height_m[row, col] >= OPAQUE_HEIGHT_M)
        return not bool((hides & (self.ids[row, col] != target_id)).any())

    def surely_sees(self, eye_m: NDArray, target_m: NDArray, target_id: int) -> bool:
        """Return whether a camera 1.2 m high sees the top of a cell, even if it cannot look under anything.

        Arguments as for `sight_is_free`.
        """
        row, col, share = self._ray(eye_m, target_m)
        heights = np.nan_to_num(self.tops.grid.height_m)
        end = self.spec.cell_of(float(target_m[0]), float(target_m[1]))
        ray_m = _LOW_EYE_M + share * (float(heights[end]) - _LOW_EYE_M)
        hides = self._walls[row, col] | (heights[row, col] >= np.minimum(ray_m, OPAQUE_HEIGHT_M))
        return not bool((hides & (self.ids[row, col] != target_id)).any())

    def might_see(self, eye_m: NDArray, target_m: NDArray, target_id: int) -> bool:
        """Return whether any robot's camera could: only walls hide, and what stands on the floor and is 1.9 m high.

        Arguments as for `sight_is_free`.
        """
        row, col, _ = self._ray(eye_m, target_m)
        grid = self.tops.grid
        with np.errstate(invalid="ignore"):
            stands = (grid.height_m[row, col] >= _HIGH_EYE_M) & (grid.lowest_m[row, col] <= _HANGING_M)
        return not bool(((self._walls[row, col] | stands) & (self.ids[row, col] != target_id)).any())

    def _ray(self, eye_m: NDArray, target_m: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return rows, cols and share of the length of points on a line, from 0.2 m before the eye to the target."""
        length = float(np.linalg.norm(target_m - eye_m))
        steps = max(2, int(length / (self.spec.cell_size_m / 4.0)))
        share = np.linspace(min(1.0, 0.2 / max(length, 1e-9)), 1.0, steps)
        points = eye_m + share[:, None] * (target_m - eye_m)
        row, col = self.spec.cells_of(points)
        inside = (row >= 0) & (row < self.spec.rows) & (col >= 0) & (col < self.spec.cols)
        return row[inside], col[inside], share[inside]


def observe_world(
    sequence: FrameSource,
    *,
    robot: RobotShape | None = None,
    surface_m: NDArray | None = None,
) -> World:
    """Find out what is true from frames whose ids are exact and world-wide.

    Obstacles come from the frames' depth, so sensor noise makes them a little thicker than they are; where the
    scene's own surfaces are known they can be given instead.

    Args:
        sequence: with ``instances`` as its segmentation, that is, ground truth.
        robot: who will drive.
        surface_m: float64 [n, 3], points on every surface, dense enough for these cells, map frame.

    Raises:
        InputError: the masks are not exact, or a frame is missing or damaged.
    """
    robot = robot or RobotShape()
    tops, low = (truth_map(sequence, ProjectionSettings(cell_size_m=size)) for size in (CELL_M, CELL_M / 2.0))
    tops = replace(tops, instance=without_specks(tops.instance))
    cells = {number: np.nonzero(tops.instance == number) for number in sorted(tops.names)}
    objects = tuple(
        TrueObject(number, tops.names[number], tops.spec.centres_of(*where))
        for number, where in cells.items()
        if len(where[0])
    )
    with np.errstate(invalid="ignore"):
        occupied = low.grid.lowest_m <= robot.height_m
    if surface_m is not None:
        occupied = _occupied_by(low.spec, surface_m, robot.height_m)
    seen = ~np.isnan(low.grid.height_m)
    return World(sequence.name, tops, objects, low.spec, occupied, seen, robot)


def without_specks(ids: NDArray) -> NDArray:
    """Take from every object the patches of fewer than `SPECK_CELLS` cells, if it has a larger one.

    Sensor noise throws single pixels of an object's outline on the floor, metres behind it.

    Args:
        ids: int32 [rows, cols], 0 = none; patches are connected by edges or corners.
    """
    cleaned = ids.copy()
    for number, window in enumerate(ndimage.find_objects(ids), start=1):
        if window is not None:
            patches, _ = ndimage.label(ids[window] == number, np.ones((3, 3)))  # pyright: ignore[reportGeneralTypeIssues]
            sizes = np.bincount(patches.ravel())
            specks = (sizes < SPECK_CELLS) & (sizes[1:].max() >= SPECK_CELLS)
            specks[0] = False
            cleaned[window][specks[patches]] = 0
    return cleaned


def _occupied_by(spec: GridSpec, surface_m: NDArray, height_m: float) -> NDArray:
    """Mark the cells with a surface between what a robot drives over and its height, bool [rows, cols]."""
    low = ProjectionSettings().obstacle_height_m
    points = surface_m[(surface_m[:, 2] >= low) & (surface_m[:, 2] <= height_m)]
    row, col = spec.cells_of(points[:, :2])
    inside = (row >= 0) & (row < spec.rows) & (col >= 0) & (col < spec.cols)
    occupied = np.zeros(spec.shape, np.bool_)
    occupied[row[inside], col[inside]] = True
    return occupied
