"""What turns pictures and words into vectors of one space, so that the nearest word names a pixel."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

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
