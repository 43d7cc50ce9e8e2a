"""What the colours mean and what is on the map, as text and as small pieces of HTML."""

from html import escape

import cv2
import numpy as np

from simaps_viz.labels import class_color, instance_color
from simaps_viz.structures import Instance, SIMap
from simaps_viz.viewer.texture import CLUTTER, FLOOR, HEIGHT_TOP_M, UNSEEN, WALL, ColorMode

MOST_CHIPS = 40
"""Instances of a class that get their own colour chip; more are summed up."""

Color = tuple[int, int, int]


def plural(count: int, noun: str) -> str:
    """Say how many, in English: "1 chair", "4 benches"."""
    if count == 1:
        return f"1 {noun}"
    if noun.endswith("person"):
        return f"{count} {noun[:-6]}people"
    if noun.endswith("knife"):
        return f"{count} {noun[:-2]}ves"
    if noun.endswith(("scissors", "skis")):
        return f"{count} {noun}"
    ending = "es" if noun.endswith(("s", "x", "ch", "sh")) else "s"
    return f"{count} {noun}{ending}"


def counts_text(simap: SIMap, most: int = 4) -> str:
    """Say what is on the map: "17 chairs, 4 dining tables · 21 instances"; rare classes are summed up."""
    if not simap.instances:
        return "No instances"
    parts = [plural(n, label) for label, n in simap.counts().items()]
    if len(parts) > most + 1:
        parts = [*parts[:most], f"{len(parts) - most} more classes"]
    return f"{', '.join(parts)} · {plural(len(simap.instances), 'instance')}"


def object_name(simap: SIMap, instance: Instance) -> str:
    """Name an instance among its class: "chair 7 of 17"."""
    siblings = [other.id for other in simap.of_class(instance.label)]
    return f"{instance.label} {siblings.index(instance.id) + 1} of {len(siblings)}"


def facts_text(simap: SIMap, instance: Instance) -> str:
    """Say how large an instance is and how often it was seen: "62 cells · 0.16 m² · seen in 38 frames"."""
    area = instance.area_m2(simap.spec.cell_size_m)
    return f"{plural(instance.cells, 'cell')} · {area:.2f} m² · seen in {plural(instance.frames, 'frame')}"


def facts_html(simap: SIMap, instance: Instance) -> str:
    """Describe an instance in full: name, facts, place, size, score."""
    (x0, y0, _), (x1, y1, top) = instance.aabb_m
    x, y, _ = instance.centroid_m
    rows = (
        ("Position", f"x {x:.2f} m, y {y:.2f} m (map frame)"),
        ("Size", f"{x1 - x0:.2f} × {y1 - y0:.2f} m, top at {top:.2f} m"),
        ("Score", f"{instance.score:.2f} mean confidence"),
    )
    table = "".join(f'<tr><td style="opacity:.6;padding-right:.8em">{k}</td><td>{escape(v)}</td></tr>' for k, v in rows)
    return (
        '<div style="padding:.4em .8em .5em;font-size:.82em;line-height:1.5">'
        '<div style="font-size:1.15em;font-weight:600">'
        f"{_chip(instance_color(instance.id), 12)}{escape(object_name(simap, instance))}</div>"
        f"<div>{escape(facts_text(simap, instance))}</div>"
        f'<table style="border-spacing:0;margin-top:.3em">{table}</table></div>'
    )


def legend_html(simap: SIMap, mode: ColorMode) -> str:
    """Explain every colour of a mode."""
    if mode == "height":
        return _box(_bar("0 m", f"{HEIGHT_TOP_M:g} m and more", "height of the highest point over the floor"))
    if mode == "observations":
        most = int(simap.grid.observations.max(initial=0))
        return _box(_bar("0", plural(most, "frame"), "frames that saw the cell, logarithmic"))
    rows = []
    for label, count in simap.counts().items():
        ids = [i.id for i in simap.of_class(label)]
        if mode == "class":
            chips = _chip(class_color(label), 12)
            rows.append(f"<div>{chips}{escape(label)} <b>{count}</b></div>")
            continue
        chips = "".join(_chip(instance_color(i), 9, gap=2) for i in ids[:MOST_CHIPS])
        rest = f" +{count - MOST_CHIPS}" if count > MOST_CHIPS else ""
        rows.append(f'<div><span style="margin-right:.6em">{escape(label)} <b>{count}</b></span>{chips}{rest}</div>')
    ground = (("wall", WALL), ("not named", CLUTTER), ("floor", FLOOR), ("never seen", UNSEEN))
    rows.append(
        '<div style="margin-top:.5em;opacity:.85">'
        + "".join(
            f'<span style="white-space:nowrap;margin-right:.9em">{_chip(color, 10)}{name}</span>'
            for name, color in ground
        )
        + "</div>"
    )
    return _box("".join(rows))


def _box(inner: str) -> str:
    return f'<div style="padding:.2em .8em .4em;font-size:.82em;line-height:1.55">{inner}</div>'


def _chip(color: Color, size: int, gap: int = 6) -> str:
    return (
        f'<span style="display:inline-block;width:{size}px;height:{size}px;border-radius:2px;'
        f'margin-right:{gap}px;background:rgb{color};box-shadow:inset 0 0 0 1px rgba(0,0,0,.18)"></span>'
    )


def _bar(low: str, high: str, meaning: str) -> str:
    steps = np.linspace(0, 255, 9).astype(np.uint8).reshape(1, -1)
    colors = cv2.cvtColor(cv2.applyColorMap(steps, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)[0]
    stops = ",".join(f"rgb({r},{g},{b})" for r, g, b in colors.tolist())
    return (
        f"<div>{escape(meaning)}</div>"
        f'<div style="height:10px;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between"><span>{escape(low)}</span>'
        f"<span>{escape(high)}</span></div>"
    )
