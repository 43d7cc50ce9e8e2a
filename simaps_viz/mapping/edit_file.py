"""The edits file, ``simap-edits/1``: MAP.edits.json beside MAP.npz; JSON, written whole or not at all.

It names the map it belongs to by a fingerprint of what edits build on: the grid with its classes and heights. Another
K, affinity or resolution leaves that alone, new frames or another segmentation do not.
"""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.files import write_whole
from simaps_viz.limits import MAX_EDITS_BYTES, check_cells, check_file
from simaps_viz.mapping.edit_log import EditLog, Entry, signature
from simaps_viz.mapping.edits import LONGEST_LABEL, Delete, Edit, Merge, Point, Region, Relabel, Split
from simaps_viz.structures import GridSpec, SIMap

FORMAT = "simap-edits/1"
_KINDS: Mapping[type, str] = {Merge: "merge", Split: "split", Relabel: "relabel", Delete: "delete"}


@dataclass(frozen=True)
class EditsFile:
    """What an edits file says."""

    fingerprint: str
    spec: GridSpec
    """Of the map whose cells the edits name."""
    log: EditLog


def edits_path(map_path: Path) -> Path:
    """Give where the edits of a map file are kept: cafe.npz -> cafe.edits.json."""
    return Path(map_path).with_suffix(".edits.json")


def fingerprint(simap: SIMap) -> str:
    """Give 32 hexadecimal digits that stand for the map's grid, classes and heights."""
    grid = simap.grid
    digest = hashlib.blake2b(json.dumps([asdict(grid.spec), grid.labels]).encode(), digest_size=16)
    for array in (grid.label, grid.height_m):
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def to_bytes(contents: EditsFile, map_name: str) -> bytes:
    """Write the contents of an edits file."""
    record = {
        "format": FORMAT,
        "map": {"file": map_name, "fingerprint": contents.fingerprint, "grid": asdict(contents.spec)},
        "edits": [_entry_json(entry) for entry in contents.log.entries],
        "undone": [_entry_json(entry) for entry in contents.log.undone],
    }
    return (json.dumps(record, ensure_ascii=False, indent=1) + "\n").encode()


def save_edits(path: Path, contents: EditsFile, map_name: str) -> bytes:
    """Write an edits file and give its bytes; an earlier file is replaced once the new one is complete on disk.

    Raises:
        InputError: it cannot be written; an earlier one is left as it was.
    """
    data = to_bytes(contents, map_name)
    write_whole(path, data, "the edits")
    return data


def read_edits(path: Path) -> tuple[EditsFile, bytes]:
    """Read an edits file; also gives its bytes.

    Raises:
        InputError: it is missing, damaged, or no ``simap-edits/1`` file. It is left as it is.
    """
    path = Path(path)
    check_file(path, MAX_EDITS_BYTES, "a file of edits")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: expected a file of edits, found: {error.strerror or error}") from error
    try:
        record = json.loads(data.decode())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected a whole {FORMAT} file, found damaged JSON ({error})") from error
    try:
        return _contents(record), data
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        why = ascii(error)[:200]
        raise InputError(f"{path}: expected a whole {FORMAT} file, found otherwise ({why})") from error


def moved_to(contents: EditsFile, simap: SIMap) -> EditsFile:
    """Move edits to another grid, by place: a cell becomes the cell that holds its centre; what lies outside is lost.

    Raises:
        InputError: the cells are of another size.
    """
    old, new = contents.spec, simap.spec
    if abs(old.cell_size_m - new.cell_size_m) > 1e-9:
        raise InputError(
            f"edits: expected a map with cells of {old.cell_size_m:g} m, found one with {new.cell_size_m:g} m"
        )

    def move(entry: Entry) -> Entry:
        return replace(entry, edit=replace(entry.edit, region=_moved(entry.edit.region, old, new)))

    log = EditLog(tuple(map(move, contents.log.entries)), tuple(map(move, contents.log.undone)))
    return EditsFile(fingerprint(simap), new, log)


def _moved(region: Region, old: GridSpec, new: GridSpec) -> Region:
    row, col = np.divmod(region.cells(), old.cols)
    s = new.cell_size_m
    row = np.floor((old.y0_m - new.y0_m) / s + row + 0.5 + 1e-6).astype(np.int64)
    col = np.floor((old.x0_m - new.x0_m) / s + col + 0.5 + 1e-6).astype(np.int64)
    inside = (row >= 0) & (row < new.rows) & (col >= 0) & (col < new.cols)
    return Region.of(np.unique(row[inside] * new.cols + col[inside]))


def _entry_json(entry: Entry) -> dict[str, Any]:
    edit = entry.edit
    record = {"who": entry.who, "when": entry.when, "do": _KINDS[type(edit)]}
    record |= {name: value for name, value in vars(edit).items() if name != "region"}
    return record | {"cells": edit.region.runs}


def _contents(record: Any) -> EditsFile:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        found = record.get("format") if isinstance(record, dict) else type(record).__name__
        raise InputError(f"expected format {FORMAT}, found {found!r}")
    where = record["map"]
    grid = where["grid"]
    spec = GridSpec(
        _whole(grid["rows"]), _whole(grid["cols"]),
        *(_number(grid[name]) for name in ("cell_size_m", "x0_m", "y0_m")),
    )  # fmt: skip
    check_cells("grid", spec.rows, spec.cols)
    if spec.rows < 1 or spec.cols < 1 or not spec.cell_size_m > 0.0:
        raise InputError(f"expected a grid with cells, found {spec.rows} x {spec.cols} of {spec.cell_size_m:g} m")
    log = EditLog(*(_entries(record[name], name, spec) for name in ("edits", "undone")))
    return EditsFile(_text(where["fingerprint"]), spec, log)


def _entries(records: Any, name: str, spec: GridSpec) -> tuple[Entry, ...]:
    if not isinstance(records, list):
        raise InputError(f"{name}: expected a list, found {type(records).__name__}")
    return tuple(_entry(record, f"{name}[{i}]", spec) for i, record in enumerate(records))


def _entry(record: Any, name: str, spec: GridSpec) -> Entry:
    try:
        when = _text(record["when"])
        datetime.strptime(when, "%Y-%m-%dT%H:%M:%SZ")
        kind = _text(record["do"])
        if kind not in _READ:
            raise InputError(f"do: expected one of {', '.join(_READ)}, found {kind!r}")
        return Entry(_READ[kind](record, _region(record["cells"], spec)), signature(_text(record["who"])), when)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{name}: expected a whole edit, found otherwise ({error!r})") from error


def _region(records: Any, spec: GridSpec) -> Region:
    runs = tuple((_whole(first), _whole(length)) for first, length in records)
    end = -1
    for first, length in runs:
        if first <= end or length < 1 or first + length > spec.rows * spec.cols:
            raise InputError(f"cells: expected ascending runs on the grid, found {[first, length]}")
        end = first + length
    return Region(runs)


def _merge(record: Mapping[str, Any], region: Region) -> Merge:
    (first, second), (a, b) = record["objects"], record["was"]
    return Merge((_whole(first), _whole(second)), (_class(a), _class(b)), _class(record["label"]), region)


def _split(record: Mapping[str, Any], region: Region) -> Split:
    start, end = (_point(point) for point in record["line_m"])
    if start == end:
        raise InputError("line_m: expected two different points, found the same twice")
    return Split(_whole(record["object"]), _class(record["label"]), region, (start, end))


def _relabel(record: Mapping[str, Any], region: Region) -> Relabel:
    (was,) = record["was"]
    return Relabel(_whole(record["object"]), (_class(was),), _class(record["label"]), region)


def _delete(record: Mapping[str, Any], region: Region) -> Delete:
    (was,) = record["was"]
    return Delete(_whole(record["object"]), (_class(was),), region)


_READ: dict[str, Callable[[Mapping[str, Any], Region], Edit]] = {
    "merge": _merge, "split": _split, "relabel": _relabel, "delete": _delete,
}  # fmt: skip


def _point(values: Sequence[Any]) -> Point:
    x, y = values
    return _number(x), _number(y)


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise InputError(f"expected a whole number, found {value!r}")
    return value


def _number(value: Any) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not np.isfinite(value):
        raise InputError(f"expected a number, found {value!r}")
    return float(value)


def _text(value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable():
        raise InputError(f"expected text, found {value!r:.90}")
    return value


def _class(value: Any) -> str:
    text = _text(value)
    if not text or len(text) > 2 * LONGEST_LABEL or text == "none" or not text.isprintable():
        raise InputError(f"expected the name of a class, found {text[:90]!r}")
    return text
