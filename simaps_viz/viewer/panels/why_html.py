"""Pieces of HTML that explain an object."""

from html import escape

import numpy as np

from simaps_viz.mapping.why import Joint, Why
from simaps_viz.mapping.why_words import joint_words, needed_text, score_text, summary
from simaps_viz.palette import Color
from simaps_viz.viewer.drawing.theme import SMALL_STYLE
from simaps_viz.viewer.drawing.why_marks import (
    CUT,
    LINK,
    RAMP,
    SOURCE,
    TARGET,
    UNKNOWN,
    drawn_links,
    sureness_range,
)


def text_html(text: str) -> str:
    """Set a sentence."""
    return f'<div style="{SMALL_STYLE}">{escape(text)}</div>'


def summary_html(why: Why, *, by_hand: bool = False) -> str:
    """Say why an instance is one object; ``by_hand``: people made it what it is."""
    words = escape(summary(why, by_hand=by_hand))
    return (
        '<div style="margin:.1em .8em .6em;padding:.4em .6em;font-size:.82em;line-height:1.45;'
        f'border-left:3px solid rgb(22,110,235);background:rgba(22,110,235,.07)">{words}</div>'
    )


def sureness_legend(why: Why) -> str:
    """Explain the colours of `sureness_colors`."""
    low, high = sureness_range(why)
    if why.method == "paper":
        meaning, ends = "mean weight of a cell's edges inside (pixel pairs per frame)", (f"{low:g}", f"{high:.1f}")
    else:
        meaning, ends = "share of sightings with the rest that say one object", (f"{low:g} and less", f"{high:g}")
    stops = ",".join(f"rgb{color}" for color in RAMP)
    rest = ""
    if np.isnan(why.sureness).any():
        rest = f"<div>{_chip(UNKNOWN)}nothing seen for or against</div>"
    return (
        f'<div style="{SMALL_STYLE}"><div>{escape(meaning)}</div>'
        f'<div style="height:10px;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between"><span>{ends[0]}</span><span>{ends[1]}</span></div>'
        f"{rest}</div>"
    )


def lines_legend(why: Why) -> str:
    """Explain the lines on the map, with their numbers' unit."""
    parts = []
    if why.weakest is not None:
        score = score_text(why.method, why.weakest.score)
        parts.append(
            f"<div>{_stroke(CUT)}weakest joint: {score}, needed: above {needed_text(why.method, why.threshold)}</div>"
        )
    if drawn_links(why):
        number = {"paper": "share of cells that neighbour the other", "evidence": "evidence that both are one"}
        parts.append(f"<div>{_stroke(LINK)}neighbours, with {number.get(why.method, 'their distance')}</div>")
    return f'<div style="{SMALL_STYLE}">{"".join(parts)}</div>' if parts else ""


def joint_html(why: Why, joint: Joint, position: int, recorded: bool | None) -> str:
    """Describe one step that made an instance; ``position`` counts from 1, ``recorded`` is None without a recording."""
    more = " The recorded build was cut into other communities and has no such step." if recorded is False else ""
    return (
        f'<div style="{SMALL_STYLE}"><b>Step {position} of {len(why.joints)}</b>: '
        f"{_stroke(TARGET)}{joint.target_cells} cells + {_stroke(SOURCE)}{joint.source_cells} cells: "
        f"{escape(joint_words(why, joint))}.{escape(more)}</div>"
    )


def joint_name(why: Why, position: int) -> str:
    """Name a step on a button: "12 · 0.83 · 30 + 14"; ``position`` counts from 1."""
    joint = why.joints[position - 1]
    weakest = " ◂ weakest" if joint is why.weakest else ""
    return f"{position} · {score_text(why.method, joint.score)} · {joint.target_cells} + {joint.source_cells}{weakest}"


def _chip(color: Color) -> str:
    return (
        '<span style="display:inline-block;width:10px;height:10px;border-radius:2px;margin-right:6px;'
        f'background:rgb{color}"></span>'
    )


def _stroke(color: Color) -> str:
    return (
        '<span style="display:inline-block;width:14px;height:4px;border-radius:2px;margin-right:5px;'
        f'vertical-align:middle;background:rgb{color}"></span>'
    )
