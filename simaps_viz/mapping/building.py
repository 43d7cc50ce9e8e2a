"""A building: a map for each of its floors, and the stairs between them. The file is JSON, ``simaps-building/1``."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.io.limits import MAX_BUILDING_BYTES, read_bytes

FORMAT = "simaps-building/1"
SUFFIX = ".json"
MAX_FLOORS, MAX_STAIRS, MAX_NAME = 500, 10_000, 200
"""Floors and stairs of a building, characters of its name."""


@dataclass(frozen=True)
class Floor:
    """One floor of a building."""

    number: int
    """Counted from 1, the lowest."""
    map: Path
    """The map of this floor: its floor is at z = 0, its x and y are those of all floors."""
    height_m: float
    """Height over the floor that the recording's map frame has at z = 0."""


@dataclass(frozen=True)
class Stairs:
    """Where one gets from a floor to the next one above: stairs, a ramp or a lift, as a camera has gone."""

    lower: int
    """Number of the lower floor; they end on the next."""
    foot_m: tuple[float, float]
    """x and y, map frame, on the lower floor; clear of the stairs."""
    head_m: tuple[float, float]
    """The same on the upper floor."""


@dataclass(frozen=True)
class Building:
    """The floors of a building, the lowest first, and the stairs between them."""

    name: str
    floors: tuple[Floor, ...]
    stairs: tuple[Stairs, ...]

    def floor(self, number: int | None) -> Floor:
        """Return a floor by its number; None: the lowest. Raises InputError where there is none of that number."""
        wanted = self.floors[0].number if number is None else number
        if not 1 <= wanted <= len(self.floors):
            raise InputError(f"{self.name}: expected a floor from 1 to {len(self.floors)}, found {wanted}")
        return self.floors[wanted - 1]


def floor_path(path: Path, number: int) -> Path:
    """Return the path that a floor's file has beside a building's: ``house-floor-2.npz`` beside ``house.npz``."""
    return path.with_name(f"{path.stem}-floor-{number}{path.suffix}")


def is_building(path: Path) -> bool:
    """Return whether a file is a building file, rather than another one that ends in .json."""
    if path.suffix.lower() != SUFFIX or not path.is_file():
        return False
    with path.open("rb") as file:
        return FORMAT.encode() in file.read(4096)


def map_of(path: Path, floor: int | None) -> Path:
    """Return the map file that is meant: a map's own path, or the map of a floor of a building; by default the lowest.

    Raises:
        InputError: there is no such floor, or the file is neither.
    """
    if is_building(path):
        return load_building(path).floor(floor).map
    if floor is not None:
        raise InputError(f"{path}: expected a building file ({SUFFIX}) with --floor, found a map")
    return path


def save_building(building: Building, path: Path) -> None:
    """Write a building file, complete or not at all; its maps have to lie in the same folder."""
    record = {
        "format": FORMAT,
        "name": building.name,
        "floors": [{"number": f.number, "map": f.map.name, "height_m": round(f.height_m, 4)} for f in building.floors],
        "stairs": [
            {"lower": s.lower, "foot_m": [round(v, 4) for v in s.foot_m], "head_m": [round(v, 4) for v in s.head_m]}
            for s in building.stairs
        ],
    }
    write_whole(path, (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode(), "the building")


def load_building(path: Path) -> Building:
    """Read a building file; its maps are opened by `load_map`, one by one.

    Raises:
        InputError: it is missing, damaged, or no ``simaps-building/1`` file.
    """
    data = read_bytes(path, MAX_BUILDING_BYTES, f"a building file ({FORMAT})")
    try:
        return _building(json.loads(data.decode()), path.parent)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        why = ascii(error)[:200]
        raise InputError(f"{path}: expected a complete {FORMAT} file, found otherwise ({why})") from error


def _building(record: Mapping[str, Any], folder: Path) -> Building:
    if record["format"] != FORMAT:
        raise InputError(f"expected format {FORMAT}, found {str(record['format'])[:60]!r}")
    name, rows, stairs = record["name"], record["floors"], record["stairs"]
    if not (isinstance(name, str) and len(name) <= MAX_NAME and name.isprintable()):
        raise InputError(f"expected a name of at most {MAX_NAME} printable characters, found {str(name)[:60]!r}")
    if not 1 <= len(rows) <= MAX_FLOORS or len(stairs) > MAX_STAIRS:
        raise InputError(
            f"expected 1 to {MAX_FLOORS} floors and at most {MAX_STAIRS} stairs, found {len(rows)} and {len(stairs)}"
        )
    floors = tuple(
        Floor(_number(row["number"], i, i), folder / _plain(row["map"]), _metres(row["height_m"]))
        for i, row in enumerate(rows, start=1)
    )
    if any(low.height_m >= high.height_m for low, high in pairwise(floors)):
        raise InputError(f"expected floors from the lowest up, found heights {[f.height_m for f in floors][:20]}")
    return Building(
        name,
        floors,
        tuple(
            Stairs(_number(row["lower"], 1, len(floors) - 1), _point(row["foot_m"]), _point(row["head_m"]))
            for row in stairs
        ),
    )


def _plain(name: Any) -> str:
    """Return the name of a file in the building's own folder."""
    if not isinstance(name, str) or Path(name).name != name or "\\" in name or not name.isprintable():
        raise InputError(f"expected the name of a map in the building's folder, found {str(name)[:60]!r}")
    return name


def _number(value: Any, low: int, high: int) -> int:
    if type(value) is not int or not low <= value <= high:
        raise InputError(f"expected the number of a floor from {low} to {high}, found {str(value)[:60]!r}")
    return value


def _metres(value: Any) -> float:
    if type(value) not in (int, float) or not isfinite(value) or abs(value) > 1e6:
        raise InputError(f"expected metres, found {str(value)[:60]!r}")
    return float(value)


def _point(values: Sequence[Any]) -> tuple[float, float]:
    x, y = values
    return _metres(x), _metres(y)
