"""Editing a map that people look at: edits are made, undone, saved beside the map, and applied when it is opened."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from simaps_viz.errors import InputError
from simaps_viz.mapping.edit_log import (
    EditLog,
    EditsFile,
    Entry,
    apply_log,
    edits_path,
    fingerprint,
    moved_to,
    read_edits,
    save_edits,
)
from simaps_viz.mapping.edits import (
    Edit,
    Point,
    cut_room,
    delete,
    describe_by_class,
    describe_by_number,
    join_rooms,
    merge,
    relabel,
    rename_room,
    split,
)  # fmt: skip
from simaps_viz.mapping.file import load_map
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.structures import SIMap


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

    def merge(self, simap: SIMap, first_id: int, second_id: int, *, who: str) -> SIMap:
        """Join two objects of the map that is shown; see `edits.merge`."""
        return self._do(simap, lambda: merge(simap, first_id, second_id), who)

    def split(self, simap: SIMap, instance_id: int, start_m: Point, end_m: Point, *, who: str) -> SIMap:
        """Cut an object of the map that is shown; see `edits.split`."""
        return self._do(simap, lambda: split(simap, instance_id, start_m, end_m), who)

    def relabel(self, simap: SIMap, instance_id: int, label: str, *, who: str) -> SIMap:
        """Change the class of an object of the map that is shown; see `edits.relabel`."""
        return self._do(simap, lambda: relabel(simap, instance_id, label), who)

    def delete(self, simap: SIMap, instance_id: int, *, who: str) -> SIMap:
        """Take away an object of the map that is shown; see `edits.delete`."""
        return self._do(simap, lambda: delete(simap, instance_id), who)

    def rename_room(self, simap: SIMap, room_id: int, name: str, *, who: str) -> SIMap:
        """Name a room of the map that is shown; see `edits.rename_room`."""
        return self._do(simap, lambda: rename_room(simap, room_id, name), who)

    def join_rooms(self, simap: SIMap, first_id: int, second_id: int, *, who: str) -> SIMap:
        """Join two rooms of the map that is shown; see `edits.join_rooms`."""
        return self._do(simap, lambda: join_rooms(simap, first_id, second_id), who)

    def cut_room(self, simap: SIMap, room_id: int, start_m: Point, end_m: Point, *, who: str) -> SIMap:
        """Cut a room of the map that is shown; see `edits.cut_room`."""
        return self._do(simap, lambda: cut_room(simap, room_id, start_m, end_m), who)

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

    def recommunity(
        self, simap: SIMap, *, resolution: float, k_percent: float | None = None, affinity: float | None = None
    ) -> SIMap:
        """Return the map for another Louvain resolution, with its edits; see `mapping.simap.recommunity`."""
        self._check(simap)
        value = {"k_percent": k_percent} if affinity is None else {"affinity": affinity}
        with self._lock:
            return apply_log(self._base_at(resolution, value), self._log).simap

    def _do(self, simap: SIMap, make: Callable[[], Edit], who: str) -> SIMap:
        with self._lock:
            self._check(simap)
            edit = make()
            log = self._log.add(edit, who=who)
            changed = self._change(simap, log)
            self._descriptions[log.entries[-1]] = describe_by_number(edit, simap)
            return changed

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

    def _base_at(self, resolution: float | None, joining: Mapping[str, float | None]) -> SIMap:
        """Return the map without edits; Louvain runs again only for a resolution that was not asked for last."""
        base = self.original
        if resolution is not None and resolution != base.parameters.get("resolution"):
            if self._base.parameters.get("resolution") != resolution:
                self._base = recommunity(base, resolution=resolution, **joining)
            base = self._base
        same = all(value is None or base.parameters[name] == value for name, value in joining.items())
        return base if same else repartition(base, **joining)

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
