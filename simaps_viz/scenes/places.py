"""The embedded places: what is in each, and where the camera walks, read from the JSON file of its name.

A new place is a JSON file here and its name in `NAMES`. Its keys: ``title``, ``about``, ``frames`` and ``width`` of the
pictures; ``floors``: name, [west, south, east, north], material; ``walls``: name, start, end, material of the right and
the left side, openings (`building.WallRun`); ``rooms``: as far as lamps shine, null = no end; ``lights``; ``things``:
name, class, model, x, y, z, yaw in degrees; and ``stations`` of the walk, which is planned where there are none.

A model is a function of `furniture.py` with its arguments, the named ones last: ["desk", "BIRCH", {"length": 1.5}].
A material is a name of `materials.py`, or its colour and texture: "#c69b6d wood".
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.scenes import furniture, materials
from simaps_viz.scenes.building import CEILING_HEIGHT_M, Opening, WallRun, slab, structure
from simaps_viz.scenes.materials import Texture, paint
from simaps_viz.scenes.scene import Scene, assemble, build, place
from simaps_viz.scenes.walk import Station, Walk, plan_stations, sample_walk

NAMES = ("cafe", "home", "office", "canteen", "shop")
_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Place:
    """One place."""

    name: str
    title: str
    """What it is, in a sentence's words: "A flat of our own making"."""
    scene: Callable[[], Scene]
    stations: Callable[[], Sequence[Station]]
    """Where the camera passes and what it turns to, in order."""
    frames: int = 200
    width: int = 640
    """Of the pictures, pixels; they are 4 : 3."""

    def walk(self, frames: int) -> Walk:
        """Return the camera's poses, that many."""
        return sample_walk(self.stations(), frames)

    def sources(self) -> list[Path]:
        """Return the files that make the place and its frames, sorted: its own, and the programs of this folder.

        So another place leaves its frames as they are.
        """
        return sorted(path for path in (_FOLDER / f"{self.name}.json", *_FOLDER.glob("*.py")) if path.is_file())


@cache
def _scene(name: str) -> Scene:
    """Build a whole place (once a process)."""
    told = _read(name)
    floors = [(one, bounds, _made(material)) for one, bounds, material in told["floors"]]
    objects = [build(one, "floor", slab(*bounds, material=material, top=0)) for one, bounds, material in floors]
    corners = np.array([bounds for _, bounds, _ in floors])
    above = (*corners[:, :2].min(axis=0), *corners[:, 2:].max(axis=0))
    objects.append(build("ceiling", "ceiling", slab(*above, material=paint("f4f1ea"), top=CEILING_HEIGHT_M + 0.05)))
    objects += structure(
        WallRun(one, tuple(start), tuple(end), _made(right), _made(left), tuple(Opening(*hole) for hole in openings))
        for one, start, end, right, left, openings in told["walls"]
    )
    objects += [
        place(one, label, _made(model), x, y, z, yaw_deg=yaw) for one, label, model, x, y, z, yaw in told["things"]
    ]
    endless = (-np.inf, -np.inf, np.inf, np.inf)
    rooms: Any = tuple(
        tuple(end if at is None else at for at, end in zip(room, endless, strict=True)) for room in told["rooms"]
    )
    return assemble(objects, rooms_m=rooms, lights_m=tuple(tuple(light) for light in told["lights"]))


def _stations(name: str) -> Sequence[Station]:
    return [tuple(row) for row in _read(name).get("stations", ())] or plan_stations(_scene(name))


def _made(told: Any) -> Any:
    """Make the model, material or other argument that a place's file tells."""
    if isinstance(told, str):
        color, _, texture = told.removeprefix("#").partition(" ")
        if told.startswith("#"):
            return paint(color, Texture[texture.upper()] if texture else Texture.PLAIN)
        return getattr(materials, told) if told.isupper() else told
    if not isinstance(told, list):
        return told
    if not told or not isinstance(told[0], str) or not hasattr(furniture, told[0]):
        return tuple(_made(one) for one in told)
    named = told[-1] if isinstance(told[-1], dict) else {}
    arguments = told[1:-1] if named else told[1:]
    return getattr(furniture, told[0])(*map(_made, arguments), **{key: _made(one) for key, one in named.items()})


@cache
def _read(name: str) -> Mapping[str, Any]:
    return json.loads((_FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def _place(name: str) -> Place:
    told = _read(name)
    return Place(name, told["title"], partial(_scene, name), partial(_stations, name), told["frames"], told["width"])


PLACES: dict[str, Place] = {name: _place(name) for name in NAMES}


def place_of(name: str) -> Place:
    """Return the place of a name; raises InputError when there is none."""
    if name not in PLACES:
        raise InputError(f"place: expected one of {', '.join(PLACES)}, found {name!r}")
    return PLACES[name]
