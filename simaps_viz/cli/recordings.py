"""`simaps recordings`, and `simaps view` on a recorded build alone."""

import shlex
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import tyro

from simaps_viz.cli import OK
from simaps_viz.errors import InputError

if TYPE_CHECKING:
    from simaps_viz.recorder.library import LibraryEntry

_USAGE = {
    "list": ("list", 0, 0), "add": ("add FILE [NAME]", 1, 2), "rename": ("rename NAME NEW_NAME", 2, 2),
    "delete": ("delete NAME", 1, 1), "trash": ("trash", 0, 0), "restore": ("restore NAME", 1, 1),
    "empty-trash": ("empty-trash", 0, 0), "repair": ("repair FILE [OUTPUT]", 1, 2),
}  # fmt: skip
Action = Literal["list", "add", "rename", "delete", "trash", "restore", "empty-trash", "repair"]
_PIPED_WIDTH = 160
"""Characters in a line where it is not for a terminal."""
NO_MAP = (
    "A recorded build alone, without its map: nothing can be selected, asked or driven here. "
    "With its map: simaps view MAP.npz --recording {name}"
)


@dataclass(frozen=True)
class Recordings:
    """List, add, rename, delete, restore or repair recorded builds.

    delete moves a recording to the trash, which trash lists and empty-trash empties for good.

    A build that was killed while it recorded leaves a hidden .NAME.PID.partial.rrd; repair makes a recording of it.

    They lie in the user's folder (SIMAPS_RECORDINGS chooses another one) and, in a checkout, in recordings/.
    Open one with: simaps view NAME.rrd

    Example: simaps recordings add cafe.rrd
    """

    action: tyro.conf.Positional[Action] = "list"
    """list; add FILE [NAME]; rename NAME NEW_NAME; delete NAME; trash; restore NAME; empty-trash;
    repair FILE [OUTPUT]."""
    names: tyro.conf.Positional[tuple[str, ...]] = ()
    """The names it is done to."""
    yes: bool = False
    """Really delete it, or empty the trash."""
    json: bool = False
    """Print one JSON line a recording."""

    def run(self) -> int:
        """Do it.

        Raises:
            InputError: the wrong number of names, no such recording, a name that is taken.
        """
        from simaps_viz.recorder.library import RecordingLibrary

        library = RecordingLibrary()
        usage, fewest, most = _USAGE[self.action]
        if not fewest <= len(self.names) <= most:
            raise InputError(f"recordings: expected {usage}, found {len(self.names)} names")
        match self.action:
            case "list":
                _show(library.entries(), library.folders, json=self.json)
            case "trash":
                _show(library.deleted(), [library.trash], json=self.json)
            case "repair":
                _repair(*map(Path, self.names), json=self.json)
            case "delete":
                entry = library.find(self.names[0])
                self._expect_yes(f"{entry.path}: expected --yes to delete it")
                moved = library.delete(entry.name)
                _report({"event": "deleted", "path": str(entry.path), "moved_to": str(moved)},
                        f"moved to the trash; back: simaps recordings restore {shlex.quote(moved.stem)}",
                        json=self.json)  # fmt: skip
            case "empty-trash":
                self._expect_yes(f"{library.trash}: expected --yes to delete {len(library.deleted())} for good")
                for path in library.empty_trash():
                    _report({"event": "deleted for good", "path": str(path)}, "deleted for good", json=self.json)
            case "add":
                entry = library.add(Path(self.names[0]), *self.names[1:])
                _report({"event": "added", **entry.to_json()}, "added", json=self.json)
            case "restore":
                entry = library.restore(self.names[0])
                _report({"event": "restored", **entry.to_json()}, "restored", json=self.json)
            case "rename":
                entry = library.rename(*self.names)
                _report({"event": "renamed", **entry.to_json()}, "renamed", json=self.json)
        return OK

    def _expect_yes(self, expected: str) -> None:
        if not self.yes:
            raise InputError(f"{expected}, found none; nothing was deleted")


def _report(record: dict[str, Any], done: str, *, json: bool) -> None:
    from simaps_viz.console.terminal import report

    report(record, f"{record['path']}: {done}", json=json)


def _repair(broken: Path, output: Path | None = None, *, json: bool) -> None:
    from simaps_viz.recorder.library import repair_recording

    output = output or broken.with_name(f"{_plain_stem(broken)}-repaired.rrd")
    frames = repair_recording(broken, output)
    _report({"event": "repaired", "path": str(output), "frames": frames}, f"repaired, {frames} frames", json=json)


def _plain_stem(path: Path) -> str:
    """Return the name a recording would have got: "cafe" of ".cafe.4711.partial.rrd"."""
    return path.stem.lstrip(".").removesuffix(".partial").rsplit(".", 1)[0] if path.name[0] == "." else path.stem


def _show(found: "Sequence[LibraryEntry]", folders: list[Path], *, json: bool) -> None:
    from rich.table import Table

    from simaps_viz.console.terminal import emit, note, show

    entries = [entry.to_json() for entry in found]
    if json:
        for entry in entries:
            emit(entry)
        return
    if not entries:
        note(f"no recordings in {', '.join(map(str, folders))}",
             "Make one: simaps build SEQUENCE -o MAP.npz --record MAP.rrd")  # fmt: skip
        return
    table = Table(box=None)
    for head in ("name", "MB", "recorded", "of", "frames", "method", "instances"):
        table.add_column(head, overflow="fold", no_wrap=head in ("MB", "recorded"))
    for entry in entries:
        of = str(entry["title"] or "unknown") + (" (simulated)" if entry["simulated"] else "")
        method = ", ".join(filter(None, (entry["method"] or "unknown", entry["parameters"])))
        if entry["fault"]:
            of, method = f"cannot be opened: {entry['fault']}", ""
        cells = (entry["name"], f"{entry['size_bytes'] / 1e6:.1f}", entry["modified"][:16].replace("T", " "), of,
                 _number(entry["frames"]), method, _number(entry["instances"]))  # fmt: skip
        table.add_row(*cells)
    width = None if sys.stdout.isatty() else _PIPED_WIDTH
    show(table, width=width)


def _number(value: int | None) -> str:
    return "unknown" if value is None else str(value)


def is_recorded_build(path: Path) -> bool:
    """Whether a path, or a name in the library, means a recorded build; recordings of others may be sequences."""
    from simaps_viz.recorder.facts import read_facts
    from simaps_viz.recorder.library import RecordingLibrary

    if path.suffix != ".rrd":
        return False
    if not path.exists():
        return path.name == str(path) and any(entry.name == path.stem for entry in RecordingLibrary().entries())
    facts = read_facts(path)
    return facts.application == "simaps" or facts.version is not None


def find_recording(path: Path) -> Path:
    """Return the file a person means: the one at that path, or the library's of that name.

    Raises:
        InputError: there is neither.
    """
    from simaps_viz.recorder.library import RecordingLibrary

    if path.is_file():
        return path
    if path.name != str(path):
        raise InputError(f"{path}: expected a recording (.rrd), found no such file")
    return RecordingLibrary().find(path.name).path


def open_alone(path: Path, *, port: int = 0, access: Any = None) -> Any:
    """Serve a page with only a recorded build, at the ``url`` of the returned server; ``close()`` ends it.

    ``access`` is a `viewer.server.access.Access` when other machines may open the page.

    Raises:
        InputError: no such recording, it is not finished, or the port is taken.
    """
    from simaps_viz.recorder.facts import read_facts
    from simaps_viz.recorder.web_viewer import CONTENT_SECURITY_POLICY, rerun_page, viewer_assets
    from simaps_viz.viewer.server.front_door import FrontDoor
    from simaps_viz.viewer.server.host import Host

    file = find_recording(path)
    facts = read_facts(file)
    title = (facts.title or file.stem) + (" (simulated)" if facts.simulated else "")
    note = f"{title}. {NO_MAP.format(name=file.name)}"
    host = Host(
        page=lambda addresses: rerun_page(addresses, note=note),
        assets=viewer_assets(),
        csp=CONTENT_SECURITY_POLICY,
        recordings=(file,),
    )
    return FrontDoor(access, port).start([host])


def view_alone(path: Path, *, port: int, browser: bool, access: Any = None) -> None:
    """Show a recorded build until Ctrl-C; on the next free port when that one is taken."""
    from simaps_viz.app.workbench import tell_where

    find_recording(path)
    served = open_alone(path, port=port, access=access)
    try:
        tell_where(served, "Recorded build", browser=browser)
        threading.Event().wait()
    finally:
        served.close()
