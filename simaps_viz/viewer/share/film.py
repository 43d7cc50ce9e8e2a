"""A run as a film: the map grows, then a robot carries out a command. An animated GIF; and one PNG."""

import io
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.structures import SIMap
from simaps_viz.viewer.share.sheet import Sheet
from simaps_viz.viewer.share.story import Look, Ride, moments

FILM_WIDTH, PICTURE_WIDTH = 760, 2400
"""About how wide the map is on a film and on a picture, pixels."""
MOST_MOMENTS = 40
MOMENT_S = 0.16
HOLD_S = 1.2
"""How long the finished map, and the end of a ride, are shown."""
TICK_S = 0.1
"""Between two pictures of a ride, at the film's speed."""
LONGEST_RIDE_S = 12.0
"""A longer ride is shown faster."""
GIF_COLORS = 128

NOTHING = "film: expected a map with frames, or a command to drive, found neither"

Shot = tuple[NDArray, float]
"""A picture, uint8 [H, W, 3], and how long it is shown, seconds."""


def shots(
    simap: SIMap,
    *,
    ride: Ride | None = None,
    look: Look | None = None,
    radius_m: float = 0.2,
    tell: Progress | None = None,
) -> Iterator[Shot]:
    """Draw the pictures of a film, one after another."""
    sheet = Sheet(simap, map_width=FILM_WIDTH)
    growth = list(_frames(simap))
    total = len(growth) + (0 if ride is None else len(_times(ride)))
    for done, moment in enumerate(moments(simap, MOST_MOMENTS, look), 1):
        last = moment.frame == len(simap.frame_names) - 1
        yield sheet.draw(moment, caption=f"Building the map · {moment.words}"), HOLD_S if last else MOMENT_S
        if tell:
            tell("drawing the film", done, total)
    if ride is None:
        return
    times = _times(ride)
    for at, time_s in enumerate(times):
        end = at == len(times) - 1
        caption = _said(ride) if end else f"“{ride.command}”"
        pose = ride.trajectory.at(float(time_s))
        yield (
            sheet.draw(caption=caption, robot=pose, path_m=ride.path_m, radius_m=radius_m),
            2 * HOLD_S if end else HOLD_S if at == 0 else TICK_S,
        )
        if tell:
            tell("drawing the film", len(growth) + at + 1, total)


def gif_bytes(film: Iterator[Shot], last: NDArray) -> bytes:
    """Make an animated GIF that plays over and over.

    Args:
        film: its pictures.
        last: one that has all the colours, such as ``key_picture`` gives.

    Raises:
        InputError: there is nothing to show.
    """
    palette = Image.fromarray(last).quantize(GIF_COLORS, dither=Image.Dither.NONE)
    images: list[Image.Image] = []
    lasting: list[int] = []
    for picture, seconds in film:
        images.append(Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE))
        lasting.append(round(seconds * 1000))
    if not images:
        raise InputError(NOTHING)
    buffer = io.BytesIO()
    images[0].save(buffer, format="GIF", save_all=True, append_images=images[1:], duration=lasting, loop=0)
    return buffer.getvalue()


def png_bytes(simap: SIMap, *, ride: Ride | None = None, radius_m: float = 0.2) -> bytes:
    """Draw a large picture of the map, with the robot at the end of a ride where there is one."""
    buffer = io.BytesIO()
    picture = key_picture(simap, ride=ride, radius_m=radius_m, width=PICTURE_WIDTH)
    Image.fromarray(picture).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def key_picture(simap: SIMap, *, ride: Ride | None = None, radius_m: float = 0.2, width: int = FILM_WIDTH) -> NDArray:
    """Draw the finished map with the end of the ride, uint8 [H, W, 3]; ``width``: about that of the map, pixels."""
    sheet = Sheet(simap, map_width=width)
    if ride is None:
        return sheet.draw()
    end = ride.trajectory.at(ride.trajectory.duration_s)
    return sheet.draw(caption=_said(ride), robot=end, path_m=ride.path_m, radius_m=radius_m)


def _frames(simap: SIMap) -> range:
    return range(min(MOST_MOMENTS, len(simap.frame_names)))


def _times(ride: Ride) -> NDArray:
    """When the ride is looked at, seconds of the ride; a long one is shown faster."""
    duration = ride.trajectory.duration_s
    count = max(2, int(np.ceil(min(duration, LONGEST_RIDE_S) / TICK_S)) + 1)
    return np.linspace(0.0, duration, count)


def _said(ride: Ride) -> str:
    return f"“{ride.command}” · {ride.outcome}"
