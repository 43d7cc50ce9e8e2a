"""The baseline VLMaps (Huang et al., "Visual Language Maps for Robot Navigation", ICRA 2023), re-implemented.

Every valid depth pixel is back-projected with its pixel embedding; a cell of the top-down grid keeps the mean of the
embeddings of all points that fell in it, whatever their height; the nearest of the words asked for names the cell.
The method knows classes, not objects. ``vlmaps`` is just that: all cells of a class are one instance, however far
apart they lie. ``vlmaps+components`` tells objects apart the way VLMaps' programs do when they need a position: the
cleaned mask of the class, contour by contour.

`SimulatedLSeg` turns pixels and words into vectors of one space without a network's 2 GB of weights and a GPU. It
stands in for LSeg (Li et al., "Language-driven Semantic Segmentation", ICLR 2022): vectors of 512 numbers, words that
mean similar things close together, an output coarser than the picture, mistakes that differ from frame to frame. Like
LSeg it is *semantic*: it gets the class at a pixel (with all the errors of the sequence's segmentation) and never which
object the pixel belongs to. What it lacks: mistakes that stay the same from every viewpoint, and words outside a
pixel's own class that fit better than the right one. Both make it kinder to VLMaps than a real network.
"""

import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from typing import Any, Literal

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from simaps_viz.baselines import BASELINES
from simaps_viz.datasets.source import FrameSource, read_ahead
from simaps_viz.errors import InputError
from simaps_viz.events import (
    BuildFinished,
    BuildStarted,
    CommunitiesFound,
    FrameProjected,
    MergesFound,
    Observer,
    notify,
    wants_color,
)  # fmt: skip
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.finalize import without_passers_by
from simaps_viz.mapping.observations import Readings, gather_readings
from simaps_viz.mapping.partition import empty_log
from simaps_viz.mapping.projection import project_pixels
from simaps_viz.mapping.simap import Origin, assemble, count_views
from simaps_viz.structures import Frame, Grid, Segment, Segmentation, SIMap

OTHER = "other"
"""The word asked for in the place of label 0, so that a pixel or cell need not be any of the classes."""


@dataclass(frozen=True, eq=False)
class PixelEmbeddings:
    """An embedding for every pixel, without H x W x D floats.

    Encoders answer more coarsely than they look: a network's output of h x w vectors is a table of h * w rows, and
    ``index`` says which of them stands over a pixel. A truly dense encoder gives a row to every pixel.
    """

    table: NDArray
    """float32 [n, D]."""
    index: NDArray
    """int32 [H, W], row of ``table``; -1 = no embedding."""


KIN = (
    ("chair", "armchair", "stool", "bar stool", "bench", "couch", "sofa", "ottoman"),
    ("table", "dining table", "coffee table", "desk", "counter", "table-merged", "bar"),
    ("cabinet", "cabinet-merged", "shelf", "bookshelf", "wardrobe", "dresser", "sideboard", "nightstand", "rack"),
    ("tv", "laptop", "monitor", "microwave", "oven"),
    ("cup", "bowl", "bottle", "wine glass", "vase"),
    ("potted plant", "plant", "tree-merged", "flower"),
    ("floor", "rug-merged", "carpet", "floor-wood", "floor-other-merged"),
    ("wall", "column", "door", "window", "ceiling", "door-stuff", "window-other", "window-blind", "curtain"),
)
"""Words that mean similar things; every other word has no kin."""


@dataclass(frozen=True)
class LSegNoise:
    """How the simulated encoder errs.

    The numbers are ours, not fitted to a network. With them and exact masks the nearest word is right at 88 % of the
    pixels of the rendered house (39 classes) and 84 % of the embedded café (43); without confusion at 92 % and 91 %,
    with bleeding alone at 96 %.
    """

    any_cosine: float = 0.75
    """About the cosine between the vectors of any two words: CLIP's text vectors lie in a narrow cone."""
    kin_cosine: float = 0.88
    """About the cosine between words of one group of `KIN`."""
    noise: float = 0.1
    """Standard deviation of the Gaussian noise on every number of every output vector."""
    output_stride_px: int = 8
    """The output has one vector for so many pixels of the picture, along both axes."""
    bleed_px: float = 6.0
    """Standard deviation of the Gaussian blur of the class shares: neighbours bleed into each other."""
    confusion: float = 0.15
    """Probability, for a class in a frame, that all its pixels there are drawn towards another class."""
    confusion_kin: float = 0.7
    """Probability that this other class is kin, when there is kin among the sequence's classes."""
    confusion_share: tuple[float, float] = (0.2, 0.7)
    """How far, uniformly from this range; over 0.5 the wrong word is the nearest."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.any_cosine <= self.kin_cosine <= 1.0:
            raise InputError(
                f"simulated encoder: expected 0 <= any cosine <= kin cosine <= 1, "
                f"found {self.any_cosine:g} and {self.kin_cosine:g}"
            )
        if self.output_stride_px < 1 or self.noise < 0.0 or self.bleed_px < 0.0:
            raise InputError(
                f"simulated encoder: expected an output stride of at least 1 and noise and bleed of at least 0, "
                f"found {self.output_stride_px}, {self.noise:g} and {self.bleed_px:g}"
            )


EXACT = LSegNoise(noise=0.0, output_stride_px=1, bleed_px=0.0, confusion=0.0)
"""No errors at all: every pixel has exactly the vector of its class."""


class SimulatedLSeg:
    """A simulated LSeg, with errors of documented size: embeds the pixels of a frame and words in one space."""

    def __init__(
        self, labels: Sequence[str], seed: int = 0, dimension: int = 512, *, noise: LSegNoise | None = None
    ) -> None:
        """Draw the vectors of the words.

        Args:
            labels: every class a pixel can have; the first is "none", pixels without a segment: they look like `OTHER`.
            seed: of everything random; the same seed gives the same vectors and noise.
            dimension: length of the vectors.
            noise: how it errs.

        Raises:
            InputError: the seed is negative or the dimension below 1.
        """
        if seed < 0 or dimension < 1:
            raise InputError(
                f"simulated encoder: expected a seed from 0 and a dimension from 1, found {seed} and {dimension}"
            )
        self.labels, self.seed, self.dimension = tuple(labels), seed, dimension
        self.noise = noise or LSegNoise()
        self._index_of = {name: i for i, name in enumerate(self.labels)}
        self._words = self.text((OTHER, *self.labels[1:]))
        groups = [_group(name) for name in self.labels]
        self._kin = [[j for j, g in enumerate(groups) if g == mine and j != i] for i, mine in enumerate(groups)]

    @property
    def description(self) -> str:
        """What it is, in words."""
        return f"simulated LSeg embeddings, {self.dimension}-D, seed {self.seed} (no network ran)"

    @property
    def parameters(self) -> dict[str, Any]:
        """What it was set to."""
        noise = {**asdict(self.noise), "confusion_share": list(self.noise.confusion_share)}
        return {"seed": self.seed, "dimension": self.dimension, **noise}

    def text(self, labels: Sequence[str]) -> NDArray:
        """Embed words, float32 [n, D], unit length; a word's vector depends on the word and the seed alone."""
        n = self.noise
        parts = (n.any_cosine, n.kin_cosine - n.any_cosine, 1.0 - n.kin_cosine)
        vectors = np.zeros((len(labels), self.dimension))
        for i, name in enumerate(labels):
            for part, word in zip(parts, ("", f"group {_group(name)}", name), strict=True):
                vectors[i] += np.sqrt(part) * self._direction(word)
        return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)

    def pixels(self, frame: Frame, segmentation: Segmentation) -> PixelEmbeddings:
        """Embed a frame from the class at every pixel; noise depends on the seed and the frame's index alone."""
        classes = self._classes(segmentation)
        present = np.unique(classes)
        table = self._shares(classes, present) @ self._confused_words(frame.index)[present]
        if self.noise.noise > 0.0:
            rng = np.random.default_rng([self.seed, 1, frame.index])
            table += np.float32(self.noise.noise) * rng.standard_normal(table.shape, dtype=np.float32)
        return PixelEmbeddings(table, self._index(*classes.shape))

    def _direction(self, word: str) -> NDArray:
        """Return the unit vector that belongs to a word; those of two words are all but orthogonal."""
        drawn = np.random.default_rng([self.seed, 0, zlib.crc32(word.encode())]).standard_normal(self.dimension)
        return drawn / np.linalg.norm(drawn)

    def _classes(self, segmentation: Segmentation) -> NDArray:
        """Return the class at every pixel, int32 [H, W]; from here on segments are forgotten."""
        table = np.zeros(max((s.id for s in segmentation.segments), default=0) + 1, dtype=np.int32)
        for segment in segmentation.segments:
            if segment.label not in self._index_of:
                raise InputError(f"simulated encoder: expected one of its {len(self.labels)} classes, "
                                 f"found {segment.label!r}")  # fmt: skip
            table[segment.id] = self._index_of[segment.label]
        return table[segmentation.ids]

    def _shares(self, classes: NDArray, present: NDArray) -> NDArray:
        """Return the share of every present class in every output vector, float32 [h * w, present]; rows sum to 1."""
        step, sigma = self.noise.output_stride_px, self.noise.bleed_px / self.noise.output_stride_px
        height, width = -(-classes.shape[0] // step), -(-classes.shape[1] // step)
        missing = ((0, height * step - classes.shape[0]), (0, width * step - classes.shape[1]))
        padded = np.pad(classes, missing, mode="edge")
        shares = np.zeros((height * width, len(present)), dtype=np.float32)
        for i, one in enumerate(present.tolist()):
            share = cv2.resize((padded == one).astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)
            if sigma > 0.0:
                share = cv2.GaussianBlur(share, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
            shares[:, i] = share.reshape(-1)
        return shares

    def _index(self, height: int, width: int) -> NDArray:
        step = self.noise.output_stride_px
        v, u = np.arange(height, dtype=np.int32) // step, np.arange(width, dtype=np.int32) // step
        return v[:, None] * np.int32(-(-width // step)) + u[None, :]

    def _confused_words(self, frame_index: int) -> NDArray:
        """Return the vector the encoder sees for every class in this frame, float32 [labels, D]."""
        n, count = self.noise, len(self.labels)
        if count < 2:
            return self._words
        rng = np.random.default_rng([self.seed, 2, frame_index])
        other = (np.arange(count) + rng.integers(1, count, count)) % count
        pick, towards_kin = rng.random(count), rng.random(count) < n.confusion_kin
        share = np.where(rng.random(count) < n.confusion, rng.uniform(*n.confusion_share, count), 0.0)
        for i in np.flatnonzero(towards_kin).tolist():
            if self._kin[i]:
                other[i] = self._kin[i][int(pick[i] * len(self._kin[i]))]
        part = share.astype(np.float32)[:, None]
        return (1.0 - part) * self._words + part * self._words[other]


def _group(name: str) -> str:
    return next((group[0] for group in KIN if name in group), name)


Weighting = Literal["uniform", "distance"]
"""What a point counts: 1, as VLMaps' paper has it, or less the farther away it was seen, as its later program does."""
DISTANCE_VARIANCE_M2 = 0.6
"""Of the distance weight exp(-d^2 / (2 * 0.6 m^2)), d from the camera (ConceptFusion, Jatavallabhula et al., 2023)."""


@dataclass(frozen=True, eq=False)
class CellPoints:
    """The points of a frame that fall on the grid."""

    rows: NDArray
    """int32 [n], counted from the map's origin."""
    cols: NDArray
    """int32 [n], counted from the map's origin."""
    embedding: NDArray
    """int32 [n], row of the frame's embedding table."""
    weights: NDArray
    """float64 [n]."""


def cell_points(
    frame: Frame,
    embeddings: PixelEmbeddings,
    T_map_camera: NDArray,
    settings: ProjectionSettings,
    *,
    stride: int,
    weighting: Weighting,
) -> CellPoints:
    """Put every stride-th pixel of every stride-th row on the grid.

    Raises:
        InputError: the embeddings have another size than the frame.
    """
    if embeddings.index.shape != frame.depth_m.shape:
        expected, found = list(frame.depth_m.shape), list(embeddings.index.shape)
        raise InputError(f"frame {frame.name}: expected embeddings of {expected} pixels, found {found}")
    size, k = settings.cell_size_m, frame.intrinsics
    reach = int(np.ceil(2.0 * settings.far_m / size))  # rays are longer than depth at the corners
    row0, col0 = int(np.floor(T_map_camera[1, 3] / size)) - reach, int(np.floor(T_map_camera[0, 3] / size)) - reach
    side = 2 * reach + 1
    cells = np.full(frame.depth_m.shape, -1, dtype=np.int32)
    heights = np.zeros(frame.depth_m.shape, dtype=np.float32)
    project_pixels(
        frame.depth_m, k.fx, k.fy, k.cx, k.cy, np.ascontiguousarray(T_map_camera, dtype=np.float64),
        settings.near_m, settings.far_m, -settings.below_floor_m, settings.cut_height_m, size,
        row0, col0, side, side, cells, heights,
    )  # fmt: skip
    kept = np.zeros(cells.shape, dtype=bool)
    kept[::stride, ::stride] = True
    v, u = np.nonzero(kept & (cells >= 0) & (embeddings.index >= 0))
    cell = cells[v, u]
    weights = np.ones(len(cell))
    if weighting == "distance":
        depth = frame.depth_m[v, u].astype(np.float64)
        squared = depth**2 * (1.0 + ((u - k.cx) / k.fx) ** 2 + ((v - k.cy) / k.fy) ** 2)
        weights = np.exp(-squared / (2.0 * DISTANCE_VARIANCE_M2))
    return CellPoints(cell // side + row0, cell % side + col0, embeddings.index[v, u], weights)


@njit(cache=True, nogil=True)
def update_means(
    slots: NDArray,  # int32 [n]
    embedding: NDArray,  # int32 [n]
    weights: NDArray,  # float64 [n]
    table: NDArray,  # float32 [rows, D]
    means: NDArray,  # in/out float32 [cells, D]
    totals: NDArray,  # in/out float64 [cells]
) -> None:
    """Move the running mean of each point's cell towards the point's embedding: m += (e - m) w / sum of w."""
    dimension = table.shape[1]
    for i in range(len(slots)):
        slot = slots[i]
        totals[slot] += weights[i]
        share = np.float32(weights[i] / totals[slot])
        mean, vector = means[slot], table[embedding[i]]
        for d in range(dimension):
            mean[d] += (vector[d] - mean[d]) * share


class EmbeddingStore:
    """Running mean embeddings of the cells seen so far, in the order in which they were first seen."""

    def __init__(self, dimension: int) -> None:
        """Start without cells."""
        self.dimension, self.count = dimension, 0
        self._means = np.zeros((0, dimension), dtype=np.float32)
        self._totals = np.zeros(0)
        self._cells = np.zeros((0, 2), dtype=np.int32)
        self._slot_of = np.full((0, 0), -1, dtype=np.int32)
        self._row0 = self._col0 = 0

    @property
    def means(self) -> NDArray:
        """float32 [cells, D]."""
        return self._means[: self.count]

    @property
    def totals(self) -> NDArray:
        """float64 [cells], sum of the weights of a cell's points."""
        return self._totals[: self.count]

    @property
    def cells(self) -> NDArray:
        """int32 [cells, 2], (row, col) counted from the map's origin."""
        return self._cells[: self.count]

    @property
    def held_bytes(self) -> int:
        """What this store takes in memory, its look-up table included; room never written to takes none."""
        return self.means.nbytes + self.totals.nbytes + self.cells.nbytes + self._slot_of.nbytes

    def add(self, points: CellPoints, table: NDArray) -> None:
        """Take in the points of a frame."""
        if len(points.rows) == 0:
            return
        if table.shape[1] != self.dimension:
            raise InputError(
                f"embeddings: expected vectors of {self.dimension} numbers, found vectors of {table.shape[1]}"
            )
        slots = self._slots(points.rows, points.cols)
        update_means(slots, points.embedding, points.weights, table, self._means, self._totals)

    def nearest(self, texts: NDArray) -> NDArray:
        """Return the cosine between every cell's mean and every text, float32 [cells, texts]; 0 for a zero mean.

        Args:
            texts: float32 [texts, D], unit length.
        """
        lengths = np.linalg.norm(self.means, axis=1, keepdims=True)
        return (self.means @ texts.T) / np.maximum(lengths, np.float32(1e-12))

    def _slots(self, rows: NDArray, cols: NDArray) -> NDArray:
        self._make_window(int(rows.min()), int(cols.min()), int(rows.max()) + 1, int(cols.max()) + 1)
        width = self._slot_of.shape[1]
        flat = (rows - self._row0).astype(np.int64) * width + (cols - self._col0)
        slot_of = self._slot_of.reshape(-1)
        new = np.unique(flat[slot_of[flat] < 0])
        last = self.count + len(new)
        self._reserve(last)
        slot_of[new] = np.arange(self.count, last)
        self._cells[self.count : last] = np.stack([new // width + self._row0, new % width + self._col0], axis=1)
        self.count = last
        return slot_of[flat]

    def _reserve(self, wanted: int) -> None:
        """Double the room when it runs out; fresh zeros cost address space, not memory, until a cell is written."""
        if wanted <= len(self._means):
            return
        room = max(wanted, 2 * len(self._means), 1024)
        means, totals, cells = (
            np.zeros((room, self.dimension), np.float32),
            np.zeros(room),
            np.zeros((room, 2), np.int32),
        )
        means[: self.count], totals[: self.count], cells[: self.count] = self.means, self.totals, self.cells
        self._means, self._totals, self._cells = means, totals, cells

    def _make_window(self, row0: int, col0: int, row1: int, col1: int) -> None:
        if self._slot_of.size:
            row0, col0 = min(row0, self._row0), min(col0, self._col0)
            row1 = max(row1, self._row0 + self._slot_of.shape[0])
            col1 = max(col1, self._col0 + self._slot_of.shape[1])
        if (row1 - row0, col1 - col0) == self._slot_of.shape:
            return
        grown = np.full((row1 - row0, col1 - col0), -1, dtype=np.int32)
        if self._slot_of.size:
            top, left = self._row0 - row0, self._col0 - col0
            grown[top : top + self._slot_of.shape[0], left : left + self._slot_of.shape[1]] = self._slot_of
        self._slot_of, self._row0, self._col0 = grown, row0, col0


def dense_bytes(rows: int, cols: int, dimension: int = 512) -> int:
    """Return what VLMaps' own store takes in memory: a float32 vector for every cell of the grid, seen or not.

    1000 x 1000 cells of 512 numbers, the size its published programs allocate, are 2,048 MB (decimal).
    """
    return int(rows) * int(cols) * int(dimension) * np.dtype(np.float32).itemsize  # no int32 may overflow here


_CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=np.uint8)


@dataclass(frozen=True)
class ContourSettings:
    """How a mask is cleaned before its contours are taken; lengths in cells.

    The defaults are the best of what was tried on the rendered house (exact masks) and the embedded café (light
    errors) with the simulated encoder: closing 0, 1, 3; sigma 0, 0.8, 1.2; dilation 0, 1; smallest box 4, 10, 50; with
    and without filling; uniform and distance weights; strides 2 and 4. They were chosen on the very scenes they are
    shown on, which favours the baseline. `PUBLISHED` holds VLMaps' own settings, made for finding an object of a class
    rather than for telling its objects apart: panoptic quality of chairs, tables and desks, house / café, is .61 / .29
    with those and .61 / .52 with these. The best on one scene alone were .71 and .53; a smallest box of 50 cells wins
    a little more by dropping whatever is as small as a stool.
    """

    closing: int = 0
    """Dilations by a cross, then as many erosions: holes and gaps up to twice this close."""
    sigma: float = 0.8
    """Standard deviation of the Gaussian blur; the mask is then where it is above one half. 0 = none."""
    dilation: int = 0
    """Final dilations by a cross."""
    min_box_cells: int = 10
    """Contours whose bounding box (height x width, each one less than its cells) is not larger are dropped."""
    fill: bool = True
    """Seen cells inside a contour that are of no thing class themselves become part of the object."""

    def __post_init__(self) -> None:
        if min(self.closing, self.dilation, self.min_box_cells) < 0 or self.sigma < 0.0:
            raise InputError(
                "contours: expected closing, dilation, sigma and smallest box of at least 0, found "
                f"{self.closing}, {self.dilation}, {self.sigma:g} and {self.min_box_cells}"
            )


PUBLISHED = ContourSettings(closing=3, sigma=0.8, dilation=1, min_box_cells=10, fill=False)
"""What VLMaps' published programs use at 5 cm a cell when they look for the nearest object of a class."""


def contour_objects(mask: NDArray, settings: ContourSettings) -> NDArray:
    """Separate the objects of a class.

    Args:
        mask: bool [rows, cols], the cells of the class.
        settings: how the mask is cleaned.

    Returns:
        int32 [rows, cols]: number of the contour a cell lies in or on, from 1, by its first cell; 0 = none. Cells of
        the mask that cleaning took away, or whose contour was dropped, lie in none.
    """
    margin = settings.closing + settings.dilation + int(np.ceil(3.0 * settings.sigma)) + 1
    clean = np.pad(mask.astype(np.uint8), margin)
    if settings.closing:
        clean = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, _CROSS, iterations=settings.closing)
    if settings.sigma > 0.0:
        clean = (cv2.GaussianBlur(clean.astype(np.float32), (0, 0), settings.sigma) > 0.5).astype(np.uint8)
    if settings.dilation:
        clean = cv2.dilate(clean, _CROSS, iterations=settings.dilation)
    contours, _ = cv2.findContours(clean, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    drawn = np.zeros(clean.shape, dtype=np.int32)
    for number, contour in enumerate(sorted(contours, key=_first_cell), start=1):
        height, width = np.ptp(contour[:, 0, 1]), np.ptp(contour[:, 0, 0])
        if height * width > settings.min_box_cells:
            cv2.drawContours(drawn, [contour], 0, number, thickness=cv2.FILLED)
    inner = drawn[margin : margin + mask.shape[0], margin : margin + mask.shape[1]]
    numbers = np.unique(inner[inner > 0])
    return np.searchsorted(numbers, inner).astype(np.int32) + (inner > 0).astype(np.int32)


def _first_cell(contour: NDArray) -> tuple[int, int]:
    col, row = min(contour[:, 0].tolist(), key=lambda point: (point[1], point[0]))
    return row, col


@dataclass(frozen=True)
class VLMapsConfig:
    """How a VLMaps baseline is built."""

    projection: ProjectionSettings = field(default_factory=ProjectionSettings)
    """Which pixels count, and how fine the grid is: as in every other method."""
    stride: int = 4
    """Every so many pixels, along both axes, one is back-projected with its embedding (VLMaps: one of 100 pixels)."""
    weighting: Weighting = "distance"
    """What a point counts in the mean of its cell; on both scenes tried, the best map by distance is the better one."""
    seed: int = 0
    """Of the simulated encoder."""
    min_cells: int = 4
    """What covers fewer cells is not called an instance, as in the other methods."""
    contours: ContourSettings = field(default_factory=ContourSettings)
    """How ``vlmaps+components`` tells objects apart."""

    def __post_init__(self) -> None:
        if self.stride < 1:
            raise InputError(f"stride: expected at least 1 pixel, found {self.stride}")
        if self.weighting not in ("uniform", "distance"):
            raise InputError(f"weighting: expected uniform or distance, found {self.weighting!r}")
        if self.min_cells < 1:
            raise InputError(f"smallest instance: expected at least 1 cell, found {self.min_cells}")

    def parameters(self, *, components: bool) -> dict[str, Any]:
        """Return what the map file keeps of it."""
        kept = {k: v for k, v in asdict(self).items() if k not in ("projection", "contours")}
        contours = {f"contour_{k}": v for k, v in asdict(self.contours).items()} if components else {}
        return {**kept, **contours, **asdict(self.projection)}


def build_vlmaps(
    sequence: FrameSource,
    config: VLMapsConfig | None = None,
    *,
    components: bool = False,
    embedder: SimulatedLSeg | None = None,
    observers: Sequence[Observer] = (),
) -> SIMap:
    """Build a map the way VLMaps does.

    The map has no graphs and an empty merge log: there is nothing to move K over. Its views say which segments saw an
    instance's cells; the method itself never looked at segments, only, through the encoder, at classes.

    Args:
        sequence: posed RGB-D frames with their segmentation.
        config: how.
        components: one instance for each contour of the class's cleaned mask; False: one for each class.
        embedder: gives pixels and words their vectors; by default one with the errors of `LSegNoise`.
        observers: notified of every event, in order.

    Raises:
        InputError: a frame is missing or damaged (named), or the configuration makes no sense.
    """
    config = config or VLMapsConfig()
    encoder = embedder or SimulatedLSeg(sequence.labels, config.seed)
    notify(observers, _started(sequence, encoder))
    gathered = VLMapsAccumulator(sequence.labels, sequence.is_thing, config, encoder)
    T_map_camera = sequence.T_map_world @ sequence.poses
    for frame, segmentation in read_ahead(sequence, color=wants_color(observers)):
        seen = gathered.add_frame(frame, segmentation, T_map_camera[frame.index])
        if observers:
            notify(observers, _projected(frame, segmentation, T_map_camera[frame.index], gathered, seen))

    grid, instance = split_classes(gathered.grid(), config, components=components)
    grid = without_passers_by(grid, gathered.seen(grid), config.projection.obstacle_height_m)
    notify(observers, CommunitiesFound(grid, instance, len(sequence) - 1, final=True))
    notify(observers, MergesFound(grid, instance, empty_log(), np.zeros(0, dtype=bool)))
    simap = _assemble(sequence, config, gathered, grid, instance, components=components)
    notify(observers, BuildFinished(simap))
    return simap


class VLMapsAccumulator:
    """Takes frames one by one; heights and observations as in every map, labels from the mean embeddings."""

    def __init__(
        self, labels: tuple[str, ...], is_thing: tuple[bool, ...], config: VLMapsConfig, embedder: SimulatedLSeg
    ) -> None:
        """Start empty.

        Args:
            labels: class names, index 0 is "none".
            is_thing: aligned with ``labels``.
            config: how points are gathered.
            embedder: gives pixels and words their vectors.
        """
        self.config, self.embedder = config, embedder
        self.store = EmbeddingStore(embedder.dimension)
        self._heights = MapAccumulator(labels, is_thing, config.projection, links=False)
        self._segments: list[tuple[Segment, ...]] = []
        self._texts = embedder.text([OTHER, *labels[1:]])

    def add_frame(self, frame: Frame, segmentation: Segmentation, T_map_camera: NDArray) -> NDArray:
        """Put a frame on the map.

        Returns:
            int32 [n, 2]: (row, col), counted from the map's origin, of the cells it saw.
        """
        if segmentation.segmented:
            embeddings = self.embedder.pixels(frame, segmentation)
            points = cell_points(
                frame, embeddings, T_map_camera, self.config.projection,
                stride=self.config.stride, weighting=self.config.weighting,
            )  # fmt: skip
            self.store.add(points, embeddings.table)
        self._segments.append(segmentation.segments)
        return self._heights.add_frame(frame, segmentation, T_map_camera)

    def grid(self) -> Grid:
        """Copy the map as it is now; a cell no sampled point fell in has no label."""
        grid = self._heights.snapshot()
        label = np.zeros(grid.spec.shape, dtype=np.int16)
        row, col = (self.store.cells - np.array(self.origin_cell, dtype=np.int32)).T
        label[row, col] = self.store.nearest(self._texts).argmax(axis=1)
        return _relabelled(grid, label)

    def seen(self, grid: Grid) -> Readings:
        """Return which segments saw the cells of the finished map."""
        return gather_readings(self._heights.readings, self._segments, self.origin_cell, grid.labels, grid.spec.cols)

    @property
    def origin_cell(self) -> tuple[int, int]:
        """(row, col), counted from the map's origin, of cell (0, 0) of `grid`."""
        return self._heights.origin_cell


def split_classes(grid: Grid, config: VLMapsConfig, *, components: bool) -> tuple[Grid, NDArray]:
    """Turn classes into instances.

    Returns:
        The grid, whose labels change only where ``config.contours.fill`` gives an object the cells inside its
        contour; and instances int32 [rows, cols], numbered from 1 class by class, 0 = none.
    """
    label, instance = grid.label.copy(), np.zeros(grid.spec.shape, dtype=np.int32)
    things = np.array(grid.is_thing)
    for index in np.flatnonzero(things).tolist():
        mine = grid.label == index
        if not mine.any():
            continue
        objects = contour_objects(mine, config.contours) if components else mine.astype(np.int32)
        taken = mine
        if components and config.contours.fill:
            taken = mine | (~things[label] & (grid.observations > 0))
        objects = _without_small(np.where(taken, objects, 0), config.min_cells)
        label[objects > 0] = index
        instance[objects > 0] = objects[objects > 0] + int(instance.max())
    return _relabelled(grid, label), instance


def _assemble(
    sequence: FrameSource,
    config: VLMapsConfig,
    gathered: "VLMapsAccumulator",
    grid: Grid,
    instance: NDArray,
    *,
    components: bool,
) -> SIMap:
    origin = Origin(
        T_map_world=sequence.T_map_world,
        method=next(name for name, apart in BASELINES.items() if apart == components),
        parameters=config.parameters(components=components),
        provenance=_provenance(sequence, gathered.embedder, gathered.store, grid),
        frame_names=sequence.frame_names,
        T_map_camera=sequence.T_map_world @ sequence.poses,
    )
    return assemble(grid, (), instance, empty_log(), count_views(grid, instance, gathered.seen(grid)), origin)


def _without_small(objects: NDArray, min_cells: int) -> NDArray:
    """Drop objects of fewer cells and number the others from 1 without gaps."""
    kept = np.bincount(objects.reshape(-1)) >= min_cells
    kept[0] = False
    return np.where(kept, np.cumsum(kept), 0).astype(np.int32)[objects]


def _relabelled(grid: Grid, label: NDArray) -> Grid:
    return Grid(grid.spec, grid.labels, grid.is_thing, label, grid.height_m, grid.lowest_m, grid.observations)


def _started(sequence: FrameSource, encoder: SimulatedLSeg) -> BuildStarted:
    return BuildStarted(
        name=sequence.name,
        frame_names=sequence.frame_names,
        T_map_world=sequence.T_map_world,
        segmentation_source=f"{sequence.segmentation_source}; {encoder.description}",
        simulated=True,
    )


def _projected(
    frame: Frame, segmentation: Segmentation, T_map_camera: NDArray, gathered: VLMapsAccumulator, seen: NDArray
) -> FrameProjected:
    return FrameProjected(
        frame=frame,
        segmentation=segmentation,
        T_map_camera=T_map_camera,
        cells=(seen - np.array(gathered.origin_cell, dtype=np.int32)).astype(np.int32),
        new_edges=np.zeros((0, 4), dtype=np.int32),
        new_edge_labels=np.zeros(0, dtype=np.int16),
        snapshot=gathered.grid,
    )


def _provenance(sequence: FrameSource, encoder: SimulatedLSeg, store: EmbeddingStore, grid: Grid) -> dict[str, Any]:
    return {
        "sequence": str(sequence.path),
        "name": sequence.name,
        "segmentation": f"{sequence.segmentation_source}; {encoder.description}",
        "simulated": True,
        "frames": len(sequence),
        "simaps_version": version("simaps-viz"),
        "embeddings": encoder.description,
        "embedder": dict(encoder.parameters),
        "embedding_bytes_dense": dense_bytes(grid.spec.rows, grid.spec.cols, encoder.dimension),
        "embedding_bytes_held": store.held_bytes,
    }
