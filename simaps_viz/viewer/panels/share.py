"""The panel that saves the page's content as one file, which the browser downloads."""

import functools
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import viser

from simaps_viz.navigation.agent import Answer, StepEvent
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, PanelSpec
from simaps_viz.viewer.page.worker import Worker
from simaps_viz.viewer.panels.compare import Cancelled, note
from simaps_viz.viewer.share.files import share_bytes
from simaps_viz.viewer.share.story import Drive, Look, drive_of, title_of

ABOUT = "one file of map and build that opens without a server; pictures and films"


@dataclass(frozen=True)
class ShareServices:
    """Plain functions behind the panel."""

    ask: Callable[[SIMap, str, Pose2], Answer] | None = None
    """As in `Services`; without it no robot drives."""
    steps: Callable[[SIMap, str, Pose2], Iterable[StepEvent]] | None = None
    """As in `Services`."""
    look: Callable[[SIMap], Look | None] | None = None
    """(map) -> function that returns the map after a frame; None if no history is at hand."""
    radius_m: float = 0.2
    """The radius of the robot."""


def share_panel(services: ShareServices) -> PanelSpec:
    """Return the tab of a page that has this panel."""
    return PanelSpec("Share", viser.Icon.SHARE, lambda page: SharePanel(page, services), about=ABOUT)


class SharePanel(Panel):
    """A command to end with, and a button for each kind of file."""

    def __init__(self, page: Page, services: ShareServices) -> None:
        """Fill the open container."""
        self._page, self._services = page, services
        self._worker = Worker(self._failed)  # a thread of its own: a film takes some seconds
        self._stopped = False
        gui = page.gui
        gui.add_html(note("One file to send to somebody. It opens without a network and holds no frames."))
        self._command = gui.add_text(
            "Ends with", "", visible=services.ask is not None,
            hint="A command the robot carries out at the end of a page or a film; empty: none.",
        )  # fmt: skip
        self._buttons = {
            ending: gui.add_button(label, icon=icon, hint=hint)
            for ending, label, icon, hint in (
                (".html", "Save as page (.html)", viser.Icon.WORLD, "To turn, zoom and scrub in any browser."),
                (
                    ".gif",
                    "Save as film (.gif)",
                    viser.Icon.MOVIE,
                    "The build and the robot's drive, for slides and chats.",
                ),
                (".png", "Save as picture (.png)", viser.Icon.PHOTO, "Large, with title, legend and scale bar."),
            )
        }
        for ending, button in self._buttons.items():
            button.on_click(functools.partial(self._clicked, ending))
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._status = gui.add_html("")

    def close(self) -> None:
        """Cancel the file that is being made."""
        self._stopped = True
        self._worker.stop()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until the file is made; False when that took too long."""
        return self._worker.wait_idle(timeout_s)

    def _clicked(self, ending: str, _: viser.GuiEvent) -> None:
        for button in self._buttons.values():
            button.disabled = True
        self._progress.visible, self._progress.value = True, 0.0
        self._status.content = note("Making the file …")
        self._worker.submit("share", functools.partial(self._make, ending, self._page.simap))

    def _make(self, ending: str, simap: SIMap) -> None:
        def report(what: str, done: int, total: int) -> None:
            if self._stopped:
                raise Cancelled
            self._progress.value = 100.0 * done / max(total, 1)

        services = self._services
        look = services.look(simap) if services.look is not None else None
        try:
            drive = self._drive(simap)
            content = share_bytes(ending, simap, drive=drive, look=look, radius_m=services.radius_m, progress=report)
        except Cancelled:
            return
        name = file_name(simap, ending)
        self._page.send(name, content)
        self._done()
        self._status.content = note(f"{name} · {len(content) / 1e6:.1f} MB")

    def _drive(self, simap: SIMap) -> Drive | None:
        command, services = str(self._command.value).strip(), self._services
        if not command or services.ask is None:
            return None
        return drive_of(simap, command, self._page.pose, ask=services.ask, steps=services.steps)

    def _done(self) -> None:
        self._progress.visible = False
        for button in self._buttons.values():
            button.disabled = False

    def _failed(self, error: Exception) -> None:
        self._done()
        self._status.content = note("No file was made: see the message.", tone="bad")
        self._page.report(error)


def file_name(simap: SIMap, ending: str) -> str:
    """Name a file after what the map shows: "cafe-light-errors.html"."""
    stem = re.sub("[^a-z0-9]+", "-", Path(title_of(simap)).stem.lower()).strip("-")
    return f"{stem or 'map'}{ending}"
