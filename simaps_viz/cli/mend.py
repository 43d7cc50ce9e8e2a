"""`simaps mend`: edit a map on the command line, list its edits, and save the edited map."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from simaps_viz.cli import OK
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.mapping.mending import Mending
    from simaps_viz.structures import SIMap

FORMS = (
    "merge ID ID, split ID X Y X Y (metres), relabel ID CLASS, delete ID, rename-room ID NAME, join-rooms ID ID, "
    "cut-room ID X Y X Y, undo, redo"
)


@dataclass(frozen=True)
class Mend:
    """Edit a map by hand, list its edits, or save the edited map; edits are saved beside it, in MAP.edits.json.

    Edits: "merge 3 4" (of the class of 3), "split 8 3.6 0 3.6 1" (along the line through two points, metres),
    "relabel 5 sofa bed", "delete 9", "undo", "redo"; of rooms "rename-room 3 study", "join-rooms 1 2",
    "cut-room 1 2 0 2 9". Ids are those of simaps info.

    Example: simaps mend cafe.npz "merge 3 4" "delete 9" -o mended.npz
    """

    map: tyro.conf.Positional[Path]
    """Map file (.npz); it is never changed."""
    edit: tyro.conf.Positional[tuple[str, ...]] = ()
    """What to do, in order; all of it, or nothing when one of them is refused. Left out, the edits are listed."""
    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Also write the mended map as a map of its own (.npz)."""
    who: str = ""
    """Who signs; by default the name you are logged in by."""
    adopt: bool = False
    """Take over, by place, edits that were made on another build of this map."""
    json: bool = False
    """Print the edits as one JSON line."""

    def run(self) -> int:
        """Do the edits, save the map where that is asked for, and list all edits.

        Raises:
            InputError: an edit is refused, or a file is damaged or cannot be written. No file was changed.
        """
        from simaps_viz.app.workbench import login
        from simaps_viz.console.terminal import emit, say
        from simaps_viz.io.files import check_ending
        from simaps_viz.mapping.file import check_writable, save_map
        from simaps_viz.mapping.mending import open_mending

        if self.output is not None:
            if self.output.resolve() == self.map.resolve():
                raise InputError(f"{self.output}: expected another file than the map, which stays as it was built")
            check_ending(self.output, ".npz", "a map's name")
            check_writable(self.output)
        mending = open_mending(self.map, adopt=self.adopt)
        simap = mending.simap()
        with mending.batch():
            for text in self.edit:
                simap = do(mending, simap, text, self.who or login())
            if self.output is not None:
                # Saved inside the batch: if the map cannot be written, the edits are not recorded either.
                save_map(simap, self.output)
        if self.adopt and mending.saved and not self.edit:
            mending.save()
        lines, record = _report(self, mending, simap)
        if self.json:
            emit(record)
        else:
            say("\n".join(lines) + "\n")
        return OK


def do(mending: "Mending", simap: "SIMap", text: str, who: str) -> "SIMap":
    """Do one edit, given in words.

    Raises:
        InputError: it is not understood, or refused.
    """
    verb, *rest = text.split() or [""]
    take = {"merge": "ii", "split": "ipp", "relabel": "iw", "delete": "i", "rename-room": "iw", "join-rooms": "ii",
            "cut-room": "ipp", "undo": "", "redo": ""}  # fmt: skip
    try:
        arguments = _arguments(take[verb.lower()], rest)
    except (KeyError, ValueError) as error:
        raise InputError(f"edit: expected {FORMS}; found {text!r}") from error
    if arguments:
        return mending.do(simap, verb.lower(), *arguments, who=who)
    return mending.undo(simap) if verb.lower() == "undo" else mending.redo(simap)


def _arguments(kinds: str, words: list[str]) -> list[Any]:
    """Read the words of an edit: i an id, p the x and y of a point, w all the rest; ValueError for anything else."""
    found: list[Any] = []
    for kind in kinds:
        if kind == "i":
            found.append(int("".join(words[:1])))
            words = words[1:]
        elif kind == "p":
            x, y = map(float, words[:2])
            found.append((x, y))
            words = words[2:]
        else:
            found.append(" ".join(words))
            words = []
    if words or "" in found:
        raise ValueError("words left over, or missing")
    return found


def _report(command: Mend, mending: "Mending", simap: "SIMap") -> tuple[list[str], dict[str, Any]]:
    from simaps_viz.drawing.legend import counted

    entries, refused = [entry.to_json() for entry in mending.log.entries], mending.refused()
    lines = [f"{i}. {entry['when']}  {entry['who']}  {entry['what']}" for i, entry in enumerate(entries, start=1)]
    lines += [f"not done: {why}" for why in refused]
    lines += [f"{len(mending.log.undone)} taken back (redo brings the last one again)"] if mending.log.undone else []
    lines.append(f"{mending.path}: {len(entries)} edits" if mending.saved else f"{command.map}: no edits")
    lines += [f"{command.output}: the mended map, {len(simap.instances)} instances"] if command.output else []
    return lines, {
        "file": str(mending.path) if mending.saved else None,
        "edits": entries,
        "undone": len(mending.log.undone),
        "not_done": list(refused),
        "output": str(command.output) if command.output else None,
        "counts": counted(simap),
    }
