"""What the section on a frame's masks says: legend, segments, the effect of thresholds; as small pieces of HTML."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from html import escape

import numpy as np

from simaps_viz.labels import plural
from simaps_viz.palette import Color
from simaps_viz.structures import Segmentation
from simaps_viz.viewer.drawing.mask_picture import ColorBy, confidence_color, named_color
from simaps_viz.viewer.drawing.theme import BAD_STYLE, DIM_STYLE, SMALL_STYLE, remark_html

MOST_ROWS = 40


def error_html(text: str) -> str:
    """Set what went wrong."""
    return f'<div role="alert" style="{SMALL_STYLE};{BAD_STYLE}">{escape(text)}</div>'


def class_counts(masks: Segmentation) -> dict[str, tuple[int, bool]]:
    """Give {class: (how many segments, is it a thing)}: things first, then by name."""
    counts = Counter(s.label for s in masks.segments)
    things = {s.label: s.is_thing for s in masks.segments}
    return {label: (counts[label], things[label]) for label in sorted(counts, key=lambda c: (not things[c], c))}


def masks_legend(masks: Segmentation, color_by: ColorBy, colors: Mapping[str, Color] | None = None) -> str:
    """Explain the colours and the two kinds of fill; ``colors`` are those of the map's classes."""
    kinds = (
        f'<div style="opacity:.85">{_chip((150, 150, 150), thing=True)}thing (can be counted)'
        f'<span style="margin-left:1em">{_chip((150, 150, 150), thing=False)}stuff (floor, wall …)</span></div>'
    )
    if color_by == "confidence":
        stops = ",".join(f"rgb{confidence_color(level)}" for level in np.linspace(0.0, 1.0, 9))
        bar = (
            "<div>how sure the network is</div>"
            f'<div style="height:10px;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
            '<div style="display:flex;justify-content:space-between"><span>0</span><span>0.5</span><span>1</span></div>'
        )
        return f'<div style="{SMALL_STYLE}">{bar}{kinds}</div>'
    chips = "".join(
        f'<span style="white-space:nowrap;margin-right:.9em">{_chip(named_color(label, colors or {}), thing=thing)}'
        f"{escape(label)} <b>{count}</b></span>"
        for label, (count, thing) in class_counts(masks).items()
    )
    return f'<div style="{SMALL_STYLE}">{chips}{kinds}</div>'


def segments_html(masks: Segmentation, hidden: Collection[str]) -> str:
    """List the segments, surest first: class, confidence, share of the picture."""
    shown = sorted((s for s in masks.segments if s.label not in hidden), key=lambda s: (not s.is_thing, -s.score))
    if not shown:
        return remark_html("No segment is shown on this frame.")
    areas = np.bincount(masks.ids.reshape(-1), minlength=max(s.id for s in shown) + 1) / masks.ids.size
    cell = '<td style="padding-right:1em;text-align:right">'
    rows = "".join(
        f'<tr><td style="padding-right:1em">{escape(s.label)}</td>{cell}{s.score:.2f}</td>{cell}{_share(areas[s.id])}'
        "</td></tr>"
        for s in shown[:MOST_ROWS]
    )
    rest = f"<div>and {len(shown) - MOST_ROWS} more</div>" if len(shown) > MOST_ROWS else ""
    head = f'<td style="padding-right:1em">segment</td>{cell}confidence</td>{cell}of the picture</td>'
    rows = f'<tr style="{DIM_STYLE}">{head}</tr>{rows}'
    return f'<div style="{SMALL_STYLE}"><table style="border-spacing:0">{rows}</table>{rest}</div>'


def effect_words(before: Segmentation, now: Segmentation) -> str:
    """Say what other thresholds change on a frame."""
    named = [float(np.count_nonzero(masks.ids) / max(masks.ids.size, 1)) for masks in (before, now)]
    old, new = (Counter(s.label for s in masks.segments) for masks in (before, now))
    text = f"{plural(len(now.segments), 'segment')}, {_share(named[1])} of the picture"
    if now is before:
        return f"As the map was built: {text}."
    parts = [f"+{n} {label}" for label, n in sorted((new - old).items())]
    parts += [f"−{n} {label}" for label, n in sorted((old - new).items())]
    changed = float(np.count_nonzero((before.ids > 0) != (now.ids > 0)) / max(now.ids.size, 1))
    what = ", ".join(parts) if parts else "as many of each class"
    return (
        f"Now {text}. As the map was built: {len(before.segments)}, {_share(named[0])}. Change: {what}; "
        f"{_share(changed)} of the pixels gained or lost their segment."
    )


def command_words(source: str, options: Mapping[str, float], names: Mapping[str, str]) -> str:
    """Give the options that build a map with such thresholds."""
    told = " ".join(f"{names[key]} {value:g}" for key, value in options.items() if key in names)
    return f"To build a map so: simaps build … --segmentation {source} {told}" if told else ""


def has_confidence(masks: Segmentation) -> bool:
    """Tell whether the things on a frame carry a confidence; masks without one say 1 of each."""
    scores: Sequence[float] = [s.score for s in masks.segments if s.is_thing]
    return not scores or any(score < 1.0 for score in scores)


def _share(share: float) -> str:
    return f"{100 * share:.1f} %"


def _chip(color: Color, *, thing: bool) -> str:
    solid = f"rgb{color}"
    fill = solid if thing else f"repeating-linear-gradient(135deg,{solid} 0 3px,transparent 3px 6px)"
    return (
        f'<span style="display:inline-block;width:12px;height:12px;border-radius:2px;margin-right:5px;'
        f'background:{fill};box-shadow:inset 0 0 0 1px rgba(0,0,0,.3)"></span>'
    )
