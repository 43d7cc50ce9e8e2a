"""Maps and truths drawn as digits, for scoring by hand: every character is a block of cells."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from simaps_viz.evaluation.truth import Truth, truth_as_map
from simaps_viz.structures import Grid, GridSpec, SIMap

LABELS = ("none", "chair", "floor", "table")
IS_THING = (False, True, False, True)


def drawn(drawing: str, *, cells: int = 4) -> NDArray:
    """Return int32 ids of a drawing, north up: digits and letters are ids (a = 10), "." is none."""
    lines = [line.strip() for line in drawing.strip().splitlines()][::-1]
    ids = np.array([[0 if c == "." else int(c, 36) for c in line] for line in lines], np.int32)
    return np.kron(ids, np.ones((cells, cells), np.int32)).astype(np.int32)


def truth_of_ids(
    ids: NDArray, classes: Mapping[int, str], *, origin_m: tuple[float, float] = (0.0, 0.0), size_m: float = 0.05
) -> Truth:
    """Make a truth of thing ids; cells without one are floor."""
    spec = GridSpec(ids.shape[0], ids.shape[1], size_m, *origin_m)
    label = np.full(ids.shape, LABELS.index("floor"), np.int16)
    for number, name in classes.items():
        label[ids == number] = LABELS.index(name)
    height = np.where(ids > 0, 0.7, 0.0).astype(np.float32)
    grid = Grid(spec, LABELS, IS_THING, label, height, height.copy(), np.ones(ids.shape, np.int32))
    return Truth(grid, ids.astype(np.int32), dict(classes), np.eye(4), "a drawing")


def map_of_ids(ids: NDArray, classes: Mapping[int, str], scores: Mapping[int, float] | None = None, **place) -> SIMap:
    """Make a map of ids; instances have score 1 unless told otherwise."""
    simap = truth_as_map(truth_of_ids(ids, classes, **place))
    scored = tuple(replace(i, score=(scores or {}).get(i.id, 1.0)) for i in simap.instances)
    return replace(simap, instances=scored, method="paper")
