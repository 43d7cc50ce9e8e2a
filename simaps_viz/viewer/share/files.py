"""The files a map can be shared as, by the ending of their names."""

from collections.abc import Callable, Mapping
from typing import Any

from simaps_viz.events import Progress
from simaps_viz.structures import SIMap
from simaps_viz.viewer.share.film import gif_bytes, key_picture, png_bytes, shots
from simaps_viz.viewer.share.page import page_html
from simaps_viz.viewer.share.story import Look, Ride


def share_bytes(
    ending: str,
    simap: SIMap,
    *,
    ride: Ride | None = None,
    look: Look | None = None,
    radius_m: float = 0.2,
    tell: Progress | None = None,
) -> bytes:
    """Make a file.

    Args:
        ending: one of ``MAKERS``.
        simap: the map.
        ride: a command that the robot carries out at the end.
        look: the map after a frame, where that is known; else objects appear once a frame has named them.
        radius_m: of the robot.
        tell: told how far it is; may raise to end the work.

    Raises:
        InputError: there is nothing to show.
    """
    return MAKERS[ending](simap, ride=ride, look=look, radius_m=radius_m, tell=tell)


def _gif(simap: SIMap, *, ride: Ride | None, look: Look | None, radius_m: float, tell: Progress | None) -> bytes:
    film = shots(simap, ride=ride, look=look, radius_m=radius_m, tell=tell)
    return gif_bytes(film, key_picture(simap, ride=ride, radius_m=radius_m))


def _png(simap: SIMap, *, ride: Ride | None, look: Look | None, radius_m: float, tell: Progress | None) -> bytes:
    return png_bytes(simap, ride=ride, radius_m=radius_m)


def _html(simap: SIMap, **what: Any) -> bytes:
    return page_html(simap, **what)


MAKERS: Mapping[str, Callable[..., bytes]] = {".html": _html, ".gif": _gif, ".png": _png}
