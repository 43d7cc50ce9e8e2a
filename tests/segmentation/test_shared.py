"""The real detector on real and rendered frames; skipped, saying so, where the shared folder is absent."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.masks import agreement, map_agreement
from benchmarks.networks import Every
from toy_maps import toy_map

from simaps_viz import build_map, open_sequence
from simaps_viz.mapping.simap import repartition
from simaps_viz.segmentation.recognise import NetworkSettings, open_network
from simaps_viz.segmentation.sequences import segment_sequence
from simaps_viz.structures import Segment, Segmentation

DATA = Path(__file__).parents[2].parent / "shared" / "data"
NETWORK = DATA / "yolo11n-seg-int8" / "yolo11n-seg_int8.onnx"
needs_shared = pytest.mark.skipif(not NETWORK.is_file(), reason=f"{NETWORK} is not on this machine")


@pytest.mark.slow
@needs_shared
def test_the_real_detector_gives_the_masks_and_the_map_of_the_precomputed_ones(tmp_path):
    some = Every(open_sequence(DATA / "aws-small-house/rgbd/sequence-pred.json"), 25)
    network, _ = open_network(NETWORK, NetworkSettings(providers=("cpu",), threads=2))
    assert len(network.labels) == 80 and network.labels[56] == "chair"
    # Floor and walls by geometry would take away what the detector sees in flat walls: better, but not the same.
    masks = segment_sequence(some, network, tmp_path, stuff=False)  # pyright: ignore[reportArgumentType] - it has what is used
    seen = agreement((masks.segmentation(i), some.segmentation(i)) for i in range(len(some)))
    assert seen.mean_iou >= 0.9 and seen.lost + seen.extra <= 0.1 * len(seen.ious), str(seen)
    mapped = map_agreement(build_map(masks), build_map(some))
    assert len(mapped.ious) >= 20 and mapped.mean_iou >= 0.85 and mapped.lost + mapped.extra <= 2, str(mapped)


def test_segments_agree_by_class_and_overlap():
    ids = np.zeros((4, 10), np.int32)
    ids[:, :4], ids[:, 6:] = 1, 2
    theirs = Segmentation(ids, (Segment(1, "chair"), Segment(2, "chair")))
    moved = np.zeros((4, 10), np.int32)
    moved[:, :3], moved[:, 6:] = 7, 8
    ours = Segmentation(moved, (Segment(7, "chair"), Segment(8, "couch"), Segment(9, "floor", is_thing=False)))
    found = agreement([(ours, theirs), (theirs, theirs)])
    assert sorted(found.ious) == [0.75, 1.0, 1.0] and (found.lost, found.extra) == (1, 1)
    assert str(found) == "3 match, mean IoU 0.917; 1 only there, 1 only here"
    empty = Segmentation(np.zeros((4, 10), np.int32), ())
    assert agreement([(empty, empty)]).mean_iou == 1.0 and agreement([(empty, theirs)]).mean_iou == 0.0


def test_a_map_agrees_with_itself_and_less_with_another_partition():
    simap = toy_map()
    same = map_agreement(simap, simap, min_cells=1)
    assert same.ious == (1.0,) * len(simap.instances) and same.lost == same.extra == 0
    apart = map_agreement(repartition(simap, k_percent=100.0), simap, min_cells=1)
    assert apart.ious == (1.0,) * 5 and (apart.lost, apart.extra) == (2, 4)  # a chair and a table fell in two
