"""What a build reads: frames one by one, with their segmentation, of one sequence or of several that are joined."""

from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_CLASSES, MAX_FRAMES
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


STEP_S = (1e-3, 10.0)
"""The median time between two frames lies in this range, or their names are no times."""


def named_times(names: Sequence[str]) -> NDArray | None:
    """Return the times of frames, float64 [n], seconds, ascending, where all are named by theirs, else None."""
    try:
        times = np.array([float(name) for name in names])
    except ValueError:
        return None
    steps = np.diff(times)
    timed = len(steps) and all("." in name for name in names) and bool((steps > 0).all())
    return times if timed and STEP_S[0] <= np.median(steps) < STEP_S[1] else None


MAX_TILT_DEG = 3.0
"""Largest angle between the up directions of two sequences of one world frame."""
MAX_STEP_M = 0.3
"""And in what they take for the floor's height; a map has one floor."""
BETWEEN = " + "
"""Between the paths of sequences that are joined."""


class JoinedFrames:
    """The frames of several sequences, one sequence after the other: a `FrameSource`.

    The map frame is that of the first; a frame is called by its sequence and its name there.
    """

    def __init__(self, sequences: Sequence[FrameSource], *, floors: bool = False) -> None:
        """Join them.

        Args:
            sequences: of one world frame.
            floors: they may be on different floors, for a building.

        Raises:
            InputError: they cannot be of one world frame, a class is a thing in one and none in another, or there are
                too many frames.
        """
        if not sequences:
            raise InputError("sequences to join: expected at least one, found none")
        self.sequences = tuple(sequences)
        first = self.sequences[0]
        for other in self.sequences[1:]:
            _check_same_world(first, other, floors=floors)
        called = _distinct([sequence.name for sequence in self.sequences])
        self.name: str = " + ".join(called) if len(called) <= 3 else f"{called[0]} and {len(called) - 1} more"
        self.path: Path = Path(BETWEEN.join(str(sequence.path) for sequence in self.sequences))
        """No file: the paths of all."""
        self.T_map_world: NDArray = first.T_map_world
        self.poses: NDArray = np.concatenate([sequence.poses for sequence in self.sequences])
        self.frame_names: tuple[str, ...] = tuple(
            f"{name}/{frame}" for name, one in zip(called, self.sequences, strict=True) for frame in one.frame_names
        )
        if len(self.frame_names) > MAX_FRAMES:
            raise InputError(f"{self.name}: expected at most {MAX_FRAMES} frames, found {len(self.frame_names)}")
        classes = _joined_classes(self.sequences)
        self.labels: tuple[str, ...] = ("none", *sorted(classes))
        self.is_thing: tuple[bool, ...] = (False, *(classes[label] for label in sorted(classes)))
        self.segmentation_source: str = "; ".join(dict.fromkeys(s.segmentation_source for s in self.sequences))
        self.simulated: bool = any(sequence.simulated for sequence in self.sequences)
        self.notes: tuple[str, ...] = tuple(
            f"{name}: {note}"
            for name, one in zip(called, self.sequences, strict=True)
            for note in getattr(one, "notes", ())
        )
        self._first_of = np.cumsum([0, *(len(sequence) for sequence in self.sequences)])

    def __len__(self) -> int:
        return len(self.frame_names)

    def described(self) -> bytes:
        """Return what each says its images mean."""
        return b"\0".join(sequence.described() for sequence in self.sequences)

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame, as its sequence does, under its number and name here.

        Raises:
            InputError: it is missing or damaged, or there is no frame of that index.
        """
        sequence, inner = self._at(index)
        return replace(sequence.read(inner, color=color), index=index, name=self.frame_names[index])

    def segmentation(self, index: int) -> Segmentation:
        """Read a frame's segmentation; raises InputError like ``read``."""
        sequence, inner = self._at(index)
        return sequence.segmentation(inner)

    def _at(self, index: int) -> tuple[FrameSource, int]:
        if not 0 <= index < len(self):
            raise InputError(f"{self.name}: expected a frame index from 0 to {len(self) - 1}, found {index}")
        number = int(np.searchsorted(self._first_of, index, side="right")) - 1
        return self.sequences[number], index - int(self._first_of[number])


def _distinct(names: Sequence[str]) -> list[str]:
    """Return names that differ, fit to stand before a frame's: the second "hall" becomes "hall-2"."""
    given: list[str] = []
    for name in names:
        plain = "-".join(name.replace("/", " ").replace("\\", " ").split()).strip(".") or "sequence"
        number, candidate = 2, plain
        while candidate in given:
            number, candidate = number + 1, f"{plain}-{number}"
        given.append(candidate)
    return given


def _check_same_world(first: FrameSource, other: FrameSource, *, floors: bool) -> None:
    """Sequences of one world frame agree on up and on the floor; whether x and y are shared, nobody can tell here."""
    ours, theirs = first.T_map_world, other.T_map_world
    tilt_deg = float(np.degrees(np.arccos(np.clip(ours[2, :3] @ theirs[2, :3], -1.0, 1.0))))
    if tilt_deg > MAX_TILT_DEG:
        raise InputError(
            f"{other.path}: expected the world frame of {first.path}, found another up, {tilt_deg:.1f} degrees off"
        )
    step_m = abs(float(ours[2, 3] - theirs[2, 3]))
    if step_m > MAX_STEP_M and not floors:
        raise InputError(
            f"{other.path}: expected the world frame and the floor of {first.path}, found a floor {step_m:.2f} m off; "
            "a map has one floor (-o NAME.json makes a building, with a map for each)"
        )


def _joined_classes(sequences: Sequence[FrameSource]) -> dict[str, bool]:
    classes: dict[str, bool] = {}
    for sequence in sequences:
        for label, thing in zip(sequence.labels[1:], sequence.is_thing[1:], strict=True):
            if classes.setdefault(label, thing) != thing:
                kinds = ("stuff", "a thing")
                raise InputError(
                    f"{sequence.path}: class {label}: expected {kinds[classes[label]]} as in the sequences before it, "
                    f"found {kinds[thing]}"
                )
    if len(classes) >= MAX_CLASSES:
        raise InputError(f"{sequences[0].path}: expected fewer than {MAX_CLASSES} classes in all, found {len(classes)}")
    return classes
