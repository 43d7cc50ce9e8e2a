"""The real detector on real and rendered frames; skipped, saying so, where the shared folder is absent."""

from pathlib import Path

import numpy as np
import pytest

from simaps_viz import BuildConfig, build_map, open_sequence
from simaps_viz.evaluation.bench_networks import Every
from simaps_viz.mapping.votes import VoteSettings
from simaps_viz.segmentation.recognise import NetworkSettings, open_network
from simaps_viz.segmentation.sequences import segment_sequence
from simaps_viz.structures import Segmentation

DATA = Path(__file__).parents[1].parent / "shared" / "data"
NETWORK = DATA / "yolo11n-seg-int8" / "yolo11n-seg_int8.onnx"
needs_shared = pytest.mark.skipif(not NETWORK.is_file(), reason=f"{NETWORK} is not on this machine")


def agreement(ours: Segmentation, theirs: Segmentation) -> tuple[list[float], int]:
    """Give the IoU of each of their segments with ours of its class, those over 0.5, and how many have none."""
    ious, lost = [], 0
    for segment in theirs.segments:
        mask = theirs.ids == segment.id
        rivals = [ours.ids == s.id for s in ours.segments if s.label == segment.label]
        best = max(((mask & other).sum() / (mask | other).sum() for other in rivals), default=0.0)
        if best > 0.5:
            ious.append(float(best))
        else:
            lost += 1
    return ious, lost


@needs_shared
@pytest.mark.parametrize(
    ("name", "seen"), [("hololens-breakroom", "dining table"), ("aws-small-house/rgbd/sequence-pred.json", "chair")]
)
def test_the_real_detector_gives_the_masks_and_the_map_of_the_precomputed_ones(tmp_path, name, seen):
    some = Every(open_sequence(DATA / name), 16)
    network, _ = open_network(NETWORK, NetworkSettings(providers=("cpu",), threads=2))
    assert len(network.labels) == 80 and network.labels[56] == "chair"
    # Without floor and walls: they take stray cells away, which is better, but not the same.
    masks = segment_sequence(some, network, tmp_path, stuff=False)  # pyright: ignore[reportArgumentType] - it has what is used
    found = [agreement(masks.segmentation(i), some.segmentation(i)) for i in range(len(some))]
    ious, lost = [iou for pair in found for iou in pair[0]], sum(pair[1] for pair in found)
    assert np.mean(ious) >= 0.9 and lost <= 0.1 * len(ious)
    # By the highest pixel: votes of so few frames hang on a hair.
    plain = BuildConfig(method="components", votes=VoteSettings(enabled=False))
    ours, theirs = (build_map(s, plain) for s in (masks, some))
    number, other = ours.grid.labels.index(seen), theirs.grid.labels.index(seen)
    mine, wanted = ours.grid.label == number, theirs.grid.label == other
    assert wanted.sum() > 300 and (mine & wanted).sum() > 0.9 * (mine | wanted).sum()
