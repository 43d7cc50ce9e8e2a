"""The files a map can be shared as: one picture (.png), a film (.gif), or a page to be turned and scrubbed (.html)."""

import io
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from simaps_viz.colors.instances import instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.legend import counts_text, title_of
from simaps_viz.drawing.sheet import PALE_INK, PAPER, Sheet, png_bytes
from simaps_viz.drawing.texture import map_image
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.structures import GridSpec, Pose2, SIMap
from simaps_viz.viewer.scene.camera import Extent
from simaps_viz.viewer.scene.map_scene import PATH, ROBOT, ROBOT_RADIUS_M, seen_extent
from simaps_viz.viewer.share.page import page_html
from simaps_viz.viewer.share.story import Drive, Look, TimeStep, is_simulated, origin_text, time_steps

ENDINGS = (".html", ".gif", ".png")

FILM_WIDTH, PICTURE_WIDTH = 760, 2400
"""About how wide the map is on a film and on a picture, pixels."""
MAX_TIME_STEPS = 40
TIME_STEP_S = 0.16
HOLD_S = 1.2
"""How long the finished map, and the end of a drive, are shown."""
TICK_S = 0.1
"""Between two pictures of a drive, at the film's speed."""
MAX_DRIVE_S = 12.0
"""A longer drive is shown faster."""
GIF_COLORS = 128

WARN_INK: Color = (110, 76, 0)
WARN_PAPER: Color = (255, 236, 179)
MARGIN_CELLS = 3
_SUB = 4
"""Bits of a pixel's fraction that OpenCV takes."""

Shot = tuple[NDArray, float]
"""A picture, uint8 [H, W, 3], and how long it is shown, seconds."""


def share_bytes(
    ending: str,
    simap: SIMap,
    *,
    drive: Drive | None = None,
    look: Look | None = None,
    progress: Progress | None = None,
) -> bytes:
    """Make a file.

    Args:
        ending: one of ``ENDINGS``.
        simap: the map.
        drive: a command that the robot carries out at the end.
        look: the map after a frame, where that is known; else objects appear once a frame has named them.
        progress: called with what is done; may raise to end the work.

    Raises:
        InputError: there is nothing to show.
    """
    if ending == ".html":
        return page_html(simap, drive=drive, look=look, progress=progress)
    if ending == ".png":
        return png_bytes(key_picture(simap, drive=drive, width=PICTURE_WIDTH))
    film = shots(simap, drive=drive, look=look, progress=progress)
    return gif_bytes(film, key_picture(simap, drive=drive))


def key_picture(simap: SIMap, *, drive: Drive | None = None, width: int = FILM_WIDTH) -> NDArray:
    """Draw the finished map with the end of the drive, uint8 [H, W, 3]; ``width``: about that of the map, pixels."""
    sheet = MapSheet(simap, map_width=width)
    if drive is None:
        return sheet.draw()
    end = drive.trajectory.at(drive.trajectory.duration_s)
    return sheet.draw(caption=drive.caption, robot=end, path_m=drive.path_m)


def shots(
    simap: SIMap,
    *,
    drive: Drive | None = None,
    look: Look | None = None,
    progress: Progress | None = None,
) -> Iterator[Shot]:
    """Draw the pictures of a film, one after another."""
    sheet = MapSheet(simap, map_width=FILM_WIDTH)
    frames = len(simap.frame_names)
    times = np.zeros(0) if drive is None else _times(drive.trajectory.duration_s)
    total = min(MAX_TIME_STEPS, frames) + len(times)
    done = 0

    # The map grows ...
    for step in time_steps(simap, MAX_TIME_STEPS, look):
        picture = sheet.draw(step, caption=f"Building the map · {step.words}")
        yield picture, HOLD_S if step.frame == frames - 1 else TIME_STEP_S
        done += 1
        if progress:
            progress("drawing the film", done, total)

    # ... then the robot drives; its start is held, and its end twice as long.
    for at, time_s in enumerate(times.tolist()):
        assert drive is not None
        end = at == len(times) - 1
        caption = drive.caption if end else f"“{drive.command}”"
        picture = sheet.draw(caption=caption, robot=drive.trajectory.at(time_s), path_m=drive.path_m)
        yield picture, 2 * HOLD_S if end else HOLD_S if at == 0 else TICK_S
        done += 1
        if progress:
            progress("drawing the film", done, total)


def gif_bytes(film: Iterator[Shot], last: NDArray) -> bytes:
    """Encode an animated GIF that plays over and over.

    Args:
        film: its pictures.
        last: one that has all the colours, such as ``key_picture`` returns.

    Raises:
        InputError: there is nothing to show.
    """
    palette = Image.fromarray(last).quantize(GIF_COLORS, dither=Image.Dither.NONE)
    images: list[Image.Image] = []
    durations_ms: list[int] = []
    for picture, seconds in film:
        images.append(Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE))
        durations_ms.append(round(seconds * 1000))
    if not images:
        raise InputError("film: expected a map with frames, or a command to drive, found neither")
    buffer = io.BytesIO()
    images[0].save(buffer, format="GIF", save_all=True, append_images=images[1:], duration=durations_ms, loop=0)
    return buffer.getvalue()


def _times(duration_s: float) -> NDArray:
    """Return the times of a drive that are shown, seconds; those of a long one are farther apart."""
    count = max(2, int(np.ceil(min(duration_s, MAX_DRIVE_S) / TICK_S)) + 1)
    return np.linspace(0.0, duration_s, count)


class MapSheet:
    """Draws sheets of one map that all have the same layout: title, origin, map from above, legend, scale bar."""

    def __init__(self, simap: SIMap, *, map_width: int = 760) -> None:
        """Lay out a sheet.

        Args:
            simap: the finished map; its counts and colours fill the legend.
            map_width: about how wide the map itself shall be, pixels; the words grow with it.
        """
        self._simap = simap
        self._row0, self._col0, self._rows, self._cols = _seen_cells(simap.spec, seen_extent(simap))

        # Cells have several pixels, or pixels several cells; words grow with the map.
        longest = max(self._cols, self._rows * 1.25)
        self._scale, self._every = max(1, int(map_width // longest)), max(1, int(-(-longest // (2 * map_width))))
        self._per_m = self._scale / self._every / simap.spec.cell_size_m
        self._width, self._height = (-(-n // self._every) * self._scale for n in (self._cols, self._rows))
        blank = Sheet(0, 0, max(1.0, max(self._cols, self._rows) // self._every * self._scale / 760))

        # The map below the title, the legend to its right, the scale bar below.
        px = blank.px
        self._x, self._y = px(22), px(78)
        self._legend_x = self._x + self._width + px(24)
        body = max(self._height, px(330))
        self._foot_y = self._y + body + px(30)
        height, width = self._y + body + px(64), self._legend_x + px(300)
        self.size = (height + height % 2, width + width % 2)  # films want even sides
        blank.begin(self.size[1], self.size[0])
        self._draw_head(blank)
        self._draw_legend(blank)
        self._caption_x = blank.scale_bar((self._x, self._foot_y), self._per_m) + px(30)
        self._blank = blank

    def draw(
        self,
        step: TimeStep | None = None,
        *,
        caption: str = "",
        robot: Pose2 | None = None,
        path_m: NDArray | None = None,
    ) -> NDArray:
        """Draw one sheet.

        Args:
            step: of the build; None draws the finished map.
            caption: a line below the map.
            robot: its pose, if it is there.
            path_m: its path, [n, 2], map frame.

        Returns:
            uint8 [H, W, 3], RGB, even sides, the same for all sheets of this object.
        """
        sheet = self._blank.copy()
        sheet.paste(self._map_picture(step), (self._x, self._y), framed=True)
        if path_m is not None and len(path_m) > 1:
            points = self._pixels(path_m)
            for thickness, color in ((7, PAPER), (4, PATH)):
                cv2.polylines(sheet.pixels, [points], False, color, sheet.px(thickness), cv2.LINE_AA, _SUB)
        if robot is not None:
            self._draw_robot(sheet, robot)
        room = sheet.width - self._caption_x - sheet.px(20)
        sheet.text(caption, (self._caption_x, self._foot_y), 18, bold=True, room=room)
        return sheet.pixels

    def pixel_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the (row, column) of the pixel that shows a position on the map."""
        x, y = (self._pixels(np.array([[x_m, y_m]]))[0, 0] / (1 << _SUB)).astype(int).tolist()
        return y, x

    def _map_picture(self, step: TimeStep | None) -> NDArray:
        """Paint the seen part of the map, uint8 [height, width, 3], north up."""
        n, every = self._scale, self._every
        shown, hidden = (self._simap, []) if step is None else (step.simap, step.hidden.tolist())
        image = map_image(shown, "instance", hidden=hidden, scale=n)
        low, left = self._row0 * n, self._col0 * n
        part = image[low : low + self._rows * n : every, left : left + self._cols * n : every]
        return part[::-1]

    def _pixels(self, points_m: NDArray) -> NDArray:
        """Return int32 [n, 1, 2], where points are on the sheet in parts of a pixel, as OpenCV wants them."""
        spec = self._simap.spec
        x = self._x + (points_m[:, 0] - spec.x0_m - self._col0 * spec.cell_size_m) * self._per_m
        y = self._y + self._height - (points_m[:, 1] - spec.y0_m - self._row0 * spec.cell_size_m) * self._per_m
        return np.rint(np.stack([x, y], axis=1) * (1 << _SUB)).astype(np.int32)[:, None]

    def _draw_robot(self, sheet: Sheet, pose: Pose2) -> None:
        radius = max(ROBOT_RADIUS_M * self._per_m, sheet.px(9))
        x, y = self._pixels(np.array([[pose.x_m, pose.y_m]]))[0, 0].tolist()
        for wide, color in ((radius + sheet.px(2), PAPER), (radius, ROBOT)):
            cv2.circle(sheet.pixels, (x, y), round(wide * (1 << _SUB)), color, -1, cv2.LINE_AA, _SUB)
        c, s = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
        nose = np.array([[0.8, 0.0], [-0.5, 0.55], [-0.2, 0.0], [-0.5, -0.55]]) * radius
        nose = nose @ np.array([[c, s], [-s, c]]) * (1, -1)  # rows count down
        corners = np.rint(nose * (1 << _SUB) + np.array([x, y])).astype(np.int32)
        cv2.fillPoly(sheet.pixels, [corners], PAPER, cv2.LINE_AA, _SUB)

    def _draw_head(self, sheet: Sheet) -> None:
        x, px = self._x, sheet.px
        room = sheet.width - 2 * x
        sheet.text(title_of(self._simap), (x, px(26)), 26, bold=True, room=room - px(130))
        if is_simulated(self._simap):
            sheet.badge("simulated", (sheet.width - x, px(26)), 16, WARN_INK, WARN_PAPER)
        sheet.text(origin_text(self._simap), (x, px(56)), 15, PALE_INK, room=room)

    def _draw_legend(self, sheet: Sheet) -> None:
        """List the classes with the colours of their instances, as far as there is room, then the kinds of ground."""
        px, x, y = sheet.px, self._legend_x, self._y + sheet.px(8)
        names_wide, step = px(132), px(22)
        bottom = sheet.height - px(64)
        sheet.text(counts_text(self._simap, most=0).rpartition("· ")[2], (x, y), 17, bold=True)

        colors = instance_colors(self._simap)
        labels = list(self._simap.counts())
        fit = max(1, int((bottom - px(112) - y) // step) - 1)
        shown = labels if len(labels) <= fit else labels[: fit - 1]
        most = int((sheet.width - x - px(20) - names_wide - px(24)) // px(11))
        for label in shown:
            y += step
            instances = self._simap.of_class(label)
            sheet.text(f"{label} {len(instances)}", (x, y), 14, room=names_wide - px(6))
            left = x + names_wide
            for one in instances[:most]:
                sheet.fill((left, y - px(4), left + px(9), y + px(5)), colors[one.id])
                left += px(11)
            if len(instances) > most:
                sheet.text(f"+{len(instances) - most}", (left + px(3), y), 12, PALE_INK)
        if len(shown) < len(labels):
            sheet.text(f"and {len(labels) - len(shown)} more classes", (x, y + step), 14, PALE_INK)

        y = bottom - px(96)
        for name, color in zip(("never seen", "floor", "not named", "wall"), LIGHT.grounds, strict=True):
            y += step
            sheet.swatch(color, name, (x, y), 14, PALE_INK)


def _seen_cells(spec: GridSpec, extent: Extent) -> tuple[int, int, int, int]:
    """Return (row, column, rows, columns) of the cells of an extent, with a margin, within the grid."""
    low, left = spec.cell_of(extent[0] + 1e-6, extent[1] + 1e-6)
    high, right = spec.cell_of(extent[2] - 1e-6, extent[3] - 1e-6)
    row0, col0 = max(0, low - MARGIN_CELLS), max(0, left - MARGIN_CELLS)
    return row0, col0, min(spec.rows, high + 1 + MARGIN_CELLS) - row0, min(spec.cols, right + 1 + MARGIN_CELLS) - col0
