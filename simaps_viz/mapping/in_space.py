"""Objects in space: their boxes, and what stands on, under and in what, from the voxels of their surfaces."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, wraps
from typing import Any, Concatenate, Final, ParamSpec, TypeVar

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from simaps_viz.structures import Box, InSpace, Instance, Points, SIMap

VOXEL_M: Final = 0.05
_ON_EDGE: Final = 1e-4
"""Share of a voxel by which a point may miss it, so that points put exactly on its lower faces are in it."""
_BELOW: Final = 64
"""Layers below the floor that a key can name."""
Z_BITS, X_BITS = 8, 26
"""Bits of a key below y, and below x: layers and rows."""
_MIDDLE: Final = 1 << 17
_LEGS: Final = 3
"""A voxel is of a surface if so many layers above it are free of its object: else it is a leg or a side."""
_REACH: Final = 2
"""Cells by which what was seen of a surface is grown: what stands on it hides the rest."""
_MIN_SURFACE: Final = 3
"""Voxels."""
FRINGE_PERCENT: Final = 1.0
_LOOSE: Final = 0.25
"""Of the voxels touched by those on its faces (upper quartile): a column in which none touches so many is a stray."""
_MIN_PATCH, _SURE_PATCH = 0.1, 0.5
"""Share of the largest patch's voxels from which a patch near it, or any patch, is part of the object."""
_FEW, _NEAR = 6, 4
"""Voxels of a patch from which it can be part of an object without being nearly as large, and cells to it."""
SLIVER: Final = 0.03
"""Objects whose largest patch has a smaller share of the voxels usual in their class are slivers."""
_AROUND: Final = [(x << X_BITS) + (y << Z_BITS) + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
_AHEAD: Final = [step for step in _AROUND if step > 0]
"""From a voxel to half of those that touch it."""
MIN_ON, MIN_UNDER, MIN_INSIDE = 0.5, 0.3, 0.5
"""Shares of an object's cells from which it stands on, under or in another."""


_REMEMBERED: Final = 1024
"""Objects whose body, box and shape are kept: most stay as they are when a slider cuts others."""

P = ParamSpec("P")
R = TypeVar("R")


def _remembered(compute: Callable[Concatenate[NDArray, P], R]) -> Callable[Concatenate[NDArray, P], R]:
    """Return a function of an object's voxels, int64 [n], that computes the latest results once."""

    @lru_cache(_REMEMBERED)
    def found(voxels: bytes, *args: Any, **kwargs: Any) -> R:
        return compute(np.frombuffer(voxels, np.int64), *args, **kwargs)

    @wraps(compute)
    def of(keys: NDArray, /, *args: P.args, **kwargs: P.kwargs) -> R:
        return found(keys.tobytes(), *args, **kwargs)

    return of


def voxel_keys(positions: ArrayLike, origin_m: tuple[float, float]) -> NDArray:
    """Number the voxels of points: int64 [n], ascending by x, then y, then z; ``key >> Z_BITS`` numbers the column.

    Args:
        positions: float [n, 3], metres, map frame; within 6 km of the origin, from 3.2 m below the floor to 9.5 m.
        origin_m: a corner of the voxels' grid, whose layers begin at z = 0.
    """
    scaled = (np.asarray(positions, np.float64) - (*origin_m, 0.0)) / VOXEL_M
    x, y, z = np.floor(scaled + _ON_EDGE).astype(np.int64).reshape(-1, 3).T
    return (x + _MIDDLE) << X_BITS | (y + _MIDDLE) << Z_BITS | np.clip(z + _BELOW, 0, 255)


def voxel_indices(keys: NDArray) -> NDArray:
    """Return the x, y and z of numbered voxels in voxels from the origin, int64 [n, 3]."""
    row = keys >> Z_BITS & 2 * _MIDDLE - 1
    return np.stack([(keys >> X_BITS) - _MIDDLE, row - _MIDDLE, (keys & 255) - _BELOW], axis=1)


def voxel_centres(keys: NDArray, origin_m: tuple[float, float]) -> NDArray:
    """Return the centres of numbered voxels, float64 [n, 3], metres, map frame."""
    return (voxel_indices(keys) + 0.5) * VOXEL_M + (*origin_m, 0.0)


def majority(keys: NDArray, values: NDArray, weights: NDArray | None = None) -> tuple[NDArray, NDArray, NDArray]:
    """Return the distinct keys, ascending, with the heaviest value of each (the lower of equals) and its total weight.

    Args:
        keys: int64 [n].
        values: int64 [n].
        weights: int64 [n]; 1 each if left out.
    """
    order = np.lexsort((values, keys))
    keys, values = keys[order], values[order]
    weights = np.ones(len(keys), np.int64) if weights is None else weights[order]
    if len(keys) == 0:
        return keys, values, weights
    # One row for each (key, value), then the heaviest of each key comes last.
    starts = np.flatnonzero(np.r_[True, (np.diff(keys) != 0) | (np.diff(values) != 0)])
    keys, values, weights = keys[starts], values[starts], np.add.reduceat(weights, starts)
    order = np.lexsort((-values, weights, keys))
    keys, values, weights = keys[order], values[order], weights[order]
    last = np.flatnonzero(np.r_[np.diff(keys) != 0, True])
    totals = np.add.reduceat(weights, np.r_[0, last[:-1] + 1])
    return keys[last], values[last], totals


def among(keys: NDArray, sorted_keys: NDArray) -> NDArray:
    """Return which keys are among others, bool [n]."""
    if len(sorted_keys) == 0:
        return np.zeros(len(keys), bool)
    return sorted_keys[np.minimum(np.searchsorted(sorted_keys, keys), len(sorted_keys) - 1)] == keys


def voxels_by_instance(points: Points, origin_m: tuple[float, float]) -> dict[int, NDArray]:
    """Return {instance: its voxels, sorted keys}; a voxel in which several have points is of the one with most."""
    keys = voxel_keys(points.positions, origin_m)
    order = np.argsort(keys)
    keys, owner = keys[order], points.instances[order].astype(np.int64)
    if (np.diff(keys) == 0).any():
        keys, owner, _ = majority(keys, owner)
    keys, owner = keys[owner > 0], owner[owner > 0]
    order = np.argsort(owner, kind="stable")
    ids, starts = np.unique(owner[order], return_index=True)
    parts = np.split(keys[order], starts[1:])
    return dict(zip(ids.tolist(), parts, strict=True)) if len(ids) else {}


def without_strays(keys: NDArray) -> NDArray:
    """Return an object's voxels without what errors of masks leave at its rim and apart from it.

    Columns go first in which no voxel touches a quarter as many others as is usual on the object's faces (the upper
    quartile): a leg stands below what it carries. Of the patches that are left, voxels that touch, one with half the
    voxels of the largest is kept. A smaller one is if it has a tenth of them, is more than a few voxels, and stands
    near the largest, over it or under it.

    Args:
        keys: sorted.
    """
    return _body(keys)[0]


@_remembered
def _body(keys: NDArray) -> tuple[NDArray, int]:
    """Return an object's voxels without strays, and how many the largest patch has."""
    if len(keys) == 0:
        return keys, 0
    touched = np.bincount(np.concatenate(_touching(keys)), minlength=len(keys))
    columns = keys >> Z_BITS
    keys = keys[among(columns, np.unique(columns[touched >= _LOOSE * np.percentile(touched, 75)]))]
    patch, sizes = patches(keys)
    largest = int(sizes.argmax())
    kept = sizes >= _SURE_PATCH * sizes[largest]
    doubtful = np.flatnonzero(~kept & (sizes >= _MIN_PATCH * sizes[largest]) & (sizes >= _FEW))
    if len(doubtful):
        cells = voxel_indices(keys)[:, :2]
        body = KDTree(cells[patch == largest])
        kept[doubtful] = [body.query(cells[patch == one], p=np.inf)[0].min() <= _NEAR for one in doubtful]
    return keys[kept[patch]], int(sizes[largest])


def patches(keys: NDArray) -> tuple[NDArray, NDArray]:
    """Return the patch of voxels that touch which each voxel is of, int [n], and how many voxels each patch has."""
    ends = _touching(keys)
    graph = coo_matrix((np.ones(len(ends[0]), bool), ends), (len(keys), len(keys)))
    _, patch = connected_components(graph, directed=False)
    return patch, np.bincount(patch)


def _touching(keys: NDArray) -> tuple[NDArray, NDArray]:
    """Return every two voxels that touch, by their places, int [pairs] each; keys ascend."""
    first, second = [], []
    for step in _AHEAD:
        at = np.minimum(np.searchsorted(keys, keys + step), len(keys) - 1)
        touching = np.flatnonzero(keys[at] == keys + step)
        first.append(touching)
        second.append(at[touching])
    return np.concatenate(first), np.concatenate(second)


def least_sizes(sizes: NDArray, classes: NDArray) -> NDArray:
    """Return how many voxels each object needs to be no sliver, which masks that slip over an edge leave behind it.

    Usual in a class is the size of the object in which the middle one of all its voxels lies, the objects in order of
    size; so slivers hardly change it.

    Args:
        sizes: int64 [n], voxels of each object.
        classes: [n], anything that sorts.

    Returns:
        float64 [n].
    """
    order = np.lexsort((sizes, classes))
    ascending = np.cumsum(sizes[order])
    _, starts, at, objects = np.unique(classes[order], return_index=True, return_inverse=True, return_counts=True)
    first, last = order[starts], starts + objects - 1
    middle = (ascending[starts] - sizes[first] + ascending[last]) / 2.0
    least = np.zeros(len(sizes))
    least[order] = SLIVER * sizes[order[np.searchsorted(ascending, middle)]][at]
    return least


def whole_objects(voxels: Mapping[int, NDArray], class_of: Mapping[int, int | str]) -> dict[int, NDArray]:
    """Return objects without strays, and without those that are slivers: all scattered, too, if no patch is larger.

    Args:
        voxels: {object: its voxels, sorted keys}.
        class_of: {object: its class}.
    """
    kept = {number: _body(keys) for number, keys in voxels.items()}
    sizes = np.array([len(keys) for keys, _ in kept.values()], np.int64)
    least = least_sizes(sizes, np.array([class_of[number] for number in kept]))
    return {
        number: keys for (number, (keys, largest)), enough in zip(kept.items(), least, strict=True) if largest >= enough
    }


@_remembered
def box_of(keys: NDArray, origin_m: tuple[float, float], *, trim_percent: float = FRINGE_PERCENT) -> Box:
    """Return the box round an object's voxels: turned as the rectangle of least area round their centres.

    From low to high it reaches from the 2nd to the 98th percentile. Centres, as a thing ends anywhere in its last
    voxel; no side is shorter than a voxel.

    Args:
        keys: its voxels.
        origin_m: of their grid.
        trim_percent: share of the voxels left out at each end of length and width: pixels of other things at its rim.
    """
    centres = voxel_centres(keys, origin_m)
    middle = centres[:, :2].mean(axis=0)
    _, _, degrees = cv2.minAreaRect((centres[:, :2] - middle).astype(np.float32))
    yaw = np.deg2rad(degrees)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    ends = np.percentile((centres[:, :2] - middle) @ turn, [trim_percent, 100 - trim_percent], axis=0)
    (length, width), (x, y) = ends[1] - ends[0], turn @ ends.mean(axis=0) + middle
    low, high = np.percentile(centres[:, 2], [2, 98])
    if width > length:
        length, width, yaw = width, length, yaw + np.pi / 2
    yaw = float((yaw + np.pi / 2) % np.pi - np.pi / 2)  # a box turned by half is the same
    length, width, height = (max(float(side), VOXEL_M) for side in (length, width, high - low))
    return Box((float(x), float(y), float(low + high) / 2), (length, width, height), yaw)


@dataclass(frozen=True, eq=False)
class _Shape:
    """One object's voxels, as relations need them."""

    keys: NDArray
    indices: NDArray
    """int64 [n, 3]."""
    columns: NDArray
    """int64 [m], ascending."""
    lowest: NDArray
    """int64 [m], layer of the lowest voxel in each column."""
    highest: NDArray
    surface: NDArray
    """int64 [k, 3], voxels that something can stand on."""
    bottom: int
    low: NDArray
    """int64 [3]."""
    high: NDArray

    @property
    def cells(self) -> NDArray:
        """int64 [m, 2], x and y of the columns."""
        return voxel_indices(self.columns << Z_BITS)[:, :2]


@_remembered
def _shape_of(keys: NDArray) -> _Shape:
    indices = voxel_indices(keys)
    columns, first = np.unique(keys >> Z_BITS, return_index=True)
    last = np.r_[first[1:], len(keys)] - 1
    bare = ~np.logical_or.reduce([among(keys + up, keys) for up in range(1, _LEGS + 1)])
    bottom = int(np.percentile(indices[:, 2], 2, method="lower"))
    return _Shape(
        keys, indices, columns, indices[first, 2], indices[last, 2], indices[bare], bottom,
        indices.min(axis=0), indices.max(axis=0),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Relations:
    """What an object has to do with others: {other: share of the object's cells}, the largest share first."""

    on: dict[int, float]
    under: dict[int, float]
    inside: dict[int, float]


def relations(voxels: Mapping[int, NDArray]) -> dict[int, Relations]:
    """Find what stands on, under and in what.

    *On*: the object's bottom is at most 5 cm below and 10 cm above a surface of the other, and half of its cells lie
    over that surface; what it hides of the surface counts as surface, up to the other's convex outline. *Under*: in at
    least 30 % of its cells the other has something higher than its highest voxel. *In*: in at least half of its
    cells the other has something below and something above it.

    Args:
        voxels: {object: sorted keys}; no object is empty.
    """
    shapes = {number: _shape_of(keys) for number, keys in voxels.items()}
    found = {number: Relations({}, {}, {}) for number in shapes}
    for a, b in _near_pairs(shapes):
        one, other = shapes[a], shapes[b]
        _, at, there = np.intersect1d(one.columns, other.columns, assume_unique=True, return_indices=True)
        above = one.highest[at] < other.highest[there]
        within = above & (other.lowest[there] < one.lowest[at])
        shares = (_share_on(one, other), above.sum() / len(one.columns), within.sum() / len(one.columns))
        kinds = (found[a].on, found[a].under, found[a].inside)
        for kind, share, least in zip(kinds, shares, (MIN_ON, MIN_UNDER, MIN_INSIDE), strict=True):
            if share >= least:
                kind[b] = float(share)
    return {number: Relations(*map(_largest_first, (r.on, r.under, r.inside))) for number, r in found.items()}


def _near_pairs(shapes: Mapping[int, _Shape]) -> Iterator[tuple[int, int]]:
    """Yield the pairs of objects whose bounding boxes touch or nearly do."""
    if not shapes:
        return
    ids = list(shapes)
    low, high = (np.array([getattr(shape, end) for shape in shapes.values()]) for end in ("low", "high"))
    for at, number in enumerate(ids):
        near = ((low - _LEGS <= high[at]) & (high + _LEGS >= low[at]))[:, :2].all(axis=1)
        yield from ((number, ids[other]) for other in np.flatnonzero(near) if other != at)


def _share_on(one: _Shape, other: _Shape) -> float:
    """Return the share of an object's cells that lie over a surface of the other at its bottom."""
    gap = one.bottom - other.surface[:, 2]
    cells = other.surface[:, :2]
    around = ((cells >= one.low[:2] - _LEGS) & (cells <= one.high[:2] + _LEGS)).all(axis=1)
    top = cells[(gap >= -1) & (gap <= 2) & around]
    if len(top) < _MIN_SURFACE:
        return 0.0
    corner = one.low[:2] - 2 * _LEGS
    size = one.high[:2] - one.low[:2] + 4 * _LEGS + 1
    seen = cv2.dilate(_hull(top - corner, size), np.ones((2 * _REACH + 1, 2 * _REACH + 1), np.uint8))
    holds = seen & _hull(other.cells - corner, size)
    col, row = (one.cells - corner).T
    return float(holds[row, col].mean())


def _hull(cells: NDArray, size: NDArray) -> NDArray:
    """Fill the convex outline of cells, x and y each, in a picture of a size (x, y): uint8, 1 inside."""
    picture = np.zeros((int(size[1]), int(size[0])), np.uint8)
    cv2.fillConvexPoly(picture, cv2.convexHull(cells.astype(np.int32)), (1,))
    return picture


def _largest_first(shares: dict[int, float]) -> dict[int, float]:
    return dict(sorted(shares.items(), key=lambda pair: (-pair[1], pair[0])))


def column_points(simap: SIMap, *, things: bool = False) -> Points:
    """Return what a map without voxels knows of space: columns from the floor to the height of their cell, filled.

    Cells never seen have none, cells of floor one voxel; colours are the median colours of objects, else grey.

    Args:
        simap: the map.
        things: only the columns of instances.
    """
    spec, height = simap.spec, np.nan_to_num(simap.grid.height_m, nan=-1.0)
    parts = _parts(simap)
    row, col = np.nonzero(simap.instance > 0 if things else ~np.isnan(simap.grid.height_m))
    top = np.floor(height[row, col] / VOXEL_M).astype(np.int64)
    instance, label = simap.instance[row, col], simap.grid.label[row, col]
    stands = (top > 0) & ((instance > 0) | (label > 0))
    layers = np.where(stands, top + 1, 1)
    first = np.where(stands, 0, top)
    which = np.repeat(np.arange(len(row)), layers)
    layer = first[which] + np.arange(len(which)) - np.repeat(np.cumsum(layers) - layers, layers)
    colors = np.full((int(simap.instance.max(initial=0)) + 1, 3), 150, np.uint8)
    for one in simap.instances:
        colors[one.id] = simap.color_of(one) or (150, 150, 150)
    shift = (np.arange(parts) + 0.5) / parts
    across = np.stack(np.meshgrid(shift, shift), axis=-1).reshape(-1, 2)
    which, layer, across = (
        np.repeat(which, len(across)), np.repeat(layer, len(across)), np.tile(across, (len(which), 1))
    )  # fmt: skip
    positions = np.empty((len(which), 3), np.float32)
    positions[:, 0] = spec.x0_m + (col[which] + across[:, 0]) * spec.cell_size_m
    positions[:, 1] = spec.y0_m + (row[which] + across[:, 1]) * spec.cell_size_m
    positions[:, 2] = (layer + 0.5) * VOXEL_M
    classes = np.where(label > 0, label, -1).astype(np.int16)
    return Points(positions, colors[instance[which]], classes[which], instance[which].astype(np.int32))


def has_voxels(simap: SIMap) -> bool:
    """Return whether a map knows the surface of things; else it knows their tops only."""
    return simap.surface is not None


def space_points(simap: SIMap, *, things: bool = False) -> Points:
    """Return the observed voxels of a map; where it has none, filled columns, with ``things`` those of instances.

    Voxels as wide as cells of more than 5 cm are split, so that all are at most 5 cm wide.
    """
    if not has_voxels(simap):
        return column_points(simap, things=things)
    points, parts = simap.points(), _parts(simap)
    if parts == 1:
        return points
    shift = (np.arange(parts) - (parts - 1) / 2) * simap.spec.cell_size_m / parts
    across = np.stack([*(a.ravel() for a in np.meshgrid(shift, shift)), np.zeros(parts**2)], axis=1).astype(np.float32)
    positions = (points.positions[:, None] + across).reshape(-1, 3)
    return Points(positions, *(a.repeat(parts**2, axis=0) for a in (points.colors, points.classes, points.instances)))


def _parts(simap: SIMap) -> int:
    """Return into how many parts of at most 5 cm the side of a cell is split."""
    return max(1, int(np.ceil(simap.spec.cell_size_m / VOXEL_M - 1e-6)))


def all_instances(simap: SIMap) -> tuple[Instance, ...]:
    """Return the instances of a map and those that no cell shows."""
    return (*simap.instances, *simap.hidden)


def objects_in_space(simap: SIMap) -> dict[int, InSpace]:
    """Describe where the objects of a map are in space, by id; from their columns on a map without voxels."""
    return in_space(space_points(simap, things=True), (simap.spec.x0_m, simap.spec.y0_m))


def box_in(simap: SIMap, instance_id: int) -> Box | None:
    """Return the box of one instance of a map with voxels, without looking at the others; None where it has none."""
    if not has_voxels(simap):
        return None
    points, origin_m = space_points(simap), (simap.spec.x0_m, simap.spec.y0_m)
    mine = points.positions[points.instances == instance_id]
    return box_of(without_strays(np.unique(voxel_keys(mine, origin_m))), origin_m) if len(mine) else None


def in_space(points: Points, origin_m: tuple[float, float]) -> dict[int, InSpace]:
    """Describe where the objects of a cloud are in space, by id; voxels are those of the grid at an origin.

    Slivers (`least_sizes`) are left out.
    """
    order = np.argsort(points.instances, kind="stable")
    ids, starts = np.unique(points.instances[order], return_index=True)
    class_of = dict(zip(ids.tolist(), points.classes[order[starts]].tolist(), strict=True))
    voxels = whole_objects(voxels_by_instance(points, origin_m), class_of)
    related = relations(voxels)
    colors = dict(zip(ids.tolist(), np.split(points.colors[order], starts[1:]), strict=True)) if len(order) else {}
    made = {}
    for number, keys in voxels.items():
        box, relation = box_of(keys, origin_m), related[number]
        red, green, blue = np.median(colors[number], axis=0).astype(int).tolist()
        made[number] = InSpace(box, relation.on, relation.under, relation.inside, len(keys), (red, green, blue))
    return made
