"""The first tab while a map is being built: progress, speed and remaining time; stop and resume."""

import base64
import threading
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Generic, Literal, Protocol, TypeVar

import viser

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.theme import BAD_STYLE, BOX_STYLE, DIM_STYLE
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec, Question, button, by_person

S = TypeVar("S")
Status = Literal["starting", "building", "finishing", "stopping", "stopped", "failed", "done"]


@dataclass(frozen=True)
class LiveState:
    """The progress of a build."""

    status: Status = "starting"
    done: int = 0
    """Frames on the map."""
    total: int = 0
    """Frames of the sequence; 0 = they come live, and nobody knows how many."""
    rate: float | None = None
    """Frames a second over the last frames."""
    left_s: float | None = None
    """Seconds until the last frame is on the map."""
    skipped: int = 0
    """Frames that could not be read."""
    error: str = ""
    """Why it failed."""
    notice: str = ""
    """Where the finished map was saved, or how a stopped build can be resumed."""
    shown: int = 0
    """Frames in the map that the page shows; 0 = no map yet."""
    sketch: bytes = b""
    """Picture (PNG) of the cells seen so far, north up; empty = none."""
    words: str = ""
    """State of a live source: rate, delay, drops, connection."""
    driving: str = ""
    """What the real robot does, or why it does not."""


class Drives(Protocol):
    """Lets the real robot drive."""

    @property
    def allowed(self) -> bool:
        """It can be switched on."""
        ...

    @property
    def switched(self) -> bool:
        """It is."""
        ...

    def switch(self, on: bool) -> None:
        """Allow driving, or stop."""
        ...

    def go(self, command: str) -> None:
        """Rehearse a command, and let the robot drive its path."""
        ...

    def stop(self) -> None:
        """Stop."""
        ...


ABOUT = "progress of the build; stop it, and resume it"
EVERY_S = 1.0
"""Seconds between updates."""
HEADS: dict[Status, str] = {
    "starting": "Waiting for the first frame …",
    "building": "Building the map",
    "finishing": "All frames are in: finding the objects …",
    "stopping": "Stopping after this frame, and drawing the map so far …",
    "stopped": "Stopped",
    "failed": "The build failed",
    "done": "The map is done",
}
LIVE_HEADS: dict[Status, str] = {
    "building": "The map grows",
    "stopping": "Saving the map …",
    "failed": "No map was made",
}
"""Where frames come live."""

STOPS = {
    True: (
        "Stop",
        "Resumed, it goes on where it was stopped if its method keeps a log; else it begins anew.",
    ),
    False: ("End and save", "The map of what was seen so far is finished and saved. No more frames are added to it."),
}
"""{whether the build has an end of its own: what stopping it is called, and what becomes of the map}."""
WAITING = "The first objects appear after a few seconds; the smaller the cells, the longer it takes to find them."


def live_panel(
    state: Callable[[], LiveState], stop: Callable[[], None], resume: Callable[[], None], drive: Drives | None = None
) -> PanelSpec:
    """Return the spec of the tab; the functions report, stop and resume the build, and return at once."""
    make = lambda page: LivePanel(page, state, stop, resume, drive)  # noqa: E731
    return PanelSpec("Progress", viser.Icon.HAMMER, make, "front", ABOUT)


class ProgressPanel(Panel, Generic[S]):
    """A panel that shows a state, again each time it has changed; a thread looks until the panel is closed."""

    def __init__(self, state: Callable[[], S]) -> None:
        """Show the state; to be called once the widgets are made."""
        self._state = state
        self._closed = threading.Event()
        self._shown: S | None = None
        self._update()
        threading.Thread(target=self._run, name="workbench-live", daemon=True).start()

    def close(self) -> None:
        """Stop updating."""
        self._closed.set()

    def show(self, state: S) -> None:
        """Fill the widgets."""
        raise NotImplementedError

    def _run(self) -> None:
        while not self._closed.wait(EVERY_S):
            try:
                self._update()
            except RuntimeError:  # the widgets were removed meanwhile; a lock could deadlock with their removal
                if not self._closed.is_set():
                    raise

    def _update(self) -> None:
        state = self._state()
        if state != self._shown:
            self._shown = state
            self.show(state)


class LivePanel(ProgressPanel[LiveState]):
    """Progress of a build, a sketch of its map, and buttons to stop and resume it for those who may."""

    def __init__(
        self, page: Page, state: Callable[[], LiveState], stop: Callable[[], None], resume: Callable[[], None],
        drive: Drives | None = None,
    ) -> None:  # fmt: skip
        """Fill the open container."""
        gui = page.gui
        self._head = gui.add_html("")
        self._bar = gui.add_progress_bar(0.0)  # an animated one makes the browser redraw the page 60 times a second
        self._text = gui.add_html("")
        self._sketch = gui.add_html("")
        self._page, self._stop_build, self._may_stop = page, stop, page.may("edit")
        if self._may_stop:
            self._stop = button(gui, "Stop …", self._ask_whether, icon=viser.Icon.PLAYER_STOP, color="gray")
            self._resume = button(gui, "Resume", resume, icon=viser.Icon.PLAYER_PLAY, visible=False)
        self._driving = None if drive is None or not page.may("drive") else self._add_driving(gui, drive)
        super().__init__(state)

    def _add_driving(self, gui: viser.GuiApi, drive: Drives) -> viser.GuiHtmlHandle:
        """Add what lets the real robot drive; *Stop* works whatever the switch says."""
        self.drive_switch = gui.add_checkbox(
            "Drive the real robot", drive.switched, disabled=not drive.allowed,
            hint="Off: nothing but maps and paths is sent." if drive.allowed else "Needs simaps live … --drive.",
        )  # fmt: skip
        by_person(self.drive_switch, lambda: drive.switch(self.drive_switch.value))
        command = gui.add_text("Command", "", disabled=not drive.allowed)
        button(gui, "Rehearse and drive", lambda: drive.go(command.value), disabled=not drive.allowed)
        button(gui, "Stop the robot", drive.stop, icon=viser.Icon.PLAYER_STOP, color="red", disabled=not drive.allowed)
        return gui.add_html("")

    def show(self, state: LiveState) -> None:
        """Fill the widgets."""
        if self._driving is not None:
            self._driving.content = f'<div role="status" style="{BOX_STYLE}">{escape(state.driving)}</div>'
        heads = HEADS if state.total else HEADS | LIVE_HEADS
        self._head.content = head_html(heads[state.status], bad=state.status == "failed")
        self._bar.visible = state.total > 0 and state.status != "done"
        self._bar.value = 100.0 * state.done / max(state.total, 1)
        self._text.content = text_html(state)
        self._sketch.content = sketch_html(state)
        if not self._may_stop:
            return
        self._stop.visible = state.status in ("starting", "building", "finishing", "stopping")
        self._stop.disabled = state.status in ("finishing", "stopping")
        self._stop.label = f"{STOPS[state.total > 0][0]} …"
        self._resume.visible = state.status in ("stopped", "failed") and state.total > 0

    def _ask_whether(self) -> None:
        what, then = STOPS[self._state().total > 0]
        Question(self._page, f"{what}?", then, {f"{what} now": self._stop_build})


def head_html(text: str, *, bad: bool = False) -> str:
    """Set what is being done as a heading."""
    style = f"{BOX_STYLE};font-size:1em;font-weight:600" + (f";{BAD_STYLE}" if bad else "")
    return f'<div role="status" style="{style}">{escape(text)}</div>'


def text_html(state: LiveState) -> str:
    """Describe progress, speed and remaining time."""
    live = not state.total
    parts = [f"{plural(state.done, 'frame')} on the map" if live else f"{state.done} of {plural(state.total, 'frame')}"]
    if not live and state.status == "building" and state.rate:
        parts.append(f"{state.rate:.{0 if state.rate >= 10 else 1}f} frames/s")
    if state.status == "building" and state.left_s is not None:
        parts.append(f"{duration(state.left_s)} left")
    if state.skipped:
        parts.append(f"{state.skipped} could not be read")
    lines = [f"<div>{escape(' · '.join(parts))}</div>"]
    lines += [f"<div>{escape(state.words)}</div>"] if state.words else []
    lines += [f"<div>{escape(state.error)}</div>"] if state.error else []
    if state.status in ("building", "stopping"):
        known = f"The map shows the first {plural(state.shown, 'frame')}." if state.shown else WAITING
        lines.append(f'<div style="{DIM_STYLE}">{known}</div>')
    lines += [f'<div style="{DIM_STYLE};overflow-wrap:anywhere">{escape(state.notice)}</div>'] if state.notice else []
    return f'<div style="{BOX_STYLE}">{"".join(lines)}</div>'


def sketch_html(state: LiveState) -> str:
    """Show a small picture of the cells seen so far; its height is fixed, so that nothing below it moves."""
    if not state.sketch or state.status not in ("building", "stopping", "stopped"):
        return ""
    picture = base64.b64encode(state.sketch).decode()
    style = "width:100%;height:11em;object-fit:contain;image-rendering:pixelated;display:block"
    title = f'<div style="{DIM_STYLE}">Seen so far, by class; the red dot is the camera</div>'
    return (
        f'<div style="{BOX_STYLE}">{title}<img alt="What was seen so far" style="{style}" '
        f'src="data:image/png;base64,{picture}"></div>'
    )


def duration(seconds: float) -> str:
    """Write a duration: "8 s", "2 min 05 s", "1 h 10 min"."""
    whole = max(round(seconds), 1)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
