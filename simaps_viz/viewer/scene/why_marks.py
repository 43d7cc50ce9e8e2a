"""Marks on the map that explain an object: how sure its cells are, its joints, its links to neighbours."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import viser
from numpy.typing import NDArray

from simaps_viz.colors.palette import Color
from simaps_viz.drawing.texture import outline_segments
from simaps_viz.mapping.explain import Joint, Link, Why, score_text
from simaps_viz.mapping.methods import method_of
from simaps_viz.structures import SIMap
from simaps_viz.viewer.scene.annotations import Label, Texts, Zoom, draw_lines, label_of, line_share

CUT: Color = (0, 128, 80)
"""The weakest joint: it held, so no colour of alarm."""
LINK: Color = (112, 120, 134)
TARGET: Color = (0, 90, 200)
SOURCE: Color = (230, 120, 0)
OTHER: Color = (130, 40, 160)
UNKNOWN: Color = (150, 150, 150)
"""Cells of which nothing was seen for or against."""
RAMP: tuple[Color, ...] = ((202, 46, 34), (244, 141, 82), (250, 222, 140), (126, 178, 214), (33, 90, 168))
"""From unsure to sure; distinguishable with any kind of colour vision."""
LOW_EVIDENCE = 0.5
"""Evidence at or below this is as unsure as the colours go."""
SHORTEST_LINK_M = 0.4
"""Links between objects that touch are drawn so long, or one would not see them."""
MAX_LINKS = 8
MAX_NUMBERS = 3
"""Links whose numbers are on the map; the panel has those of the others."""
SMALL_M = 1.2
"""The number of a neighbour up to this size is next to it; that of a larger one is where the link ends."""
NODES: dict[str, tuple[Color, float]] = {
    "cut": (CUT, 3.5),
    "target": (TARGET, 2.5),
    "source": (SOURCE, 2.5),
    "links": (LINK, 2.0),
    "other": (OTHER, 2.5),
}
"""Colour and thickness in pixels of what is drawn."""
FLOOR_M = 0.02
ABOVE_OUTLINES_M = 0.01


def sureness_range(why: Why) -> tuple[float, float]:
    """Return what the two ends of the colour scale mean."""
    if not method_of(why.method).weights_per_frame:
        return LOW_EVIDENCE, 1.0
    known = why.sureness[~np.isnan(why.sureness)]
    return 0.0, float(known.max(initial=0.0)) or 1.0


def sureness_colors(why: Why) -> NDArray:
    """Colour the instance's cells by how sure the map is of them, uint8 [n, 3], aligned with ``why.cells``."""
    low, high = sureness_range(why)
    share = np.clip((np.nan_to_num(why.sureness) - low) / (high - low), 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(RAMP))
    colors = np.stack([np.interp(share, stops, [color[i] for color in RAMP]) for i in range(3)], axis=1)
    colors[np.isnan(why.sureness)] = UNKNOWN
    return np.rint(colors).astype(np.uint8)


def paint_cells(image: NDArray, cells: NDArray, colors: NDArray, cols: int) -> None:
    """Paint cells (flat) of a map's picture, uint8 [rows * scale, cols * scale, 3], in place."""
    scale = image.shape[1] // cols
    row, col = np.divmod(cells, cols)
    image.reshape(-1, scale, cols, scale, 3)[row, :, col] = colors[:, None, None]


def cell_outline(simap: SIMap, cells: NDArray, z_m: float = FLOOR_M) -> NDArray:
    """Return the cell edges around some cells (flat), float32 [n, 2, 3], map frame, metres."""
    mask = np.zeros(simap.spec.shape, np.int32)
    mask.reshape(-1)[cells] = 1
    return outline_segments(replace(simap, instance=mask), 1, z_m=z_m)


def joint_line(simap: SIMap, why: Why, joint: Joint, z_m: float = FLOOR_M) -> NDArray:
    """Return the cell edges along which the two parts of a joint meet, or a line between them where they do not.

    Returns:
        float32 [n, 2, 3], map frame, metres.
    """
    part = np.zeros(simap.spec.shape, np.int8)
    part.reshape(-1)[why.cells_of(joint.source)] = 1
    part.reshape(-1)[why.cells_of(joint.target)] = 2
    row, col = np.nonzero(part[1:] + part[:-1] == 3)  # 1 next to 2
    level = np.stack([np.stack([col, row + 1], -1), np.stack([col + 1, row + 1], -1)], 1)
    row, col = np.nonzero(part[:, 1:] + part[:, :-1] == 3)
    upright = np.stack([np.stack([col + 1, row], -1), np.stack([col + 1, row + 1], -1)], 1)
    spec = simap.spec
    corners = np.concatenate([level, upright]) * spec.cell_size_m + (spec.x0_m, spec.y0_m)
    if len(corners) == 0:
        corners = np.array([[_middle(simap, why.cells_of(side)) for side in (joint.source, joint.target)]])
    return np.concatenate([corners, np.full((*corners.shape[:2], 1), z_m)], axis=2).astype(np.float32)


def drawn_links(why: Why) -> tuple[Link, ...]:
    """Choose the links worth drawing: those that something was seen of, and those that touch; strongest first."""
    return tuple(link for link in why.neighbours if link.touching or link.same + link.different > 0)[:MAX_LINKS]


def link_lines(links: Sequence[Link], z_m: float = FLOOR_M) -> NDArray:
    """Return a line from cell to cell for each link, float32 [n, 2, 3], map frame, metres."""
    lines = np.zeros((len(links), 2, 3), np.float32)
    for line, link in zip(lines, links, strict=True):
        a, b = np.array(link.ends_m)
        step, middle = b - a, (a + b) / 2.0
        stretch = max(1.0, SHORTEST_LINK_M / max(float(np.hypot(*step)), 1e-6))
        line[0, :2], line[1, :2] = middle - step * stretch / 2.0, middle + step * stretch / 2.0
        line[:, 2] = z_m
    return lines


def link_text(why: Why, link: Link) -> str:
    """Return the number that is written at a link, and what it measures: "evidence 12 %", "0.40 m away"."""
    slider = method_of(why.method).slider
    score = score_text(why.method, link.score, why.threshold)
    return f"{link.distance_m:.2f} m away" if slider is None else f"{slider.word} {score}"


@dataclass(frozen=True, eq=False)
class Marks:
    """What is to be drawn."""

    simap: SIMap
    why: Why
    lines: bool = True
    """Draw the weakest joint and the links to neighbours."""
    joint: Joint | None = None
    """Outline both parts of this joint, and draw it instead of the weakest."""
    beside: int | None = None
    """Outline this instance too, and draw no link but the one to it."""
    beside_link: Link | None = None


class WhyMarks:
    """The nodes of the 3-D scene below ``/why``; every method replaces what it showed before."""

    def __init__(self, page: viser.ViserServer | viser.ClientHandle, texts: Texts) -> None:
        """Draw nothing yet."""
        self._page, self._texts = page, texts
        self._drawn: dict[str, NDArray] = {}
        self._around: NDArray = np.zeros((0, 2, 3))
        self._lock = threading.RLock()
        self._zoom = Zoom(page, self._draw_lines)

    def draw(self, marks: Marks | None, z_m: float = FLOOR_M) -> None:
        """Draw an explanation, or take it away; ``z_m`` is the height of the lines over the floor."""
        with self._page.atomic(), self._lock:
            self._drawn = dict.fromkeys(NODES, np.zeros((0, 2, 3)))
            links: tuple[Link, ...] = ()
            if marks is not None:
                links = _links_of(marks)
                self._drawn |= _lines_of(marks, links, z_m)
                self._around = outline_segments(marks.simap, marks.why.instance.id)
            self._draw_lines()
            numbers = [] if marks is None else [link_label(marks, link) for link in links[:MAX_NUMBERS]]
            self._texts.show("why", [label._replace(z=z_m) for label in numbers])

    def _draw_lines(self) -> None:
        with self._page.atomic(), self._lock:
            share = line_share(self._around, self._zoom.metres_per_px())
            for name, segments in self._drawn.items():
                color, thickness = NODES[name]
                draw_lines(self._page.scene, f"/why/{name}", segments, color, thickness * share)


def link_label(marks: Marks, link: Link) -> Label:
    """Name a neighbour and its link's number, next to the neighbour: "chair 6 · evidence 12 %"."""
    text = f"{link.other.name} · {link_text(marks.why, link)}"
    (x0, y0), (x1, y1) = link.ends_m
    (xmin, ymin, _), (xmax, ymax, _) = link.other.aabb_m
    if max(xmax - xmin, ymax - ymin) > SMALL_M:
        return Label(text, x1, y1, away_x=x1 - x0, away_y=y1 - y0, id=link.other.id)
    return label_of(text, link.other)._replace(away_x=x1 - x0, away_y=y1 - y0)


def _links_of(marks: Marks) -> tuple[Link, ...]:
    """Choose the links to draw, strongest first."""
    if marks.joint is not None:
        return ()
    if marks.beside is not None:
        return () if marks.beside_link is None else (marks.beside_link,)
    return drawn_links(marks.why) if marks.lines else ()


def _lines_of(marks: Marks, links: Sequence[Link], z_m: float) -> dict[str, NDArray]:
    """Return the lines to draw, by their names in NODES."""
    simap, why, joint = marks.simap, marks.why, marks.joint
    lines: dict[str, NDArray] = {}
    shown = joint or (why.weakest if marks.lines else None)
    if shown is not None:
        lines["cut"] = joint_line(simap, why, shown, z_m + ABOVE_OUTLINES_M)
    if joint is not None:
        lines["source"] = cell_outline(simap, why.cells_of(joint.source), z_m)
        lines["target"] = cell_outline(simap, why.cells_of(joint.target), z_m)
    elif marks.beside is not None:
        lines["other"] = outline_segments(simap, marks.beside, z_m=z_m)
    if links:
        lines["links"] = link_lines(links, z_m)
    return lines


def _middle(simap: SIMap, cells: NDArray) -> tuple[float, float]:
    row, col = np.divmod(cells, simap.spec.cols)
    return simap.spec.centre_of(float(row.mean()), float(col.mean()))
