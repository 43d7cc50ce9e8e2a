"""Legends of the colours, and descriptions of a map and its objects, as text and as small pieces of HTML."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape
from pathlib import PurePath

import cv2
import numpy as np

from simaps_viz.colors.classes import CLUTTER, FLOOR, WALL, cells_of_classes, ground_kinds, plain, plural
from simaps_viz.colors.instances import instance_colors
from simaps_viz.colors.naming import color_name
from simaps_viz.colors.palette import PALETTE, Color, as_color
from simaps_viz.drawing.texture import HEIGHT_TOP_M, STRIPE, ColorMode, class_patterns, shown_class_colors
from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE, LIGHT, NESTED_EM, Theme, short, short_html
from simaps_viz.mapping.changes import changes_in
from simaps_viz.mapping.in_space import all_instances, has_voxels
from simaps_viz.structures import Instance, SIMap

_FLOOR_M = 0.025
"""What begins lower, or below the floor by what depth is off, begins at the floor."""
MAX_ROWS = 8
"""Classes that a page's legend shows at once; the others are folded up."""
MAX_CHIPS = 40
"""Instances of a class that get their own colour chip; more are summed up."""


def title_of(simap: SIMap) -> str:
    """Return the name of a map: its own, or that of its sequence."""
    sequence = PurePath(str(simap.provenance.get("sequence", "unknown sequence")))
    folder = sequence.parent.name if sequence.suffix == ".json" and sequence.parent.name else sequence.name
    return str(simap.provenance.get("name") or folder)


def counts_of(simap: SIMap, doubtful: Collection[int] | None = None) -> dict[str, tuple[int, int]]:
    """Return {class: (objects that count, doubtful ones)} of a map's `objects`, most first, then by name.

    Args:
        simap: the map.
        doubtful: ids of what does not count; by default those of the map.
    """
    unsure = simap.doubtful if doubtful is None else doubtful
    both: dict[str, list[int]] = {}
    for one in simap.objects:
        both.setdefault(one.label, [0, 0])[one.id in unsure] += 1
    return {label: (n, more) for label, (n, more) in sorted(both.items(), key=lambda row: (-row[1][0], row[0]))}


def counted(simap: SIMap, doubtful: Collection[int] | None = None) -> dict[str, int]:
    """Return {class: objects that count}, see `counts_of`, of those of which any do."""
    return {label: n for label, (n, _) in counts_of(simap, doubtful).items() if n}


def counts_text(simap: SIMap, most: int = 4, doubtful: Collection[int] | None = None) -> str:
    """Describe what is on the map: "17 chairs, 4 dining tables · 21 instances, 2 more doubtful"."""
    if not simap.objects:
        return f"No instances: {why_empty(simap)}"
    both = counts_of(simap, doubtful)
    parts = [plural(n, short(label)) for label, (n, _) in both.items() if n]
    if len(parts) > most + 1:
        parts = [*parts[:most], f"{len(parts) - most} more classes"]
    sure, more = (sum(numbers) for numbers in zip(*both.values(), strict=True))
    total = plural(sure, "instance") + (f", {more} more doubtful" if more else "")
    return " · ".join(filter(None, [", ".join(parts), total]))


def why_empty(simap: SIMap) -> str:
    """Return why a map has no instances."""
    if not any(simap.grid.is_thing):
        return "none of the classes of its masks is countable (is_thing)."
    if not (simap.grid.observations > 0).any():
        return "no frame saw the floor or anything on it."
    things = np.array(simap.grid.is_thing, dtype=bool)[simap.grid.label]
    if not things.any():
        return "no mask named a countable thing; walls, floor and what nobody named are shown."
    return f"things were named, but none reaches the least size ({simap.parameters.get('min_cells', 1)} cells)."


def object_names(simap: SIMap, most: int | None = None, uncounted: Mapping[int, str] | None = None) -> dict[str, int]:
    """Return {name: id} of the instances, those of `not_counted` with a word; ``most`` keeps the largest."""
    instances = all_instances(simap)
    if most is not None and len(instances) > most:
        largest = sorted(instances, key=lambda one: -one.cells)[:most]
        kept = {one.id for one in largest}
        instances = tuple(one for one in instances if one.id in kept)
    words = {number: f", {why.partition(':')[0]}" for number, why in (uncounted or {}).items()}
    return {f"{one.name}{words.get(one.id, '')}": one.id for one in instances}


def not_counted(simap: SIMap, doubtful: Collection[int]) -> dict[int, str]:
    """Return why what does not count does not: what is doubtful, and what is hidden and no object of its own."""
    left_out = {number: f"not counted: {why}" for number, why in simap.left_out.items()}
    return {**left_out, **dict.fromkeys(doubtful, "doubtful")}


def facts_text(simap: SIMap, instance: Instance) -> str:
    """Describe how large an instance is and how often it was seen: "62 cells · 0.16 m² · seen in 38 frames"."""
    area = instance.area_m2(simap.spec.cell_size_m)
    digits = 2 if area >= 0.01 else 4
    return f"{plural(instance.cells, 'cell')} · {area:.{digits}f} m² · seen in {plural(instance.frames, 'frame')}"


def facts_html(simap: SIMap, instance: Instance, doubtful: Collection[int] | None = None) -> str:
    """Describe an instance in full: name, facts, place, size, score; ``doubtful`` as for `counts_of`."""
    unsure = simap.doubtful if doubtful is None else doubtful
    doubt = not_counted(simap, unsure).get(instance.id, "")
    mark = f" · <b>{doubt.partition(':')[0]}</b>" if doubt else ""
    (x0, y0, _), (x1, y1, top) = instance.aabb_m
    x, y, _ = instance.centroid_m
    seen = simap.color_of(instance)
    rows = (
        ("Class", f"{short(instance.label)}, {_one_of(simap, instance.label, unsure, doubt)}"),
        ("Position", f"x {x:.2f} m, y {y:.2f} m (map frame)"),
        ("Size", _size(instance) if has_voxels(simap) else f"{x1 - x0:.2f} × {y1 - y0:.2f} m, top at {top:.2f} m"),
        *[(kind, ", ".join(simap.by_id(i).name for i in found)) for kind, found in _related(simap, instance)],
        ("Score", f"{instance.score:.2f} mean confidence"),
        *[("History", one.words()) for one in changes_in(simap) if one.id == instance.id],
        *([("Colour", f"about {color_name(seen)}, as the cameras saw it")] if seen is not None else []),
    )
    table = "".join(
        f'<tr><td style="{DIM_STYLE};padding-right:.8em">{k}</td><td>{escape(v)}</td></tr>' for k, v in rows
    )
    return (
        f'<div style="{BOX_STYLE}">'
        '<button class="simaps-selected" type="button" data-do="deselect" title="Select nothing (Esc)">'
        f"<span>{short_html(instance.name)}</span> ✕</button>"
        f"<div>{escape(facts_text(simap, instance))}{mark}</div>"
        f'<table style="border-spacing:0;margin-top:.3em">{table}</table></div>'
    )


def _one_of(simap: SIMap, label: str, doubtful: Collection[int], doubt: str) -> str:
    ones = [one for one in simap.objects if one.label == label]
    sure, count = sum(one.id not in doubtful for one in ones), count_text(ones, doubtful)
    if doubt:
        why = "doubtful: seen too little to count" if doubt == "doubtful" else doubt
        are = "are" if sure or len(ones) > 1 else "is"
        return f"{why}; of this class there {are} {count.replace(' more doubtful', ' doubtful')}, this one included"
    if sure > 1:
        return f"one of {count}"
    return f"the only one; {len(ones) - 1} more doubtful" if len(ones) > 1 else "the only one"


def count_text(ones: Collection[Instance], doubtful: Collection[int]) -> str:
    """Count objects as the legend does: "13, 2 more doubtful"."""
    faint = sum(one.id in doubtful for one in ones)
    sure = len(ones) - faint
    return f"{sure}, {faint} more doubtful" if faint and sure else f"{faint} doubtful" if faint else str(sure)


def _size(instance: Instance) -> str:
    box = instance.box
    if box is None:
        return "too little of its surface was seen to tell"
    sides = " × ".join(f"{side:.2f}" for side in box.size_m)
    low_m = box.center_m[2] - box.size_m[2] / 2
    return f"{sides} m, {'from the floor up' if low_m < _FLOOR_M else f'from {low_m:.2f} m up'}"


def _related(simap: SIMap, instance: Instance) -> list[tuple[str, Iterable[int]]]:
    """Return what an instance stands on, in and under, each said once; columns say nothing of it."""
    if not has_voxels(simap):
        return []
    under = [other for other in instance.under if other not in instance.inside and other not in instance.on]
    related = (("On", list(instance.on)[:1]), ("In", instance.inside), ("Under", under))
    return [(kind, found) for kind, found in related if found]


def legend_html(
    simap: SIMap,
    mode: ColorMode,
    theme: Theme = LIGHT,
    *,
    buttons: bool = False,
    doubtful: Collection[int] | None = None,
    colored: bool = True,
) -> str:
    """Explain every colour of a mode.

    Args:
        simap: the map.
        mode: what the colours mean.
        theme: of the page.
        buttons: classes can be pressed, where the page's script hears it.
        doubtful: as for `counts_of`; they are counted apart.
        colored: objects have their colours on the map, or on a photo their outlines.
    """
    unsure = simap.doubtful if doubtful is None else doubtful
    if mode == "height":
        bar = _bar("0 m", f"{HEIGHT_TOP_M:g} m and more", "height of the highest point over the floor")
        return _box(f"{bar}{_unseen(theme)}")
    if mode == "observations":
        most = int(simap.grid.observations.max(initial=0))
        return _box(f"{_bar('0', plural(most, 'frame'), 'frames that saw the cell, logarithmic')}{_unseen(theme)}")
    chips = _class_chips(simap) if mode == "class" else {}
    if mode == "class":
        rows = _class_rows(simap, buttons, unsure, chips)
    else:
        rows = _instance_rows(simap, buttons, unsure, chips=colored)
    if buttons and len(rows) > MAX_ROWS + 1:
        more = f"<summary>all {len(rows)} classes, the doubtful too</summary>{''.join(rows[MAX_ROWS:])}"
        rows = [*rows[:MAX_ROWS], f'<details class="simaps-more">{more}</details>']
    if mode == "photo":
        outlined = "; objects are outlined" if colored else ""
        return _box(f"{CHIP_STYLE}<div>as the cameras saw it{outlined}</div>{''.join(rows)}{_unseen(theme)}")
    rows.insert(0, f"<div>a colour for each {'class' if mode == 'class' else 'object'}, not its real one</div>")
    if mode == "class":
        others = "".join(f'<span class="simaps-entry">{name}</span>' for name in _uncounted(simap, chips))
        said = "not counted, as they have no objects"
        rows += [f'<div style="margin-top:.5em">{said}: {others}</div>'] if others else []
    rows += [_note("Faint: doubtful, seen too little to count.")] if unsure else []
    rows += [_note(text) for text in _repeats(simap, mode)]
    ground = (("wall", theme.wall), ("not named", theme.clutter), ("floor", theme.floor), ("never seen", theme.unseen))
    there = np.isin((WALL, CLUTTER, FLOOR), ground_kinds(simap.grid))  # what was never seen is around every map
    ground = [entry for entry, known in zip(ground, (*there, True), strict=True) if known]
    names = "".join(f'<span class="simaps-entry">{chip(color)}{name}</span>' for name, color in ground)
    return _box(f'{CHIP_STYLE}{"".join(rows)}<div style="margin-top:.5em">{names}</div>')


def _repeats(simap: SIMap, mode: ColorMode) -> list[str]:
    """Return the note that colours repeat, where there are more classes or objects than colours."""
    if mode == "class" and any(class_patterns(simap).values()):
        return ["Classes of one colour differ by stripes or squares."]
    if mode == "instance" and len(simap.instances) > len(PALETTE):
        return ["Objects near one another have different colours; farther off, colours repeat."]
    return []


def _unseen(theme: Theme) -> str:
    return f'<div>{CHIP_STYLE}<span class="simaps-entry">{chip(theme.unseen)}never seen</span></div>'


def _class_rows(simap: SIMap, buttons: bool, doubtful: Collection[int], chips: Mapping[str, str]) -> list[str]:
    shown, counts = simap.counts(), counts_of(simap, doubtful).items()
    entries = (_class_entry(one, n, buttons and one in shown, more, chips.get(one, "")) for one, (n, more) in counts)
    return [f'<div class="simaps-entry">{entry}</div>' for entry in entries]


def _class_chips(simap: SIMap) -> dict[str, str]:
    colors, patterns = shown_class_colors(simap), class_patterns(simap)
    return {name: chip(color, PATTERN_STYLES[patterns[name]]) for name, color in colors.items()}


def _uncounted(simap: SIMap, chips: Mapping[str, str]) -> list[str]:
    """Return the other classes that have a colour on the map, which cannot be counted."""
    grid, counts = simap.grid, counts_of(simap)
    bare = (simap.instance == 0) & (grid.label > 0) & ~cells_of_classes(grid, "floor", "wall")
    names = {grid.labels[i] for i in np.flatnonzero(np.bincount(grid.label[bare], minlength=len(grid.labels)))}
    return [f"{chips[name]}{short_html(plain(name))}" for name in sorted(names) if name not in counts]


def _class_entry(label: str, count: int, buttons: bool, doubtful: int, chip: str = "") -> str:
    """Return a class and its number of objects, as a button that shows it alone and one that fades it."""
    counted = [f"<b>{count}</b>"] * (count > 0) + [f"{doubtful} doubtful"] * (doubtful > 0)
    text = f"{chip}{short_html(label)} {' + '.join(counted)}"
    if not buttons:
        return text
    name = escape(label)
    return (
        f'<button type="button" class="simaps-class" data-class="{name}" data-do="only" aria-pressed="false" '
        f'title="Show only this class; again: all">{text}</button>'
        f'<button type="button" class="simaps-fade" data-class="{name}" data-do="fade" aria-pressed="false" '
        f'aria-label="Fade {name}" title="Fade this class; again: show it">fade</button>'
    )


def _instance_rows(simap: SIMap, buttons: bool, doubtful: Collection[int], chips: bool) -> list[str]:
    colors = instance_colors(simap)
    ids: dict[str, list[int]] = {}
    for one in simap.instances:
        ids.setdefault(one.label, []).extend([one.id] * (one.id not in doubtful))
    rows = []
    for label, (count, more) in counts_of(simap, doubtful).items():
        shown = ids.get(label, [])
        some = "".join(chip(as_color(colors[i]), number=i if buttons else 0) for i in shown[:MAX_CHIPS])
        some += f" +{len(shown) - MAX_CHIPS}" if len(shown) > MAX_CHIPS else ""
        below = f' <span style="{DIM_STYLE}">{count - len(shown)} below others</span>' if count > len(shown) else ""
        entry = _class_entry(label, count, buttons and label in ids, more)
        rows.append(f'<div><span class="simaps-entry">{entry}</span>{some if chips else ""}{below}</div>')
    return rows


def _box(inner: str) -> str:
    return f'<div style="{BOX_STYLE}">{inner}</div>'


def _note(text: str) -> str:
    return f'<div style="{DIM_STYLE};font-size:{NESTED_EM}em;margin-top:.3em">{escape(text)}</div>'


CHIP_STYLE = (
    "<style>.simaps-chip{display:inline-block;width:.8em;height:.8em;border-radius:2px;margin-right:.25em;"
    "box-shadow:inset 0 0 0 1px rgba(128,128,128,.45)}.simaps-entry{white-space:nowrap;margin-right:.8em}</style>"
)


_DARK = f"rgba(0,0,0,{1.0 - STRIPE:.2f})"
_STRIPES = f"repeating-linear-gradient(%sdeg,{_DARK} 0 .2em,transparent 0 .4em)"
PATTERN_STYLES = (
    "none",
    *(_STRIPES % degrees for degrees in (45, 135, 0, 90)),
    f"repeating-conic-gradient({_DARK} 0 25%,transparent 0 50%) 0 0/.4em .4em",
)
"""The patterns of `texture.PATTERNS` as CSS."""


def chip(color: Color, pattern: str = "none", number: int = 0) -> str:
    """Return a small square of a colour, whose look is `CHIP_STYLE`; one with an object's number can be pressed."""
    one = f' data-one="{number}"' if number else ""
    drawn = f"rgb{color}" if pattern == "none" else f"{pattern},rgb{color}"
    return f'<i class="simaps-chip"{one} style="background:{drawn}"></i>'


def _bar(low: str, high: str, meaning: str) -> str:
    steps = np.linspace(0, 255, 9).astype(np.uint8).reshape(1, -1)
    colors = cv2.cvtColor(cv2.applyColorMap(steps, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)[0]
    return gradient_html(meaning, [as_color(color) for color in colors], (low, high))


def gradient_html(meaning: str, colors: Sequence[Color], ticks: Sequence[str]) -> str:
    """Draw a bar of colours, with what it means above and evenly spaced numbers below."""
    stops = ",".join(f"rgb{color}" for color in colors)
    numbers = "".join(f"<span>{escape(tick)}</span>" for tick in ticks)
    return (
        f"<div>{escape(meaning)}</div>"
        f'<div style="height:10px;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between">{numbers}</div>'
    )
