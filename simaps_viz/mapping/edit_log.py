"""Which edits were made on a map, by whom and when; and which were taken back."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from simaps_viz.mapping.edits import Edit, EditRefused
from simaps_viz.mapping.mend import Replayed, replay
from simaps_viz.structures import SIMap

LONGEST_NAME = 80
"""Characters of a person's name."""


@dataclass(frozen=True)
class Entry:
    """One edit, signed."""

    edit: Edit
    who: str
    when: str
    """ISO 8601, UTC, whole seconds: 2026-11-21T19:30:00Z."""

    def to_json(self) -> dict[str, str]:
        """Say who did what, when."""
        return {"who": self.who, "when": self.when, "what": self.edit.words}


@dataclass(frozen=True)
class EditLog:
    """The edits on a map in the order they were made, whoever made them; frozen, every change gives a new one."""

    entries: tuple[Entry, ...] = ()
    undone: tuple[Entry, ...] = ()
    """Those that ``redo`` brings back, the next one last."""

    def done(self, edit: Edit, *, who: str, when: str | None = None) -> "EditLog":
        """Add an edit; what was undone before cannot be redone any more.

        Raises:
            InputError: nobody signed it, or the name is too long.
        """
        return EditLog((*self.entries, Entry(edit, signature(who), when or now())))

    def undo(self) -> "EditLog":
        """Take the last edit back.

        Raises:
            InputError: there is none.
        """
        if not self.entries:
            raise EditRefused("undo: expected an edit to take back, found none", "There is nothing to undo.")
        return EditLog(self.entries[:-1], (*self.undone, self.entries[-1]))

    def redo(self) -> "EditLog":
        """Make the edit again that was taken back last.

        Raises:
            InputError: there is none.
        """
        if not self.undone:
            raise EditRefused("redo: expected an edit that was taken back, found none", "There is nothing to redo.")
        return EditLog((*self.entries, self.undone[-1]), self.undone[:-1])

    def people(self) -> dict[str, int]:
        """Give {who: number of edits}, most first, then by name."""
        names = [entry.who for entry in self.entries]
        return {name: names.count(name) for name in sorted(set(names), key=lambda name: (-names.count(name), name))}


def mended(simap: SIMap, log: EditLog) -> Replayed:
    """Replay a log on a map that has none yet.

    The provenance of the mended map says under ``edits`` who did what, when, and which instances came of it.
    """
    done = replay(simap, [entry.edit for entry in log.entries])
    if done.simap is simap:
        return done
    refused = {i for i, _ in done.refused}
    instance = done.simap.instance.reshape(-1)
    told = []
    for i, entry in enumerate(log.entries):
        if i not in refused:
            ids = np.unique(instance[entry.edit.region.cells()])
            told.append({**entry.to_json(), "instances": ids[ids > 0].tolist()})
    edits = [*simap.provenance.get("edits", []), *told]
    return replace(done, simap=replace(done.simap, provenance={**simap.provenance, "edits": edits}))


def edits_of(simap: SIMap, instance_id: int) -> list[dict[str, Any]]:
    """Give who did what, when, of the edits that made an instance what it is; none for what nobody touched."""
    return [edit for edit in simap.provenance.get("edits", []) if instance_id in edit.get("instances", [])]


def people_in_words(edits: Iterable[Mapping[str, Any]]) -> str:
    """Say how many edits there are and by whom: "3 edits: 2 by Ann, 1 by Bo"; nothing when there are none."""
    names = [str(edit.get("who")) for edit in edits]
    if not names:
        return ""
    each = sorted(set(names), key=lambda name: (-names.count(name), name))
    count = f"{len(names)} edit{'s' if len(names) > 1 else ''}"
    return f"{count}: {', '.join(f'{names.count(name)} by {name}' for name in each)}"


def signature(who: str) -> str:
    """Give a person's name with single spaces, or raise InputError where it is none."""
    name = " ".join(who.split())
    if not name or len(name) > LONGEST_NAME or not name.isprintable():
        raise EditRefused(
            f"name: expected who makes the edit, in 1 to {LONGEST_NAME} characters, found {who[:90]!r}",
            f"Write your name below, in 1 to {LONGEST_NAME} characters: edits are signed with it.",
        )
    return name


def now() -> str:
    """Give the time, ISO 8601, UTC, whole seconds."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
