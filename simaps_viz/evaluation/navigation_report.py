"""The success table as text and as JSON, and what the paper says beside it."""

from collections.abc import Sequence
from typing import Any, Final

from simaps_viz.evaluation.driving import FORWARD_M
from simaps_viz.evaluation.navigation import TRUE_MAP, NavigationReport, NavigationRun
from simaps_viz.evaluation.report import TextTable
from simaps_viz.evaluation.scoring import SUCCESS_M
from simaps_viz.evaluation.world import TOLERANCE_M

FORMAT: Final = "simaps-navigation/1"
LEGEND: Final = (
    f"Each cell: automatic / strict, shares of the commands. Automatic: stopped within {SUCCESS_M:g} m of every goal,\n"
    "in order (VLMaps' rule), or refused what is not there. Strict: also at the very object that is meant, on the\n"
    f"right side of it, without a collision. A run ends where the robot collides; {TOLERANCE_M * 100:g} cm of overlap\n"
    f"are put down to the map's rounding. \"{TRUE_MAP}\" has the true instances: what it misses is no map's fault."
)
PAPER_GAIN_PERCENT: Final = 233.0
"""Gain of instance-level maps over the baseline on instance-specific commands, from the paper's abstract."""
PAPER: Final = (
    "Beside the paper (Nanwani et al., Instance-Level Semantic Maps for Vision Language Navigation, 2023,\n"
    "arXiv:2305.12363): its table of success rates is left out, as its figures could not be checked word for word.\n"
    'Its abstract says that its map improves navigation "by two-fold (233%)" over its baseline, on commands with\n'
    "instance-specific descriptions. That is another experiment: other scenes, another simulator, other commands.\n"
    "Here commands are made from the truth in fixed families and read by one grammar for all methods, masks are\n"
    "exact, simulated or the sequence's own, and the judge is a program; what people say is a line of its own."
)


def success_tables(report: NavigationReport) -> tuple[TextTable, ...]:
    """Lay out one table for each kind of errors: families down, methods across."""
    tables = []
    for errors in report.errors:
        rows = [
            (family, str(len(report.of(errors, report.methods[0], family))),
             *(_cell(report.of(errors, method, family)) for method in report.methods))
            for family in report.families
        ]  # fmt: skip
        everything = [report.of(errors, method) for method in report.methods]
        rows.append(("all", str(len(everything[0])), *map(_cell, everything)))
        rows.append(("collisions", "", *(str(sum(run.drive.collided for run in runs)) for runs in everything)))
        title = f"{report.name}: {_words(errors)}; {_robot(report)}"
        note = LEGEND if errors == report.errors[-1] else ""
        tables.append(TextTable(title, ("family", "commands", *report.methods), tuple(rows), note=note))
    return tuple(tables)


def navigation_text(report: NavigationReport) -> str:
    """Return everything to print: the tables, the gain over VLMaps, and the paper beside it."""
    pieces = [table.text() for table in success_tables(report)]
    gains = gains_over(report, "vlmaps")
    if gains:
        lines = [f"  {errors} errors, {method}: {gain:+.0f} %" for (errors, method), gain in gains.items()]
        head = f"Strict success against vlmaps (the paper's abstract, its own experiment: {PAPER_GAIN_PERCENT:+.0f} %):"
        pieces.append("\n".join([head, *lines]) + "\n")
    return "\n".join([*pieces, PAPER]) + "\n"


def gains_over(report: NavigationReport, baseline: str) -> dict[tuple[str, str], float]:
    """{(errors, method): gain of its strict success over the baseline's, percent}; empty without that baseline."""
    gains = {}
    for errors in report.errors:
        base = strict_share(report.of(errors, baseline))
        for method in report.methods if base else ():
            if base and method not in (baseline, TRUE_MAP):
                gains[errors, method] = (strict_share(report.of(errors, method)) / base - 1.0) * 100.0
    return gains


def automatic_share(runs: Sequence[NavigationRun]) -> float:
    """Return the share of runs that reached their goals; 0 for no runs."""
    return sum(run.verdict.automatic for run in runs) / max(len(runs), 1)


def strict_share(runs: Sequence[NavigationRun]) -> float:
    """Return the share of runs that did what was meant; 0 for no runs."""
    return sum(run.verdict.strict for run in runs) / max(len(runs), 1)


def navigation_json(report: NavigationReport) -> dict[str, Any]:
    """Return the tables and every run, JSON-able; ``people`` is null: they judge later, see `judging`."""
    shares = [
        {
            "errors": errors, "method": method, "family": family, "commands": len(runs),
            "automatic": automatic_share(runs), "strict": strict_share(runs),
            "collisions": sum(run.drive.collided for run in runs),
        }
        for errors in report.errors
        for method in report.methods
        for family in (*report.families, None)
        if (runs := report.of(errors, method, family))
    ]  # fmt: skip
    return {
        "format": FORMAT, "name": report.name, "sequence": str(report.path), "simulated": report.simulated,
        "robot": {"radius_m": report.robot.radius_m, "height_m": report.robot.height_m}, "actions": report.actions,
        "success_m": SUCCESS_M, "tolerance_m": TOLERANCE_M, "shares": shares,
        "people": None, "paper": PAPER,
        "runs": [run.to_json() for run in report.runs],
    }  # fmt: skip


def _cell(runs: Sequence[NavigationRun]) -> str:
    return f"{automatic_share(runs):.2f} / {strict_share(runs):.2f}"


def _words(errors: str) -> str:
    known = {"none": "maps from exact masks", "precomputed": "maps from the masks of the sequence"}
    return known.get(errors, f"maps from masks with {errors} simulated network errors")


def _robot(report: NavigationReport) -> str:
    way = "driven exactly" if report.actions == "continuous" else f"driven in steps of {FORWARD_M:g} m and 5 degrees"
    return f"simulated robot, radius {report.robot.radius_m:g} m, {way}"
