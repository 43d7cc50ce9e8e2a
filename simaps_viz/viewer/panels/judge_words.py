"""What a judge reads: the command, what the robot did, and in the end what people say of each method."""

from collections.abc import Mapping
from html import escape
from typing import Any

from simaps_viz.viewer.drawing.theme import DIM_STYLE
from simaps_viz.viewer.services import JudgingLike, RunLike

_CELL = "padding:.15em .5em;text-align:right"


def run_html(run: RunLike) -> str:
    """Show a run's command in large letters, and its number."""
    return (
        '<div style="padding:.6em .8em .2em">'
        f'<div style="font-size:.82em;{DIM_STYLE}">Run <b>{run.number} of {run.total}</b> · answers are saved at once'
        "</div>"
        '<div style="font-size:1.5em;line-height:1.25;font-weight:650;margin:.2em 0;overflow-wrap:anywhere">'
        f"“{escape(str(run.shown.get('command', '')))}”</div></div>"
    )


def outcome_text(shown: Mapping[str, Any]) -> str:
    """Say what the robot did, without saying whether it was right."""
    stops = len(shown.get("stops") or ())
    moved = len(shown.get("track") or ()) > 1
    if shown.get("collision"):
        return "The robot bumped into something (✖) and stayed there."
    if shown.get("status") == "refused":
        return "The robot refused the command and did not move."
    if shown.get("status") == "failed":
        return "The robot found no way to go on" + ("." if moved else ", and did not move.")
    if not moved:
        return "The robot did not move."
    return "The robot drove and stopped once." if stops == 1 else f"The robot drove and stopped {stops} times."


def summary_html(session: JudgingLike) -> str:
    """Show what people say of each method, a table for each kind of errors."""
    tables: dict[str, list[str]] = {}
    for (errors, method), score in session.summary().items():
        share = "–" if score.share is None else f"{100.0 * score.share:.0f} %"
        cells = "".join(
            f'<td style="{_CELL}">{value}</td>' for value in (score.yes, score.no, score.skipped, f"<b>{share}</b>")
        )
        tables.setdefault(errors, []).append(
            f'<tr><td style="padding:.15em .5em .15em 0">{escape(method)}</td>{cells}</tr>'
        )
    head = "".join(f'<th style="{_CELL};font-weight:500;{DIM_STYLE}">{h}</th>' for h in ("yes", "no", "skip", "right"))
    parts = [
        f'<div style="margin-top:.6em;font-weight:600">{escape(_masks(errors))}</div>'
        f'<table style="border-collapse:collapse;font-variant-numeric:tabular-nums"><tr><th></th>{head}</tr>'
        f"{''.join(rows)}</table>"
        for errors, rows in tables.items()
    ]
    return (
        '<div style="padding:.6em .8em;font-size:.88em;line-height:1.4">'
        '<div style="font-size:1.4em;font-weight:650">All runs are judged</div>'
        "<div>What people say: share of runs that did what was asked, runs that were skipped left out.</div>"
        f"{''.join(parts)}</div>"
    )


def _masks(errors: str) -> str:
    """Say what the maps were built from."""
    known = {"none": "Exact masks", "precomputed": "The sequence's own masks"}
    return known.get(errors, f"Masks with {errors} simulated errors")
