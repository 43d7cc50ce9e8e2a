"""Where a map that has begun lies on an earlier one of the same place: turned about the vertical, moved on the floor.

All turns and shifts are tried on rasters of 10 cm, by their Fourier transforms; the best few are then refined on the
cells. What counts is what agrees of that which both maps have seen: obstacles, what is free, and classes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import distance_transform_edt, map_coordinates
from scipy.optimize import minimize

from simaps_viz.geometry import wrap_angle
from simaps_viz.mapping.observations import FrameReadings, FrameRuns, no_runs
from simaps_viz.mapping.steps import FrameSeen, FrameStep
from simaps_viz.mapping.surface import owned_runs
from simaps_viz.structures import Grid, Segment, SIMap

MIN_SCORE = 0.85
"""Agreement, 0 to 1, below which a place is no place."""
MIN_LEAD = 0.1
"""The best place has to agree by so much more than the second best, which lies elsewhere."""
ELSEWHERE = (1.0, np.deg2rad(30.0))
"""Two places are different ones when they are so many metres, or so large an angle, apart."""
MIN_SEEN_M2 = 4.0
"""With less to compare nothing is tried."""
OVERLAP = 0.5
"""With less of the new map on the old one, the agreement counts less in proportion."""
RASTER_M, TURN_RAD = 0.1, np.deg2rad(3.0)
SOFT_M = 0.1
"""An obstacle that is so far off still agrees by .6."""
CANDIDATES = 5
AS_FRAMES = 5
"""An earlier map counts as so many frames, which saw all of it from above."""
MIN_CELLS, MAX_CLASSES, MAX_POINTS = 8, 8, 1500
"""Of a class that is compared; the largest classes; and points of each that are looked up when refining."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the new map lies on the old one."""

    T_old_new: NDArray
    """float64 [4, 4]."""
    score: float
    second: float
    """Of the best place elsewhere."""

    @property
    def is_sure(self) -> bool:
        """Whether it is good enough, and clearly the best."""
        return self.score >= MIN_SCORE and self.score - self.second >= MIN_LEAD


@dataclass(frozen=True, eq=False)
class _Layer:
    """One thing to compare: where the new map has it, and how much the old map agrees at any place."""

    points: NDArray
    """float64 [n, 2], new map frame."""
    agrees: NDArray
    """float32 [rows, cols] of the old grid, 0 to 1."""
    kind: int
    """What counts together: 0 obstacles, 1 what is free, 2 classes."""


def find_placement(old: Grid, new: Grid) -> Placement | None:
    """Return the best place of a map on another one of the same floor height; None where too little was seen."""
    layers = tuple(_layers(old, new))
    if not sum(len(one.points) for one in layers):
        return None
    # Turns are about the middle of the new map, so that neighbouring places have neighbouring numbers.
    middle = np.concatenate([one.points for one in layers]).mean(axis=0)
    layers = tuple(replace(one, points=one.points - middle) for one in layers)
    seen_m2 = sum(len(one.points) for one in layers if one.kind < 2) * new.spec.cell_size_m**2
    if seen_m2 < MIN_SEEN_M2 or not old.observations.any():
        return None
    found: list[tuple[float, NDArray]] = []
    rng = np.random.default_rng(0)
    fewer = [_Layer(_some(one.points, rng), one.agrees, one.kind) for one in layers]
    seen = (old.observations > 0).astype(np.float32)
    for start in _coarse(old, layers):
        cost = lambda p: -_agreement(old, seen, fewer, p)  # noqa: E731
        simplex = start + np.array([[0, 0, 0], [0.06, 0, 0], [0, 0.06, 0], [0, 0, 0.04]])
        best = minimize(cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": 80})
        found.append((-float(best.fun), best.x))
    found.sort(key=lambda one: -one[0])
    score, (x, y, yaw) = found[0]
    second = max((s for s, p in found[1:] if _apart(p, found[0][1])), default=0.0)
    T = np.eye(4)
    T[:2, :2] = _turn(yaw)
    T[:2, 3] = (x, y) - _turn(yaw) @ middle
    return Placement(T, score, second)


def as_steps(old: SIMap, name: str, T_map_camera: NDArray) -> list[FrameStep]:
    """Return a map as the first frames of another one in its frame: each saw all of it, and every object as a segment.

    Args:
        old: the map.
        name: of the frames.
        T_map_camera: float64 [4, 4], where they are drawn.
    """
    grid, (row0, col0) = old.grid, old.spec.origin_cell
    cell = np.flatnonzero(~np.isnan(grid.height_m))
    # Objects, hidden ones too, are segments, and what is no thing is one of its class.
    objects = (*old.instances, *old.hidden)
    stuff = [i for i, thing in enumerate(grid.is_thing) if i and not thing]
    segments = [Segment(n, one.label, one.score, True) for n, one in enumerate(objects, 1)]
    segments += [Segment(n, grid.labels[i], 1.0, False) for n, i in enumerate(stuff, len(objects) + 1)]
    of_object = np.zeros(max((one.id for one in objects), default=0) + 1, np.int32)
    of_object[[one.id for one in objects]] = np.arange(1, len(objects) + 1)
    of_class = np.zeros(len(grid.labels), np.int32)
    of_class[stuff] = np.arange(len(objects) + 1, len(segments) + 1)

    def segment(instance: NDArray, label: NDArray) -> NDArray:
        return np.where(instance > 0, of_object[instance], of_class[np.maximum(label, 0)]).astype(np.int32)

    rows, cols = np.divmod(cell, old.spec.cols)
    readings = FrameReadings(
        (rows + row0).astype(np.int32), (cols + col0).astype(np.int32),
        segment(old.instance.reshape(-1)[cell], grid.label.reshape(-1)[cell]), grid.height_m.reshape(-1)[cell],
    )  # fmt: skip
    runs, surface = no_runs(), old.surface
    if surface is not None and surface.spec == old.spec and len(cell):
        label, instance = owned_runs(old, surface)
        place = np.minimum(np.searchsorted(cell, surface.cell), len(cell) - 1)
        at = cell[place] == surface.cell
        runs = FrameRuns(place[at].astype(np.int32), segment(instance, label)[at], surface.low[at], surface.high[at])
    lowest = grid.lowest_m.reshape(-1)[cell]
    low = ~np.isnan(lowest)
    return [
        FrameStep(FrameSeen(i, f"{name} {i + 1}", T_map_camera, readings, tuple(segments), runs=runs), low, lowest[low])
        for i in range(AS_FRAMES)
    ]


def _layers(old: Grid, new: Grid) -> Iterator[_Layer]:
    """Yield what both maps can be compared by."""
    seen = old.observations > 0
    solid = [~np.isnan(grid.lowest_m) for grid in (old, new)]
    free = [(grid.observations > 0) & ~one for grid, one in zip((old, new), solid, strict=True)]
    yield _Layer(new.spec.centres_of(*np.nonzero(solid[1])), _soft(old, solid[0]), 0)
    yield _Layer(new.spec.centres_of(*np.nonzero(free[1])), (free[0] | ~seen).astype(np.float32), 1)
    sizes = np.bincount(new.label[solid[1]], minlength=len(new.labels))
    known = [label for label, name in enumerate(new.labels) if label and name in old.labels]
    for label in sorted(known, key=lambda label: -sizes[label])[:MAX_CLASSES]:
        where, name = (new.label == label) & solid[1], new.labels[label]
        if sizes[label] >= MIN_CELLS:
            there = (old.label == old.labels.index(name)) & solid[0]
            if np.count_nonzero(there) >= MIN_CELLS:
                yield _Layer(new.spec.centres_of(*np.nonzero(where)), _soft(old, there), 2)


def _coarse(old: Grid, layers: tuple[_Layer, ...]) -> list[NDArray]:
    """Return the best places of all turns and shifts, (x, y, yaw), each elsewhere from the others."""
    spec, step = old.spec, max(round(RASTER_M / old.spec.cell_size_m), 1)
    size_m = step * spec.cell_size_m
    half = int(max(float(np.linalg.norm(one.points, axis=1).max(initial=0.0)) for one in layers) / size_m) + 1
    seen = (old.observations > 0).astype(np.float32)[step // 2 :: step, step // 2 :: step]
    shape = tuple(fft.next_fast_len(n + 2 * half, real=True) for n in seen.shape)
    agrees: list[Any] = [fft.rfft2(one.agrees[step // 2 :: step, step // 2 :: step] * seen, shape) for one in layers]
    of_seen, total = fft.rfft2(seen, shape), sum(len(one.points) for one in layers if one.kind < 2)
    peaks: list[tuple[float, NDArray]] = []
    for yaw in np.arange(0.0, 2 * np.pi, TURN_RAD):
        agreed, known = (np.zeros((3, *agrees[0].shape), np.complex64) for _ in range(2))
        for one, image in zip(layers, agrees, strict=True):
            cells = np.floor(one.points @ _turn(yaw).T / size_m).astype(int) + half
            raster = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
            np.add.at(raster, (cells[:, 1], cells[:, 0]), 1.0)
            spectrum = np.conj(np.asarray(fft.rfft2(raster, shape)))
            agreed[one.kind] += image * spectrum
            known[one.kind] += of_seen * spectrum
        back: Any = fft.irfft2
        scores: NDArray = _score(back(agreed, shape), back(known, shape), total)
        # The best shift, and the best one elsewhere: corridors look alike all along.
        for _ in range(2):
            row, col = (int(at) for at in np.unravel_index(int(scores.argmax()), scores.shape))
            shift = [
                at - n * (at >= m) + half
                for at, n, m in zip((col, row), scores.shape[::-1], seen.shape[::-1], strict=True)
            ]
            at_m = np.array([spec.x0_m, spec.y0_m]) + np.array(shift) * size_m
            peaks.append((float(scores[row, col]), np.array([*at_m, yaw])))
            around = int(ELSEWHERE[0] / size_m) + 1
            scores[max(row - around, 0) : row + around, max(col - around, 0) : col + around] = 0.0
    chosen: list[NDArray] = []
    for _, place in sorted(peaks, key=lambda one: -one[0]):
        if len(chosen) < CANDIDATES and all(_apart(place, other) for other in chosen):
            chosen.append(place)
    return chosen


def _score(agreed: NDArray, known: NDArray, total: int) -> NDArray:
    """Return the agreement, [...], of sums [3, ...] by kind: the mean of kinds, for the part that both have seen."""
    share = np.where(known > 0.5, agreed / np.maximum(known, 0.5), 0.0)
    return share.mean(axis=0) * np.clip((known[0] + known[1]) / (OVERLAP * total), 0.0, 1.0)


def _agreement(old: Grid, seen: NDArray, layers: list[_Layer], place: NDArray) -> float:
    """Return the agreement at a place (x, y, yaw)."""
    agreed, known = np.zeros(3), np.zeros(3)
    spec, total = old.spec, 0
    for one in layers:
        at = (one.points @ _turn(place[2]).T + place[:2] - (spec.x0_m, spec.y0_m)) / spec.cell_size_m - 0.5
        here = map_coordinates(seen, at[:, ::-1].T, order=0, mode="constant")
        agreed[one.kind] += (map_coordinates(one.agrees, at[:, ::-1].T, order=1, mode="constant") * here).sum()
        known[one.kind] += here.sum()
        total += len(one.points) if one.kind < 2 else 0
    return float(_score(agreed, known, total))


def _soft(grid: Grid, where: NDArray) -> NDArray:
    away_m = np.asarray(distance_transform_edt(~where)) * grid.spec.cell_size_m if where.any() else np.inf
    return np.exp(-0.5 * (np.broadcast_to(away_m, where.shape) / SOFT_M) ** 2).astype(np.float32)


def _some(points: NDArray, rng: np.random.Generator) -> NDArray:
    return points if len(points) <= MAX_POINTS else points[rng.choice(len(points), MAX_POINTS, replace=False)]


def _turn(yaw_rad: float) -> NDArray:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s], [s, c]])


def _apart(one: NDArray, other: NDArray) -> bool:
    turned = abs(wrap_angle(one[2] - other[2]))
    return bool(np.hypot(*(one - other)[:2]) > ELSEWHERE[0] or turned > ELSEWHERE[1])
