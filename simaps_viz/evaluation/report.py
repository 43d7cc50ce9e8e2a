"""Reports as tables of text and as JSON."""

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from simaps_viz.evaluation.evaluate import NOT_SIMULATED, Report, Run
from simaps_viz.evaluation.quality import CountScore, Score

FORMAT = "simaps-evaluation/1"
MIB = 2.0**20


@dataclass(frozen=True)
class Measured:
    """A number over several seeds."""

    mean: float | None
    """None where no seed gave a number."""
    spread: float
    """Sample standard deviation; 0 for one seed."""

    @classmethod
    def over(cls, values: Sequence[float | None]) -> "Measured":
        """Sum up; seeds without a number are left out."""
        known = [v for v in values if v is not None]
        if not known:
            return cls(None, 0.0)
        return cls(statistics.fmean(known), statistics.stdev(known) if len(known) > 1 else 0.0)

    def text(self, digits: int) -> str:
        """Show it, with its spread if there is any; "none" where there is no number."""
        if self.mean is None:
            return "none"
        spread = f" ±{self.spread:.{digits}f}" if self.spread > 0 else ""
        return f"{self.mean:.{digits}f}{spread}"


@dataclass(frozen=True)
class TextTable:
    """A table to print."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int = 1
    """Columns from the left that hold words; the others hold numbers and stand right."""
    note: str = ""

    def text(self) -> str:
        """Lay it out for a terminal or a file."""
        lines = [self.columns, *self.rows]
        width = [max(len(line[i]) for line in lines) for i in range(len(self.columns))]

        def line(cells: Sequence[str]) -> str:
            aligned = [
                c.ljust(w) if i < self.words else c.rjust(w) for i, (c, w) in enumerate(zip(cells, width, strict=True))
            ]
            return "  ".join(aligned).rstrip()

        rule = "  ".join("-" * w for w in width)
        body = [self.title, line(self.columns), rule, *(line(row) for row in self.rows)]
        return "\n".join([*body, self.note] if self.note else body) + "\n"


_SCORES: tuple[tuple[str, int, Callable[[Score], float | None]], ...] = (
    ("PQ", 3, lambda s: s.pq),
    ("SQ", 3, lambda s: s.sq),
    ("RQ", 3, lambda s: s.rq),
    ("AP50", 3, lambda s: s.ap50),
    ("true", 0, lambda s: s.true),
    ("found", 1, lambda s: s.found),
    ("matched", 1, lambda s: s.matched),
    ("over", 1, lambda s: s.over),
    ("under", 1, lambda s: s.under),
    ("label acc", 3, lambda s: s.label_accuracy),
)
"""Column, digits behind the point, and what it shows."""

LEGEND = (
    "PQ panoptic quality = SQ segmentation quality x RQ recognition quality, over all instances; AP50 average\n"
    "precision at IoU 0.5, mean of the classes; over: true instances split; under: found instances merged; label acc:\n"
    "share of the cells of things with the right class. Mean ± standard deviation over seeds."
)
COST_LEGEND = (
    "In memory: label and instance arrays, and what else the method must hold. On disk: the map file, and the same.\n"
    "Build time includes reading frames, not simulating errors; it is a comparison within this run only."
)


def overall_table(report: Report, *, first: str = "method", versus: str | None = None) -> TextTable:
    """Lay out how good the maps are: one row for each errors and method.

    Args:
        report: what was measured.
        first: what the names in the first column are.
        versus: a method; adds the difference of PQ to its.
    """
    columns = ("errors", first, *(name for name, _, _ in _SCORES), *([f"PQ - {versus}"] if versus else []))
    rows = []
    for errors in report.errors:
        base = _measure(report.of(errors, versus), lambda s: s.pq).mean if versus else None
        for method in report.methods:
            scores = [run.scores.overall for run in report.of(errors, method)]
            row = [errors, method, *_score_cells(scores)]
            if versus:
                own = _measure(report.of(errors, method), lambda s: s.pq).mean
                row.append("none" if own is None or base is None else f"{own - base:+.3f}")
            rows.append(tuple(row))
    return TextTable(_title(report), columns, tuple(rows), words=2, note=LEGEND)


def cost_table(report: Report) -> TextTable:
    """Lay out what the maps cost: one row for each errors and method."""
    columns = ("errors", "method", "MiB in memory", "MiB on disk", "build s", "x fastest")
    rows = []
    for errors in report.errors:
        for method in report.methods:
            runs = report.of(errors, method)
            weights = [Measured.over([w / MIB for w in ws]).text(2) for ws in _weights(runs)]
            ratio = _times_fastest(report, errors, method)
            rows.append((errors, method, *weights, _seconds(runs).text(2), "none" if ratio is None else f"{ratio:.2f}"))
    return TextTable(f"{report.name}: cost", columns, tuple(rows), words=2, note=COST_LEGEND)


def ablation_table(report: Report) -> TextTable:
    """Lay out a report over variants; the last column is the difference to the first one's PQ."""
    return overall_table(report, first="variant", versus=report.methods[0])


def class_table(report: Report) -> TextTable:
    """Lay out one row for each errors, class and method; below them what was found of classes that are not there."""
    columns = ("errors", "class", "method", *(name for name, _, _ in _SCORES))
    rows = []
    for errors in report.errors:
        runs = [run for method in report.methods for run in report.of(errors, method)]
        for label in sorted({label for run in runs for label in run.scores.by_class}):
            for method in report.methods:
                runs = report.of(errors, method)
                found = [run.scores.by_class[label] for run in runs if label in run.scores.by_class]
                rows.append((errors, label, method, *_score_cells(found)))
        for label, method, found in _invented(report, errors):
            shown = {"true": "0", "found": found.text(1 if found.spread else 0)}
            rows.append((errors, label, method, *(shown.get(name, "") for name, _, _ in _SCORES)))
    return TextTable(f"{report.name}: class by class", columns, tuple(rows), words=3)


def counts_table(counts: Mapping[str, tuple[CountScore, ...]], *, min_cells: int) -> TextTable:
    """Lay out counts: one row for each class, one pair of columns for each method."""
    methods = list(counts)
    columns = ["class", "by eye"]
    for method in methods:
        columns += [method, "+/-"]
    rows = []
    for at, one in enumerate(counts[methods[0]] if methods else ()):
        row = [one.label, str(one.expected)]
        for method in methods:
            row += [str(counts[method][at].found), f"{counts[method][at].difference:+d}"]
        rows.append(tuple(row))
    note = f"Instances of at least {min_cells} cells; +/-: more or fewer than counted by eye."
    return TextTable("Instances of each class", tuple(columns), tuple(rows), note=note)


def report_json(report: Report) -> dict[str, Any]:
    """Return the report as JSON.

    Keys: ``format``; ``name``, ``sequence``, ``truth`` (who made it), ``simulated`` (the frames are); ``rules``;
    ``rows``, one for each errors and method: ``method``, ``errors``, ``simulated_errors``, ``seeds``, ``mean`` and
    ``std`` over the seeds of pq, sq, rq, ap50, true, found, matched, over, under, label_accuracy, seconds,
    times_fastest (mean only), ram_bytes, disk_bytes; and ``runs``, one for each seed with ``seed``, ``overall``,
    ``by_class`` {class: the same scores}, ``invented`` {class: found instances of a class that is not there},
    ``seconds``, ``ram_bytes``, ``disk_bytes``. A score is null where there is nothing to judge.
    """
    return {
        "format": FORMAT,
        "name": report.name,
        "sequence": str(report.path),
        "truth": report.truth_source,
        "simulated": report.simulated,
        "rules": asdict(report.rules),
        "rows": [_row_json(report, e, m) for e in report.errors for m in report.methods],
    }


def _row_json(report: Report, errors: str, method: str) -> dict[str, Any]:
    runs = report.of(errors, method)
    names = ("pq", "sq", "rq", "ap50", "true", "found", "matched", "over", "under", "label_accuracy")
    measured = {name: _measure(runs, lambda s, name=name: getattr(s, name)) for name in names}
    measured["seconds"] = _seconds(runs)
    measured["ram_bytes"], measured["disk_bytes"] = (Measured.over(weights) for weights in _weights(runs))
    mean = {name: m.mean for name, m in measured.items()}
    mean["times_fastest"] = _times_fastest(report, errors, method)
    return {
        "method": method,
        "errors": errors,
        "simulated_errors": errors not in NOT_SIMULATED,
        "seeds": [run.seed for run in runs],
        "mean": mean,
        "std": {name: m.spread for name, m in measured.items()},
        "runs": [
            {"seed": run.seed, **run.scores.to_json(), "seconds": run.seconds, **asdict(run.footprint)} for run in runs
        ],
    }


def _title(report: Report) -> str:
    simulated = [e for e in report.errors if e not in NOT_SIMULATED]
    kind = "simulated frames, " if report.simulated else ""
    words = (
        f"{report.name}: {kind}{report.runs[0].scores.overall.true} true instances (exact ids by {report.truth_source})"
    )
    return words + (f"; simulated network errors: {', '.join(simulated)}" if simulated else "")


def _score_cells(scores: Sequence[Score]) -> list[str]:
    cells = []
    for _, digits, take in _SCORES:
        measured = Measured.over([take(s) for s in scores])
        whole = digits < 3 and measured.spread == 0
        cells.append(measured.text(0 if whole else digits))
    return cells


def _measure(runs: Sequence[Run], take: Callable[[Score], float | None]) -> Measured:
    return Measured.over([take(run.scores.overall) for run in runs])


def _seconds(runs: Sequence[Run]) -> Measured:
    return Measured.over([run.seconds for run in runs])


def _weights(runs: Sequence[Run]) -> tuple[list[float], list[float]]:
    """Bytes in memory and bytes on disk, by seed."""
    return [float(r.footprint.ram_bytes) for r in runs], [float(r.footprint.disk_bytes) for r in runs]


def _times_fastest(report: Report, errors: str, method: str) -> float | None:
    """Mean build time as a multiple of that of the fastest method on the same masks."""
    means = {m: _seconds(report.of(errors, m)).mean or 0.0 for m in report.methods}
    quickest = min(means.values())
    return means[method] / quickest if quickest else None


def _invented(report: Report, errors: str) -> list[tuple[str, str, Measured]]:
    """(class, method, found) of classes without a true instance large enough."""
    found = []
    for method in report.methods:
        runs = report.of(errors, method)
        for label in {label for run in runs for label in run.scores.invented}:
            found.append((label, method, Measured.over([run.scores.invented.get(label, 0) for run in runs])))
    return sorted(found, key=lambda row: (row[0], report.methods.index(row[1])))
