"""Run a network over a sequence, which then has the network's masks, or on one frame with thresholds to be tried.

Networks are shown pictures that stand upright, however the camera was held; their masks are turned back.
"""

import hashlib
import threading
from collections import OrderedDict, deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import OtherMasks
from simaps_viz.errors import InputError
from simaps_viz.events import Progress
from simaps_viz.geometry import turned, upright_turns
from simaps_viz.segmentation.coco_panoptic import SOURCE as COCO
from simaps_viz.segmentation.coco_panoptic import read_coco_panoptic
from simaps_viz.segmentation.geometry_stuff import FLOOR, WALL, add_stuff
from simaps_viz.segmentation.mask_store import About, MaskStore, file_stamp, find_store
from simaps_viz.segmentation.protocol import Adjustable, Network, Threshold
from simaps_viz.structures import Frame, Segmentation

KEPT = 4
"""Frames whose raw outputs are kept; they take some ten megabytes each."""


class _Shown(NamedTuple):
    """A frame on its way through a network."""

    index: int
    frame: Frame | None
    """Turned as well, where floor and walls are named by geometry."""
    shape: tuple[int, int]
    turns: int
    """Quarter turns that made the picture stand upright."""
    tensors: Any
    """The network's input, then its outputs."""


def _prepared(sequence: PosedFrames, network: Network, index: int, *, by_geometry: bool) -> _Shown:
    turns = quarter_turns(sequence, index)
    frame, color = sequence.read(index).turned(turns) if by_geometry else None, turned(sequence.color(index), turns)
    return _Shown(index, frame, color.shape[:2], turns, network.prepare(color))


def _inferred(network: Network, shown: _Shown) -> _Shown:
    return shown._replace(tensors=network.infer(shown.tensors))


def _decoded(sequence: PosedFrames, network: Network, shown: _Shown) -> Segmentation:
    found = network.decode(shown.tensors, *shown.shape)
    if shown.frame is not None:
        found = add_stuff(shown.frame, found, sequence.T_map_world @ shown.frame.T_world_camera)
    return found.turned(-shown.turns)


class FrameTuner:
    """Reads a network's output on one frame with thresholds of one's choice. Several threads may ask."""

    def __init__(self, sequence: PosedFrames, network: Network, *, by_geometry: bool) -> None:
        """Take the frames and the network.

        Args:
            sequence: posed frames.
            network: already open.
            by_geometry: name floor and walls by geometry, as `segment_sequence` does.

        Raises:
            InputError: the network has no thresholds to try.
        """
        if not isinstance(network, Adjustable):
            raise InputError(f"{network.name}: expected a network with thresholds, found one that has none")
        self._sequence, self._network, self._by_geometry = sequence, network, by_geometry
        self._raw: OrderedDict[int, _Shown] = OrderedDict()
        self._lock = threading.Lock()
        self.runs = 0
        """How often the network ran."""
        self.thresholds: tuple[Threshold, ...] = network.thresholds

    def segmentation(self, index: int, thresholds: Mapping[str, float]) -> Segmentation:
        """Segment a frame.

        Args:
            index: of the frame.
            thresholds: by key; those that are left out stay as the network has them.

        Raises:
            InputError: the picture is damaged, a threshold is none of the network's, or it does not run.
        """
        network = self._network
        assert isinstance(network, Adjustable)
        known = [threshold.key for threshold in self.thresholds]
        for key in thresholds:
            if key not in known:
                raise InputError(f"{self._network.name}: expected thresholds {', '.join(known)}, found {key}")
        return _decoded(self._sequence, network.adjusted(thresholds), self._output(index))

    def _output(self, index: int) -> _Shown:
        with self._lock:
            if index not in self._raw:
                ready = _prepared(self._sequence, self._network, index, by_geometry=self._by_geometry)
                self._raw[index] = _inferred(self._network, ready)
                self.runs += 1
            self._raw.move_to_end(index)
            while len(self._raw) > KEPT:
                self._raw.popitem(last=False)
            return self._raw[index]


def above_score(masks: Segmentation, score: float) -> Segmentation:
    """Drop the segments that are less sure than this; their pixels count as nothing."""
    kept = tuple(segment for segment in masks.segments if segment.score >= score)
    if len(kept) == len(masks.segments):
        return masks
    ids = masks.ids.copy()
    for segment in masks.segments:
        if segment.score < score:
            ids[masks.ids == segment.id] = 0
    return Segmentation(ids, kept)


def score_threshold() -> Threshold:
    """Return the only threshold that masks made elsewhere have."""
    return Threshold("score", "Score", 0.0, "Least confidence of a segment.")


PREPARED_AHEAD = 3
"""Pictures decoded and prepared before the network is ready for them."""


class Masks(Protocol):
    """Segmentations of all frames of a sequence, by position."""

    def classes(self) -> dict[str, bool]:
        """Return {class name: is it a thing}."""
        ...

    def get(self, index: int) -> Segmentation | None:
        """Read a frame's masks; None when nobody was to look for any."""
        ...


class WithMasks(OtherMasks):
    """The frames of a sequence with other masks than its own: a `FrameSource`. Several threads may read at once."""

    def __init__(self, sequence: PosedFrames, masks: Masks, source: str) -> None:
        super().__init__(sequence)
        self._masks, self._intrinsics, self.color = masks, sequence.intrinsics, sequence.color
        self.segmentation_source: str = source
        classes = masks.classes()
        self.labels = ("none", *classes)  # those that the network found
        self.is_thing = (False, *classes.values())

    def segmentation(self, index: int) -> Segmentation:
        """Read the masks of a frame.

        Raises:
            InputError: they are damaged or of another size than the pictures.
        """
        found, k = self._masks.get(index), self._intrinsics
        if found is None:
            return Segmentation(np.zeros((k.height, k.width), np.int32), (), segmented=False)
        if found.ids.shape != (k.height, k.width):
            raise InputError(
                f"{self.segmentation_source}: frame {self.frame_names[index]}: expected masks of {k.width}x{k.height} "
                f"pixels like the picture, found {found.ids.shape[1]}x{found.ids.shape[0]}"
            )
        return found


def segment_sequence(
    sequence: PosedFrames,
    network: Network,
    root: Path,
    *,
    stuff: bool | None = None,
    frames: Sequence[int] | None = None,
    progress: Progress | None = None,
    origin: Mapping[str, Any] | None = None,
) -> WithMasks:
    """Segment every frame that has not been yet, and return the sequence with these masks.

    Pictures are decoded and prepared on one thread, the network runs on this one, its output is read and kept by a
    third. What is done stays done when this is interrupted.

    Args:
        sequence: posed frames.
        network: what looks at the pictures.
        root: folder for the masks.
        stuff: name floor and walls by geometry; None: where the network knows neither.
        frames: look only at these, ascending (see `choose_frames`); the others add geometry to a map. None: at all.
        progress: told how far it is.
        origin: how to open the network again, kept with the masks; see `About`.

    Raises:
        InputError: a picture is damaged, the network does not run, or the folder cannot be written.
    """
    by_geometry = needs_stuff(network) if stuff is None else stuff
    store = MaskStore(root, replace(about(sequence, network, by_geometry, frames), origin=origin or {}))
    wanted = range(len(sequence)) if frames is None else frames
    stamps = {index: _stamp(sequence, index, by_geometry) for index in wanted}
    missing = [index for index in wanted if not store.holds(index, stamps[index])]
    done = len(wanted) - len(missing)
    stage = f"segmenting, {network.name}"
    if progress and missing:
        progress(stage, done, len(wanted))
    for index, found in segmented(sequence, network, missing, by_geometry=by_geometry):
        store.put(index, stamps[index], found)
        done += 1
        if progress:
            progress(stage, done, len(wanted))
    return WithMasks(sequence, store, store.about.source)


def masks_from(sequence: PosedFrames, source: str, root: Path) -> WithMasks | None:
    """Find masks again by what a map's provenance says of them; None when they are gone.

    Args:
        sequence: posed frames.
        source: a `segmentation_source`.
        root: folder of kept masks.

    Raises:
        InputError: they are damaged.
    """
    if source.startswith(COCO):
        table = Path(source.removeprefix(COCO))
        return WithMasks(sequence, read_coco_panoptic(table, sequence.frame_names), source) if table.is_file() else None
    store = find_store(root, sequence=str(sequence.path.resolve()), source=source)
    return None if store is None else WithMasks(sequence, store, source)


def needs_stuff(network: Network) -> bool:
    """Return whether a network knows only things."""
    return all(network.is_thing)


def about(sequence: PosedFrames, network: Network, by_geometry: bool, frames: Sequence[int] | None = None) -> About:
    """Describe what the masks depend on."""
    source = f"{network.name}, {FLOOR} and {WALL} by geometry" if by_geometry else network.name
    key = f"{network.key} {sequence.T_map_world.round(9).tolist() if by_geometry else ''}"
    turns = [quarter_turns(sequence, index) for index in range(len(sequence))]
    if any(turns):
        key += f" turned {turns}"
    if frames is not None:
        key += f" frames {list(frames)}"
        source += f", {len(frames)} of {len(sequence)} frames"
    chosen = None if frames is None else list(frames)
    return About(str(sequence.path.resolve()), f"{source} [{_short(key)}]", key, frames=chosen)


def quarter_turns(sequence: PosedFrames, index: int) -> int:
    """Return the quarter turns counter-clockwise after which a frame's picture stands upright."""
    return upright_turns(sequence.T_map_world @ sequence.poses[index])


def segmented(
    sequence: PosedFrames, network: Network, indices: Sequence[int], *, by_geometry: bool
) -> Iterator[tuple[int, Segmentation]]:
    """Segment frames in the given order, and give each with its index as soon as it is done."""
    with ThreadPoolExecutor(1, "prepare") as before, ThreadPoolExecutor(1, "decode") as after:
        waiting: deque[Future[_Shown]] = deque()
        finishing: deque[tuple[int, Future[Segmentation]]] = deque()
        ahead = iter(indices)
        try:
            for _ in range(len(indices)):
                while len(waiting) < PREPARED_AHEAD and (index := next(ahead, None)) is not None:
                    waiting.append(before.submit(_prepared, sequence, network, index, by_geometry=by_geometry))
                shown = _inferred(network, waiting.popleft().result())
                finishing.append((shown.index, after.submit(_decoded, sequence, network, shown)))
                while finishing and (finishing[0][1].done() or len(finishing) > 1):
                    done, found = finishing.popleft()
                    yield done, found.result()
            for done, found in finishing:
                yield done, found.result()
        finally:
            for future in waiting:
                future.cancel()


def _stamp(sequence: PosedFrames, index: int, by_geometry: bool) -> list[int]:
    """Return what changes when the files that a frame's masks were made from do; a recording may be one file."""
    files = [sequence.color_file(index) or sequence.path]
    if by_geometry:
        files.append(sequence.files(index)[1])
    return file_stamp(*(path for path in files if path.exists()))


def _short(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()[:12]
