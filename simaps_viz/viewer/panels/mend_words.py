"""The sentences and choices of the panel on which people mend the map."""

from collections.abc import Sequence
from html import escape

import cv2
import numpy as np

from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.drawing.legend import facts_text, object_name
from simaps_viz.viewer.drawing.theme import BAD_STYLE, BOX_STYLE, DIM_STYLE, STICKY, TEXT_STYLE, note_html, short_html
from simaps_viz.viewer.panels.command_words import message_html
from simaps_viz.viewer.panels.mend_services import EntryLike

NEAREST = 15
"""How many objects are offered to join with."""
LISTED = 40
"""Edits listed; the file has all."""


def nearest(simap: SIMap, one: Instance) -> dict[str, int]:
    """Name the objects nearest to one, those of its class first, with their distance: {text: id}."""
    here = np.asarray(one.centroid_m[:2])
    others = [other for other in simap.instances if other.id != one.id]
    far = {other.id: float(np.hypot(*(np.asarray(other.centroid_m[:2]) - here))) for other in others}
    others.sort(key=lambda other: (other.label != one.label, far[other.id], other.id))
    return {f"{object_name(simap, other)}, {far[other.id]:.1f} m": other.id for other in others[:NEAREST]}


def classes(simap: SIMap) -> list[str]:
    """Give the map's classes by name; countable ones first."""
    named = zip(simap.grid.labels[1:], simap.grid.is_thing[1:], strict=True)
    return [label for label, _ in sorted(named, key=lambda pair: (not pair[1], pair[0]))]


def status_html(simap: SIMap, one: Instance | None, words: str, tone: str, *, known: bool) -> str:
    """Say what is selected, and what became of the last thing done; it stays in sight while the panel scrolls."""
    if not known:
        head = note_html("This is another map than the one that the edits belong to.")
    elif one is None:
        head = note_html("Select an object on the map, or in the list under Instance, to mend it.")
    else:
        facts = escape(facts_text(simap, one))
        head = (
            f'<div style="{BOX_STYLE};{TEXT_STYLE};overflow-wrap:anywhere"><b>{short_html(object_name(simap, one))}</b>'
            f'<br><span style="{DIM_STYLE}">{facts}</span></div>'
        )
    said = f'<div role="status">{message_html("", words, tone)}</div>' if words else ""
    return f'<div class="{STICKY}">{head}{said}</div>'


def joined_text(simap: SIMap, first: int, second: int) -> str:
    """Say that two objects are joined, and how far apart they are where they do not touch."""
    apart = apart_m(simap, first, second)
    return "Joined." if apart == 0.0 else f"Joined. They do not touch: {apart:.2f} m lie between them. Undo parts them."


def apart_m(simap: SIMap, first: int, second: int) -> float:
    """Give the distance between the nearest edges of two objects, metres; 0 where cells of theirs touch."""
    both = np.isin(simap.instance, (first, second))
    row, col = np.flatnonzero(both.any(axis=1)), np.flatnonzero(both.any(axis=0))
    if first == second or not (simap.instance == first).any() or not (simap.instance == second).any():
        return 0.0
    part = simap.instance[row[0] : row[-1] + 1, col[0] : col[-1] + 1]
    away = cv2.distanceTransform((part != first).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    cells = float(away[part == second].min())
    return 0.0 if cells < 1.5 else (cells - 1.0) * simap.spec.cell_size_m


def edits_html(entries: Sequence[tuple[str, EntryLike]], undone: int, refused: Sequence[str]) -> str:
    """List the edits (what they did, and the edits themselves), the last one first."""
    lost = "".join(f'<li style="{BAD_STYLE}">{escape(why)}</li>' for why in refused)
    if not entries and not lost:
        more = f" {undone} taken back." if undone else ""
        return note_html(f"No edits yet.{more}")
    rows = [
        f"<li>{escape(what)}<br>"
        f'<span style="{DIM_STYLE}">{escape(entry.who)}, {escape(when_text(entry.when))}</span></li>'
        for what, entry in list(reversed(entries))[:LISTED]
    ]
    rest = f"<li>and {len(entries) - LISTED} before</li>" if len(entries) > LISTED else ""
    back = note_html(f"{undone} taken back.") if undone else ""
    return (
        f'<ol reversed start="{len(entries)}" aria-label="Edits" style="{BOX_STYLE};{TEXT_STYLE};margin:0;'
        f'padding-left:2.6em;overflow-wrap:anywhere">{"".join(rows)}{rest}</ol>{back}'
        + (f'<ul aria-label="Not done" style="{BOX_STYLE};margin:0;padding-left:2.6em">{lost}</ul>' if lost else "")
    )


def saved_html(path: str, saved: bool) -> str:
    """Say where the edits are."""
    said = "Saved to" if saved else "Edits will be saved to"
    return note_html(f'{said} <span style="overflow-wrap:anywhere">{escape(path)}</span>')


def when_text(when: str) -> str:
    """Write a time for people: 2026-11-21T19:30:00Z -> 2026-11-21 19:30 UTC."""
    return f"{when[:10]} {when[11:16]} UTC" if len(when) == 20 else when
