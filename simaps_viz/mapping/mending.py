"""Editing a map that people look at: edits are made, undone, saved beside the map, and applied when it is opened.

Who made an edit and when is kept, and which were undone. An edits file is JSON of format ``simap-edits/1``, named
MAP.edits.json. It names the map by a fingerprint of its grid, as its cells mean nothing on another one.
"""

import hashlib
import json
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.io.files import write_whole
from simaps_viz.io.limits import MAX_EDITS_BYTES, check_cells, read_bytes
from simaps_viz.mapping.edits import (
    CUTS,
    LABELLED,
    MAKERS,
    MAX_LABEL_LENGTH,
    TWO,
    Edit,
    Edited,
    EditRefused,
    Point,
    Region,
    apply_edits,
    describe_by_class,
    describe_by_id,
    describe_by_number,
)
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.structures import GridSpec, SIMap

FORMAT = "simap-edits/1"
MAX_NAME_LENGTH = 80
"""Characters of a person's name."""


@dataclass(frozen=True)
class Entry:
    """One edit, signed and dated."""

    edit: Edit
    who: str
    when: str
    """ISO 8601, UTC, whole seconds: 2026-11-21T19:30:00Z."""

    def to_json(self) -> dict[str, str]:
        """Return who did what, when."""
        return {"who": self.who, "when": self.when, "what": describe_by_id(self.edit)}


@dataclass(frozen=True)
class EditLog:
    """The edits of a map in the order they were made, whoever made them; every change returns a new log."""

    entries: tuple[Entry, ...] = ()
    undone: tuple[Entry, ...] = ()
    """Those that `redo` makes again, the next one last."""

    def add(self, edit: Edit, *, who: str, when: str | None = None) -> "EditLog":
        """Return the log with one more edit; edits that were undone can no longer be redone.

        Raises:
            InputError: the name of the person is empty, too long or not printable.
        """
        return EditLog((*self.entries, Entry(edit, signature(who), when or now())))

    def undo(self) -> "EditLog":
        """Return the log without its last edit.

        Raises:
            InputError: it has none.
        """
        if not self.entries:
            raise EditRefused("undo: expected an edit to take back, found none", "There is nothing to undo.")
        return EditLog(self.entries[:-1], (*self.undone, self.entries[-1]))

    def redo(self) -> "EditLog":
        """Return the log with the edit that was undone last.

        Raises:
            InputError: there is none.
        """
        if not self.undone:
            raise EditRefused("redo: expected an edit that was taken back, found none", "There is nothing to redo.")
        return EditLog((*self.entries, self.undone[-1]), self.undone[:-1])


def apply_log(simap: SIMap, log: EditLog) -> Edited:
    """Apply the edits of a log to a map that has none yet.

    The provenance of the edited map lists under ``edits`` who did what, when, and the ids of the resulting instances.
    """
    edited = apply_edits(simap, [entry.edit for entry in log.entries])
    if edited.simap is simap:
        return edited
    refused = {i for i, _ in edited.refused}
    instance = edited.simap.instance.reshape(-1)
    applied = []
    for i, entry in enumerate(log.entries):
        if i not in refused:
            ids = np.unique(instance[entry.edit.region.cells()]) if not entry.edit.of_room else np.zeros(0, np.int32)
            applied.append({**entry.to_json(), "instances": ids[ids > 0].tolist()})
    edits = [*simap.provenance.get("edits", []), *applied]
    return replace(edited, simap=replace(edited.simap, provenance={**simap.provenance, "edits": edits}))


def edits_of(simap: SIMap, instance_id: int) -> list[dict[str, Any]]:
    """Return the edits that made an instance what it is, as in the provenance; none where nobody edited it."""
    return [edit for edit in simap.provenance.get("edits", []) if instance_id in edit.get("instances", [])]


def people_in_words(edits: Iterable[Mapping[str, Any]]) -> str:
    """Return how many edits there are and by whom, "3 edits: 2 by Ann, 1 by Bo"; empty when there are none."""
    names = [str(edit.get("who")) for edit in edits]
    if not names:
        return ""
    each = sorted(set(names), key=lambda name: (-names.count(name), name))
    count = f"{len(names)} edit{'s' if len(names) > 1 else ''}"
    return f"{count}: {', '.join(f'{names.count(name)} by {name}' for name in each)}"


def signature(who: str) -> str:
    """Return a person's name with single spaces; raises InputError unless it is one."""
    name = " ".join(who.split())
    if not name or len(name) > MAX_NAME_LENGTH or not name.isprintable():
        raise EditRefused(
            f"name: expected who makes the edit, in 1 to {MAX_NAME_LENGTH} characters, found {who[:90]!r}",
            f"Write your name below, in 1 to {MAX_NAME_LENGTH} characters: edits are signed with it.",
        )
    return name


def now() -> str:
    """Return the current time, ISO 8601, UTC, whole seconds."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


@dataclass(frozen=True)
class EditsFile:
    """The contents of an edits file."""

    fingerprint: str
    """Of the map whose cells the edits name, see `fingerprint`."""
    spec: GridSpec
    """The grid of that map."""
    log: EditLog


def edits_path(map_path: Path) -> Path:
    """Return the path of the edits of a map file: cafe.npz -> cafe.edits.json."""
    return Path(map_path).with_suffix(".edits.json")


def fingerprint(simap: SIMap) -> str:
    """Return a hash of the map's grid, classes and heights, 32 hexadecimal digits."""
    grid = simap.grid
    digest = hashlib.blake2b(json.dumps([asdict(grid.spec), grid.labels]).encode(), digest_size=16)
    for array in (grid.label, grid.height_m):
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def to_bytes(contents: EditsFile, map_name: str) -> bytes:
    """Return the contents of an edits file as bytes."""
    record = {
        "format": FORMAT,
        "map": {"file": map_name, "fingerprint": contents.fingerprint, "grid": asdict(contents.spec)},
        "edits": [_entry_json(entry) for entry in contents.log.entries],
        "undone": [_entry_json(entry) for entry in contents.log.undone],
    }
    return (json.dumps(record, ensure_ascii=False, indent=1) + "\n").encode()


def save_edits(path: Path, contents: EditsFile, map_name: str) -> bytes:
    """Write an edits file and return its bytes; an earlier file is replaced once the new one is complete on disk.

    Raises:
        InputError: it cannot be written; an earlier one is left as it was.
    """
    data = to_bytes(contents, map_name)
    write_whole(path, data, "the edits")
    return data


def read_edits(path: Path) -> tuple[EditsFile, bytes]:
    """Return the contents of an edits file, and its bytes.

    Raises:
        InputError: it is missing, damaged, or no ``simap-edits/1`` file.
    """
    path = Path(path)
    data = read_bytes(path, MAX_EDITS_BYTES, "a file of edits")
    try:
        record = json.loads(data.decode())
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected a complete {FORMAT} file, found damaged JSON ({error})") from error
    try:
        return _contents(record), data
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        why = ascii(error)[:200]
        raise InputError(f"{path}: expected a complete {FORMAT} file, found otherwise ({why})") from error


def moved_to(contents: EditsFile, simap: SIMap) -> EditsFile:
    """Move edits to another grid by position: a cell becomes the cell that holds its centre, if there is one.

    Raises:
        InputError: the cells of the other grid have another size.
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
    record = {"who": entry.who, "when": entry.when, "do": edit.kind}
    record |= {_ids_name(edit.kind): edit.ids if edit.kind in TWO else edit.ids[0], "was": edit.was}
    record |= {name: value for name in ("label", "line_m") if (value := getattr(edit, name))}
    return record | {"cells": edit.region.runs}


def _ids_name(kind: str) -> str:
    """Return what an edit of a kind calls its ids in the file."""
    return {"merge": "objects", "join-rooms": "rooms"}.get(kind, "room" if kind.endswith("-room") else "object")


def _contents(record: Any) -> EditsFile:
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        found = record.get("format") if isinstance(record, dict) else type(record).__name__
        raise InputError(f"expected format {FORMAT}, found {found!r}")
    where = record["map"]
    grid = where["grid"]
    spec = GridSpec(
        _integer(grid["rows"]), _integer(grid["cols"]),
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
        if kind not in MAKERS:
            raise InputError(f"do: expected one of {', '.join(MAKERS)}, found {kind!r}")
        return Entry(_edit(kind, record, _region(record["cells"], spec)), signature(_text(record["who"])), when)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{name}: expected a complete edit, found otherwise ({error!r})") from error


def _region(records: Any, spec: GridSpec) -> Region:
    runs = tuple((_integer(first), _integer(length)) for first, length in records)
    end = -1
    for first, length in runs:
        if first <= end or length < 1 or first + length > spec.rows * spec.cols:
            raise InputError(f"cells: expected ascending runs on the grid, found {[first, length]}")
        end = first + length
    return Region(runs)


def _edit(kind: str, record: Mapping[str, Any], region: Region) -> Edit:
    was = tuple(map(_class, record["was"] if "was" in record else [record["label"]]))
    ids = record[_ids_name(kind)]
    ids = tuple(map(_integer, ids if kind in TWO else [ids]))
    if not len(ids) == len(was) == 1 + (kind in TWO):
        raise InputError(f"expected {1 + (kind in TWO)} of ids and of classes, found {len(ids)} and {len(was)}")
    label = was[0] if kind == "split" else _class(record["label"]) if kind in LABELLED else ""
    line = None
    if kind in CUTS:
        start, end = (_point(point) for point in record["line_m"])
        if start == end:
            raise InputError("line_m: expected two different points, found the same twice")
        line = (start, end)
    return Edit(kind, ids, was, region, label, line)


def _point(values: Sequence[Any]) -> Point:
    x, y = values
    return _number(x), _number(y)


def _integer(value: Any) -> int:
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
    if not text or len(text) > 2 * MAX_LABEL_LENGTH or text == "none" or not text.isprintable():
        raise InputError(f"expected the name of a class, found {text[:90]!r}")
    return text


class Mending:
    """One map and its edits, shared by all pages that show it; every change is on disk before it is shown.

    A page may show the map for another K, affinity or resolution: methods take the map that is shown and return the
    edited map for the same parameters.
    """

    def __init__(
        self, simap: SIMap, log: EditLog, path: Path, *, map_name: str = "", on_disk: bytes | None = None
    ) -> None:
        """Take a map and its edits.

        Args:
            simap: the map as built, without edits.
            log: its edits.
            path: the edits file.
            map_name: the name of the map in that file.
            on_disk: the contents of the edits file; None when there is none.
        """
        self.original, self.path = simap, path
        self._log, self._map_name, self._on_disk = log, map_name, on_disk
        self._base = simap
        self._fingerprint: str | None = None
        self._waiting = False
        self._descriptions: dict[Entry, str] = {}
        self._refused: tuple[EditLog, tuple[str, ...]] = (EditLog(), ())
        self._lock = threading.RLock()

    @property
    def log(self) -> EditLog:
        """The edits so far."""
        return self._log

    @property
    def saved(self) -> bool:
        """Whether there is an edits file."""
        return self._on_disk is not None

    def simap(self) -> SIMap:
        """Return the map with its edits, for the parameters it was built with."""
        return apply_log(self.original, self._log).simap

    def refused(self) -> tuple[str, ...]:
        """Return, for each edit that no longer makes sense on the map, why."""
        with self._lock:
            if self._refused[0] is not self._log:
                self._refused = self._log, tuple(why for _, why in apply_log(self.original, self._log).refused)
            return self._refused[1]

    def descriptions(self) -> tuple[str, ...]:
        """Return what each edit did, without ids; those made here name objects by their numbers at the time."""
        with self._lock:
            found = ((self._descriptions.get(entry), entry.edit) for entry in self._log.entries)
            return tuple(text or describe_by_class(edit) for text, edit in found)

    def covers(self, simap: SIMap) -> bool:
        """Return whether a map is this one, with whatever edits and parameters."""
        return simap.grid.height_m is self.original.grid.height_m and simap.spec == self.original.spec

    def do(self, simap: SIMap, kind: str, *arguments: Any, who: str) -> SIMap:
        """Make an edit of the map that is shown: `edits.MAKERS` names its kinds, and what each asks for.

        Raises:
            InputError: the edit is refused, or cannot be saved; nothing is changed.
        """
        with self._lock:
            self._check(simap)
            edit = MAKERS[kind](simap, *arguments)
            log = self._log.add(edit, who=who)
            changed = self._change(simap, log)
            self._descriptions[log.entries[-1]] = describe_by_number(edit, simap)
            return changed

    def undo(self, simap: SIMap) -> SIMap:
        """Undo the last edit, whoever made it.

        Raises:
            InputError: there is none, or that cannot be saved.
        """
        with self._lock:
            return self._change(simap, self._log.undo())

    def redo(self, simap: SIMap) -> SIMap:
        """Make the edit again that was undone last.

        Raises:
            InputError: there is none, or that cannot be saved.
        """
        with self._lock:
            return self._change(simap, self._log.redo())

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Save the edits made inside all at once at the end, or none of them when one is refused."""
        with self._lock:
            before, self._waiting = self._log, True
            try:
                yield
                self._waiting = False
                if self._log is not before:
                    self._write(self._log)
            except BaseException:
                self._log = before
                raise
            finally:
                self._waiting = False

    def save(self) -> None:
        """Write the edits file, even when nothing changed.

        Raises:
            InputError: they cannot be written; the file is left as it was.
        """
        with self._lock:
            self._write(self._log)

    def refresh(self, simap: SIMap) -> SIMap:
        """Return the map that is shown with all edits made since."""
        with self._lock:
            return apply_log(self._base_of(simap), self._log).simap

    def recommunity(self, simap: SIMap, *, resolution: float, **value: float) -> SIMap:
        """Return the map for another Louvain resolution, with its edits; see `mapping.simap.recommunity`."""
        self._check(simap)
        with self._lock:
            return apply_log(self._base_at(resolution, value), self._log).simap

    def _change(self, simap: SIMap, log: EditLog) -> SIMap:
        """Save a log, and return the map that is shown with its edits."""
        self._check(simap)
        done = apply_log(self._base_of(simap), log)
        last = len(log.entries) - 1
        refused = dict(done.refused)
        if len(log.entries) > len(self._log.entries) and last in refused:
            raise InputError(refused[last])
        if not self._waiting:
            self._write(log)
        self._log, self._refused = log, (log, tuple(refused.values()))
        return done.simap

    def _check(self, simap: SIMap) -> None:
        if not self.covers(simap):
            raise InputError(f"edits: expected the map that {self.path} belongs to, found another")

    def _base_of(self, simap: SIMap) -> SIMap:
        """Return the map without edits, for the parameters of the one that is shown."""
        slider = method_of(self.original.method).slider
        if slider is None:
            return self.original
        wanted = simap.parameters
        return self._base_at(wanted.get("resolution"), {slider.parameter: float(wanted[slider.parameter])})

    def _base_at(self, resolution: float | None, value: Mapping[str, float]) -> SIMap:
        """Return the map without edits; Louvain runs again only for a resolution that was not asked for last."""
        base = self.original
        if resolution is not None and resolution != base.parameters.get("resolution"):
            if self._base.parameters.get("resolution") != resolution:
                self._base = recommunity(base, resolution=resolution, **value)
            base = self._base
        return base if value.items() <= base.parameters.items() else repartition(base, **value)

    def _write(self, log: EditLog) -> None:
        found = self.path.read_bytes() if self.path.is_file() else None
        if found != self._on_disk:
            raise InputError(f"{self.path}: expected the edits as they were read, found others: open the map anew")
        if self._fingerprint is None:
            self._fingerprint = fingerprint(self.original)
        contents = EditsFile(self._fingerprint, self.original.spec, log)
        self._on_disk = save_edits(self.path, contents, self._map_name)


def open_mending(map_path: Path, simap: SIMap | None = None, *, adopt: bool = False) -> Mending:
    """Open a map file, with its edits if there are any, to edit it.

    Args:
        map_path: the map file.
        simap: its contents, when they are at hand.
        adopt: take over edits of another build of the map, by position; they are saved with the next change.

    Raises:
        InputError: the map or its edits are damaged, or the edits belong to another map. No file is changed.
    """
    map_path = Path(map_path)
    simap = load_map(map_path) if simap is None else simap
    path = edits_path(map_path)
    if not path.exists():
        return Mending(simap, EditLog(), path, map_name=map_path.name)
    try:
        contents, data = read_edits(path)
    except InputError as error:
        raise InputError(f"{error}; --no-edits leaves them out") from error
    if contents.fingerprint != fingerprint(simap):
        if not adopt:
            raise InputError(
                f"{path}: expected edits of {map_path.name} as it is, found edits of another build of it; "
                f"simaps mend {map_path} --adopt takes them over by place, --no-edits leaves them out"
            )
        contents = moved_to(contents, simap)
    return Mending(simap, contents.log, path, map_name=map_path.name, on_disk=data)


def load_mended(path: Path, *, edits: bool = True) -> SIMap:
    """Return a map file's map with the edits beside it, if there are any and they are wanted.

    Raises:
        InputError: the map or its edits are damaged, or the edits belong to another build of the map.
    """
    return open_mending(path).simap() if edits else load_map(path)
