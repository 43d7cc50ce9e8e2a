"""The layers of a map that was opened: checked at once, unpacked only when somebody asks for one.

Few uses of a map need all of its layers, and those of a building of 500 m x 500 m take 0.4 GB each.
"""

import threading
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, Self

from numpy.typing import NDArray

from simaps_viz.arrays import Rows
from simaps_viz.structures import Grid, SIMap

LAYERS = ("height", "lowest", "observations", "community")
"""The arrays of a map file that are such layers."""


class _Unpacking:
    """Fields that are found when first asked for, and then kept. Threads may share it."""

    @classmethod
    def of(cls, layers: Mapping[str, Rows], **known: Any) -> Self:
        """Make it of the fields that are there, and those that stay packed; both were checked."""
        made = cls.__new__(cls)
        vars(made).update(known, _layers=layers, _lock=threading.Lock())
        return made

    def __getattr__(self, name: str) -> Any:
        known = vars(self)
        if name not in known.get("_layers", ()):
            raise AttributeError(f"{type(self).__name__} has no {name}")
        with known["_lock"]:
            if name not in known:
                layer: NDArray = known["_layers"][name][:]
                known[name] = layer
        return known[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, one.name) for one in fields(self))  # pyright: ignore[reportArgumentType]


class StoredGrid(_Unpacking, Grid):
    """A grid with packed layers."""


class StoredMap(_Unpacking, SIMap):
    """A map with packed layers."""
