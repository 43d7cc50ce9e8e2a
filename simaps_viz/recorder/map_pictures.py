"""The grid as pictures of small whole numbers, and the colours and names those numbers stand for.

Pictures are north up: row 0 is the northernmost row of cells. On the plane of the pictures x is east and y is south
(minus north), in metres, so a picture of a grown grid stays where the smaller one was.
"""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from simaps_viz.colors.classes import CLUTTER, FLOOR, UNSEEN, WALL, class_color, ground_kinds, instance_color
from simaps_viz.colors.palette import Color
from simaps_viz.structures import Grid, GridSpec, MergeLog

Entry = tuple[int, str, tuple[int, int, int, int]]
"""Value of a pixel, what it is called, its RGBA colour (0-255)."""

NOTHING: Entry = (0, "", (0, 0, 0, 0))

UNPARTED = 4
GROUND: tuple[Entry, ...] = (
    (UNSEEN, "not seen", (216, 219, 226, 255)),
    (FLOOR, "floor", (246, 248, 250, 255)),
    (CLUTTER, "no name", (196, 202, 211, 255)),
    (WALL, "wall", (92, 98, 110, 255)),
    (UNPARTED, "seen, not told apart yet", (240, 214, 160, 255)),
)
"""Everything under the objects."""

CLASS_BASE = 60_000
"""Added to a class index where classes and communities share a picture; communities stay below."""

HEIGHT_STEP_M = 0.02
HEIGHT_TOP_M = 2.0


def north_up(cells: NDArray) -> NDArray:
    """Turn [rows, cols] cells, row 0 at the south, into a picture with row 0 at the north."""
    return np.ascontiguousarray(cells[::-1])


def picture_corner(spec: GridSpec) -> tuple[float, float]:
    """Return where the top left corner of a grid's picture lies on the plane of the pictures, metres."""
    return (spec.x0_m, -(spec.y0_m + spec.rows * spec.cell_size_m))


def on_picture(points_m: NDArray) -> NDArray:
    """Project map-frame points [..., 2 or more] (x, y, ...) on the plane of the pictures, float32 [..., 2]."""
    return (np.asarray(points_m)[..., :2] * (1.0, -1.0)).astype(np.float32)


def cell_centres(spec: GridSpec, rows: NDArray, cols: NDArray) -> NDArray:
    """Return the map-frame centres, float64 [..., 2], of cells."""
    return np.stack([spec.x0_m + (cols + 0.5) * spec.cell_size_m, spec.y0_m + (rows + 0.5) * spec.cell_size_m], axis=-1)


def ground_picture(grid: Grid) -> NDArray:
    """Draw floor, walls, things without a name and things with one, uint8 [rows, cols], values as in ``GROUND``."""
    picture = ground_kinds(grid)
    picture[np.array(grid.is_thing, dtype=bool)[grid.label]] = UNPARTED
    return north_up(picture)


def class_picture(grid: Grid) -> NDArray:
    """Show classes: index + 1 of the class, 0 = unseen; uint8 [rows, cols], uint16 when there are many classes."""
    dtype = np.uint8 if len(grid.labels) < 255 else np.uint16
    seen = (grid.observations > 0) | ~np.isnan(grid.height_m)
    return north_up(np.where(seen, grid.label + 1, 0).astype(dtype))


def class_entries(labels: Sequence[str]) -> list[Entry]:
    """Name the values of ``class_picture``."""
    entries = [GROUND[UNSEEN], (1, "no name", GROUND[FLOOR][2])]
    return entries + [(i + 1, name, (*class_color(name), 255)) for i, name in enumerate(labels) if i > 0]


def object_picture(ids: NDArray) -> NDArray:
    """Show communities or instances, uint16 [rows, cols], 0 = none. Ids wrap where they would not fit."""
    wrapped = np.where(ids > 0, (ids - 1) % (CLASS_BASE - 1) + 1, 0)
    return north_up(wrapped.astype(np.uint16))


def thing_picture(grid: Grid) -> NDArray:
    """Return countable classes before objects are separated, uint16 [rows, cols]: ``CLASS_BASE`` + index, 0 = none."""
    thing = np.array(grid.is_thing, dtype=bool)[grid.label]
    return north_up(np.where(thing, CLASS_BASE + grid.label.astype(np.int32), 0).astype(np.uint16))


def object_entries(grid: Grid, ids: NDArray, colors: NDArray | None = None) -> list[Entry]:
    """Name the values of ``object_picture`` and ``thing_picture``.

    Args:
        grid: the map.
        ids: int32 [rows, cols], communities or instances, 0 = none.
        colors: uint8 [n, 3], at the place of the id; None takes those that ids alone give.
    """
    present, first = np.unique(ids, return_index=True)
    entries = [NOTHING]
    for value, at in zip(present.tolist(), first.tolist(), strict=True):
        if 0 < value < CLASS_BASE:
            name = grid.labels[int(grid.label.reshape(-1)[at])]
            entries.append((value, f"{name} (id {value})", (*_color(value, colors), 255)))
    things = [(i, name) for i, name in enumerate(grid.labels) if grid.is_thing[i]]
    return entries + [(CLASS_BASE + i, name, (*class_color(name), 255)) for i, name in things]


def recolored(entries: Sequence[Entry], colors: NDArray) -> list[Entry]:
    """Return ``object_entries`` with other colours, uint8 [n, 3], indexed by id."""
    return [
        (value, name, (*_color(value, colors), 255)) if 0 < value < CLASS_BASE else (value, name, color)
        for value, name, color in entries
    ]


def _color(value: int, colors: NDArray | None) -> Color:
    if colors is None or value >= len(colors):
        return instance_color(value)
    red, green, blue = colors[value].tolist()
    return red, green, blue


def height_picture(grid: Grid) -> NDArray:
    """Show heights, uint8 [rows, cols]: 1 + height / ``HEIGHT_STEP_M``, 0 = unseen."""
    steps = np.clip(np.nan_to_num(grid.height_m), 0.0, HEIGHT_TOP_M) / HEIGHT_STEP_M
    return north_up(np.where(np.isnan(grid.height_m), 0, 1 + np.rint(steps)).astype(np.uint8))


def height_entries() -> list[Entry]:
    """Name the values of ``height_picture``, in the colours of viridis."""
    steps = round(HEIGHT_TOP_M / HEIGHT_STEP_M) + 1
    ramp = np.linspace(0, 255, steps).astype(np.uint8)[None]
    colors = cv2.cvtColor(cv2.applyColorMap(ramp, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)[0].tolist()
    names = [f"{i * HEIGHT_STEP_M:.2f} m" for i in range(steps)]
    return [GROUND[UNSEEN], *((i + 1, names[i], (*colors[i], 255)) for i in range(steps))]


def merge_order(applied: NDArray) -> NDArray:
    """Put the applied steps of a merge log before the others; each part keeps its order. Int64 [steps]."""
    return np.concatenate([np.flatnonzero(applied), np.flatnonzero(~applied)])


def shown_steps(steps: int, applied: int, most: int) -> NDArray:
    """Choose which of the counts 0 .. ``steps`` of merges done get a picture.

    0 and ``applied`` are always among them, and ``steps`` if ``most`` is above 2. The applied ones are taken
    first; what is left over is spread evenly.

    Returns:
        int64 [at most max(most, 2)], ascending.
    """
    chosen = {0, applied}
    for low, high in ((0, applied), (applied, steps)):
        room = max(most, 2) - len(chosen)
        if room > 0 and high > low:
            count = min(room + (high in chosen), high - low)
            chosen |= set(np.rint(np.linspace(high, low, count, endpoint=False)).astype(int).tolist())
    return np.array(sorted(chosen), dtype=np.int64)


class Merging:
    """Follows a merge log step by step. A group is called by the smallest of its communities."""

    def __init__(self, log: MergeLog, order: NDArray, communities: int) -> None:
        self.log, self.order = log, order
        self.name_of = np.arange(communities + 1, dtype=np.int32)
        """int32 [communities + 1]: the present id of each community."""

    def step(self, position: int) -> tuple[int, int]:
        """Apply the step at a position of the order; return the ids of its two groups, source first."""
        at = self.order[position]
        source, target = (int(self.name_of[c[at]]) for c in (self.log.source, self.log.target))
        self.name_of[np.isin(self.name_of, (source, target))] = min(source, target)
        return source, target


def log_entries(stream: rr.RecordingStream, path: str, entries: Iterable[Entry]) -> None:
    """Log, for all times, the meaning of the pixel values of an entity's pictures."""
    stream.log(path, annotations(entries), static=True)


def annotations(entries: Iterable[Entry]) -> rr.AnnotationContext:
    """Turn entries into rerun's names and colours."""
    return rr.AnnotationContext([rr.AnnotationInfo(id=i, label=name, color=color) for i, name, color in entries])


def log_map_picture(
    stream: rr.RecordingStream, path: str, picture: NDArray, spec: GridSpec, *, draw_order: float
) -> None:
    """Lay a picture of the grid on the plane of the pictures, where its cells are."""
    s = spec.cell_size_m
    stream.log(
        path,
        rr.SegmentationImage(picture, opacity=1.0, draw_order=draw_order),
        rr.Transform3D(translation=(*picture_corner(spec), 0.0), scale=(s, s, 1.0)),
    )


def markdown(text: str) -> rr.TextDocument:
    """Return a document of a text in Markdown."""
    return rr.TextDocument(text, media_type="text/markdown")


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Write a table whose first column is text and whose others are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
