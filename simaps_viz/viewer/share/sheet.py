"""The map as one sheet, drawn by us: title, origin, map from above, legend, scale bar, and a robot on its way."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.legend import counts_text
from simaps_viz.drawing.lettering import BOLD, chip, fitting, width_of, write
from simaps_viz.drawing.texture import CLUTTER, FLOOR, UNSEEN, WALL, cell_colors, map_image
from simaps_viz.structures import GridSpec, Pose2, SIMap
from simaps_viz.viewer.scene.camera import Extent
from simaps_viz.viewer.scene.map_scene import PATH, ROBOT, seen_extent
from simaps_viz.viewer.share.story import Moment, is_simulated, origin_text, title_of

INK: Color = (26, 30, 38)
DIM: Color = (90, 97, 108)
PAPER: Color = (255, 255, 255)
RULE: Color = (214, 218, 226)
WARN_INK: Color = (110, 76, 0)
WARN_PAPER: Color = (255, 236, 179)
MARGIN_CELLS = 3
_SUB = 4
"""Bits of a pixel's fraction that OpenCV takes."""


@dataclass(frozen=True)
class _Area:
    """Where the seen part of the grid lies on the sheet."""

    row0: int
    col0: int
    rows: int
    cols: int
    scale: int
    """Pixels along a cell's edge."""
    every: int
    """Cells along a pixel's edge; 1 unless the map is very large."""
    x: int
    y: int

    @property
    def width(self) -> int:
        return -(-self.cols // self.every) * self.scale

    @property
    def height(self) -> int:
        return -(-self.rows // self.every) * self.scale


class Sheet:
    """Draws sheets of one map that all have the same layout."""

    def __init__(self, simap: SIMap, *, map_width: int = 760) -> None:
        """Lay out a sheet.

        Args:
            simap: the finished map; its counts and colours fill the legend.
            map_width: about how wide the map itself shall be, pixels; the words grow with it.
        """
        self._simap = simap
        extent = seen_extent(simap)
        rows, cols = _cells(simap.spec, extent)[2:]
        longest = max(cols, rows * 1.25)
        scale, every = max(1, int(map_width // longest)), max(1, int(-(-longest // (2 * map_width))))
        self._f = max(1.0, max(cols, rows) // every * scale / 760)
        head = self.px(78)
        margin = self.px(22)
        row0, col0 = _cells(simap.spec, extent)[:2]
        self._area = _Area(row0, col0, rows, cols, scale, every, margin, head)
        self._legend_x = margin + self._area.width + self.px(24)
        width = self._legend_x + self.px(300)
        body = max(self._area.height, self.px(330))
        self.size = (_even(head + body + self.px(64)), _even(width))
        self._foot_y = head + body + self.px(30)
        self._blank = self._background()

    def px(self, pixels: float) -> int:
        """Scale a length of the layout."""
        return round(pixels * self._f)

    def draw(
        self,
        moment: Moment | None = None,
        *,
        caption: str = "",
        robot: Pose2 | None = None,
        path_m: NDArray | None = None,
        radius_m: float = 0.2,
    ) -> NDArray:
        """Draw one sheet.

        Args:
            moment: of the build; None draws the finished map.
            caption: a line below the map.
            robot: where it stands, if it is there.
            path_m: its way, [n, 2], map frame.
            radius_m: of the robot.

        Returns:
            uint8 [H, W, 3], RGB, even sides, the same for all sheets of this object.
        """
        sheet = self._blank.copy()
        area = self._area
        shown = self._simap if moment is None else moment.simap
        hidden: list[int] = [] if moment is None else moment.hidden.tolist()
        view = sheet[area.y : area.y + area.height, area.x : area.x + area.width]
        view[:] = self._map(shown, hidden)
        cv2.rectangle(sheet, (area.x - 1, area.y - 1), (area.x + area.width, area.y + area.height), RULE, 1, cv2.LINE_8)
        if path_m is not None and len(path_m) > 1:
            points = self._pixels(path_m)
            cv2.polylines(sheet, [points], False, PAPER, self.px(7), cv2.LINE_AA, _SUB)
            cv2.polylines(sheet, [points], False, PATH, self.px(4), cv2.LINE_AA, _SUB)
        if robot is not None:
            self._draw_robot(sheet, robot, radius_m)
        if caption:
            left = area.x + self.px(230)
            size = self.px(18)
            room = sheet.shape[1] - left - self.px(20)
            write(sheet, fitting(caption, size, room, weight=BOLD), (left, self._foot_y), size, INK, weight=BOLD)
        return sheet

    def place_of(self, x_m: float, y_m: float) -> tuple[int, int]:
        """Return the (row, column) of the pixel that shows a place of the map."""
        x, y = (self._pixels(np.array([[x_m, y_m]]))[0, 0] / (1 << _SUB)).astype(int).tolist()
        return y, x

    def _map(self, simap: SIMap, hidden: list[int]) -> NDArray:
        """Paint a map where the finished one lies; uint8 [height, width, 3], north up."""
        area, n = self._area, self._area.scale
        image = map_image(simap, "instance", hidden=hidden, scale=n)
        if simap.spec != self._simap.spec:
            image = moved_image(image, simap.spec, self._simap.spec, n)
        low, left = area.row0 * n, area.col0 * n
        part = image[low : low + area.rows * n, left : left + area.cols * n]
        return part[:: area.every, :: area.every][::-1][: area.height, : area.width]

    def _pixels(self, points_m: NDArray) -> NDArray:
        """Return int32 [n, 1, 2], the places of points on the sheet in parts of a pixel, as OpenCV wants them."""
        area, spec = self._area, self._simap.spec
        per_m = area.scale / area.every / spec.cell_size_m
        x = area.x + (points_m[:, 0] - spec.x0_m) * per_m - area.col0 * area.scale / area.every
        y = area.y + area.height - ((points_m[:, 1] - spec.y0_m) * per_m - area.row0 * area.scale / area.every)
        return np.rint(np.stack([x, y], axis=1) * (1 << _SUB)).astype(np.int32)[:, None]

    def _draw_robot(self, sheet: NDArray, pose: Pose2, radius_m: float) -> None:
        per_m = self._area.scale / self._area.every / self._simap.spec.cell_size_m
        radius = max(radius_m * per_m, self.px(9))
        x, y = self._pixels(np.array([[pose.x_m, pose.y_m]]))[0, 0].tolist()
        for wide, color in ((radius + self.px(2), PAPER), (radius, ROBOT)):
            cv2.circle(sheet, (x, y), round(wide * (1 << _SUB)), color, -1, cv2.LINE_AA, _SUB)
        turn = np.array([[np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)], [-np.sin(pose.yaw_rad), np.cos(pose.yaw_rad)]])
        nose = np.array([[0.8, 0.0], [-0.5, 0.55], [-0.2, 0.0], [-0.5, -0.55]]) * radius @ turn * (1, -1)
        corners = np.rint(nose * (1 << _SUB) + np.array([x, y])).astype(np.int32)
        cv2.fillPoly(sheet, [corners], PAPER, cv2.LINE_AA, _SUB)

    def _background(self) -> NDArray:
        """What all sheets share."""
        sheet = np.full((*self.size, 3), PAPER, np.uint8)
        x, f = self._area.x, self.px
        room = sheet.shape[1] - 2 * x
        write(
            sheet,
            fitting(title_of(self._simap), f(26), room - f(130), weight=BOLD),
            (x, f(26)),
            f(26),
            INK,
            weight=BOLD,
        )
        if is_simulated(self._simap):
            wide = width_of("simulated", f(16), weight=BOLD) + 2 * round(0.45 * f(16))
            chip(sheet, "simulated", (sheet.shape[1] - x - wide, f(26)), f(16), WARN_INK, WARN_PAPER, bold=True)
        write(sheet, fitting(origin_text(self._simap), f(15), room), (x, f(56)), f(15), DIM)
        self._draw_legend(sheet)
        self._draw_scale(sheet)
        return sheet

    def _draw_legend(self, sheet: NDArray) -> None:
        f, x, y = self.px, self._legend_x, self._area.y + self.px(8)
        room = sheet.shape[1] - x - f(20)
        write(sheet, counts_text(self._simap, most=0).rpartition("· ")[2], (x, y), f(17), INK, weight=BOLD)
        bottom = self.size[0] - f(64)
        lines = [(label, self._chips(label)) for label in self._simap.counts()]
        step, ground = f(22), f(112)
        fit = max(1, int((bottom - ground - y) // step) - 1)
        shown = lines if len(lines) <= fit else lines[: fit - 1]
        for label, colors in shown:
            y += step
            text = f"{label} {len(colors)}"
            wide = f(132)
            write(sheet, fitting(text, f(14), wide - f(6)), (x, y), f(14), INK)
            most = int((room - wide - f(24)) // f(11))
            for at, color in enumerate(colors[:most]):
                left = x + wide + at * f(11)
                sheet[y - f(4) : y + f(5), left : left + f(9)] = color
            if len(colors) > most:
                write(sheet, f"+{len(colors) - most}", (x + wide + most * f(11) + f(3), y), f(12), DIM)
        if len(shown) < len(lines):
            y += step
            rest = len(lines) - len(shown)
            write(sheet, f"and {rest} more classes", (x, y), f(14), DIM)
        y = bottom - f(96)
        for name, color in (("wall", WALL), ("not named", CLUTTER), ("floor", FLOOR), ("never seen", UNSEEN)):
            y += f(22)
            cv2.rectangle(sheet, (x, y - f(6)), (x + f(14), y + f(6)), color, -1)
            cv2.rectangle(sheet, (x, y - f(6)), (x + f(14), y + f(6)), RULE, 1)
            write(sheet, name, (x + f(22), y), f(14), DIM)

    def _chips(self, label: str) -> list[Color]:
        """The colours of a class's instances, as they are on the map."""
        colors = self._cell_colors().reshape(-1, 3)
        flat = self._simap.instance.reshape(-1)
        ids, first = np.unique(flat, return_index=True)
        at = dict(zip(ids.tolist(), first.tolist(), strict=True))
        return [tuple(colors[at[i.id]].tolist()) for i in self._simap.of_class(label) if i.id in at]

    def _cell_colors(self) -> NDArray:
        if not hasattr(self, "_colors"):
            self._colors = cell_colors(self._simap, "instance")
        return self._colors

    def _draw_scale(self, sheet: NDArray) -> None:
        f, x, y = self.px, self._area.x, self._foot_y
        per_m = self._area.scale / self._area.every / self._simap.spec.cell_size_m
        length = next((m for m in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if m * per_m >= f(60)), 50.0)
        end = x + round(length * per_m)
        sheet[y - f(2) : y + f(2), x:end] = INK
        for tick in (x, end):
            sheet[y - f(7) : y + f(7), tick - f(1) : tick + f(1)] = INK
        write(sheet, f"{length:g} m", (end + f(8), y), f(16), INK)
        north = end + f(8) + width_of(f"{length:g} m", f(16)) + f(22)
        cv2.arrowedLine(sheet, (north, y + f(11)), (north, y - f(11)), INK, max(1, f(2)), cv2.LINE_AA, 0, 0.45)
        write(sheet, "N", (north + f(8), y), f(16), INK, weight=BOLD)


def _cells(spec: GridSpec, extent: Extent) -> tuple[int, int, int, int]:
    """Return (row, column, rows, columns) of the cells of an extent, with a margin, within the grid."""
    low, left = spec.cell_of(extent[0] + 1e-6, extent[1] + 1e-6)
    high, right = spec.cell_of(extent[2] - 1e-6, extent[3] - 1e-6)
    row0, col0 = max(0, low - MARGIN_CELLS), max(0, left - MARGIN_CELLS)
    return row0, col0, min(spec.rows, high + 1 + MARGIN_CELLS) - row0, min(spec.cols, right + 1 + MARGIN_CELLS) - col0


def moved_image(image: NDArray, old: GridSpec, new: GridSpec, n: int) -> NDArray:
    """Put a map's picture where it lies in another grid of the same place."""
    row = round((old.y0_m - new.y0_m) / new.cell_size_m)
    col = round((old.x0_m - new.x0_m) / new.cell_size_m)
    result = np.full((new.rows * n, new.cols * n, 3), UNSEEN, np.uint8)
    low = max(0, row), max(0, col)
    high = min(new.rows, row + old.rows), min(new.cols, col + old.cols)
    if high[0] > low[0] and high[1] > low[1]:
        part = image[(low[0] - row) * n : (high[0] - row) * n, (low[1] - col) * n : (high[1] - col) * n]
        result[low[0] * n : high[0] * n, low[1] * n : high[1] * n] = part
    return result


def _even(pixels: int) -> int:
    """Films want even sides."""
    return pixels + pixels % 2
