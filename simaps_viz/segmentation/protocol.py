"""What a segmentation network is to the rest of the program; write a class like this to bring one's own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from numpy.typing import NDArray

from simaps_viz.structures import Segmentation


class Network(Protocol):
    """Turns a colour image into a panoptic segmentation, in three steps that may run on three threads.

    While one picture is in `infer`, the next is in `prepare` and the last in `decode`; so these two must not share
    state with it. `prepare` and `decode` run on one thread each.
    """

    @property
    def name(self) -> str:
        """In words, for the map's provenance."""
        ...

    @property
    def key(self) -> str:
        """Changes whenever the answers would: results are kept under it."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Class names, in the network's order."""
        ...

    @property
    def is_thing(self) -> tuple[bool, ...]:
        """Aligned with ``labels``: countable classes."""
        ...

    def prepare(self, color: NDArray) -> Any:
        """Make the network's input of an image, uint8 [H, W, 3], RGB."""
        ...

    def infer(self, prepared: Any) -> Any:
        """Run the network; nothing else is done here."""
        ...

    def decode(self, outputs: Any, height: int, width: int) -> Segmentation:
        """Make a segmentation [height, width] of the network's outputs."""
        ...


@dataclass(frozen=True)
class Threshold:
    """A number between 0 and 1 that decides what of a network's output counts."""

    key: str
    label: str
    value: float
    hint: str


@runtime_checkable
class Adjustable(Protocol):
    """A network whose output can be read anew with other thresholds, without running it again."""

    @property
    def thresholds(self) -> tuple[Threshold, ...]:
        """The ones it has, with their present values."""
        ...

    def adjusted(self, thresholds: Mapping[str, float]) -> Network:
        """Return the same network, already open, with some thresholds changed, by key."""
        ...
