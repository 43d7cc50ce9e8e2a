"""Several sequences of one building as one: the same world frame, one map."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_CLASSES, MAX_FRAMES
from simaps_viz.structures import Frame, Segmentation

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

    def __init__(self, sequences: Sequence[FrameSource]) -> None:
        """Join them.

        Raises:
            InputError: they cannot be of one world frame, a class is a thing in one and none in another, or there are
                too many frames.
        """
        if not sequences:
            raise InputError("sequences to join: expected at least one, found none")
        self.sequences = tuple(sequences)
        first = self.sequences[0]
        for other in self.sequences[1:]:
            _check_same_world(first, other)
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


def _check_same_world(first: FrameSource, other: FrameSource) -> None:
    """Sequences of one world frame agree on up and on the floor; whether x and y are shared, nobody can tell here."""
    ours, theirs = first.T_map_world, other.T_map_world
    tilt_deg = float(np.degrees(np.arccos(np.clip(ours[2, :3] @ theirs[2, :3], -1.0, 1.0))))
    if tilt_deg > MAX_TILT_DEG:
        raise InputError(
            f"{other.path}: expected the world frame of {first.path}, found another up, {tilt_deg:.1f} degrees off"
        )
    step_m = abs(float(ours[2, 3] - theirs[2, 3]))
    if step_m > MAX_STEP_M:
        raise InputError(
            f"{other.path}: expected the world frame and the floor of {first.path}, found a floor {step_m:.2f} m off; "
            "a map has one floor"
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
