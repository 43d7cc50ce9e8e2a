"""The panel that saves the page's content as one file, which the browser downloads."""

import functools
import re
from pathlib import Path

import viser

from simaps_viz.drawing.legend import title_of
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page, Worker
from simaps_viz.viewer.page.panel import Panel, PanelSpec, button
from simaps_viz.viewer.page.share import Drive, drive_of, share_bytes
from simaps_viz.viewer.panels.compare import Cancelled, note

ABOUT = "one file of map and build that opens without a server; pictures and films"


KINDS = (
    (".html", "Save as page (.html)", viser.Icon.WORLD, "To turn, zoom and scrub in any browser."),
    (".gif", "Save as film (.gif)", viser.Icon.MOVIE, "The build and the robot's drive, for slides and chats."),
    (".png", "Save as picture (.png)", viser.Icon.PHOTO, "Large, with title, legend and scale bar."),
)
"""Ending, label, icon and hint of each kind of file."""


class SharePanel(Panel):
    """A command to end with, and a button for each kind of file."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page = page
        self._worker = Worker(self._failed)  # a thread of its own: a film takes some seconds
        self._stopped = False
        gui = page.gui
        gui.add_html(note("One file to send to somebody. It opens without a network and holds no frames."))
        self._command = gui.add_text(
            "Robot's drive", "", visible=page.services.ask is not None,
            hint="A command, such as: go to the couch. A page or a film ends with the robot's drive; empty: without.",
        )  # fmt: skip
        self._buttons = [
            button(gui, label, functools.partial(self._clicked, ending), icon=icon, hint=hint)
            for ending, label, icon, hint in KINDS
        ]
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._status = gui.add_html("")

    def close(self) -> None:
        """Cancel the file that is being made."""
        self._stopped = True
        self._worker.stop()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until the file is made; False when that took too long."""
        return self._worker.wait_idle(timeout_s)

    def _clicked(self, ending: str) -> None:
        for one in self._buttons:
            one.disabled = True
        self._progress.visible, self._progress.value = True, 0.0
        self._status.content = note("Making the file …")
        self._worker.submit("share", functools.partial(self._make, ending, self._page.simap))

    def _make(self, ending: str, simap: SIMap) -> None:
        def report(what: str, done: int, total: int) -> None:
            if self._stopped:
                raise Cancelled
            self._progress.value = 100.0 * done / max(total, 1)

        past = self._page.services.look_back
        look = None if past is None else functools.partial(past, simap)
        try:
            content = share_bytes(ending, simap, drive=self._drive(simap), look=look, progress=report)
        except Cancelled:
            return
        name = file_name(simap, ending)
        self._page.send(name, content)
        self._done()
        self._status.content = note(f"{name} · {len(content) / 1e6:.1f} MB")

    def _drive(self, simap: SIMap) -> Drive | None:
        command, services = str(self._command.value).strip(), self._page.services
        if not command or services.ask is None:
            return None
        return drive_of(simap, command, self._page.pose, ask=functools.partial(services.ask, robot=self._page.robot))

    def _done(self) -> None:
        self._progress.visible = False
        for one in self._buttons:
            one.disabled = False

    def _failed(self, error: Exception) -> None:
        self._done()
        self._status.content = note("No file was made: see the message.", tone="bad")
        self._page.report(error)


def file_name(simap: SIMap, ending: str) -> str:
    """Name a file after what the map shows: "cafe-light-errors.html"."""
    stem = re.sub("[^a-z0-9]+", "-", Path(title_of(simap)).stem.lower()).strip("-")
    return f"{stem or 'map'}{ending}"


SHARE = PanelSpec("Share", viser.Icon.SHARE, SharePanel, about=ABOUT)
