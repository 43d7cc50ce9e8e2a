"""What a panel may ask of the page it stands on: one person's page, in one browser tab."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import viser
from numpy.typing import NDArray

from simaps_viz.structures import GridSpec, SIMap
from simaps_viz.viewer.drawing.scene import MapScene


@dataclass(frozen=True, eq=False)
class MapPicture:
    """A picture that lies where a map lies, in the place of the map's own."""

    spec: GridSpec
    """Which part of the floor it covers."""
    pixels: NDArray
    """uint8 [rows * n, cols * n, 3 or 4], RGB or RGBA, row 0 at the south; n = 1, 2, ..."""


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
    def selected(self) -> int | None:
        """Id of the selected instance of that map."""
        ...

    def select(self, instance_id: int | None) -> None:
        """Select an instance, or none."""
        ...

    def jump(self, frame: int) -> None:
        """Show a frame, here and in the recording."""
        ...

    def change_map(self, simap: SIMap) -> None:
        """Show another map of the same place on this page; what was selected stays so where it still exists."""
        ...

    def publish(self, simap: SIMap) -> None:
        """Show a changed map on every open page, and on those opened later; each page cuts it as its sliders are."""
        ...

    def show_picture(self, picture: MapPicture | None) -> None:
        """Lay a picture in the place of the map's own colours; None takes it away."""
        ...

    def repaint(self) -> None:
        """Colour the map anew, soon."""
        ...

    def submit(self, name: str, job: Callable[[], None]) -> None:
        """Do work off the page's threads; a waiting job of the same name is replaced; what it raises is said here."""
        ...

    def say(self, title: str, text: str) -> None:
        """Tell this person something in passing."""
        ...

    def report(self, error: Exception) -> None:
        """Tell this person that something went wrong."""
        ...


class Panel(Protocol):
    """A part of the page. ``Panel(desk, ...)`` fills the container of ``desk.gui`` that is open at that time."""

    def map_changed(self, simap: SIMap) -> None:
        """Another map is shown."""
        ...

    def take_click(self, x_m: float, y_m: float) -> bool:
        """Use a click on the map, if one was waited for (the robot's start, a line to split by); False lets it pass."""
        ...

    def close(self) -> None:
        """The person has gone: stop threads and timers."""
        ...
