"""A sequence with exact ids whose masks are spoiled in memory by simulated network errors."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.geometry import transform_points
from simaps_viz.scenes.simulated_errors import KnownInstance, check_level, simulate_errors
from simaps_viz.structures import Frame, Segment, Segmentation

_FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]


class WithSimulatedErrors:
    """The frames of a sequence with exact ids, with masks spoiled the way a network errs: a `FrameSource`.

    A frame is spoiled when first asked for and kept packed, about as fast to unpack as a file is to read; so builds
    of several methods cost what they would cost with masks on disk. Several threads may read at once.
    """

    simulated = True

    def __init__(self, sequence: PosedFrames, level: str, seed: int = 0) -> None:
        """Wrap a sequence.

        Args:
            sequence: its masks are the truth; its scene file gives each object's box.
            level: a key of `scenes.simulated_errors.LEVELS`.
            seed: not negative.

        Raises:
            InputError: there is no such level, the masks are not exact, or the scene file lacks boxes.
        """
        if seed < 0:
            raise InputError(f"seed: expected 0 or more, found {seed}")
        self.level, self.seed, self._exact = check_level(level), seed, sequence
        self._known = _known_instances(sequence)
        self._packed: dict[int, tuple[NDArray, tuple[Segment, ...]]] = {}
        self.name: str = f"{sequence.name}, {self.segmentation_source}"
        self.path: Path = sequence.path
        self.frame_names: tuple[str, ...] = sequence.frame_names
        self.poses: NDArray = sequence.poses
        self.T_map_world: NDArray = sequence.T_map_world
        self.labels: tuple[str, ...] = sequence.labels
        self.is_thing: tuple[bool, ...] = sequence.is_thing

    @property
    def segmentation_source(self) -> str:
        """In words, always "simulated …"."""
        return f"simulated network errors, {self.level}, seed {self.seed}"

    def __len__(self) -> int:
        return len(self._exact)

    def described(self) -> bytes:
        """Return what the sequence says its images mean; ``segmentation_source`` names the errors."""
        return self._exact.described()

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame, as the sequence itself does."""
        return self._exact.read(index, color=color)

    def color(self, index: int) -> NDArray:
        """Read a frame's colour image, uint8 [H, W, 3], RGB."""
        return self._exact.color(index)

    def segmentation(self, index: int) -> Segmentation:
        """Return a frame's spoiled masks; the same every time."""
        if index not in self._packed:
            self._packed[index] = self._spoil(index)
        packed, segments = self._packed[index]
        return Segmentation(np.asarray(cv2.imdecode(packed, cv2.IMREAD_UNCHANGED), dtype=np.int32), segments)

    def prepare(self, progress: Progress | None = None) -> None:
        """Spoil all frames now, on two threads."""
        with ThreadPoolExecutor(max_workers=2) as pool:
            for done, _ in enumerate(pool.map(self.segmentation, range(len(self))), start=1):
                if progress:
                    progress(f"simulating network errors, {self.level}, seed {self.seed}", done, len(self))

    def _spoil(self, index: int) -> tuple[NDArray, tuple[Segment, ...]]:
        exact = self._exact.segmentation(index)
        name = self.frame_names[index]
        ids, rows = simulate_errors(exact.ids, self._known, level=self.level, seed=self.seed, frame=name)
        things = dict(zip(self.labels, self.is_thing, strict=True))
        segments = tuple(Segment(r["id"], r["label"], float(r["score"]), things[r["label"]]) for r in rows)
        narrow = ids.astype(np.uint8) if ids.max(initial=0) < 256 else ids.astype(np.uint16)
        done, packed = cv2.imencode(".png", narrow, _FAST_PNG)
        if not done:
            raise InputError(f"{self.path}: frame {name}: expected ids of at most 65535, found {int(ids.max())}")
        return packed, segments


def _known_instances(sequence: PosedFrames) -> Mapping[int, KnownInstance]:
    segments = sequence.recording.segments
    if not sequence.ground_truth or segments is None or segments.table is None or segments.world is None:
        raise InputError(
            f"{sequence.path}: expected exact world-wide ids, to simulate errors on them, found masks by "
            f'"{sequence.segmentation_source}"'
        )
    path = segments.table
    things = dict(zip(sequence.labels, sequence.is_thing, strict=True))
    known = {}
    for row in read_json(path)["instances"]:
        middle = transform_points(sequence.T_map_world, _middle(path, row))
        known[int(row["id"])] = KnownInstance(row["label"], things[row["label"]], (float(middle[0]), float(middle[1])))
    return known


def _middle(path: Path, row: Mapping[str, Any]) -> NDArray:
    """Return the middle of an object's box, world frame, metres."""
    try:
        low, high = (np.array(row[key], dtype=np.float64).reshape(3) for key in ("aabb_min", "aabb_max"))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: id {row['id']}: expected aabb_min and aabb_max, three numbers each, to tell neighbours by; "
            f"found another shape or none"
        ) from error
    return (low + high) / 2.0
