"""The comparison in words: what differs, how often, what the marks mean. Text and small pieces of HTML."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from simaps_viz.colors.classes import plural
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.compare_picture import KINDS, mark_color
from simaps_viz.drawing.theme import BAD_STYLE, DIM_STYLE, LIGHT, Theme, short
from simaps_viz.evaluation.two_maps import Item, MapSide, TwoMaps
from simaps_viz.events import Progress
from simaps_viz.structures import SIMap

Named = tuple[str, SIMap]
"""A map and what it is called on the page."""
TRUTH = "truth"
"""Key of the source that is the ground truth."""


@dataclass(frozen=True)
class Source:
    """A map that can be had besides the one on the page."""

    key: str
    title: str
    """Such as "Method paper" or "Ground truth"."""
    hint: str = ""
    """Such as what it is simulated with."""


@dataclass(frozen=True)
class CompareServices:
    """Plain functions behind the comparison; what is None is left out."""

    compare: Callable[[Named, Named, Literal["left", "right"] | None], TwoMaps]
    """(left, right, which is the truth) -> the comparison; may raise SIMapsError."""
    sources: tuple[Source, ...] = ()
    """What ``make`` can make."""
    make: Callable[[str, SIMap, Progress, threading.Event], SIMap] | None = None
    """(key, map on the page, told how far it is, set to give up) -> that map, from a cache if it was made before. Slow;
    called on a thread of its own. Raises `Cancelled` when it was told to give up."""
    rejoin: Callable[[SIMap, float, float], SIMap] | None = None
    """(map, K or evidence in percent, Louvain resolution) -> the map partitioned so; fast."""
    load: Callable[[str, bytes], SIMap] | None = None
    """(file name, content) -> the map of that file; may raise SIMapsError."""


class Cancelled(Exception):  # noqa: N818 - nothing went wrong
    """The work was given up because a person asked for it."""


ALL = "all"
MOST_NAMED = 5
"""Objects of a difference that are named; more are counted."""
PQ_MEANS = "PQ: the share of objects that are found, times how well their outlines agree; 1 is perfect."
_TONES = {"plain": "", "bad": BAD_STYLE}


def item_text(item: Item, maps: TwoMaps) -> str:
    """Describe what a difference is: "merged · chairs 4 + 5 → 1", "missed · chair 2", "label · chair 1 → couch 2".

    Numbers are those of the objects among their class, each on its own map.
    """
    here, there = _names(item.left, maps.left), _names(item.right, maps.right)
    if maps.reference == "right":
        here, there = there, here
    if item.kind in ("merged", "split"):
        return f"{item.kind} · {_together(here)} → {_together(there, known=item.label)}"
    if item.kind in ("label", "outline"):
        return f"{item.kind} · {_together(here)} → {_together(there, known=item.label)}"
    return f"{item.kind} · {_together(here or there)}"


def _names(ids: Sequence[int], side: MapSide) -> list[str]:
    return [side.names.get(one, f"instance {one}") for one in ids]


def _together(names: Sequence[str], *, known: str = "") -> str:
    """Name several objects: "chairs 4 + 5"; of the class that is known already only the numbers."""
    parts = [name.rpartition(" ") for name in names]
    labels = {label for label, _, _ in parts}
    more = f" + {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    if len(labels) > 1:
        return " + ".join(short(name) for name in names[:MOST_NAMED]) + more
    numbers = " + ".join(number for _, _, number in parts[:MOST_NAMED]) + more
    (label,) = labels or {""}
    if label == known:
        return numbers
    return f"{short(label if len(names) == 1 else plural(2, label).removeprefix('2 '))} {numbers}"


def kind_options(maps: TwoMaps) -> tuple[str, ...]:
    """Return what the list can be narrowed to: "all (9)", "merged (2)", ... only kinds that occur."""
    found = [f"{kind} ({count})" for kind, count in maps.counts.items() if count]
    return (f"{ALL} ({len(maps.items)})", *found)


def of_kind(maps: TwoMaps, option: str) -> list[Item]:
    """Return the differences of an option of ``kind_options``."""
    kind = option.partition(" (")[0]
    return [item for item in maps.items if kind in (ALL, item.kind)]


def headline_html(maps: TwoMaps) -> str:
    """Say in two lines how much differs, and how good the map is where that is known."""
    empty = [escape(side.title) for side in (maps.left, maps.right) if not side.count]
    if len(empty) == 2:
        return note("<b>Neither map has an object:</b> there is nothing to compare.")
    total = len(maps.items)
    said = f"<b>{plural(total, 'difference')}</b>" if total else "<b>No differences</b>"
    compared = " of those that are large enough" if maps.left.ignored + maps.right.ignored else ""
    lines = [f"{said} · {plural(maps.same, 'object')}{compared} {'agrees' if maps.same == 1 else 'agree'}"]
    lines += [f"<b>{title} has no object.</b>" for title in empty]
    if maps.score is not None:
        pq = "none" if maps.score.pq is None else f"{maps.score.pq:.2f}"
        lines.append(f"<b>PQ {pq}</b> · {maps.score.matched} of {maps.score.true} true objects found")
        lines.append(f'<span style="{DIM_STYLE}">{PQ_MEANS}</span>')
    return note(*lines)


def summary_html(maps: TwoMaps, theme: Theme = LIGHT) -> str:
    """Describe what every colour of a mark means and how often it occurs, and the rest of the numbers."""
    left, right = maps.left, maps.right
    reference, other = (left, right) if maps.reference == "left" else (right, left)
    lines = []
    if maps.items:
        lines.append(f"What became of the objects of <b>{escape(reference.title)}</b> on {escape(other.title)}:")
    rows = "".join(
        f'<tr><td style="padding-right:.5em">{_ring(mark_color(kind, theme))}</td>'
        f'<td style="text-align:right;padding-right:.6em"><b>{count}</b></td>'
        f"<td><b>{kind}</b> · {KINDS[kind][1]}</td></tr>"
        for kind, count in maps.counts.items()
        if count
    )
    lines.append(f'<table style="border-spacing:0">{rows}</table>')
    lines += [f"{escape(side.title)}: {plural(side.count, 'instance')}" for side in (left, right)]
    lines += ignored_lines(maps)
    score = maps.score
    if score is not None and (maps.items or score.over or score.under):
        lines.append(
            f"{score.found - score.matched} of {score.found} on {escape(other.title)} match nothing · "
            f"{score.over} split, {score.under} merged"
        )
    lines.append(
        '<span style="opacity:.75">Same colour: same object, by overlap. Grey: on no object of the left.</span>'
    )
    return note(*lines)


def ignored_lines(maps: TwoMaps) -> list[str]:
    """Describe which objects were too small to be compared, where there are any."""
    left, right = maps.left, maps.right
    if not left.ignored and not right.ignored:
        return []
    if left.least_cells == right.least_cells:
        small = f"under {left.least_cells} cells"
    else:
        small = f"under {left.least_cells} cells left, {right.least_cells} right"
    return [f"Too small to compare ({small}, or lying on one that is): {left.ignored} left, {right.ignored} right"]


def note(*lines: str, tone: str = "plain") -> str:
    """Wrap lines of HTML as a text of the panel."""
    body = "".join(f"<div>{line}</div>" for line in lines)
    style = f"padding:.2em .8em .4em;font-size:.82em;line-height:1.5;overflow-wrap:anywhere;{_TONES[tone]}"
    return f'<div style="{style}">{body}</div>'


def chosen_html(item: Item, maps: TwoMaps, position: int, total: int, theme: Theme = LIGHT) -> str:
    """Describe the difference that was clicked."""
    sides = [(maps.left, item.left), (maps.right, item.right)]
    where = " · ".join(
        f"{escape(side.title)}: {escape(_together(_names(ids, side)) if ids else 'nothing')}" for side, ids in sides
    )
    return note(
        f"{_ring(mark_color(item.kind, theme))} <b>{escape(item_text(item, maps))}</b> ({position} of {total})",
        f"{KINDS[item.kind][1]}",
        f'<span style="opacity:.75">{where}</span>',
    )


def _ring(color: Color) -> str:
    return (
        f'<span style="display:inline-block;width:11px;height:11px;border-radius:2px;border:3px solid rgb{color};'
        'box-sizing:border-box;vertical-align:-1px"></span>'
    )
