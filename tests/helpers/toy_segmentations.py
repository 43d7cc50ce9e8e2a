"""Shared by the tests of viewer and others."""

import numpy as np

from simaps_viz.errors import InputError
from simaps_viz.segmentation.protocol import Threshold
from simaps_viz.segmentation.sequences import above_score
from simaps_viz.structures import Segment, Segmentation
from simaps_viz.viewer.panels.masks import SegmentationServices

GREY = np.full((60, 80, 3), 100, np.uint8)


def two_masks() -> Segmentation:
    """A chair on the left, floor on the right."""
    ids = np.zeros((60, 80), np.int32)
    ids[10:50, 5:35], ids[10:50, 45:75] = 4, 9
    return Segmentation(ids, (Segment(4, "chair", 0.8), Segment(9, "floor", 0.6, is_thing=False)))


def toy_segmentation(**others) -> SegmentationServices:
    """Three frames; frame 2 is damaged."""

    def look(frame: int):
        if frame == 2:
            raise InputError("0012.png: expected a picture, found 3 bytes")
        return GREY + frame, two_masks()

    knobs = (Threshold("score", "Score", 0.25, "Least confidence."),)
    return SegmentationServices(
        frame_names=("0010", "0011", "0012"), look=look, knobs=knobs, source="toy.onnx", network="toy.onnx",
        retry=others.pop("retry", lambda frame, values: above_score(two_masks(), values["score"])), **others,
    )  # fmt: skip
