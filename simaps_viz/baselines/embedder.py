"""Embedders, which turn pixels and words into vectors of one space, and a SIMULATED one.

`SimulatedLSeg` is for machines without the network's 2 GB of weights and a GPU. It stands in for LSeg (Li et al.,
"Language-driven Semantic Segmentation", ICLR 2022): vectors of 512 numbers, words that mean similar things close
together, an output coarser than the picture, mistakes that differ from frame to frame. Like LSeg it is *semantic*: it
gets the class at a pixel (with all the errors of the sequence's segmentation) and never which object the pixel
belongs to. What it lacks: mistakes that stay the same from every viewpoint, and words outside a pixel's own class that
fit better than the right one. Both make it kinder to VLMaps than a real network.
"""

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import Frame, Segmentation

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

    def __post_init__(self) -> None:
        if self.table.ndim != 2 or self.table.dtype != np.float32:
            found = f"{self.table.dtype} {list(self.table.shape)}"
            raise InputError(f"pixel embeddings: expected a table float32 [n, D], found {found}")
        if self.index.ndim != 2 or self.index.dtype != np.int32:
            found = f"{self.index.dtype} {list(self.index.shape)}"
            raise InputError(f"pixel embeddings: expected an index int32 [H, W], found {found}")
        if self.index.size and int(self.index.max()) >= len(self.table):
            raise InputError(
                f"pixel embeddings: expected an index below {len(self.table)}, found {int(self.index.max())}"
            )


class Embedder(Protocol):
    """Embeds the pixels of a frame and the words of a query in one space."""

    @property
    def dimension(self) -> int:
        """D, the length of every vector; 512 for CLIP ViT-B/32 and LSeg."""
        ...

    @property
    def description(self) -> str:
        """What it is, in words; shown beside every map made with it."""
        ...

    @property
    def parameters(self) -> Mapping[str, Any]:
        """What it was set to, JSON-able; kept in the map's provenance."""
        ...

    @property
    def simulated(self) -> bool:
        """It is no network: must be called simulated wherever its maps are shown."""
        ...

    @property
    def wants_color(self) -> bool:
        """It looks at ``Frame.color``, so frames have to be decoded with it."""
        ...

    def pixels(self, frame: Frame, segmentation: Segmentation) -> PixelEmbeddings:
        """Embed every pixel; a network looks at the colour, a simulation at the class of each pixel."""
        ...

    def text(self, labels: Sequence[str]) -> NDArray:
        """Embed words: float32 [n, D], unit length."""
        ...


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
    """A simulated LSeg: an `Embedder` of documented noise."""

    simulated = True
    wants_color = False

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
