"""What `simaps evaluate` does: settings in, tables, JSON and a picture out."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.drawing.sheet import save_png
from simaps_viz.errors import InputError
from simaps_viz.evaluation.compare import Comparison, compare_maps, compare_report, render
from simaps_viz.evaluation.evaluate import ERRORS, PRECOMPUTED, Build, Report, Store, evaluate
from simaps_viz.evaluation.quality import (
    MIN_CELLS,
    CountScore,
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
from simaps_viz.evaluation.truth import exact_of
from simaps_viz.events import Progress
from simaps_viz.io.files import check_output, write_whole
from simaps_viz.structures import SIMap

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
