"""What a build reads: frames one by one, with their segmentation, a few of them ahead of their use."""

from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.structures import Frame, Segmentation


class FrameSource(Protocol):
    """What a build reads; every dataset reader gives this."""

    @property
    def name(self) -> str:
        """Name of the sequence."""
        ...

    @property
    def path(self) -> Path:
        """The file it was opened from."""
        ...

    @property
    def frame_names(self) -> tuple[str, ...]:
        """In order."""
        ...

    @property
    def poses(self) -> NDArray:
        """float64 [n, 4, 4], T_world_camera."""
        ...

    @property
    def T_map_world(self) -> NDArray:
        """float64 [4, 4], world to map frame."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Class names; index 0 is "none"."""
        ...

    @property
    def is_thing(self) -> tuple[bool, ...]:
        """Aligned with ``labels``."""
        ...

    @property
    def segmentation_source(self) -> str:
        """In words."""
        ...

    @property
    def simulated(self) -> bool:
        """Frames or masks are simulated."""
        ...

    def described(self) -> bytes:
        """Return what says what the images mean (camera, depth unit, segment tables), to see whether it has changed."""
        ...

    def __len__(self) -> int: ...

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Decode a frame, its colour only when asked."""
        ...

    def segmentation(self, index: int) -> Segmentation:
        """Decode a frame's segmentation."""
        ...


class OtherMasks:
    """The frames of a sequence as they are, for a `FrameSource` with masks of its own. Several threads may read."""

    def __init__(self, sequence: FrameSource) -> None:
        self._sequence = sequence
        self.name: str = sequence.name
        self.path: Path = sequence.path
        self.frame_names: tuple[str, ...] = sequence.frame_names
        self.poses: NDArray = sequence.poses
        self.T_map_world: NDArray = sequence.T_map_world
        self.labels: tuple[str, ...] = sequence.labels
        self.is_thing: tuple[bool, ...] = sequence.is_thing
        self.simulated: bool = sequence.simulated

    def __len__(self) -> int:
        return len(self.frame_names)

    def described(self) -> bytes:
        """Return what the sequence says its images mean; ``segmentation_source`` names the masks."""
        return self._sequence.described()

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame, as the sequence itself does."""
        return self._sequence.read(index, color=color)


READ_TOGETHER = 4
"""Frames that a thread reads in one go: handing over each by itself costs more than a tenth of the reading."""
READ_AHEAD = 3
"""Such batches read before they are needed; two threads read while a third maps."""


@dataclass(frozen=True, eq=False)
class Unreadable:
    """A frame that is missing or damaged."""

    index: int
    error: InputError


def read_ahead(sequence: FrameSource, *, color: bool) -> Iterator[tuple[Frame, Segmentation]]:
    """Read a sequence in order, a few frames ahead of their use, on two threads.

    Raises:
        InputError: a frame is missing or damaged.
    """
    for read in read_each(sequence, range(len(sequence)), color=color):
        if isinstance(read, Unreadable):
            raise read.error
        yield read


def read_each(
    sequence: FrameSource, indices: Sequence[int], *, color: bool
) -> Generator[tuple[Frame, Segmentation] | Unreadable, None, None]:
    """Read some frames of a sequence like `read_ahead`; a frame that cannot be read is reported, not raised."""

    def read(first: int) -> list[tuple[Frame, Segmentation] | Unreadable]:
        return [_read(sequence, index, color=color) for index in indices[first : first + READ_TOGETHER]]

    with ThreadPoolExecutor(max_workers=2, thread_name_prefix="read") as pool:
        waiting: deque[Future[list[tuple[Frame, Segmentation] | Unreadable]]] = deque()
        try:
            for first in range(0, len(indices), READ_TOGETHER):
                waiting.append(pool.submit(read, first))
                if len(waiting) > READ_AHEAD:
                    yield from waiting.popleft().result()
            while waiting:
                yield from waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _read(sequence: FrameSource, index: int, *, color: bool) -> tuple[Frame, Segmentation] | Unreadable:
    try:
        return sequence.read(index, color=color), sequence.segmentation(index)
    except InputError as error:
        return Unreadable(index, error)
