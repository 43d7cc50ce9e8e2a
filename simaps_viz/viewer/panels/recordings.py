"""The panel with the list of recorded builds: dock one beside the map, rename it, move it to the trash and back."""

import functools
from collections.abc import Callable, Sequence
from html import escape
from typing import TYPE_CHECKING

import viser

from simaps_viz.colors.classes import plural
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec, Question, button

if TYPE_CHECKING:
    from simaps_viz.recorder.library import LibraryEntry, RecordingLibrary

NONE = "no recordings yet"
MAX_OFFERED = 12
"""Recordings of the trash that the page offers, the newest first."""
_NOTHING: tuple[str, ...] = (NONE,)
_NOTE = "padding:.2em .8em .4em;font-size:.82em;line-height:1.5;overflow-wrap:anywhere"
_EMPTY = (
    "There are no recorded builds in {folder}.<br>Make one: <b>simaps build SEQUENCE -o MAP.npz --record MAP.rrd</b>, "
    "then <b>simaps recordings add MAP.rrd</b>."
)


def recordings_panel(library: "RecordingLibrary") -> PanelSpec:
    """Return the spec of the panel, which is the last of the tab Build."""
    return PanelSpec("Build", viser.Icon.TIMELINE, lambda page: RecordingsPanel(page, library))


class RecordingsPanel(Panel):
    """The list of recorded builds, the facts about the chosen one, and buttons to show, rename or delete it.

    Those that rename, delete or restore are only on the pages of people who may.
    """

    def __init__(self, page: Page, library: "RecordingLibrary") -> None:
        """Fill the open container."""
        self._page, self._library = page, library
        self._entries: dict[str, LibraryEntry] = {}
        self._listed: Sequence[LibraryEntry] = ()
        with page.gui.add_folder("Recorded builds", expand_by_default=False):
            self._fill(page)
        self._show()
        self.refresh()

    def _fill(self, page: Page) -> None:
        gui = page.gui
        self._choice = gui.add_dropdown("Recording", _NOTHING, hint="Recorded builds, the newest first")
        self._choice.on_update(lambda _: self._show())
        self._details = gui.add_html("")
        show, rename, delete = (
            functools.partial(self._with_chosen, job) for job in (self._open_it, self._ask_name, self._ask_whether)
        )
        restore = functools.partial(page.submit, "ask", self._ask_which)
        icon = viser.Icon
        self._open = button(gui, "Show it beside the map", show, icon=icon.PLAYER_PLAY)
        self._may_edit = page.may("edit")
        if self._may_edit:
            self._rename = button(gui, "Rename …", rename, icon=icon.PENCIL, color="gray")
            self._delete = button(gui, "Delete …", delete, icon=icon.TRASH, color="gray")
            self._restore = button(gui, "Restore …", restore, icon=icon.ARROW_BACK_UP, color="gray", visible=False)
        button(gui, "List again", self.refresh, icon=icon.REFRESH, color="gray")

    def refresh(self, select: str | None = None) -> None:
        """Queue reading the list again; ``select`` names the recorded build to choose."""
        self._page.submit("recordings", lambda: self._list(select))

    @property
    def chosen(self) -> "LibraryEntry | None":
        """The recorded build that is chosen in the list."""
        return self._entries.get(self._choice.value)

    def _list(self, select: str | None) -> None:
        kept = self.chosen
        self._listed = self._library.entries()
        self._entries = {_option(entry): entry for entry in self._listed}
        options = tuple(self._entries) or _NOTHING
        wanted = select or (kept.name if kept else None)
        self._choice.options = options
        self._choice.value = next((o for o, e in self._entries.items() if e.name == wanted), options[0])
        if self._may_edit:
            self._restore.visible = bool(self._library.deleted())
        self._show()

    def _show(self) -> None:
        entry = self.chosen
        text = details_html(entry) if entry else _EMPTY.format(folder=escape(str(self._library.folders[0])))
        if entry is not None and entry.fault is None and self._page.recording.url is None:
            text += f"To watch it: <b>simaps view {escape(str(entry.path))}</b>"
        self._details.content = f'<div style="{_NOTE}">{text}</div>'
        self._open.visible = entry is not None and self._page.recording.url is not None
        self._open.disabled = entry is None or entry.fault is not None
        if self._may_edit:
            self._rename.visible = self._delete.visible = entry is not None and entry.read_only is None

    def _ask_name(self, entry: "LibraryEntry") -> None:
        answers = {"Save the name": lambda: self._rename_it(entry, asked.name)}
        title, where = f"Rename {entry.name}", escape(str(entry.path))
        asked = Question(self._page, title, where, answers, file=entry.path, name=entry.name)

    def _ask_whether(self, entry: "LibraryEntry") -> None:
        text = f"{entry.size_bytes / 1e6:.1f} MB, {escape(str(entry.path))}.<br>It can be restored from the trash."
        answers = {"Move to the trash": lambda: self._delete_it(entry)}
        Question(self._page, f"Delete {entry.name}?", text, answers, file=entry.path)

    def _ask_which(self) -> None:
        answers = {
            f"{entry.name} · {entry.size_bytes / 1e6:.1f} MB": lambda entry=entry: self._restore_it(entry)
            for entry in self._library.deleted()[:MAX_OFFERED]
        }
        text = f"In {escape(str(self._library.trash))}; <b>simaps recordings empty-trash --yes</b> empties it."
        Question(self._page, "Restore a recording", text, answers)

    def _with_chosen(self, job: "Callable[[LibraryEntry], None]") -> None:
        """Queue a job on the chosen recorded build."""
        entry = self.chosen
        if entry is not None:
            self._page.submit("ask", lambda: job(entry))

    def _open_it(self, entry: "LibraryEntry") -> None:
        self._page.recording.show(entry.path)
        self._page.say("Recording", f"{entry.name} is shown beside the map.")

    def _rename_it(self, entry: "LibraryEntry", new_name: str) -> None:
        if new_name and new_name != entry.name:
            self._library.rename(entry.name, new_name)
        self._list(new_name or entry.name)

    def _delete_it(self, entry: "LibraryEntry") -> None:
        self._library.delete(entry.name)
        self._list(None)
        self._page.say("Recording", f"{entry.name} was moved to the trash.")

    def _restore_it(self, entry: "LibraryEntry") -> None:
        self._library.restore(entry.name)
        self._list(entry.name)
        self._page.say("Recording", f"{entry.name} was restored.")


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
        "seen from above": None if facts.instances is None else plural(facts.instances, "instance"),
        "simulated": None if facts.simulated is None else "yes" if facts.simulated else "no",
        "size": f"{entry.size_bytes / 1e6:.1f} MB",
        "file": str(entry.path),
    } | ({"read-only": f"it {entry.read_only}, and is neither renamed nor deleted here"} if entry.read_only else {})
    cells = "".join(
        f'<tr><td style="padding-right:.8em;opacity:.7;white-space:nowrap;vertical-align:top">{name}</td>'
        f"<td>{escape('unknown' if value is None else str(value))}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table>{cells}</table>"
