"""Instances as plain records: what tables, polygons and scenes tell of each."""

from typing import Any

from simaps_viz.colors.classes import class_color
from simaps_viz.colors.instances import class_colors, instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.structures import Instance, SIMap


def node_name(instance: Instance) -> str:
    """Name an instance as it is called in every export, e.g. "chair-7": its class and id."""
    return f"{instance.label}-{instance.id}"


def color_of(simap: SIMap, instance: Instance) -> Color:
    """Return the instance's colour on the page, RGB, 0-255."""
    r, g, b = instance_colors(simap)[instance.id].tolist()
    return (r, g, b)


def label_colors(simap: SIMap) -> list[Color]:
    """Return every class of ``simap.grid.labels`` its colour on the page, RGB, 0-255."""
    things = class_colors(simap)
    return [things.get(name, class_color(name)) for name in simap.grid.labels]


def hex_color(simap: SIMap, instance: Instance) -> str:
    """Return the instance's colour on the page, "#rrggbb"."""
    return "#{:02x}{:02x}{:02x}".format(*color_of(simap, instance))


def record(simap: SIMap, instance: Instance) -> dict[str, Any]:
    """Return an instance flat and JSON-able; lengths in metres of the map frame."""
    (x_min, y_min, z_min), (x_max, y_max, z_max) = instance.aabb_m
    x, y, z = instance.centroid_m
    metres = {
        "x_m": x, "y_m": y, "z_m": z, "x_min_m": x_min, "y_min_m": y_min, "z_min_m": z_min,
        "x_max_m": x_max, "y_max_m": y_max, "z_max_m": z_max,
    }  # fmt: skip
    return {
        "id": instance.id,
        "name": node_name(instance),
        "label": instance.label,
        "cells": instance.cells,
        "area_m2": round(instance.area_m2(simap.spec.cell_size_m), 6),
        **{key: round(value, 6) for key, value in metres.items()},
        "frames": instance.frames,
        "score": round(instance.score, 6),
        "color": hex_color(simap, instance),
    }


def origin(simap: SIMap) -> dict[str, Any]:
    """Describe where an export comes from, JSON-able."""
    return {
        "name": simap.provenance.get("name"),
        "method": simap.method,
        "segmentation": simap.provenance.get("segmentation"),
        "simulated": bool(simap.provenance.get("simulated", False)),
    }
