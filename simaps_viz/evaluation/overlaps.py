"""Which found instance lies on which true one, cell by cell; every score follows from this table."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.evaluation.truth import Truth, check_same_frame
from simaps_viz.evaluation.windows import joint_window, moved, whole_cells
from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class ScoringRules:
    """What counts."""

    min_true_cells: int = 20
    """A true instance that tops fewer cells is not asked for."""
    min_found_cells: int = 8
    """A found instance of fewer cells is ignored."""
    notable_share: float = 0.25
    """Share of a true instance's cells from which a found one is said to cover it (for splits and mergers)."""

    def __post_init__(self) -> None:
        for name, value in (("true", self.min_true_cells), ("found", self.min_found_cells)):
            if value < 1:
                raise InputError(f"smallest {name} instance: expected at least 1 cell, found {value}")
        if not 0.0 < self.notable_share <= 0.5:
            raise InputError(f"notable share: expected above 0, at most 0.5, found {self.notable_share:g}")


@dataclass(frozen=True, eq=False)
class Objects:
    """One side of the comparison. All arrays are aligned and sorted by id."""

    ids: NDArray
    """int64 [n], > 0."""
    cells: NDArray
    """int64 [n]."""
    label: NDArray
    """int64 [n], index into the names both sides share; the class of most of its cells."""
    counts: NDArray
    """bool [n]: takes part in the scores."""


@dataclass(frozen=True, eq=False)
class Overlaps:
    """True and found instances, and the cells they share."""

    labels: tuple[str, ...]
    """Class names of both sides; index 0 is "none"."""
    true: Objects
    found: Objects
    pairs: NDArray
    """int64 [p, 3]: position in ``true``, position in ``found``, cells they share (> 0)."""
    iou: NDArray
    """float64 [p]: shared cells / cells of either."""
    right_cells: NDArray
    """int64 [labels]: cells on which truth and map name this thing class."""
    either_cells: NDArray
    """int64 [labels]: cells on which truth or map name it."""
    either_thing_cells: int
    """Cells on which truth or map name any thing class."""
    rules: ScoringRules

    @property
    def same_class(self) -> NDArray:
        """Bool [p]: both sides count and have the same class."""
        true, found = self.pairs[:, 0], self.pairs[:, 1]
        both = self.true.counts[true] & self.found.counts[found]
        return both & (self.true.label[true] == self.found.label[found])

    @property
    def matched(self) -> NDArray:
        """Bool [p]: same class, IoU above 0.5. Such a pair is the only one of both its members."""
        return self.same_class & (self.iou > 0.5)

    @property
    def covering(self) -> NDArray:
        """Bool [p]: same class, and the found one has a notable share of the true one's cells."""
        shared, size = self.pairs[:, 2], self.true.cells[self.pairs[:, 0]]
        return self.same_class & (shared >= self.rules.notable_share * size)

    @property
    def split(self) -> NDArray:
        """Bool [true]: covered by two or more found ones."""
        return np.bincount(self.pairs[self.covering, 0], minlength=len(self.true.ids)) >= 2

    @property
    def merged(self) -> NDArray:
        """Bool [found]: covers two or more true ones."""
        return np.bincount(self.pairs[self.covering, 1], minlength=len(self.found.ids)) >= 2


def find_overlaps(simap: SIMap, truth: Truth, rules: ScoringRules | None = None) -> Overlaps:
    """Lay a map on its truth. Windows may differ; every cell of either counts.

    Raises:
        InputError: they lie in different map frames, or their cells do not coincide.
    """
    rules = rules or ScoringRules()
    check_same_frame(simap, truth)
    labels, map_index, truth_index, is_thing = _shared_names(simap, truth)
    window = joint_window(simap.spec, truth.spec)

    def flat(cells: NDArray, spec_of: SIMap | Truth) -> NDArray:
        return moved(cells, whole_cells(spec_of.spec, window), window.shape, 0).reshape(-1)

    found_id, true_id = flat(simap.instance, simap), flat(truth.instance, truth)
    found_label, true_label = map_index[flat(simap.grid.label, simap)], truth_index[flat(truth.label, truth)]
    true, true_at = _objects(true_id, true_label, len(labels))
    found, found_at = _objects(found_id, found_label, len(labels))
    both = (true_at >= 0) & (found_at >= 0)
    key, shared = np.unique(true_at[both] * max(len(found.ids), 1) + found_at[both], return_counts=True)
    pairs = np.stack([*np.divmod(key, max(len(found.ids), 1)), shared], axis=1).astype(np.int64)
    either = true.cells[pairs[:, 0]] + found.cells[pairs[:, 1]] - pairs[:, 2]
    things = is_thing[true_label] | is_thing[found_label]
    return Overlaps(
        labels=labels,
        true=_counting(true, true.cells >= rules.min_true_cells),
        found=_counting(found, _found_counts(true, found, pairs, rules)),
        pairs=pairs,
        iou=pairs[:, 2] / np.maximum(either, 1),
        right_cells=np.bincount(true_label[things & (true_label == found_label)], minlength=len(labels)),
        either_cells=np.bincount(true_label[things], minlength=len(labels))
        + np.bincount(found_label[things & (true_label != found_label)], minlength=len(labels)),
        either_thing_cells=int(things.sum()),
        rules=rules,
    )


def _shared_names(simap: SIMap, truth: Truth) -> tuple[tuple[str, ...], NDArray, NDArray, NDArray]:
    """Number the classes of both sides together: names, map index -> shared, truth index -> shared, is it a thing."""
    labels = tuple(dict.fromkeys((*truth.labels, *simap.grid.labels)))
    index_of = {name: i for i, name in enumerate(labels)}

    def table(names: Sequence[str]) -> NDArray:
        return np.array([index_of[name] for name in names], dtype=np.int64)

    is_thing = np.zeros(len(labels), dtype=bool)
    is_thing[table(simap.grid.labels)] = simap.grid.is_thing
    is_thing[table(truth.labels)] = truth.grid.is_thing
    return labels, table(simap.grid.labels), table(truth.labels), is_thing


def _objects(instance: NDArray, label: NDArray, labels: int) -> tuple[Objects, NDArray]:
    """Measure the instances of one side; also int64 [cells]: the position of each cell's instance, -1 = none."""
    size = np.bincount(instance)
    ids = np.flatnonzero(size[1:]) + 1
    position = np.full(len(size), -1, dtype=np.int64)
    position[ids] = np.arange(len(ids))
    at = position[instance]
    votes = np.bincount(at[at >= 0] * labels + label[at >= 0], minlength=len(ids) * labels).reshape(len(ids), labels)
    most = votes.argmax(axis=1) if len(ids) else np.zeros(0, dtype=np.int64)
    return Objects(ids, size[ids], most, np.zeros(len(ids), dtype=bool)), at


def _found_counts(true: Objects, found: Objects, pairs: NDArray, rules: ScoringRules) -> NDArray:
    """Bool [found]: large enough, and not mostly on true instances of its class too small to be asked for."""
    small = (true.cells < rules.min_true_cells)[pairs[:, 0]]
    small &= true.label[pairs[:, 0]] == found.label[pairs[:, 1]]
    on_small = np.bincount(pairs[small, 1], weights=pairs[small, 2], minlength=len(found.ids))
    return (found.cells >= rules.min_found_cells) & (on_small <= 0.5 * found.cells)


def _counting(objects: Objects, counts: NDArray) -> Objects:
    return Objects(objects.ids, objects.cells, objects.label, counts)
