"""The panel that saves what is on the page as one file, which the browser downloads."""

import functools
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import viser

from simaps_viz.errors import InputError
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.desk import Desk
from simaps_viz.viewer.own_page import Send, robot_on, send_from
from simaps_viz.viewer.panels.compare_services import Cancelled
from simaps_viz.viewer.panels.compare_words import note
from simaps_viz.viewer.panels.spec import PanelSpec
from simaps_viz.viewer.services import AnswerLike, StepLike
from simaps_viz.viewer.share.files import share_bytes
from simaps_viz.viewer.share.story import Look, Ride, ride_of, title_of
from simaps_viz.viewer.worker import Worker


@dataclass(frozen=True)
class ShareServices:
    """Plain functions behind the panel."""

    ask: Callable[[SIMap, str, Pose2], AnswerLike] | None = None
    """As in `Services`; without it no robot drives."""
    steps: Callable[[SIMap, str, Pose2], Iterable[StepLike]] | None = None
    """As in `Services`."""
    look: Callable[[SIMap], Look | None] | None = None
    """(map) -> what gives the map after a frame, where that is known."""
    start: Callable[[SIMap], Pose2] | None = None
    """Where the robot starts when the page does not say; may raise InputError."""
    radius_m: float = 0.2
    """Of the robot."""


def share_panel(services: ShareServices) -> PanelSpec:
    """Give the tab of a page that has this panel."""

    def make(desk: Desk) -> SharePanel:
        return SharePanel(desk, services, send=send_from(desk), pose=robot_on(desk))

    return PanelSpec("Share", viser.Icon.SHARE, make)


class SharePanel:
    """A command to end with, and a button for each kind of file."""

    def __init__(
        self, desk: Desk, services: ShareServices, *, send: Send | None, pose: Callable[[], Pose2] | None = None
    ) -> None:
        """Fill the open container.

        Args:
            desk: the page.
            services: what carries out the command.
            send: hands the browser a file; None: there is none to hand it to.
            pose: where this page's robot stands; None takes ``services.start``.
        """
        self._desk, self._services, self._send, self._pose = desk, services, send, pose
        self._worker = Worker(self._failed)  # of its own: a film takes some seconds
        self._stopped = False
        gui = desk.gui
        gui.add_html(note("One file to send to somebody. It opens without a network and holds no frames."))
        self._command = gui.add_text(
            "Ends with", "", visible=services.ask is not None,
            hint="A command the robot carries out at the end of a page or a film; empty: none.",
        )  # fmt: skip
        self._buttons = {
            ending: gui.add_button(label, icon=icon, hint=hint)
            for ending, label, icon, hint in (
                (".html", "Save as page (.html)", viser.Icon.WORLD, "To turn, zoom and scrub in any browser."),
                (".gif", "Save as film (.gif)", viser.Icon.MOVIE, "The build and the ride, for slides and chats."),
                (".png", "Save as picture (.png)", viser.Icon.PHOTO, "Large, with title, legend and scale bar."),
            )
        }
        for ending, button in self._buttons.items():
            button.on_click(functools.partial(self._clicked, ending))
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._status = gui.add_html("")

    def map_changed(self, simap: SIMap) -> None:
        """Nothing to do: a file shows the map of the moment it was asked for."""

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Wait for no click."""
        return False

    def close(self) -> None:
        """Give up what is being made."""
        self._stopped = True
        self._worker.stop()

    def wait_idle(self, timeout_s: float = 60.0) -> bool:
        """Wait until nothing is being made; False when that took too long."""
        return self._worker.wait_idle(timeout_s)

    def _clicked(self, ending: str, _: viser.GuiEvent) -> None:
        for button in self._buttons.values():
            button.disabled = True
        self._progress.visible, self._progress.value = True, 0.0
        self._status.content = note("Making the file …")
        self._worker.submit("share", functools.partial(self._make, ending, self._desk.simap))

    def _make(self, ending: str, simap: SIMap) -> None:
        def tell(what: str, done: int, total: int) -> None:
            if self._stopped:
                raise Cancelled
            self._progress.value = 100.0 * done / max(total, 1)

        services = self._services
        look = services.look(simap) if services.look is not None else None
        try:
            ride = self._ride(simap)
            content = share_bytes(ending, simap, ride=ride, look=look, radius_m=services.radius_m, tell=tell)
        except Cancelled:
            return
        name = file_name(simap, ending)
        if self._send is None:
            raise InputError("share: expected a browser to hand the file to, found none")
        self._send(name, content)
        self._done()
        self._status.content = note(f"{name} · {len(content) / 1e6:.1f} MB")

    def _ride(self, simap: SIMap) -> Ride | None:
        command, services = str(self._command.value).strip(), self._services
        if not command or services.ask is None:
            return None
        if self._pose is not None:
            pose = self._pose()
        elif services.start is not None:
            pose = services.start(simap)
        else:
            raise InputError("share: expected a place where the robot starts, found none")
        return ride_of(simap, command, pose, ask=services.ask, steps=services.steps)

    def _done(self) -> None:
        self._progress.visible = False
        for button in self._buttons.values():
            button.disabled = False

    def _failed(self, error: Exception) -> None:
        self._done()
        self._status.content = note("No file was made: see the message.", tone="bad")
        self._desk.report(error)


def file_name(simap: SIMap, ending: str) -> str:
    """Name a file after what the map shows: "cafe-light-errors.html"."""
    stem = re.sub("[^a-z0-9]+", "-", Path(title_of(simap)).stem.lower()).strip("-")
    return f"{stem or 'map'}{ending}"
