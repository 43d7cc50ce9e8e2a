"""The VLMaps baselines on the tiny sequence, where every cell is known, and once on the house."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from sequences import write_tiny_sequence

from simaps_viz import build_map, load_map, open_sequence, save_map
from simaps_viz.baselines.vlmaps import (
    EXACT,
    ContourSettings,
    SimulatedLSeg,
    VLMapsConfig,
    build_vlmaps,
    dense_bytes,
)
from simaps_viz.errors import InputError
from simaps_viz.events import BuildFinished, BuildStarted, CommunitiesFound, FrameProjected, MergesFound

CLEAN = ContourSettings(closing=0, sigma=0.0, dilation=0, min_box_cells=0, fill=False)
DENSE = VLMapsConfig(stride=1, weighting="uniform", contours=CLEAN)


@pytest.fixture
def tiny(tmp_path):
    return open_sequence(write_tiny_sequence(tmp_path / "tiny"))


def exact(sequence):
    return SimulatedLSeg(sequence.labels, noise=EXACT)


class Watcher:
    """Keeps every event and what the map looked like."""

    wants_color = False

    def __init__(self):
        self.events, self.labels = [], []

    def on_event(self, event):
        self.events.append(event)
        if isinstance(event, FrameProjected):
            self.labels.append(event.snapshot())


def votes(sequence):
    """How many pixels of each class fell in every cell of the finished map, one pixel at a time."""
    counts: dict[tuple[int, int], Counter] = {}
    T_map_camera = sequence.T_map_world @ sequence.poses
    for index in range(len(sequence)):
        frame, segmentation = sequence.read(index), sequence.segmentation(index)
        k, label = frame.intrinsics, {s.id: s.label for s in segmentation.segments}
        for v, u in np.ndindex(frame.depth_m.shape):
            z = float(frame.depth_m[v, u])
            x, y, *_ = T_map_camera[index] @ ((u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z, 1.0)
            cell = (int(np.floor(y / 0.05)), int(np.floor(x / 0.05)))
            counts.setdefault(cell, Counter())[label[int(segmentation.ids[v, u])]] += 1
    return counts


def test_a_cell_is_called_by_the_mean_of_all_its_points_whatever_their_height(tiny):
    simap = build_vlmaps(tiny, DENSE, embedder=exact(tiny))
    spec, checked, outvoted = simap.spec, 0, 0
    paper = build_map(tiny)
    for (row, col), counted in votes(tiny).items():
        at = (row - round(spec.y0_m / 0.05), col - round(spec.x0_m / 0.05))
        (best, most), *others = counted.most_common()
        if others and most < 1.5 * others[0][1]:
            continue  # a tie would hang on the vectors' lengths
        checked += 1
        assert simap.grid.labels[simap.grid.label[at]] == best
        outvoted += simap.grid.label[at] != paper.grid.label[at]
    assert checked > 0.9 * (simap.grid.observations > 0).sum()
    assert (simap.grid.label[simap.grid.observations == 0] == 0).all()


def test_heights_and_observations_are_those_of_every_other_map(tiny):
    simap, paper = build_vlmaps(tiny), build_map(tiny)
    assert simap.spec == paper.spec and simap.grid.is_thing == paper.grid.is_thing
    for layer in ("height_m", "lowest_m", "observations"):
        np.testing.assert_array_equal(getattr(simap.grid, layer), getattr(paper.grid, layer))
    np.testing.assert_array_equal(simap.T_map_camera, paper.T_map_camera)


def test_without_a_notion_of_instance_both_chairs_are_one(tiny):
    simap = build_vlmaps(tiny, DENSE, embedder=exact(tiny))
    assert simap.method == "vlmaps" and simap.counts() == {"chair": 1}
    np.testing.assert_array_equal(simap.instance > 0, simap.grid.label == simap.grid.labels.index("chair"))
    chairs = simap.instances[0]
    assert chairs.cells == 32 and chairs.frames == 3 and chairs.score == pytest.approx(0.9)
    assert abs(chairs.centroid_m[0]) < 0.01  # between the two
    assert len(simap.merges) == 0 and simap.graphs == ()


def test_contours_tell_the_chairs_apart(tiny):
    simap = build_vlmaps(tiny, DENSE, components=True, embedder=exact(tiny))
    assert simap.method == "vlmaps+components" and simap.counts() == {"chair": 2}
    west, east = sorted(simap.instances, key=lambda i: i.centroid_m[0])
    assert west.centroid_m == pytest.approx((-0.2, 0.0, 1.0), abs=1e-3)
    assert east.centroid_m == pytest.approx((0.2, 0.0, 1.0), abs=1e-3)
    assert west.cells == east.cells == 16 and west.frames == east.frames == 3


def test_filling_gives_an_object_the_cells_inside_its_contour_that_are_of_no_thing(tiny):
    grown = replace(CLEAN, dilation=1)
    kept = build_vlmaps(tiny, replace(DENSE, contours=grown), components=True, embedder=exact(tiny))
    filling = replace(DENSE, contours=replace(grown, fill=True))
    filled = build_vlmaps(tiny, filling, components=True, embedder=exact(tiny))
    assert [i.cells for i in kept.instances] == [16, 16]
    for one, before in zip(filled.instances, kept.instances, strict=True):
        rim = np.asarray(binary_dilation(kept.instance == before.id), dtype=bool) & (kept.grid.observations > 0)
        np.testing.assert_array_equal(filled.instance == one.id, rim)
        assert one.cells > 16
    chair = filled.grid.labels.index("chair")
    np.testing.assert_array_equal(filled.grid.label == chair, filled.instance > 0)


@pytest.mark.parametrize("components", [False, True])
def test_a_map_comes_back_from_its_file_and_the_same_again_bit_for_bit(tiny, tmp_path, components):
    config = VLMapsConfig(stride=1, contours=CLEAN)
    simap = build_vlmaps(tiny, config, components=components)
    save_map(simap, tmp_path / "one.npz")
    save_map(build_vlmaps(tiny, config, components=components), tmp_path / "two.npz")
    one, two = load_map(tmp_path / "one.npz"), load_map(tmp_path / "two.npz")
    for loaded in (one, two):
        assert loaded.instances == simap.instances and loaded.parameters == simap.parameters
        assert loaded.provenance == simap.provenance and loaded.graphs == () and len(loaded.merges) == 0
        np.testing.assert_array_equal(loaded.instance, simap.instance)
        np.testing.assert_array_equal(loaded.grid.label, simap.grid.label)
        np.testing.assert_array_equal(loaded.grid.height_m, simap.grid.height_m)
        for part in ("community", "frame", "segment", "cells", "score"):
            np.testing.assert_array_equal(getattr(loaded.views, part), getattr(simap.views, part))
    assert not np.array_equal(simap.instance, 0)


def test_it_is_called_simulated_and_tells_what_it_weighs(tiny):
    watcher = Watcher()
    simap = build_vlmaps(tiny, observers=[watcher])
    assert not tiny.simulated and simap.provenance["simulated"]
    assert "simulated LSeg" in simap.provenance["segmentation"] and "drawn by" in simap.provenance["segmentation"]
    assert simap.provenance["embedder"]["dimension"] == 512
    assert simap.provenance["embedding_bytes_dense"] == dense_bytes(*simap.spec.shape)
    assert simap.provenance["embedding_bytes_held"] > 0
    started = watcher.events[0]
    assert isinstance(started, BuildStarted) and started.simulated
    assert "simulated LSeg" in started.segmentation_source


def test_those_who_watch_are_told_in_order_and_see_the_map_grow(tiny):
    watcher = Watcher()
    simap = build_vlmaps(tiny, DENSE, components=True, embedder=exact(tiny), observers=[watcher])
    kinds = [type(event) for event in watcher.events]
    assert kinds == [BuildStarted, *[FrameProjected] * 3, CommunitiesFound, MergesFound, BuildFinished]
    for event, grid in zip(watcher.events[1:4], watcher.labels, strict=True):
        rows, cols = event.cells.T
        assert (grid.observations[rows, cols] > 0).all() and event.new_edges.shape == (0, 4)
    np.testing.assert_array_equal(watcher.labels[-1].label, simap.grid.label)
    assert (watcher.labels[0].label == simap.grid.labels.index("chair")).sum() == 32
    finished = watcher.events[-1]
    assert isinstance(finished, BuildFinished) and finished.simap is simap


@pytest.mark.parametrize(
    ("change", "message"),
    [({"stride": 0}, "stride"), ({"weighting": "heavy"}, "'heavy'"), ({"min_cells": 0}, "smallest instance")],
)
def test_bad_settings_are_named(change, message):
    with pytest.raises(InputError, match=message):
        VLMapsConfig(**change)
