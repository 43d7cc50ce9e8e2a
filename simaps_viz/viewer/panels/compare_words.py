"""The comparison in words: what differs, how often, what the marks mean. Text and small pieces of HTML."""

from collections.abc import Sequence
from html import escape

from simaps_viz.viewer.drawing.compare_picture import KINDS, Color
from simaps_viz.viewer.drawing.legend import plural
from simaps_viz.viewer.drawing.theme import BAD_STYLE
from simaps_viz.viewer.panels.compare_services import ItemLike, TwoMapsLike

ALL = "all"
_TONES = {"plain": "", "bad": BAD_STYLE}


def item_text(item: ItemLike, reference: str) -> str:
    """Say what a difference is: "merged · 3 chairs → 1", "missed · chair", "label · chair → couch"."""
    there = item.right if reference == "left" else item.left
    here = item.left if reference == "left" else item.right
    if item.kind in ("merged", "split"):
        return f"{item.kind} · {plural(len(here), item.label)} → {len(there)}"
    if item.kind == "label":
        return f"{item.kind} · {item.label} → {item.other_label}"
    return f"{item.kind} · {item.label}"


def kind_options(maps: TwoMapsLike) -> tuple[str, ...]:
    """Give what the list can be narrowed to: "all (9)", "merged (2)", ... only kinds that occur."""
    found = [f"{kind} ({count})" for kind, count in maps.counts.items() if count]
    return (f"{ALL} ({len(maps.items)})", *found)


def of_kind(maps: TwoMapsLike, option: str) -> list[ItemLike]:
    """Give the differences of an option of ``kind_options``."""
    kind = option.partition(" (")[0]
    return [item for item in maps.items if kind in (ALL, item.kind)]


def headline_html(maps: TwoMapsLike) -> str:
    """Say in two lines how much differs, and how good the map is where that is known."""
    total = len(maps.items)
    said = f"<b>{plural(total, 'difference')}</b>" if total else "<b>No differences</b>"
    lines = [f"{said} · {plural(maps.same, 'object')} {'agrees' if maps.same == 1 else 'agree'}"]
    if maps.score is not None:
        pq = "none" if maps.score.pq is None else f"{maps.score.pq:.2f}"
        lines.append(f"<b>PQ {pq}</b> · {maps.score.matched} of {maps.score.true} true objects found")
    return note(*lines)


def summary_html(maps: TwoMapsLike) -> str:
    """Say what every colour of a mark means and how often it occurs, and the rest of the numbers."""
    left, right = maps.left, maps.right
    reference, other = (left, right) if maps.reference == "left" else (right, left)
    lines = []
    if maps.items:
        lines.append(f"What became of the objects of <b>{escape(reference.title)}</b> on {escape(other.title)}:")
    rows = "".join(
        f'<tr><td style="padding-right:.5em">{_ring(KINDS[kind][0])}</td>'
        f'<td style="text-align:right;padding-right:.6em"><b>{count}</b></td>'
        f"<td><b>{kind}</b> · {KINDS[kind][1]}</td></tr>"
        for kind, count in maps.counts.items()
        if count
    )
    lines.append(f'<table style="border-spacing:0">{rows}</table>')
    lines += [f"{escape(side.title)}: {plural(side.count, 'instance')}" for side in (left, right)]
    if maps.ignored:
        lines.append(f"{maps.ignored} too small to compare")
    if maps.score is not None:
        score = maps.score
        lines.append(
            f"{score.found - score.matched} of {score.found} on {escape(other.title)} match nothing · "
            f"{score.over} split, {score.under} merged"
        )
    lines.append(
        '<span style="opacity:.75">Same colour: same object, by overlap. Grey: on no object of the left.</span>'
    )
    return note(*lines)


def note(*lines: str, tone: str = "plain") -> str:
    """Wrap lines of HTML as a text of the panel."""
    body = "".join(f"<div>{line}</div>" for line in lines)
    return f'<div style="padding:.2em .8em .4em;font-size:.82em;line-height:1.5;{_TONES[tone]}">{body}</div>'


def chosen_html(item: ItemLike, maps: TwoMapsLike, position: int, total: int) -> str:
    """Describe the difference that was clicked."""
    sides = [(maps.left.title, item.left), (maps.right.title, item.right)]
    where = " · ".join(f"{escape(title)}: {_ids(ids)}" for title, ids in sides)
    return note(
        f"{_ring(KINDS[item.kind][0])} <b>{escape(item_text(item, maps.reference))}</b> ({position} of {total})",
        f"{KINDS[item.kind][1]}",
        f'<span style="opacity:.75">{where}</span>',
    )


def _ids(ids: Sequence[int]) -> str:
    return ("instance " if len(ids) == 1 else "instances ") + ", ".join(map(str, ids)) if ids else "nothing"


def _ring(color: Color) -> str:
    return (
        f'<span style="display:inline-block;width:11px;height:11px;border-radius:2px;border:3px solid rgb{color};'
        'box-sizing:border-box;vertical-align:-1px"></span>'
    )
