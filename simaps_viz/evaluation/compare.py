"""Maps side by side: the same object has the same colour on all of them, and every instance a verdict.

Plain data: whoever shows it (a picture, the workbench, a recording) needs nothing else.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.errors import InputError
from simaps_viz.evaluation.coloring import distinct_colors, paint, partners
from simaps_viz.evaluation.evaluate import NOT_SIMULATED, Report, Run
from simaps_viz.evaluation.quality import Overlaps, Score
from simaps_viz.evaluation.truth import Truth, joint_window, moved_grid, whole_cells
from simaps_viz.geometry import moved
from simaps_viz.structures import Grid, GridSpec, Instance, SIMap


class Verdict(Enum):
    """Verdict on a found instance."""

    RIGHT = "right"
    """Matches a true one."""
    MERGED = "merged"
    """Covers two or more true ones of its class."""
    PIECE = "piece"
    """Matches none, but most of it lies on one true one of its class."""
    WRONG = "wrong"
    """None of these: another class, spilled over, or nothing is there."""
    UNJUDGED = "unjudged"
    """Too small to count, on a true one too small to count, or there is no truth."""


@dataclass(frozen=True, eq=False)
class Panel:
    """One map of a comparison, on the window all of them share."""

    title: str
    subtitle: str
    colors: NDArray
    """uint8 [rows, cols, 3], RGB, row 0 at the south; without marks."""
    instance: NDArray
    """int32 [rows, cols], ids of this map, 0 = none."""
    verdicts: Mapping[int, Verdict]
    """{id: verdict}."""
    partner: Mapping[int, int]
    """{id: id, on the reference panel, of what it overlaps most}; whom it overlaps not at all is missing."""
    missed: NDArray
    """bool [rows, cols]: cells of true instances that no found one covers."""
    score: Score | None = None


@dataclass(frozen=True, eq=False)
class Comparison:
    """Panels in rows. The first panel of all is the reference: the truth, or the first method if there is none."""

    name: str
    spec: GridSpec
    reference: Panel
    rows: tuple[tuple[str, tuple[Panel, ...]], ...]
    """(what the row's masks are, its panels without the reference)."""
    has_truth: bool

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, the reference first, row by row."""
        return (self.reference, *(panel for _, row in self.rows for panel in row))


def compare_report(report: Report) -> Comparison:
    """Lay out the first seed of every method, a row for each kind of errors, all on one window.

    Raises:
        InputError: the maps' cells do not coincide.
    """
    truth = next(iter(report.maps.values()))[1]
    window = _window([truth.spec, *(simap.spec for simap, _ in report.maps.values())])
    truth = truth.on(window)
    colors = distinct_colors(truth.instance)
    rows = []
    for errors in report.errors:
        runs = [report.of(errors, method)[0] for method in report.methods]
        panels = tuple(_judged(run, report.maps[errors, run.method][0], truth, colors) for run in runs)
        rows.append((_row_words(errors, runs[0].seed), panels))
    asked = report.runs[0].scores.overall.true
    words = f"{asked} things of at least {report.rules.min_true_cells} cells"
    reference = _panel("truth", words, truth.grid, truth.instance, colors)
    return Comparison(report.name, window, reference, tuple(rows), has_truth=True)


def compare_maps(
    name: str, maps: Sequence[tuple[str, str, SIMap]], *, keep: Callable[[Instance], bool] | None = None
) -> Comparison:
    """Lay out maps without truth; all take their colours from the first.

    Args:
        name: of the sequence.
        maps: (title, subtitle, map), at least one.
        keep: which instances to show; the others are as if nobody had named them. By default all.

    Raises:
        InputError: there is none, or the maps' cells do not coincide.
    """
    if not maps:
        raise InputError("comparison: expected at least one map, found none")
    window = _window([simap.spec for _, _, simap in maps])
    (title, subtitle, first), *others = maps
    grid, cells = _on(first, window, keep)
    colors = distinct_colors(cells)
    reference = _panel(title, subtitle, grid, cells, colors)
    panels = []
    for title, subtitle, simap in others:
        grid, own = _on(simap, window, keep)
        panels.append(_panel(title, subtitle, grid, own, colors, partners(own, cells)))
    return Comparison(name, window, reference, (("", tuple(panels)),) if panels else (), has_truth=False)


def verdicts(overlaps: Overlaps) -> dict[int, Verdict]:
    """Assign a verdict to every found instance."""
    found, pairs = overlaps.found, overlaps.pairs
    right = np.isin(np.arange(len(found.ids)), pairs[overlaps.matched, 1])
    inside = overlaps.same_class & (pairs[:, 2] > 0.5 * found.cells[pairs[:, 1]])
    piece = np.isin(np.arange(len(found.ids)), pairs[inside, 1])
    result = {}
    for at, number in enumerate(found.ids.tolist()):
        if not found.counts[at]:
            result[number] = Verdict.UNJUDGED
        elif overlaps.merged[at]:
            result[number] = Verdict.MERGED
        elif right[at]:
            result[number] = Verdict.RIGHT
        else:
            result[number] = Verdict.PIECE if piece[at] else Verdict.WRONG
    return result


def missed_ids(overlaps: Overlaps) -> list[int]:
    """Return the true instances asked for of which found ones of their class, all together, cover no notable share."""
    true, kept = overlaps.true, overlaps.same_class
    covered = np.bincount(overlaps.pairs[kept, 0], weights=overlaps.pairs[kept, 2], minlength=len(true.ids))
    return true.ids[true.counts & (covered < overlaps.rules.notable_share * true.cells)].tolist()


def _judged(run: Run, simap: SIMap, truth: Truth, colors: Mapping[int, Color]) -> Panel:
    score, overlaps = run.scores.overall, run.scores.overlaps
    grid, cells = _on(simap, truth.spec)
    pq = "none" if score.pq is None else f"{score.pq:.2f}"
    words = (
        f"{score.matched} of {score.true} found, {score.found - score.matched} wrong or in pieces; "
        f"{score.over} split, {score.under} merged"
    )
    plain = _panel(f"{run.method}   PQ {pq}", words, grid, cells, colors, partners(cells, truth.instance))
    missed = np.isin(truth.instance, missed_ids(overlaps))
    return replace(plain, verdicts=verdicts(overlaps), missed=missed, score=score)


def _panel(
    title: str,
    subtitle: str,
    grid: Grid,
    cells: NDArray,
    colors: Mapping[int, Color],
    partner: Mapping[int, int] | None = None,
) -> Panel:
    """Make a panel without verdicts; without partners it is the reference itself."""
    ids = np.unique(cells[cells > 0]).tolist()
    partner = {i: i for i in ids} if partner is None else dict(partner)
    own = {i: colors[partner[i]] for i in ids if i in partner}
    unjudged = dict.fromkeys(ids, Verdict.UNJUDGED)
    nothing = np.zeros(cells.shape, dtype=bool)
    return Panel(title, subtitle, paint(grid, cells, own), cells, unjudged, partner, nothing)


def _window(specs: Sequence[GridSpec]) -> GridSpec:
    window = specs[0]
    for spec in specs[1:]:
        window = joint_window(window, spec)
    return window


def _on(simap: SIMap, window: GridSpec, keep: Callable[[Instance], bool] | None = None) -> tuple[Grid, NDArray]:
    """Move a map's grid and the instances to show to another window."""
    cells = simap.instance
    if keep is not None:
        cells = np.where(np.isin(cells, [i.id for i in simap.instances if keep(i)]), cells, 0).astype(np.int32)
    return moved_grid(simap.grid, window), moved(cells, whole_cells(simap.spec, window), window.shape, 0)


def _row_words(errors: str, seed: int) -> str:
    if errors in NOT_SIMULATED:
        return {"none": "exact masks"}.get(errors, "masks of the sequence")
    return f"simulated network errors: {errors}, seed {seed}"
