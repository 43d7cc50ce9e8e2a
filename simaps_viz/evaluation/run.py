"""What `simaps evaluate` does: settings in, tables, JSON and a picture out.

The picture is one PNG: the maps side by side, the same object in the same colour on all of them, what is wrong marked.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.drawing.compare_picture import rims_of
from simaps_viz.drawing.sheet import INK, PALE_INK, WORDS, Sheet, save_png, width_of
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import ERRORS, NOT_SIMULATED, PRECOMPUTED, Build, Report, Run, Store, evaluate
from simaps_viz.evaluation.quality import (
    MIN_CELLS,
    CountScore,
    Overlaps,
    Score,
    ScoringRules,
    parse_counts,
    resolve_classes,
    score_counts,
    things_of,
)
from simaps_viz.evaluation.report import (
    FORMAT,
    TextTable,
    class_table,
    cost_table,
    counts_table,
    overall_table,
    report_json,
)
from simaps_viz.evaluation.truth import Truth, exact_of, joint_window, moved_grid, partners, whole_cells
from simaps_viz.evaluation.two_maps import NO_PARTNER, PALETTE, distinct_colors, paint
from simaps_viz.events import Progress
from simaps_viz.geometry import moved
from simaps_viz.io.files import check_output, write_whole
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
    return Panel(title, subtitle, paint(grid, cells, own), cells, unjudged, nothing)


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


WRONG_RED = (206, 17, 38)
RIM = 0.5
"""Factor that darkens the rim of an instance."""
MAX_WIDTH, MAX_PANEL_WIDTH = 3200, 1000
"""Pixels; panels get as many pixels a cell as fit."""
MAX_ACROSS = 4
ROW_TITLE, SWATCH = 18, 20
BAR_WIDTH = 240
"""Room for the scale bar, left of the legend, pixels."""
_DARK = 330
"""Sum of red, green and blue below which marks are white."""
_ORDER = list(Verdict)


def panel_image(panel: Panel, scale: int) -> NDArray:
    """Paint a panel with its marks, north up.

    Args:
        panel: what to paint.
        scale: pixels along a cell's edge.

    Returns:
        uint8 [rows * scale, cols * scale, 3], RGB.
    """
    colors, ids, missed = (np.ascontiguousarray(a[::-1]) for a in (panel.colors, panel.instance, panel.missed))
    image, ids, missed = (a.repeat(scale, axis=0).repeat(scale, axis=1) for a in (colors, ids, missed))
    of_id = np.full(int(ids.max(initial=0)) + 1, -1, np.int8)
    for number, verdict in panel.verdicts.items():
        if number < len(of_id):
            of_id[number] = _ORDER.index(verdict)
    verdict = np.where(ids > 0, of_id[ids], -1)
    row, col = np.arange(ids.shape[0])[:, None], np.arange(ids.shape[1])[None]
    dot = max(2, scale // 2)
    marked = (verdict == _ORDER.index(Verdict.MERGED)) & ((row + col) % 10 < 4)
    marked |= (verdict == _ORDER.index(Verdict.PIECE)) & (row % (4 * dot) < dot) & (col % (4 * dot) < dot)
    dark = image[marked].astype(int).sum(axis=-1, keepdims=True) < _DARK
    image[marked] = np.where(dark, 255, INK)
    rim = rims_of(ids)
    image[rim] = (image[rim] * RIM).astype(np.uint8)
    wrong = np.isin(verdict, [_ORDER.index(Verdict.MERGED), _ORDER.index(Verdict.WRONG)])
    image[_outline(wrong, scale)] = WRONG_RED
    image[_outline(missed, scale) & ((row + col) % 12 < 7)] = WRONG_RED
    return image


def render(comparison: Comparison) -> NDArray:
    """Lay out the complete picture: the reference, the rows of panels, the legend. uint8 [H, W, 3], RGB."""
    rows, cols = comparison.spec.shape
    across, lines = _layout(comparison)

    # A large picture is shown small: words and distances grow with it.
    scale = int(np.clip(min(MAX_PANEL_WIDTH // cols, MAX_WIDTH // (across * cols)), 2, 8))
    growth = float(np.clip(across * cols * scale / 1700, 1.0, 1.8))
    sheet = Sheet(0, 0, growth)
    gap = sheet.px(24)
    row_title, head = sheet.px(ROW_TITLE + 12), sheet.panel_head(subtitle=True)
    wide = max(cols * scale, *(width_of(panel.subtitle, sheet.px(WORDS)) for panel in comparison.panels))
    heights = [(row_title if title else 0) + head + rows * scale + gap for title, _ in lines]
    width = (across + 1) * gap + across * wide
    legend = _legend_places(comparison.has_truth, sheet, width)
    sheet.begin(width, 2 * gap + sum(heights) + sheet.px(28) + max(y for _, y in legend))

    y = gap
    for (title, panels), height in zip(lines, heights, strict=True):
        sheet.text(title, (gap, y + sheet.px(ROW_TITLE / 2)), ROW_TITLE, PALE_INK)
        top = y + (row_title if title else 0)
        for at, panel in enumerate(panels):
            if panel is not None:
                place = (gap + at * (wide + gap), top)
                sheet.panel(panel_image(panel, scale), place, panel.title, panel.subtitle)
        y += height
    y += sheet.px(12)
    sheet.scale_bar((gap, y), scale / comparison.spec.cell_size_m)
    for (sample, words), (x, down) in zip(_legend_entries(comparison.has_truth), legend, strict=True):
        sheet.swatch(panel_image(sample, 2), words, (x, y + down), SWATCH)
    return sheet.pixels


def _layout(comparison: Comparison) -> tuple[int, list[tuple[str, list[Panel | None]]]]:
    """Return panels across, and lines of (title, panels); the reference starts every row."""
    rows = comparison.rows or (("", ()),)
    longest = 1 + max(len(panels) for _, panels in rows)
    across = longest if longest <= MAX_ACROSS else -(-longest // -(-longest // MAX_ACROSS))
    lines: list[tuple[str, list[Panel | None]]] = []
    for title, panels in rows:
        shown: list[Panel | None] = [comparison.reference, *panels]
        shown += [None] * (-len(shown) % across)
        for start in range(0, len(shown), across):
            lines.append((title if start == 0 else "", shown[start : start + across]))
    return across, lines


def _outline(mask: NDArray, scale: int) -> NDArray:
    """Bool: a thick line along the inside of a mask's outer borders; holes of a few cells get none."""
    reach = 3 * scale
    pad = 2 * reach + 2  # so that the picture's edge is a border like any other
    padded = np.pad(mask, pad).astype(np.uint8)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    size = 2 * max(2, scale // 2) + 1
    inside = cv2.erode(closed, np.ones((size, size), np.uint8))
    return (closed > inside)[pad:-pad, pad:-pad]


def _legend_places(has_truth: bool, sheet: Sheet, width: int) -> list[tuple[int, int]]:
    """Return where the legend's entries are, pixels from the left and down from the first line, wrapped at a width."""
    left = sheet.px(BAR_WIDTH)
    places, x, down = [], left, 0
    for _, words in _legend_entries(has_truth):
        length = sheet.px(SWATCH + 34) + width_of(words, sheet.px(WORDS))
        if x > left and x + length > width - sheet.px(24):
            x, down = left, down + sheet.px(32)
        places.append((x, down))
        x += length
    return places


def _legend_entries(has_truth: bool) -> list[tuple[Panel, str]]:
    plain, other = PALETTE[1], NO_PARTNER
    if not has_truth:
        return [
            (_sample(plain), "same colour: same object, by overlap with the first map"),
            (_sample(other), "nothing there on the first map"),
        ]
    return [
        (_sample(plain), "colour of the true object it overlaps most"),
        (_sample(plain, Verdict.MERGED), "merges several true objects"),
        (_sample(plain, Verdict.PIECE), "only a piece of one"),
        (_sample(plain, Verdict.WRONG), "matches none"),
        (_sample(other, Verdict.WRONG), "lies on none"),
        (_sample(LIGHT.floor, missed=True), "true object missed"),
    ]


def _sample(color: Color, verdict: Verdict = Verdict.UNJUDGED, *, missed: bool = False) -> Panel:
    """Make a panel of one instance that fills it."""
    cells = np.full((11, 11), 0 if missed else 1, np.int32)
    colors = np.full((*cells.shape, 3), color, np.uint8)
    return Panel("", "", colors, cells, {1: verdict}, np.full(cells.shape, missed))


DEMO = "demo"
"""In place of a sequence: the embedded café; ``demo:home`` is another embedded place."""


@dataclass(frozen=True)
class EvaluationConfig:
    """Settings of an evaluation."""

    sequence: str
    """Folder or manifest of a sequence, or "demo" or "demo:PLACE"."""
    methods: str = "paper"
    """Methods, separated by commas."""
    errors: str = ""
    """Masks to build from, separated by commas: none (exact), light, medium, heavy, detector (simulated errors),
    precomputed (the sequence's). By default precomputed if the sequence's masks are not exact, else light."""
    seeds: int = 1
    """How many seeds of the simulated errors."""
    counts: str = ""
    """Numbers counted by eye, such as "chair=11,table=2"; judged on maps of the sequence's own masks."""
    truth: Path | None = None
    """Manifest with exact ids, if they are not the sequence's or its folder's sequence.json."""
    picture: Path | None = None
    """Write the maps side by side here (.png)."""
    output: Path | None = None
    """Write everything measured here (.json)."""
    min_count_cells: int = MIN_CELLS
    """Do not count instances of fewer cells."""
    rules: ScoringRules = field(default_factory=ScoringRules)
    """What counts in the scores."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Result of an evaluation."""

    name: str
    report: Report | None
    """Scores against the truth; None when there is none."""
    counts: Mapping[str, tuple[CountScore, ...]]
    """{method: counts}; empty when none were given."""
    comparison: Comparison
    min_count_cells: int

    def tables(self) -> list[TextTable]:
        """Return what a person reads, in this order."""
        tables = []
        if self.report:
            tables += [class_table(self.report), overall_table(self.report), cost_table(self.report)]
        if self.counts:
            tables.append(counts_table(self.counts, min_cells=self.min_count_cells))
        return tables

    def to_json(self) -> dict[str, Any]:
        """Return everything: the keys of `report_json`, and ``counts``.

        That is {method: [{label, expected, found, difference}]}; ``rows`` is empty when there is no truth.
        """
        head = report_json(self.report) if self.report else {"format": FORMAT, "name": self.name, "rows": []}
        return {**head, "counts": {method: [c.to_json() for c in counts] for method, counts in self.counts.items()}}


def run_evaluation(
    config: EvaluationConfig, build: Build, *, store: Store | None = None, progress: Progress | None = None
) -> Evaluation:
    """Evaluate as configured, and write the files asked for.

    Args:
        config: what to evaluate.
        build: builds a map of a sequence by the method of a name; called with methods of ``config`` only.
        store: what a method keeps beside its map.
        progress: notified of every step.

    Raises:
        InputError: anything asked for is not possible; nothing is left half-written.
    """
    methods, errors = split_names("methods", config.methods), split_names("errors", config.errors, ERRORS)
    if not methods or config.seeds < 1:
        found = f"{len(methods)} methods and {config.seeds} seeds"
        raise InputError(f"evaluate: expected at least one method and one seed, found {found}")
    expected = parse_counts(config.counts) if config.counts else {}
    for path, ending in ((config.picture, ".png"), (config.output, "")):  # before anything is computed
        if path is not None:
            check_output(path, ending)
    sequence = open_for_evaluation(config.sequence, progress)
    meant = resolve_classes(things_of(sequence), expected)
    report, maps, counts = None, [], {}
    if errors or config.truth is not None or not expected or exact_of(sequence) is not None:
        default = ("light",) if sequence.ground_truth else (PRECOMPUTED,)
        report = evaluate(
            sequence, methods, errors=errors or default, seeds=range(config.seeds), build=build,
            truth=config.truth, rules=config.rules, store=store, progress=progress,
        )  # fmt: skip
    if expected:
        counts, maps = _count(sequence, methods, build, expected, config, progress)
    if report is not None:
        comparison = compare_report(report)
    else:
        classes = {label for labels in meant.values() for label in labels}
        comparison = compare_maps(
            sequence.name, maps, keep=lambda i: i.label in classes and i.cells >= config.min_count_cells
        )
    result = Evaluation(sequence.name, report, counts, comparison, config.min_count_cells)
    if config.output is not None:
        write_json(result.to_json(), config.output)
    if config.picture is not None:
        save_png(render(comparison), config.picture)
    return result


def split_names(what: str, text: str, known: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Read names separated by commas; raises InputError when one is not known or comes twice."""
    names = tuple(name.strip() for name in text.split(",") if name.strip())
    if len(set(names)) != len(names):
        raise InputError(f"{what}: expected each once, found {text}")
    unknown = [name for name in names if known and name not in known]
    if unknown:
        raise InputError(f"{what}: expected some of {', '.join(known)}, found {', '.join(unknown)}")
    return names


def write_json(record: Mapping[str, Any], path: Path) -> None:
    """Write a JSON file atomically; raises InputError when it cannot be written."""
    check_output(path)
    write_whole(path, (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode(), "the report")


def open_for_evaluation(sequence: str, progress: Progress | None) -> PosedFrames:
    """Open a sequence by its path, or an embedded place with its exact masks as "demo" or "demo:PLACE"."""
    if not is_demo(sequence):
        return open_sequence(Path(sequence))
    from simaps_viz.scenes.demo import ensure_demo  # noqa: PLC0415 - the ray caster is only needed here

    place = sequence.removeprefix(DEMO).removeprefix(":") or "cafe"
    return open_sequence(ensure_demo(place=place, level="none", progress=progress))


def is_demo(sequence: str) -> bool:
    """Return whether this names an embedded place instead of a path."""
    return sequence == DEMO or sequence.startswith(f"{DEMO}:")


def _count(
    sequence: PosedFrames,
    methods: tuple[str, ...],
    build: Build,
    expected: Mapping[str, int],
    config: EvaluationConfig,
    progress: Progress | None,
) -> tuple[dict[str, tuple[CountScore, ...]], list[tuple[str, str, SIMap]]]:
    """Build a map of the sequence's own masks by every method, and count on it."""
    counts, shown = {}, []
    for done, method in enumerate(methods):
        if progress:
            progress("building maps to count on", done, len(methods))
        simap = build(sequence, method)
        counts[method] = score_counts(simap, expected, min_cells=config.min_count_cells)
        words = ", ".join(f"{c.label} {c.found} ({c.expected} by eye)" for c in counts[method])
        shown.append((method, words, simap))
    if progress:
        progress("building maps to count on", len(methods), len(methods))
    return counts, shown
