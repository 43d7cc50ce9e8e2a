"""Tries thresholds on single frames: the network runs once on a frame, and its output is read as often as one likes."""

import threading
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, NamedTuple

from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.segmentation.geometry_stuff import add_stuff
from simaps_viz.segmentation.protocol import Adjustable, Network, Threshold
from simaps_viz.structures import Frame, Segmentation

KEPT = 4
"""Frames whose raw outputs are kept; they take some ten megabytes each."""


class _Raw(NamedTuple):
    outputs: Any
    shape: tuple[int, int]
    frame: Frame | None


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
        self._raw: OrderedDict[int, _Raw] = OrderedDict()
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
        raw = self._output(index)
        found = network.adjusted(thresholds).decode(raw.outputs, *raw.shape)
        if raw.frame is not None:
            found = add_stuff(raw.frame, found, self._sequence.T_map_world @ raw.frame.T_world_camera)
        return found

    def _output(self, index: int) -> _Raw:
        with self._lock:
            if index not in self._raw:
                color = self._sequence.color(index)
                frame = self._sequence.read(index) if self._by_geometry else None
                outputs = self._network.infer(self._network.prepare(color))
                self.runs += 1
                self._raw[index] = _Raw(outputs, color.shape[:2], frame)
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
