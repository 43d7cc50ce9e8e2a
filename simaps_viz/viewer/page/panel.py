"""The interface of a panel, its widgets, how it is registered, and the panels of one page."""

import contextlib
import functools
import os
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import viser

from simaps_viz.drawing.theme import BOX_STYLE
from simaps_viz.errors import InputError
from simaps_viz.structures import SIMap
from simaps_viz.viewer.scene.map_scene import Style
from simaps_viz.viewer.server.access import Right
from simaps_viz.viewer.server.viser_hooks import inputs_of

if TYPE_CHECKING:
    from simaps_viz.viewer.page.page import Page
    from simaps_viz.viewer.page.shared import Services, Snapshot


P = TypeVar("P", bound="Panel")
W = TypeVar("W", bound=Any)
Place = Literal["head", "front", "tab"]
"""Above all tabs, the first tab, or among the tabs."""


def by_person(widget: W, do: Callable[[], None]) -> W:
    """Call a function when a person changes a widget; returns the widget."""
    widget.on_update(lambda event: do() if event.client_id is not None else None)
    return widget


def button(gui: viser.GuiApi, label: str, do: Callable[[], None], **options: Any) -> viser.GuiButtonHandle:
    """Add a button that calls a function; ``options`` are viser's."""
    made = gui.add_button(label, **options)
    made.on_click(lambda _: do())
    return made


def button_row(
    gui: viser.GuiApi, label: str, actions: Mapping[str, Callable[[], None]], **options: Any
) -> viser.GuiButtonGroupHandle:
    """Add a row of buttons, each of which calls its function; ``options`` are viser's."""
    made = gui.add_button_group(label, tuple(actions), **options)
    made.on_click(lambda event: actions[str(event.target.value)]())
    return made


class Panel:
    """A part of the page. ``Panel(page, ...)`` fills the container of ``page.gui`` that is open at that time.

    The page calls these methods when something happens; a panel overrides those that it needs. They may be called from
    any thread.
    """

    spec: "PanelSpec"
    """The line that registered it; set when it is made."""
    inputs: Sequence[viser.GuiInputHandle] = ()
    """The widgets that it made and that hold a value; set when it is made."""

    def built(self) -> None:
        """Called once all panels of the page exist and their state is restored."""

    def panels_changed(self) -> None:
        """Called when the page has other panels than before."""

    def base_changed(self, base: SIMap) -> None:
        """Called when the sliders get another map to cut; ``map_changed`` follows when it is cut."""

    def map_changed(self, simap: SIMap) -> None:
        """Called when another map is shown."""

    def selection_changed(self, instance_id: int | None) -> None:
        """Called when another instance is selected, or none."""

    def time_changed(self, frame: int, step: int | None) -> None:
        """Called when the page shows another frame of the build, or step of joining (None: the finished map)."""

    def view_changed(self, name: str) -> None:
        """Called when the top view or the slanted view was chosen; see `Viewpoints`."""

    def theme_changed(self) -> None:
        """Called when the page went from light to dark, or back."""

    def leave_robot(self) -> None:
        """Called when another panel moves the robot: stop it, and clear its path."""

    def style(self, simap: SIMap, style: Style) -> Style:
        """Return how to paint a map, given the style that the panels before this one chose."""
        return style

    def painted(self, simap: SIMap, snapshot: "Snapshot") -> None:
        """Called after a map was painted, as it was at a time step."""

    def told(self, event: dict[str, Any]) -> None:
        """Called when the page's own script reports what a person did: any JSON, to be checked."""

    def failed(self) -> None:
        """Called when a job of this page failed; the page itself shows the error."""

    clicks_first = False
    """Whether this panel's waiting for a click goes before that of panels without this."""

    def waits_for_click(self) -> bool:
        """Whether the next click on the map is for this panel."""
        return False

    def waits_for_place(self) -> bool:
        """Whether that click is one on a place, not on an object."""
        return False

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click on the map, if this panel waits for one; False passes it on."""
        return False

    def state(self) -> Any:
        """Return what to keep of this panel when the page is loaded again; None = nothing."""
        return None

    def restore(self, state: Any) -> None:
        """Restore what ``state`` returned before the reload."""

    def close(self) -> None:
        """Called when the browser tab was closed: stop threads and timers."""


@dataclass(frozen=True)
class PanelSpec:
    """The line that registers a panel, see `simaps_viz.viewer.panels`. Panels of one title share a tab."""

    title: str
    """The title of its tab."""
    icon: viser.IconName
    make: Callable[["Page"], Panel]
    """Fills the container of the page's ``gui`` that is open at that time; called once for each page."""
    place: Place = "tab"
    about: str = ""
    """What the tab is for, in the page's help; empty for one that the help describes already."""
    wanted: "Callable[[Services], bool]" = lambda services: True
    """Whether a page with these services has the panel."""
    right: Right | None = None
    """What the person at a page must be allowed for the page to have the panel; None for everybody."""

    @property
    def tab(self) -> tuple[str, str]:
        """Identifies its tab: place and title."""
        return self.place, self.title


class Panels:
    """The panels of one page. Each event of the page is passed on to all of them."""

    def __init__(self, page: "Page") -> None:
        """Take the page; `place` makes its panels, and `have` adds and removes some later."""
        self._page = page
        self._groups: dict[str, Any] = {}
        self._tabs: dict[tuple[str, str], Any] = {}
        self._panels: tuple[Panel, ...] = ()
        self._built = False
        self.specs: tuple[PanelSpec, ...] = ()
        """The specs of all panels, including those that could not be made."""

    def __getitem__(self, kind: type[P]) -> P:
        """Return the panel of a class.

        Raises:
            KeyError: the page has none.
        """
        for panel in self._panels:
            if isinstance(panel, kind):
                return panel
        raise KeyError(kind.__name__)

    def __contains__(self, kind: type[Panel]) -> bool:
        return any(isinstance(panel, kind) for panel in self._panels)

    @property
    def titles(self) -> tuple[str, ...]:
        """The titles of the tabs, each once."""
        return tuple(dict.fromkeys(panel.spec.title for panel in self._panels if panel.spec.place != "head"))

    def place(self, place: Place, group: Any, specs: Sequence[PanelSpec]) -> None:
        """Make the panels of one place, in the tabs of a group."""
        self._groups[place], self.specs = group, tuple(specs)
        self._add([spec for spec in specs if spec.place == place])

    def have(self, specs: Sequence[PanelSpec]) -> None:
        """Change the panels to these; those that exist already stay as they are."""
        self.specs = tuple(specs)
        gone = [panel for panel in self._panels if panel.spec not in specs]
        self._panels = tuple(panel for panel in self._panels if panel.spec in specs)
        for panel in gone:
            self._guarded(panel.close)
        for key in {panel.spec.tab for panel in gone} - {panel.spec.tab for panel in self._panels}:
            self._tabs.pop(key).remove()
        there = [panel.spec for panel in self._panels]
        self._add([spec for spec in specs if spec not in there])
        self.each(lambda panel: panel.panels_changed())

    def built(self) -> None:
        """Call ``built`` of all panels; a panel that is added later gets the call at once."""
        self._built = True
        self.each(lambda panel: panel.built())

    def each(self, do: Callable[[Panel], object]) -> None:
        """Pass an event on to every panel; an error of one is reported and does not keep it from the others."""
        for panel in self._panels:
            self._guarded(lambda panel=panel: do(panel))

    def style(self, simap: SIMap, style: Style) -> Style:
        """Return how all panels together want a map painted."""
        for panel in self._panels:
            style = panel.style(simap, style)
        return style

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Offer a click on the map to the panels that may wait for one."""
        panels = sorted(self._panels, key=lambda panel: not panel.clicks_first)
        return any(panel.take_click(x_m, y_m) for panel in panels)

    def wait_for_click(self) -> bool:
        """Whether a panel waits for a click on the map."""
        return any(panel.waits_for_click() for panel in self._panels)

    def wait_for_place(self) -> bool:
        """Whether a panel waits for a click on a place."""
        return any(panel.waits_for_place() for panel in self._panels)

    def states(self) -> dict[str, Any]:
        """Return the state of each panel, by its title and class."""
        states: dict[str, Any] = {}
        self.each(lambda panel: states.update({_key(panel): panel.state()}))
        return states

    def restore(self, states: Mapping[str, Any]) -> None:
        """Restore what ``states`` returned."""
        known = {key: state for key, state in states.items() if state is not None}
        self.each(lambda panel: panel.restore(known[_key(panel)]) if _key(panel) in known else None)

    def _add(self, specs: Sequence[PanelSpec]) -> None:
        """Make panels in their tabs; one that fails is left out, and its error is reported."""
        for spec in specs:
            if spec.tab not in self._tabs:
                group = self._groups[spec.place]
                self._tabs[spec.tab] = group if spec.place == "head" else group.add_tab(spec.title, spec.icon)
            known = inputs_of(self._page.gui)
            try:
                with contextlib.nullcontext() if spec.place == "head" else self._tabs[spec.tab]:
                    panel = spec.make(self._page)
            except Exception as error:
                self._page.report(error)
                continue
            panel.spec = spec
            panel.inputs = inputs_of(self._page.gui)[len(known) :]
            self._panels = (*self._panels, panel)
            if self._built:
                self._guarded(panel.built)

    def _guarded(self, do: Callable[[], object]) -> None:
        try:
            do()
        except Exception as error:
            self._page.report(error)


def _key(panel: Panel) -> str:
    return f"{panel.spec.title}/{type(panel).__name__}"


_LOCKS: "weakref.WeakKeyDictionary[viser.GuiApi, threading.RLock]" = weakref.WeakKeyDictionary()
"""One lock for all players of a page: showing a position stops the other players, which must not deadlock."""


@dataclass(frozen=True)
class Played:
    """The slider that is played, as functions; none of them may take long."""

    position: Callable[[], int]
    last: Callable[[], int]
    show: Callable[[int], None]
    rate: Callable[[], float]
    """Return the positions shown a second."""


class Player:
    """A button that plays and pauses a slider."""

    def __init__(self, gui: viser.GuiApi, label: str, played: Played) -> None:
        """Add the button to the open container; after the last position, playing begins at the first."""
        self._label, self._played = label, played
        self._turn: threading.Event | None = None
        self._lock = _LOCKS.setdefault(gui, threading.RLock())
        self.button = gui.add_button(label, icon=viser.Icon.PLAYER_PLAY)
        self.button.on_click(lambda _: self.toggle())

    def toggle(self) -> None:
        """Play, or pause."""
        with self._lock:
            if self._turn is not None:
                self.stop()
                return
            ended = self._turn = threading.Event()
            self.button.label, self.button.icon = "Pause", viser.Icon.PLAYER_PAUSE
            threading.Thread(target=self._run, args=(ended,), name="workbench-play", daemon=True).start()

    def stop(self) -> None:
        """Stop playing; no further position is shown after this call."""
        with self._lock:
            turn, self._turn = self._turn, None
            if turn is not None:
                turn.set()
                self.button.label, self.button.icon = self._label, viser.Icon.PLAYER_PLAY

    def _run(self, ended: threading.Event) -> None:
        played = self._played
        at = played.position()
        position = 0 if at >= played.last() else at
        while position <= played.last():
            with self._lock:
                if ended.is_set():
                    return
                played.show(position)
            if ended.wait(1.0 / max(played.rate(), 0.1)):
                return
            position += 1
        with self._lock:
            if self._turn is ended:
                self.stop()


ANSWER_S = 60.0
"""How long a question may be answered."""


class Question:
    """A dialog with a button for each answer, on one page.

    The buttons exist, and have ids, only once the question is asked, so that a message that was made up in advance
    presses none of them. One of them counts, once, within `ANSWER_S`, and as long as the file that the question is
    about is as it was.
    """

    def __init__(
        self,
        page: "Page",
        title: str,
        html: str,
        answers: Mapping[str, Callable[[], None]],
        *,
        file: Path | None = None,
        name: str | None = None,
    ) -> None:
        """Ask; the job of the answer that is chosen is then queued on the page's panels' thread.

        Args:
            page: whose person is asked.
            title: of the dialog.
            html: what will happen.
            answers: {label of a button: its job}.
            file: what the question is about, if that is a file.
            name: text to edit in the dialog, which `name` then returns.

        Raises:
            InputError: the person at the page may not edit.
        """
        if not page.may("edit"):
            raise InputError("expected the owner's page, found a visitor's, where nothing can be changed")
        self._page, self._file, self._seen = page, file, _mark(file)
        self._asked, self._lock, self._over = time.monotonic(), threading.Lock(), False
        gui = page.gui
        self._modal = gui.add_modal(title)
        with self._modal:
            gui.add_html(f'<div style="{BOX_STYLE};overflow-wrap:anywhere">{html}</div>')
            self._name: viser.GuiInputHandle[str] | None = None if name is None else gui.add_text("New name", name)
            for label, job in answers.items():
                button(gui, label, functools.partial(self._answer, job))
            button(gui, "Cancel", self.cancel, color="gray")

    @property
    def name(self) -> str:
        """The text of the dialog, without blanks around it."""
        return "" if self._name is None else self._name.value.strip()

    def cancel(self) -> None:
        """Close the dialog; nothing is done."""
        self._end()

    def _end(self) -> bool:
        """Close the dialog; False when that was done already."""
        with self._lock:
            over, self._over = self._over, True
        if not over:
            self._modal.close()
        return not over

    def _answer(self, job: Callable[[], None]) -> None:
        in_time = time.monotonic() - self._asked < ANSWER_S
        if self._end():
            self._page.submit(f"answer {id(self)}", functools.partial(self._do, job, in_time))

    def _do(self, job: Callable[[], None], in_time: bool) -> None:
        if not in_time:
            raise InputError(f"expected an answer within {ANSWER_S:g} s, found a later one; nothing was done")
        if _mark(self._file) != self._seen:
            raise InputError(f"{self._file}: expected the file as it was when you were asked, found it changed")
        job()


def _mark(file: Path | None) -> tuple[int, int, int] | None:
    """Return what tells a file from another one under its name; None where there is none."""
    try:
        status = None if file is None else os.stat(file, follow_symlinks=False)
    except OSError:
        return None
    return None if status is None else (status.st_ino, status.st_size, status.st_mtime_ns)
