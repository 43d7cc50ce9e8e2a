"""What a panel may ask of the page it stands on: one person's page, in one browser tab."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import viser

from simaps_viz.drawing.texture import MapPicture
from simaps_viz.drawing.theme import Theme
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.scene.camera import Extent
from simaps_viz.viewer.scene.map_scene import MapScene


class Desk(Protocol):
    """One person's page. All of it may be called from any thread; none of it takes long."""

    @property
    def gui(self) -> viser.GuiApi:
        """This page's own widgets."""
        ...

    @property
    def scene(self) -> MapScene:
        """This page's own 3-D scene."""
        ...

    @property
    def simap(self) -> SIMap:
        """The map shown now."""
        ...

    @property
    def theme(self) -> Theme:
        """Whether the page is light or dark."""
        ...

    @property
    def aspect(self) -> float:
        """Width over height of the canvas in its middle."""
        ...

    @property
    def selected(self) -> int | None:
        """Id of the selected instance of that map."""
        ...

    @property
    def pose(self) -> Pose2:
        """Where the robot stands."""
        ...

    def select(self, instance_id: int | None) -> None:
        """Select an instance, or none."""
        ...

    def jump(self, frame: int) -> None:
        """Show a frame, here and in the recording."""
        ...

    def publish(self, simap: SIMap) -> None:
        """Show a changed map on every open page, and on those opened later; each page cuts it as its sliders are."""
        ...

    def show_picture(self, picture: MapPicture | None) -> None:
        """Lay a picture in the place of the map's own colours; None takes it away."""
        ...

    def look_at(self, extent: Extent | None) -> None:
        """Look straight down on a part of the floor; None: as before."""
        ...

    def show_recording(self, path: Path) -> None:
        """Show a recorded build beside the map, where the page has a place for one."""
        ...

    def send(self, name: str, content: bytes) -> None:
        """Hand the browser a file of that name to save."""
        ...

    def repaint(self) -> None:
        """Colour the map anew, soon."""
        ...

    def submit(self, name: str, job: Callable[[], None]) -> None:
        """Do work off the page's threads; a waiting job of the same name is replaced; what it raises is said here."""
        ...

    def say(self, title: str, text: str) -> None:
        """Notify this person something in passing."""
        ...

    def report(self, error: Exception) -> None:
        """Notify this person that something went wrong."""
        ...


class Panel:
    """A part of the page. ``Panel(desk, ...)`` fills the container of ``desk.gui`` that is open at that time.

    Each method tells of something that happens on the page; a panel has those that concern it.
    """

    def map_changed(self, simap: SIMap) -> None:
        """Another map is shown."""

    def selection_changed(self, instance_id: int | None) -> None:
        """Another object is selected, or none."""

    def show_frame(self, frame: int) -> None:
        """The page shows another frame."""

    def theme_changed(self) -> None:
        """The page went from light to dark, or back."""

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click on the map, if one was waited for (a line to split by); False lets it pass."""
        return False

    def state(self) -> Any:
        """Return what this person did, for a page that is loaded again; None = nothing."""
        return None

    def restore(self, state: Any) -> None:
        """Take back what ``state`` gave."""

    def close(self) -> None:
        """The person has gone: stop threads and timers."""


MAP, COMMAND, BUILD, INSTANCE, JUDGE = "Map", "Command", "Build", "Instance", "Judge"
PROGRESS = "Progress"
"""Only there until the map is done."""


@dataclass(frozen=True)
class PanelSpec:
    """A panel that is on every page."""

    title: str
    """Of its tab."""
    icon: viser.IconName
    make: Callable[[Desk], Panel]
    """Fills the container of the desk's ``gui`` that is open at that time; once for each page."""
    place: Literal["tab", "instance", "front"] = "tab"
    """Among the tabs of the main panel, beside the one about the selected instance, or in front of all tabs."""


BUILT_IN: tuple[tuple[str, viser.IconName], ...] = (
    (JUDGE, viser.Icon.GAVEL),
    (MAP, viser.Icon.MAP),
    (COMMAND, viser.Icon.ROBOT),
    (BUILD, viser.Icon.TIMELINE),
)
"""The tabs in front of those that `Services.panels` names."""
