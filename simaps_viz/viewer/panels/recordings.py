"""The panel with the list of recorded builds: dock one beside the map, rename it, delete it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import viser

from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec

if TYPE_CHECKING:
    from simaps_viz.recorder.library import LibraryEntry

ABOUT = "all recorded builds: show one beside the map, rename, delete"
NONE = "no recordings yet"
_NOTHING: tuple[str, ...] = (NONE,)
_NOTE = "padding:.2em .8em .4em;font-size:.82em;line-height:1.5;overflow-wrap:anywhere"
_EMPTY = (
    "There are no recorded builds in {folder}.<br>Make one: <b>simaps build SEQUENCE -o MAP.npz --record MAP.rrd</b>, "
    "then <b>simaps recordings add MAP.rrd</b>."
)


@dataclass(frozen=True)
class RecordingServices:
    """Plain functions behind the panel; all may raise SIMapsError."""

    entries: "Callable[[], Sequence[LibraryEntry]]"
    """Return the recorded builds, in the order shown."""
    rename: Callable[[str, str], object]
    """(name, new name): rename a recorded build."""
    delete: Callable[[str], object]
    """(name): delete the file of a recorded build."""
    dockable: bool = False
    """Whether a page can dock a recorded build beside the map."""
    folder: str = ""
    """Folder of the person's own recorded builds."""


def recordings_spec(services: RecordingServices) -> PanelSpec:
    """Return the spec of the tab."""
    return PanelSpec("Recordings", viser.Icon.MOVIE, lambda page: RecordingsPanel(page, services), about=ABOUT)


class RecordingsPanel(Panel):
    """The list of recorded builds, the facts about the chosen one, and buttons to show, rename or delete it."""

    def __init__(self, page: Page, services: RecordingServices) -> None:
        """Fill the open container."""
        self._page, self._services = page, services
        self._entries: dict[str, LibraryEntry] = {}
        self._listed: Sequence[LibraryEntry] = ()
        gui = page.gui
        self._choice = gui.add_dropdown("Recording", _NOTHING, hint="Recorded builds, the newest first")
        self._details = gui.add_html("")
        self._open = gui.add_button("Show it beside the map", icon=viser.Icon.PLAYER_PLAY)
        self._rename = gui.add_button("Rename …", icon=viser.Icon.PENCIL, color="gray")
        self._new_name = gui.add_text("New name", "")
        self._save = gui.add_button("Save the name", icon=viser.Icon.CHECK)
        self._delete = gui.add_button("Delete …", icon=viser.Icon.TRASH, color="gray")
        self._question = gui.add_html("")
        self._really = gui.add_button("Delete for good", icon=viser.Icon.TRASH, color="red")
        self._keep = gui.add_button("Keep it", icon=viser.Icon.X, color="gray")
        self._again = gui.add_button("List again", icon=viser.Icon.REFRESH, color="gray")
        self._connect()
        self._ask(None)
        self.refresh()

    def refresh(self, select: str | None = None) -> None:
        """Queue reading the list again; ``select`` names the recorded build to choose."""
        self._page.submit("recordings", lambda: self._list(select))

    def _connect(self) -> None:
        self._choice.on_update(lambda _: self._show())
        self._open.on_click(lambda _: self._with_chosen("open a recording", self._open_it))
        self._rename.on_click(lambda _: self._ask("rename"))
        self._save.on_click(lambda _: self._with_chosen("rename a recording", self._rename_it))
        self._delete.on_click(lambda _: self._ask("delete"))
        self._really.on_click(lambda _: self._with_chosen("delete a recording", self._delete_it))
        self._keep.on_click(lambda _: self._ask(None))
        self._again.on_click(lambda _: self.refresh())

    @property
    def chosen(self) -> "LibraryEntry | None":
        """The recorded build that is chosen in the list."""
        return self._entries.get(self._choice.value)

    def _list(self, select: str | None) -> None:
        kept = self.chosen
        self._listed = self._services.entries()
        self._entries = {_option(entry): entry for entry in self._listed}
        options = tuple(self._entries) or _NOTHING
        wanted = select or (kept.name if kept else None)
        self._choice.options = options
        self._choice.value = next((o for o, e in self._entries.items() if e.name == wanted), options[0])
        self._show()

    def _show(self) -> None:
        entry = self.chosen
        if entry is None:
            self._details.content = f'<div style="{_NOTE}">{_EMPTY.format(folder=escape(self._services.folder))}</div>'
        else:
            self._details.content = f'<div style="{_NOTE}">{details_html(entry)}</div>'
        self._ask(None)

    def _ask(self, what: str | None) -> None:
        """Show the widgets that rename or delete; None shows the usual buttons."""
        entry = self.chosen
        renaming, deleting = what == "rename" and entry is not None, what == "delete" and entry is not None
        idle = not (renaming or deleting)
        self._open.visible = idle and entry is not None and self._services.dockable
        self._open.disabled = entry is None or entry.fault is not None
        self._rename.visible = self._delete.visible = idle and entry is not None
        self._again.visible = idle
        self._new_name.visible = self._save.visible = renaming
        self._question.visible = self._really.visible = deleting
        self._keep.visible = renaming or deleting
        self._keep.label = "Keep the old name" if renaming else "Keep it"
        if renaming and entry is not None:
            self._new_name.value = entry.name
        if deleting and entry is not None:
            size = f"{entry.size_bytes / 1e6:.1f} MB"
            self._question.content = (
                f'<div style="{_NOTE}">Delete <b>{escape(entry.name)}</b> ({size})? It cannot be brought back:<br>'
                f"{escape(str(entry.path))}</div>"
            )

    def _with_chosen(self, name: str, job: "Callable[[LibraryEntry], None]") -> None:
        """Queue a job on the chosen recorded build."""
        entry = self.chosen
        if entry is not None:
            self._page.submit(name, lambda: job(entry))

    def _open_it(self, entry: "LibraryEntry") -> None:
        self._page.show_recording(entry.path)
        self._page.say("Recording", f"{entry.name} is shown beside the map.")

    def _rename_it(self, entry: "LibraryEntry") -> None:
        new_name = self._new_name.value.strip()
        if new_name and new_name != entry.name:
            self._services.rename(entry.name, new_name)
        self._list(new_name or entry.name)

    def _delete_it(self, entry: "LibraryEntry") -> None:
        self._services.delete(entry.name)
        self._list(None)
        self._page.say("Recording", f"{entry.name} was deleted.")


def _option(entry: "LibraryEntry") -> str:
    method = "cannot be opened" if entry.fault else entry.facts.method or "method unknown"
    return f"{entry.name} · {entry.size_bytes / 1e6:.1f} MB · {method}"


def details_html(entry: "LibraryEntry") -> str:
    """Describe a recorded build."""
    if entry.fault:
        return f"It cannot be opened: {escape(entry.fault)}"
    facts = entry.facts
    settings = f" ({facts.parameters})" if facts.parameters else ""
    rows = {
        "of": facts.title,
        "method": f"{facts.method}{settings}" if facts.method else None,
        "frames": facts.frames,
        "instances": facts.instances,
        "simulated": None if facts.simulated is None else "yes" if facts.simulated else "no",
        "size": f"{entry.size_bytes / 1e6:.1f} MB",
        "file": str(entry.path),
    }
    cells = "".join(
        f'<tr><td style="padding-right:.8em;opacity:.7;white-space:nowrap;vertical-align:top">{name}</td>'
        f"<td>{escape('unknown' if value is None else str(value))}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table>{cells}</table>"
