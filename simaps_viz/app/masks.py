"""The frames a map was built from, its masks, and the network that made them, for the page's panel of masks.

Pictures and masks are shown upright, however the camera was held.
"""

import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from numpy.typing import NDArray

from simaps_viz.datasets.floors import indices_of
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.geometry import turned
from simaps_viz.segmentation.mask_store import About, find_store
from simaps_viz.segmentation.protocol import Threshold
from simaps_viz.segmentation.sequences import (
    FrameTuner,
    WithMasks,
    about,
    above_score,
    masks_from,
    quarter_turns,
    score_threshold,
)
from simaps_viz.structures import Segmentation, SIMap
from simaps_viz.viewer.panels.masks import SegmentationServices

NO_NETWORK = (
    "The network that made them is not at hand: only the score can be tried. With simaps view SEQUENCE --segmentation "
    "NET.onnx all thresholds can."
)
SIMULATED = "The frames are rendered, and errors of a network may be simulated."


def open_frames(simap: SIMap, cache: Path) -> tuple[PosedFrames, PosedFrames | WithMasks | None]:
    """Open the sequence a map was built from, and the same with the masks it was built from; None: no longer kept.

    Raises:
        InputError: the sequence is not where it was.
    """
    source, place = (str(simap.provenance.get(key, "")) for key in ("segmentation", "sequence"))
    if not place:
        raise InputError("the map does not name its recording")
    sequence = open_sequence(Path(place))
    return sequence, sequence if source == sequence.segmentation_source else masks_from(sequence, source, cache)


def segmentation_services(simap: SIMap, cache: Path) -> SegmentationServices:
    """Find the frames, the masks and, if its file still exists, the network that a map was built from.

    Args:
        simap: the map; its provenance names them.
        cache: folder where networks' masks are kept.
    """
    source = str(simap.provenance.get("segmentation", ""))
    try:
        sequence, masks = open_frames(simap, cache)
    except InputError as error:
        return SegmentationServices(source=source, notes=(f"The frames of this map are not at hand: {error}.",))
    services = _services(sequence, masks, source, cache)
    at = indices_of(simap.frame_names, sequence)
    if at is None or services.look is None or services.retry is None:
        return services
    # The map of a floor: its frames are some of the recording's.
    look, retry = services.look, services.retry
    return replace(
        services,
        frame_names=simap.frame_names,
        look=lambda index: look(at[index]),
        retry=lambda index, values: retry(at[index], values),
    )


def _services(
    sequence: PosedFrames, masks: PosedFrames | WithMasks | None, source: str, cache: Path
) -> SegmentationServices:
    """Return what the panel of masks can do with the frames of a sequence."""
    simulated = (SIMULATED,) if sequence.simulated else ()
    if masks is None:
        note = "The masks this map was built from are no longer kept; build it again to see them."
        return SegmentationServices(source=source, notes=(note, *simulated))
    store = find_store(cache, sequence=str(sequence.path.resolve()), source=source)
    if masks is sequence or store is None:
        return _elsewhere(sequence, masks, source, (NO_NETWORK, *simulated))
    try:
        opener = _Opener(sequence, store.about)
    except InputError as error:
        return _elsewhere(sequence, masks, source, (NO_NETWORK, f"{error}.", *simulated))
    return SegmentationServices(
        frame_names=sequence.frame_names,
        look=lambda index: _look(sequence, masks, index),
        retry=opener.segmentation,
        runs_network=True,
        knobs=tuple(Threshold(**row) for row in store.about.origin.get("thresholds", ())),
        source=source,
        network=opener.file.name,
        notes=simulated,
    )


class _Opener:
    """Opens a map's network when a threshold is first tried. Several threads may ask."""

    def __init__(self, sequence: PosedFrames, made: About) -> None:
        """Raises InputError when the network is not there any more."""
        self._sequence, self._about = sequence, made
        self._tuner: FrameTuner | None = None
        self._lock = threading.Lock()
        if not made.origin.get("network"):
            raise InputError("the masks do not say where their network was")
        self.file = Path(made.origin["network"])
        if not self.file.is_file():
            raise InputError(f"{self.file}: expected the network this map was built with, found nothing")

    def segmentation(self, index: int, values: Mapping[str, float]) -> Segmentation:
        """Segment a frame with other thresholds; raises InputError when the file has been replaced by another."""
        with self._lock:
            if self._tuner is None:
                self._tuner = self._open()
        return self._tuner.segmentation(index, values).turned(quarter_turns(self._sequence, index))

    def _open(self) -> FrameTuner:
        from simaps_viz.segmentation.recognise import NetworkSettings, open_network  # noqa: PLC0415 - onnxruntime is slow

        network, _ = open_network(self.file, NetworkSettings.from_json(self._about.origin["settings"]))
        for by_geometry in (True, False):
            now = about(self._sequence, network, by_geometry)
            if (now.source, now.key) == (self._about.source, self._about.key):
                return FrameTuner(self._sequence, network, by_geometry=by_geometry)
        raise InputError(f"{self.file}: expected the network this map was built with, found another")


def _elsewhere(
    sequence: PosedFrames, masks: PosedFrames | WithMasks, source: str, notes: tuple[str, ...]
) -> SegmentationServices:
    """Masks without their network: the score is all that can be tried."""

    def retry(index: int, values: Mapping[str, float]) -> Segmentation:
        return above_score(masks.segmentation(index), values["score"]).turned(quarter_turns(sequence, index))

    return SegmentationServices(
        frame_names=sequence.frame_names,
        look=lambda index: _look(sequence, masks, index),
        retry=retry,
        knobs=(score_threshold(),),
        source=source,
        notes=notes,
    )


def _look(sequence: PosedFrames, masks: PosedFrames | WithMasks, index: int) -> tuple[NDArray, Segmentation]:
    turns = quarter_turns(sequence, index)
    return turned(sequence.color(index), turns), masks.segmentation(index).turned(turns)
