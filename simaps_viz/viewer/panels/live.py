"""The tab in front while a map is being built: how far it is, how fast, how long still; stop and go on."""

import base64
import threading
from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Literal

import viser

from simaps_viz.colors.classes import plural
from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec

Status = Literal["starting", "building", "finishing", "stopping", "stopped", "failed", "done"]


@dataclass(frozen=True)
class LiveState:
    """How far a build is."""

    status: Status = "starting"
    done: int = 0
    """Frames on the map."""
    total: int = 0
    """Frames of the sequence."""
    rate: float | None = None
    """Frames a second, lately."""
    left_s: float | None = None
    """Seconds until the last frame is on the map."""
    skipped: int = 0
    """Frames that could not be read."""
    error: str = ""
    """Why it failed, in words."""
    said: str = ""
    """Where the map is, once it is done; or how a stopped build goes on."""
    shown: int = 0
    """Frames that the map on the page knows of; 0 = none has been shown yet."""
    sketch: bytes = b""
    """Picture (PNG) of what was seen so far, north up; empty = none."""


@dataclass(frozen=True)
class LiveServices:
    """All of these return at once."""

    state: Callable[[], LiveState]
    stop: Callable[[], None]
    go_on: Callable[[], None]
    """Begin again where it was stopped, or has failed."""


ABOUT = "how far the build is; stop it, and go on with it"
EVERY_S = 1.0
"""How often the numbers are brought up to date."""
HEADS: dict[Status, str] = {
    "starting": "Waiting for the first frame …",
    "building": "Building the map",
    "finishing": "All frames are in: finding the objects …",
    "stopping": "Stopping after this frame, and drawing the map so far …",
    "stopped": "Stopped",
    "failed": "The build failed",
    "done": "The map is done",
}

WAITING = "The first objects appear after a few seconds; the smaller the cells, the longer it takes to find them."


def live_panel(services: LiveServices) -> PanelSpec:
    """Return the tab."""
    return PanelSpec("Progress", viser.Icon.HAMMER, lambda page: LivePanel(page, services), "front", ABOUT)


class LivePanel(Panel):
    """The widgets; a thread of its own keeps them up to date until the map is done or the person has gone."""

    def __init__(self, page: Page, services: LiveServices) -> None:
        """Fill the open container."""
        self._services = services
        self._closed = threading.Event()
        self._shown: LiveState | None = None
        gui = page.gui
        self._head = gui.add_html("")
        self._bar = gui.add_progress_bar(0.0)  # one that moves by itself has the whole page drawn 60 times a second
        self._text = gui.add_html("")
        self._sketch = gui.add_html("")
        self._stop = gui.add_button("Stop", icon=viser.Icon.PLAYER_STOP, color="gray")
        self._stop.on_click(lambda _: services.stop())
        self._go_on = gui.add_button("Go on", icon=viser.Icon.PLAYER_PLAY, visible=False)
        self._go_on.on_click(lambda _: services.go_on())
        self._update()
        threading.Thread(target=self._run, name="workbench-live", daemon=True).start()

    def close(self) -> None:
        """Stop looking."""
        self._closed.set()

    def _run(self) -> None:
        while not self._closed.wait(EVERY_S):
            try:
                self._update()
            except RuntimeError:  # the widgets went meanwhile; a lock could wait for the one who removes them
                if not self._closed.is_set():
                    raise

    def _update(self) -> None:
        state = self._services.state()
        if state == self._shown:
            return
        self._shown = state
        self._head.content = head_html(state)
        self._bar.value = 100.0 * state.done / max(state.total, 1)
        self._text.content = text_html(state)
        self._sketch.content = sketch_html(state)
        self._stop.visible = state.status in ("starting", "building", "finishing", "stopping")
        self._stop.disabled = state.status in ("finishing", "stopping")
        self._go_on.visible = state.status in ("stopped", "failed")


def head_html(state: LiveState) -> str:
    """Describe what is going on."""
    style = ";color:light-dark(#b02a2a,#ff8f8f)" if state.status == "failed" else ""
    style = f"{BOX_STYLE};font-size:1em;font-weight:600{style}"
    return f'<div role="status" style="{style}">{escape(HEADS[state.status])}</div>'


def text_html(state: LiveState) -> str:
    """Describe how far, how fast, how long."""
    parts = [f"{state.done} of {plural(state.total, 'frame')}"]
    if state.status == "building" and state.rate:
        parts.append(f"{state.rate:.{0 if state.rate >= 10 else 1}f} frames/s")
    if state.status == "building" and state.left_s is not None:
        parts.append(f"{duration(state.left_s)} left")
    if state.skipped:
        parts.append(f"{state.skipped} could not be read")
    lines = [f"<div>{escape(' · '.join(parts))}</div>"]
    lines += [f"<div>{escape(state.error)}</div>"] if state.error else []
    if state.status in ("building", "stopping"):
        known = f"The map shows the first {plural(state.shown, 'frame')}." if state.shown else WAITING
        lines.append(f'<div style="{DIM_STYLE}">{known}</div>')
    lines += [f'<div style="{DIM_STYLE};overflow-wrap:anywhere">{escape(state.said)}</div>'] if state.said else []
    return f'<div style="{BOX_STYLE}">{"".join(lines)}</div>'


def sketch_html(state: LiveState) -> str:
    """Show what was seen so far, in little, while it grows; a place of one height, so that nothing moves."""
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
    """Describe how long: "8 s", "2 min 05 s", "1 h 10 min"."""
    whole = max(round(seconds), 1)
    if whole < 60:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
