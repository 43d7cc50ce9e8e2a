"""Draw the figures of docs/METHOD.md: a corner of the embedded scene, with light simulated errors.

`make docs` renews those of `assets/`: `python apps/method_figures.py assets`.
"""

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz import BuildConfig, SIMap, build_map, open_sequence
from simaps_viz.app.workbench import cache_folder
from simaps_viz.colors.classes import class_color
from simaps_viz.colors.instances import class_colors, instance_colors
from simaps_viz.scenes.demo import ensure_demo

BUILD = Path(__file__).parents[1] / "build"
SOUTH_WEST_M, ROWS, COLS = (0.2, 5.85), 28, 48  # chairs in a row at the counter
PIXELS = 12  # a cell's edge
SAME, DIFFERENT, GROUND = (30, 120, 60), (206, 17, 38), (235, 235, 235)


def paint(simap: SIMap, ids: NDArray, palette: NDArray) -> NDArray:
    """Enlarge the corner of a grid of ids, coloured, north up, so that cells stay crisp."""
    row, col = simap.spec.cell_of(*SOUTH_WEST_M)
    corner = palette[ids[row : row + ROWS, col : col + COLS]][::-1].astype(np.uint8)
    return cv2.resize(corner, None, fx=PIXELS, fy=PIXELS, interpolation=cv2.INTER_NEAREST)


def by_class(simap: SIMap, like: SIMap) -> NDArray:
    """Colour every cell by its class, as on another map, whether it became an instance or not."""
    known = class_colors(like) | {"none": GROUND, "floor": GROUND}
    return paint(simap, simap.grid.label, np.array([known.get(n) or class_color(n) for n in simap.grid.labels]))


def with_evidence(simap: SIMap, label: str, reach: int = 4) -> NDArray:
    """Draw the pairs of cells of a class: green where more frames saw them as one, red where as two."""
    picture = by_class(simap, simap) // 4 + 191
    graph = next(graph for graph in simap.graphs if simap.grid.labels[graph.label] == label)
    south, west = simap.spec.cell_of(*SOUTH_WEST_M)
    cells = np.stack([graph.cells % simap.spec.cols - west, south + ROWS - 1 - graph.cells // simap.spec.cols], axis=1)
    for edge in np.argsort(graph.different > graph.counts, kind="stable"):
        (u, v), (x, y) = (cells[graph.edges[edge]] * PIXELS + PIXELS // 2).tolist()
        if max(abs(u - x), abs(v - y)) <= reach * PIXELS:
            color = DIFFERENT if graph.different[edge] > graph.counts[edge] else SAME
            cv2.line(picture, (u, v), (x, y), color, 1, cv2.LINE_AA)
    return picture


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if sys.argv[1:] else BUILD
    folder.mkdir(exist_ok=True)
    sequence, config = open_sequence(ensure_demo(cache_dir=cache_folder())), BuildConfig()
    highest = build_map(sequence, replace(config, votes=replace(config.votes, enabled=False)))
    voted = build_map(sequence, config)
    colors = np.vstack([GROUND, instance_colors(voted)[1:]])
    votes, merge = (by_class(highest, voted), by_class(voted, voted)), (voted.community, voted.instance)
    pairs = {"votes": votes, "evidence": (votes[1], with_evidence(voted, "chair")),
             "merge": tuple(paint(voted, ids, colors) for ids in merge)}  # fmt: skip
    for name, (left, right) in pairs.items():
        both = np.hstack([left, np.full_like(left[:, :PIXELS], 255), right])
        sys.stdout.write(f"method-{name}.png {cv2.imwrite(str(folder / f'method-{name}.png'), both[..., ::-1])}\n")
