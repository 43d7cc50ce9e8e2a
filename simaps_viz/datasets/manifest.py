"""The manifest of a ``posed-frames/1`` sequence: which files there are and what their numbers mean."""

import difflib
import json
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_JSON_BYTES, read_bytes

FORMAT = "posed-frames/1"
POSE = "T_world_camera"
CAMERA_AXES = "x right, y down, z forward"

_REQUIRED = ("format", "color", "depth", "depth_unit_m", "intrinsics", "poses")
_OPTIONAL = ("name", "description", "simulated", "pose", "camera_axes", "up", "floor_height_m", "segmentation")
_SEGMENTATION_KEYS = ("ids", "segments", "instances", "source", "ground_truth")


@dataclass(frozen=True)
class SegmentationFiles:
    """Files of the precomputed segmentation."""

    ids: str
    """Pattern with ``{frame}``: one id image per frame."""
    table: str
    """The file that describes the ids: segments of each frame, or instances of the world."""
    world_wide: bool
    """The ids mean the same in every frame (key ``instances``), so they are the truth about instances."""
    source: str
    ground_truth: bool


@dataclass(frozen=True)
class Manifest:
    """A checked manifest; paths are relative to its folder."""

    path: Path
    name: str
    color: str
    depth: str
    depth_unit_m: float
    intrinsics: str
    poses: str
    up: tuple[float, float, float] | None
    """World frame, any length; None = to be estimated."""
    floor_height_m: float | None
    """Height of the floor along ``up``; None = to be estimated."""
    segmentation: SegmentationFiles | None
    simulated: bool
    description: str

    def file(self, pattern: str, frame: str = "") -> Path:
        """Return the path a pattern means for a frame."""
        return self.path.parent / pattern.replace("{frame}", frame)


def read_manifest(path: Path) -> Manifest:
    """Read and check a manifest.

    Args:
        path: The sequence's folder (with a ``sequence.json``) or a manifest of any name.

    Raises:
        InputError: It is missing, not JSON, of another format, lacks a key, or has an unknown or wrong one.
    """
    path = _manifest_path(path)
    keys = KeyTable(str(path), read_json(path), _REQUIRED + _OPTIONAL, first="format")
    if keys.text("format") != FORMAT:
        raise InputError(f'{path}: format: expected "{FORMAT}", found {shown(keys.values["format"])}')
    keys.check_known()
    keys.one_of("pose", POSE)
    keys.one_of("camera_axes", CAMERA_AXES)
    unit = keys.number("depth_unit_m")
    if unit <= 0:
        raise InputError(f"{path}: depth_unit_m: expected metres per step, more than 0, found {shown(unit)}")
    segmentation = segmentation_files(path, keys.values["segmentation"]) if "segmentation" in keys.values else None
    source = segmentation.source if segmentation else ""
    return Manifest(
        path=path,
        name=keys.text("name", path.resolve().parent.name),
        color=keys.pattern("color"),
        depth=keys.pattern("depth"),
        depth_unit_m=unit,
        intrinsics=keys.file("intrinsics"),
        poses=keys.file("poses"),
        up=keys.direction("up"),
        floor_height_m=keys.number("floor_height_m") if "floor_height_m" in keys.values else None,
        segmentation=segmentation,
        simulated=keys.flag("simulated", False) or source.lower().startswith("simulated"),
        description=keys.text("description", ""),
    )


def read_json(path: Path) -> Any:
    """Read a JSON file; raises InputError when it is missing, too large, not text, not JSON or has a key twice."""
    return parse_json(path, read_bytes(path, MAX_JSON_BYTES, "a JSON file"))


def parse_json(path: object, data: bytes) -> Any:
    """Read JSON from the bytes of a file, like `read_json`; ``path`` names it in an error."""
    try:
        return json.loads(data.decode("utf-8-sig"), object_pairs_hook=_once)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: expected JSON, found bytes that are not UTF-8 text") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: expected JSON, found an error in line {error.lineno}: {error.msg}") from error
    except _TwiceError as error:
        raise InputError(f"{path}: expected each key once, found {error}") from error
    except (RecursionError, ValueError) as error:  # nested too deeply; a whole number of thousands of digits
        raise InputError(f"{path}: expected JSON of sensible depth and numbers, found neither") from error


def shown(value: Any) -> str:
    """Show a value found in a file, in JSON's spelling, short enough for a message of one line."""
    try:
        text = json.dumps(value, ensure_ascii=False, default=repr)
    except (RecursionError, ValueError):  # nested too deeply; a number of thousands of digits
        text = f"{type(value).__name__} that is too long to show"
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text[:61])
    return text if len(text) <= 60 else text[:57] + "..."


def few(names: Sequence[object]) -> str:
    """List the first three of many."""
    return ", ".join(map(str, names[:3])) + (", ..." if len(names) > 3 else "")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make a JSON object; a duplicate key is an error, as either value could be meant."""
    values = dict(pairs)
    if len(values) != len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise _TwiceError(f"the key {shown(twice)} twice")
    return values


class _TwiceError(ValueError):
    pass


def _manifest_path(path: Path) -> Path:
    if not path.is_dir():
        if path.suffix != ".json" or not path.exists():
            is_map = "a map, which simaps view, query and export open" if path.suffix == ".npz" else ""
            found = (is_map or "another kind of file") if path.exists() else "nothing"
            raise InputError(f"{path}: expected a recording of a format that is read, or a manifest, found {found}")
        return path
    manifest = path / "sequence.json"
    if not manifest.exists():
        others = sorted(p.name for p in path.glob("*.json"))[:3]
        found = f"only {', '.join(others)}" if others else "none"
        raise InputError(f"{manifest}: expected the sequence's manifest there, found {found}")
    return manifest


def segmentation_files(path: Path, values: Any) -> SegmentationFiles:
    """Read and check the value of the key ``segmentation``; raises InputError like ``read_manifest``."""
    keys = KeyTable(f"{path}: segmentation", values, _SEGMENTATION_KEYS, first="ids")
    keys.check_known()
    tables = [key for key in ("segments", "instances") if key in keys.values]
    if len(tables) != 1:
        found = " and ".join(tables) or "neither"
        raise InputError(f'{path}: segmentation: expected either "segments" or "instances", found {found}')
    world_wide = tables[0] == "instances"
    return SegmentationFiles(
        ids=keys.pattern("ids"),
        table=keys.file(tables[0]),
        world_wide=world_wide,
        source=keys.text("source", "unknown"),
        ground_truth=keys.flag("ground_truth", world_wide),
    )


class KeyTable:
    """A JSON object that is read key by key; every complaint starts with ``where``."""

    def __init__(self, where: str, values: Any, known: Collection[str], *, first: str) -> None:
        if not isinstance(values, dict):
            raise InputError(f'{where}: expected an object with "{first}" and more, found {shown(values)}')
        self.where, self.values, self.known = where, values, known

    def check_known(self) -> None:
        """Raise InputError for the first key that the format does not have: a typo must not go unnoticed."""
        for key in self.values:
            if key not in self.known:
                near = difflib.get_close_matches(key, self.known, n=1, cutoff=0.5)
                hint = f'did you mean "{near[0]}"?' if near else f"known are {', '.join(self.known)}"
                raise InputError(f"{self.where}: expected only known keys, found {shown(key)}; {hint}")

    def text(self, key: str, default: str | None = None) -> str:
        """Return a string that is not blank; without a default it has to be there."""
        if key not in self.values and default is not None:
            return default
        value = self.values.get(key)
        if not isinstance(value, str) or (not value.strip() and default is None):
            raise self._wrong(key, "a string")
        return value

    def file(self, key: str) -> str:
        """Return a path relative to the manifest."""
        value = self.text(key)
        if Path(value).is_absolute() or not value.isprintable():
            raise self._wrong(key, "a printable path relative to the manifest")
        return value

    def pattern(self, key: str) -> str:
        """Return a relative path that holds ``{frame}``."""
        value = self.file(key)
        if "{frame}" not in value:
            raise self._wrong(key, "a path with {frame} in it")
        return value

    def number(self, key: str) -> float:
        """Return a finite number."""
        value = self.values.get(key)
        if value is None or not is_finite_number(value):
            raise self._wrong(key, "a number")
        return float(value)

    def direction(self, key: str) -> tuple[float, float, float] | None:
        """Return three numbers that are not all zero, or None when absent."""
        if key not in self.values:
            return None
        value = self.values[key]
        if isinstance(value, list) and len(value) == 3 and all(map(is_finite_number, value)):
            x, y, z = map(float, value)
            if 1e-6 < math.hypot(x, y, z) < 1e6:
                return (x, y, z)
        raise self._wrong(key, "three finite numbers that are not all zero")

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            raise self._wrong(key, "true or false")
        return value

    def one_of(self, key: str, supported: str) -> None:
        """Raise InputError unless the key is absent or has the only supported value."""
        if self.values.get(key, supported) != supported:
            raise self._wrong(key, f'"{supported}", the only supported value')

    def _wrong(self, key: str, expected: str) -> InputError:
        found = shown(self.values[key]) if key in self.values else "no such key"
        return InputError(f"{self.where}: {key}: expected {expected}, found {found}")


def is_finite_number(value: Any) -> bool:
    """Return whether a value of a JSON file is a finite number of sensible size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300  # NaN is not less
