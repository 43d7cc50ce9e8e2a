"""The files a map can be shared as: a picture (.png), a film (.gif), or a page to turn and scrub (.html).

Film and page show how the map grew, frame by frame, then a robot that carries out a command. The page opens from disk
and needs no network.
"""

import contextlib
import io
import re
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from importlib import resources

import cv2
import numpy as np
import viser
from numpy.typing import NDArray
from PIL import Image

from simaps_viz.colors.classes import plural
from simaps_viz.colors.instances import instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.drawing.frame_pictures import communities_unseen_until
from simaps_viz.drawing.legend import counts_text, legend_html, title_of
from simaps_viz.drawing.sheet import PALE_INK, PAPER, Sheet, png_bytes
from simaps_viz.drawing.texture import map_image
from simaps_viz.drawing.theme import LIGHT
from simaps_viz.errors import CommandError, InputError
from simaps_viz.events import Progress
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.partition import owner_of_community
from simaps_viz.navigation.agent import Answer, outcome_text
from simaps_viz.navigation.trajectory import Trajectory, poses_along, trajectory, trajectory_of_steps
from simaps_viz.structures import GridSpec, Pose2, SIMap
from simaps_viz.viewer.page.shared import png
from simaps_viz.viewer.scene.camera import Extent, set_first_view
from simaps_viz.viewer.scene.map_scene import PATH, ROBOT, ROBOT_RADIUS_M, MapScene, Style, light_up, seen_extent

Look = Callable[[int], SIMap | None]
"""Returns the map as it was after a frame, on the grid and in the colours of the finished one; None = not known."""


@dataclass(frozen=True, eq=False)
class Drive:
    """A command as a robot carries it out on the map, in simulation."""

    command: str
    trajectory: Trajectory
    path_m: NDArray
    """float64 [n, 2], map frame."""
    outcome: str
    """Where the robot ended, or why it stopped, in words."""
    done: bool
    """Whether it was carried out to its end."""

    @property
    def caption(self) -> str:
        """Command and outcome."""
        return f"“{self.command}” · {self.outcome}"


@dataclass(frozen=True, eq=False)
class TimeStep:
    """The map after some frames."""

    frame: int
    """Index of the last of them."""
    simap: SIMap
    """What to draw: the map of that time, or the finished one with ``hidden`` left out."""
    hidden: NDArray
    """int32 [n], communities not to draw."""
    words: str
    """Such as "Frame 40 of 200 · 31 objects"."""


def drive_of(
    simap: SIMap,
    command: str,
    pose: Pose2,
    *,
    ask: Callable[[SIMap, str, Pose2], Answer],
) -> Drive:
    """Carry out a command in simulation.

    Args:
        simap: the map.
        command: English, or a program.
        pose: where the robot is.
        ask: carries it out.

    Raises:
        CommandError: it was refused, or the robot did not move.
    """
    answer = ask(simap, command, pose)
    if answer.status == "refused":
        raise CommandError(f'"{command}": {answer.reason or "refused"}')
    if answer.steps:
        driven = trajectory_of_steps(answer.steps, pose)
    elif len(answer.path_m):
        driven = trajectory(poses_along(pose, answer.path_m, answer.final_pose))
    else:
        raise CommandError(f'"{command}": {answer.reason or "the robot does not move"}')
    path_m = np.asarray(answer.path_m, np.float64).reshape(-1, 2)
    return Drive(command, driven, path_m, outcome_text(answer), answer.status == "ok")


def time_steps(simap: SIMap, most: int, look: Look | None = None) -> Iterator[TimeStep]:
    """Yield time steps of the build, evenly spaced, the last being the finished map.

    Args:
        simap: the finished map.
        most: at most so many; at least 1.
        look: the map after a frame, where that is known; else objects appear once a frame has named them.
    """
    frames = len(simap.frame_names)
    if not frames:
        return
    for frame in np.unique(np.linspace(0, frames - 1, min(most, frames)).round().astype(int)).tolist():
        then = simap if frame == frames - 1 else (look(frame) if look is not None else None)
        hidden = communities_unseen_until(simap, frame) if then is None else np.zeros(0, np.int32)
        count = _count_left(simap, hidden) if then is None else len(then.instances)
        words = f"Frame {frame}, the last is {frames - 1} · {plural(count, 'object')}"
        yield TimeStep(frame, simap if then is None else then, hidden, words)


def is_simulated(simap: SIMap) -> bool:
    """Whether anything that the map was made from is simulated."""
    return bool(simap.provenance.get("simulated"))


def origin_text(simap: SIMap) -> str:
    """Describe how the map was made: method with its parameter, frames, cell size, masks."""
    slider = method_of(simap.method).slider
    method = f"method {simap.method}"
    if slider is not None and slider.parameter in simap.parameters:
        method += ", " + slider.setting.format(float(simap.parameters[slider.parameter]))
    masks = simap.provenance.get("segmentation", "unknown")
    frames = plural(len(simap.frame_names), "frame")
    return f"{method} · {frames} · cells of {simap.spec.cell_size_m * 100:g} cm · masks: {masks}"


def _count_left(simap: SIMap, hidden: NDArray) -> int:
    """Count the instances of which a community is not hidden."""
    owner = owner_of_community(simap)
    shown = np.setdiff1d(np.unique(simap.community[simap.community > 0]), hidden)
    return len(np.unique(owner[shown][owner[shown] > 0]))


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
        head, _, why = counts_text(self._simap, most=0).rpartition("· ")[2].partition(": ")
        sheet.text(head, (x, y), 17, bold=True)
        for line in textwrap.wrap(why, 36):  # why there are none
            y += step
            sheet.text(line, (x, y), 14)

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


GROWTH_S = 7.0
"""How long the map grows."""
MAX_TEXTURE_PIXELS, MAX_PER_CELL = 1300, 4
ASPECT = 1.6
"""Width over height of the window the camera is set for."""
BESIDE = 0.42
"""Room for the text left of the map, as a share of the map's width."""
POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob: data:; style-src 'unsafe-inline' data:; "
    "img-src data: blob:; font-src data:; connect-src data: blob:; worker-src blob: data:; media-src data: blob:"
)
"""Forbids the file to ask any network for anything."""


def page_html(
    simap: SIMap,
    *,
    drive: Drive | None = None,
    look: Look | None = None,
    progress: Progress | None = None,
) -> bytes:
    """Make the page, UTF-8; arguments as in `files.share_bytes`."""
    with contextlib.redirect_stdout(io.StringIO()):  # viser's banner
        server = viser.ViserServer(host="127.0.0.1", port=0, label="SI Maps", verbose=False)
    try:
        html = _record(server, simap, drive, look, progress)
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()
    return _with_overlay(html, simap, drive).encode()


def overlay_html(simap: SIMap, drive: Drive | None = None) -> str:
    """Return the text that lies over the page: title, origin, counts, legend, the command."""
    badge = '<span class="badge">simulated</span> ' if is_simulated(simap) else ""
    said = ""
    if drive is not None:
        said = f"<p><b>“{escape(drive.command)}”</b><br>{escape(drive.outcome)} The drive is simulated.</p>"
    parts = [
        f"<h1>{escape(title_of(simap))}</h1>",
        f'<p class="dim">{badge}{escape(origin_text(simap))}</p>',
        f"<p>{escape(counts_text(simap))}</p>",
        said,
        f'<details open><summary>Legend</summary><div class="legend">{legend_html(simap, "instance")}</div></details>',
        '<p class="dim">Drag to turn, right drag to move, wheel to zoom. Below: play, pause, scrub.</p>',
    ]
    return f'<aside id="simaps" aria-label="About this map">{"".join(parts)}</aside>'


def _record(
    server: viser.ViserServer,
    simap: SIMap,
    drive: Drive | None,
    look: Look | None,
    progress: Progress | None,
) -> str:
    """Play the build and the drive on a server without pages, and return what it recorded as HTML."""
    scene = MapScene(server, simap)
    light_up(server.scene)
    # Look straight down, with the map to the right of the text.
    xmin, ymin, xmax, ymax = scene.frame_extent
    room, head = BESIDE * (xmax - xmin), 0.06 * (ymax - ymin)
    set_first_view(server, (xmin - room, ymin - head / 3.0, xmax, ymax + head), ASPECT)
    _, _, _, ymax = scene.extent
    label = server.scene.add_label(
        "/caption", "", position=(sum(scene.extent[0::2]) / 2.0, ymax + 0.03 * (ymax - scene.extent[1]), 0.0),
        anchor="bottom-center", font_screen_scale=1.3,
    )  # fmt: skip
    robot = server.scene.get_handle_by_name("/robot")
    if robot is not None:
        robot.visible = False
    story = list(time_steps(simap, MAX_TIME_STEPS, look))
    total = max(1, len(story) + (0 if drive is None else 1))
    recorder = server.get_scene_serializer()
    for at, step in enumerate(story, 1):
        scene.show_map(simap, _png(simap, step), Style())
        label.text = f"Building the map · {step.words}"
        recorder.insert_sleep(GROWTH_S / len(story))
        if progress:
            progress("writing the page", at, total)
    if not story:
        scene.show_map(simap, _png(simap, None), Style())
    if drive is None:
        label.text = counts_text(simap)
    else:
        recorder.insert_sleep(HOLD_S)
        label.text = f"“{drive.command}”"
        if robot is not None:
            robot.visible = True
        scene.show_path(drive.path_m)
        for time_s in _times(drive.trajectory.duration_s).tolist():
            scene.show_robot(drive.trajectory.at(time_s))
            recorder.insert_sleep(TICK_S)
        label.text = drive.caption
    if story or drive is not None:
        recorder.insert_sleep(2 * HOLD_S)
    html = recorder.as_html()
    if progress:
        progress("writing the page", total, total)
    return html


def _png(simap: SIMap, step: TimeStep | None) -> bytes:
    """Paint the map at a time step of its build, PNG, row 0 at the south; None: the finished map."""
    spec = simap.spec
    scale = int(np.clip(MAX_TEXTURE_PIXELS // max(spec.shape), 1, MAX_PER_CELL))
    shown, hidden = (simap, ()) if step is None else (step.simap, step.hidden.tolist())
    return png(map_image(shown, "instance", hidden=hidden, scale=scale))


def _with_overlay(html: str, simap: SIMap, drive: Drive | None) -> str:
    """Put policy, title and text into viser's page."""
    css = resources.files("simaps_viz.viewer.page").joinpath("share.css").read_text(encoding="utf-8")
    head = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><style>{css}</style>'
    title = f"<title>{escape(title_of(simap))} · SI Maps</title>"
    html = re.sub(r"<title>.*?</title>", lambda _: title, html, count=1, flags=re.DOTALL)
    # The policy has to stand before everything it is for; the text after everything else.
    start = re.search(r"<head[^>]*>", html)
    at = start.end() if start else 0
    html = html[:at] + head + html[at:]
    end = html.rindex("</body>")
    return html[:end] + overlay_html(simap, drive) + html[end:]
