"""Exact outlines of a set of cells: along the cells' edges, only corners kept, holes included."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from simaps_viz.structures import GridSpec, Instance, SIMap

Ring = list[tuple[int, int]]
"""Grid corners (col, row), not closed: the last is joined to the first."""


def outlines(mask: NDArray) -> list[list[Ring]]:
    """Return the polygons that cover exactly the cells of a mask.

    One polygon for each 4-connected patch: its outer ring counter-clockwise (x right, y up), then its holes clockwise.
    Rings are simple: patches and holes that touch at a corner only are kept apart, as OGC simple features want it.

    Args:
        mask: bool [rows, cols].
    """
    patches, count = ndimage.label(mask)  # pyright: ignore[reportGeneralTypeIssues]
    polygons = []
    for number, where in enumerate(ndimage.find_objects(patches, count), start=1):
        offset = (where[1].start, where[0].start)
        rings = [_corners(ring) for ring in _rings(np.asarray(patches)[where] == number)]
        rings.sort(key=_signed_area, reverse=True)  # the outer ring alone is positive
        polygons.append([[(x + offset[0], y + offset[1]) for x, y in ring] for ring in rings])
    return polygons


def polygons_m(simap: SIMap, instance: Instance) -> list[list[list[tuple[float, float]]]]:
    """An instance's polygons in metres of the map frame, every ring closed (the first point again at the end)."""
    (x_low, y_low, _), (x_high, y_high, _) = instance.aabb_m
    spec, half = simap.spec, simap.spec.cell_size_m / 2
    row, col = np.maximum(spec.cell_of(x_low + half, y_low + half), 1) - np.int64(1)  # a cell more, against rounding
    row_end, col_end = np.array(spec.cell_of(x_high - half, y_high - half)) + 2
    mask = simap.instance[row:row_end, col:col_end] == instance.id
    return [[_in_metres(spec, ring, int(col), int(row)) for ring in rings] for rings in outlines(mask)]


def wkt(polygons: list[list[list[tuple[float, float]]]]) -> str:
    """Write polygons as well-known text, always a MULTIPOLYGON."""
    rings = [[", ".join(f"{x:.10g} {y:.10g}" for x, y in ring) for ring in polygon] for polygon in polygons]
    return "MULTIPOLYGON (" + ", ".join("(" + ", ".join(f"({r})" for r in p) + ")" for p in rings) + ")"


def _in_metres(spec: GridSpec, ring: Ring, col: int, row: int) -> list[tuple[float, float]]:
    s = spec.cell_size_m
    points = [(round(spec.x0_m + (x + col) * s, 9), round(spec.y0_m + (y + row) * s, 9)) for x, y in ring]
    return [*points, points[0]]


def _rings(patch: NDArray) -> Iterator[Ring]:
    """Walk along the borders of one 4-connected patch, the patch on the left; a walk is cut where it meets itself."""
    leaving = _border_steps(patch)
    while leaving:
        way: Ring = [next(iter(leaving))]
        at = {way[0]: 0}
        while True:
            ends = leaving[way[-1]]
            corner = ends.pop()
            if not ends:
                del leaving[way[-1]]
            if corner not in at:
                at[corner] = len(way)
                way.append(corner)
                continue
            start = at[corner]
            yield way[start:]
            for left in way[start + 1 :]:
                del at[left]
            del way[start + 1 :]
            if start == 0 and corner not in leaving:
                break


def _border_steps(patch: NDArray) -> dict[tuple[int, int], list[tuple[int, int]]]:
    """{corner: corners one edge further}, for every cell edge with the patch on its left and none on its right."""
    padded = np.pad(patch, 1)
    sides = (  # of a cell: its neighbour there, then where the edge starts and ends
        ((-1, 0), (0, 0), (1, 0)),
        ((0, 1), (1, 0), (1, 1)),
        ((1, 0), (1, 1), (0, 1)),
        ((0, -1), (0, 1), (0, 0)),
    )
    rows, cols = patch.shape
    leaving: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for (dr, dc), (ax, ay), (bx, by) in sides:
        bare = patch & ~padded[1 + dr : 1 + dr + rows, 1 + dc : 1 + dc + cols]
        for row, col in np.argwhere(bare).tolist():
            leaving.setdefault((col + ax, row + ay), []).append((col + bx, row + by))
    return leaving


def _corners(ring: Ring) -> Ring:
    """Leave out the points at which a ring goes straight on."""
    around = zip(ring[-1:] + ring[:-1], ring, ring[1:] + ring[:1], strict=True)
    return [b for a, b, c in around if not (a[0] == b[0] == c[0] or a[1] == b[1] == c[1])]


def _signed_area(ring: Ring) -> float:
    """Shoelace formula, cells; positive when counter-clockwise."""
    return sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(ring, ring[1:] + ring[:1], strict=True)) / 2.0
