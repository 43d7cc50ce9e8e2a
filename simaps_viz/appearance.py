"""What a map's objects look like: their colours, and vectors of an embedding of pictures and words.

Both are kept for patches: the finest communities of the map when its pictures were looked at, by their cells. So they
stay right when K moves, when communities are found anew, and when objects are joined, cut or renamed by hand.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from simaps_viz.colors.array_cache import ArrayCache
from simaps_viz.errors import InputError
from simaps_viz.structures import GridSpec, SIMap

_tables = ArrayCache()


def _no(dtype: type, *shape: int) -> NDArray:
    return np.zeros(shape, dtype)


@dataclass(frozen=True, eq=False)
class Appearance:
    """The looks of the patches of a map."""

    spec: GridSpec
    """The grid of the map."""
    cell: NDArray
    """int32 [m], flat numbers (row * cols + col) of the cells of all patches, ascending."""
    patch: NDArray
    """int32 [m], the patch of each of these cells, from 0."""
    rgb: NDArray
    """uint8 [patches, 3], median of the pixels seen; 0 where none was."""
    pixels: NDArray
    """int32 [patches], how many pixels that was."""
    vector: NDArray = field(default_factory=lambda: _no(np.int32, 0))
    """int32 [patches] or [0], row of ``vectors`` that describes the patch, -1 = none."""
    vectors: NDArray = field(default_factory=lambda: _no(np.float16, 0, 0))
    """float16 [n, D], an image embedding for each described object, of unit length."""
    weight: NDArray = field(default_factory=lambda: _no(np.float32, 0))
    """float32 [n], the visible pixels that the vector is a mean of."""
    word_vectors: NDArray = field(default_factory=lambda: _no(np.float16, 0, 0))
    """float16 [words, D], of ``model["words"]``, of unit length."""
    model: Mapping[str, Any] = field(default_factory=dict)
    """JSON-able: which embedding made the vectors; ``words``, and ``scale`` of the softmax over them."""

    def __post_init__(self) -> None:
        patches, (count, size) = len(self.rgb), self.vectors.shape
        fits = self.cell.shape == self.patch.shape and self.pixels.shape == (patches,)
        fits = fits and self.rgb.shape == (patches, 3) and self.vector.shape in ((patches,), (0,))
        fits = fits and self.weight.shape == (count,) and self.word_vectors.shape == (len(self.words), size)
        if not fits:
            raise InputError(f"appearance: expected arrays of {patches} patches and {count} vectors, found others")

    @property
    def words(self) -> tuple[str, ...]:
        """The words that ``word_vectors`` embed."""
        return tuple(self.model.get("words", ()))

    @property
    def described(self) -> bool:
        """Whether there are vectors."""
        return bool(len(self.vectors))

    def colors(self, simap: SIMap) -> NDArray:
        """Return the median colour of every instance that has one, computed once for each map.

        The median is that of the patches' colours, weighted by the pixels that each patch shares with the instance.

        Returns:
            int32 [k, 4]: id, red, green, blue; ids ascending.
        """
        return _tables.get((simap.instance, self.rgb), "colors", lambda: self._colors(simap))

    def instance_vectors(self, simap: SIMap) -> tuple[NDArray, NDArray]:
        """Return the vector of every instance that has one: the mean of its patches', weighted by visible pixels.

        Returns:
            int32 [k], ids, ascending; float32 [k, D], unit length.
        """
        arrays, both = (simap.instance, self.vectors), []

        def part(which: int) -> NDArray:
            both.extend(() if both else self._vectors(simap))
            return both[which]

        ids = _tables.get(arrays, "ids", lambda: part(0))
        return ids, _tables.get(arrays, "vectors", lambda: part(1))

    def _colors(self, simap: SIMap) -> NDArray:
        ids, shares = self._shares(simap)
        found = sparse.coo_array(shares)
        weight = found.data * self.pixels[found.col]
        kept = weight > 0
        at, patch, weight = found.row[kept], found.col[kept], weight[kept]
        seen = np.unique(at)
        table = np.zeros((len(seen), 4), np.int32)
        table[:, 0] = ids[seen]
        for channel in range(3):
            value = self.rgb[patch, channel]
            order = np.lexsort((value, at))
            below = np.cumsum(weight[order])
            ends = np.searchsorted(at[order], seen, side="right")
            before = np.r_[0.0, below[ends[:-1] - 1]] if len(seen) else np.zeros(0)
            middle = np.searchsorted(below, (before + below[ends - 1]) / 2.0)
            table[:, 1 + channel] = value[order][np.minimum(middle, ends - 1)]
        return table

    def _vectors(self, simap: SIMap) -> tuple[NDArray, NDArray]:
        ids, shares = self._shares(simap)
        patches = np.flatnonzero(self.vector >= 0) if self.described else np.zeros(0, np.int64)
        # A vector's pixels spread over the cells of the patches that it describes.
        row = self.vector[patches]
        size = np.bincount(self.patch, minlength=len(self.rgb))[patches]
        of_row = np.bincount(row, size, minlength=len(self.vectors)) if self.described else np.zeros(0)
        weight = self.weight[row] * size / np.maximum(of_row[row], 1.0)
        spread = sparse.csr_array((weight, (patches, row)), shape=(len(self.rgb), len(self.vectors)))
        total = np.asarray(shares @ spread @ self.vectors.astype(np.float32), np.float32)
        known = total.any(axis=1)
        return ids[known], unit(total[known])

    def _shares(self, simap: SIMap) -> tuple[NDArray, sparse.csr_array]:
        """Return the ids of the instances, and the share of each patch's cells that lies in them, [ids, patches]."""
        ids = np.array(sorted(one.id for one in simap.instances), np.int32)
        if simap.spec != self.spec:  # cells of another grid
            return ids[:0], sparse.csr_array((0, len(self.rgb)))
        of_cell = simap.instance.reshape(-1)[self.cell]
        inside = of_cell > 0
        at, patch = np.searchsorted(ids, of_cell[inside]), self.patch[inside]
        cells = sparse.csr_array((np.ones(len(at)), (at, patch)), shape=(len(ids), len(self.rgb)))
        size = np.bincount(self.patch, minlength=len(self.rgb))
        return ids, sparse.csr_array(cells / np.maximum(size, 1)[None, :])


def unit(vectors: NDArray) -> NDArray:
    """Return vectors [n, D] of unit length; those of length 0 as they are."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return (vectors / np.where(length > 0, length, 1.0)).astype(np.float32)
