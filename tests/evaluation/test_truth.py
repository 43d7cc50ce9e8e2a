"""The true map against a plain twin, where it is found, and masks with simulated errors."""

import json
import shutil

import cv2
import numpy as np
import pytest
from sequences import SEATS_M, frame_name, write_manifest, write_tiny_sequence

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.open import open_sequence
from simaps_viz.errors import InputError
from simaps_viz.evaluation.evaluate import WithSimulatedErrors
from simaps_viz.evaluation.quality import score
from simaps_viz.evaluation.truth import (
    find_truth,
    joint_window,
    settings_of,
    truth_as_map,
    truth_map,
    truth_of,
    whole_cells,
)
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.scenes.demo import DemoSettings, ensure_demo
from simaps_viz.structures import GridSpec


@pytest.fixture
def exact(tmp_path):
    return open_sequence(write_tiny_sequence(tmp_path / "exact", truth="instances", frames=4))


@pytest.fixture(scope="module")
def small_cafe(tmp_path_factory):
    """Six small frames of the café: (exact manifest, manifest with light errors)."""
    cache, small = tmp_path_factory.mktemp("cache"), DemoSettings(frames=6, width=96, height=72)
    return tuple(
        open_sequence(ensure_demo(level=level, cache_dir=cache, settings=small)) for level in ("none", "light")
    )


def plain_truth(sequence, truth, settings):
    """The twin: sort every pixel of all frames by height, and let the last one of each cell name it."""
    cells, heights, ids, order = [], [], [], []
    k = sequence.intrinsics
    v, u = np.mgrid[: k.height, : k.width]
    for index in range(len(sequence)):
        z = sequence.read(index).depth_m.astype(float)
        points = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z, np.ones_like(z)], -1)
        x, y, h, _ = np.moveaxis(points @ (sequence.T_map_world @ sequence.poses[index]).T, -1, 0)
        kept = (
            (z > settings.near_m) & (z < settings.far_m) & (h < settings.cut_height_m) & (h > -settings.below_floor_m)
        )
        col, row = (np.floor(a / settings.cell_size_m).astype(int) for a in (x, y))
        row, col = (
            row - round(truth.spec.y0_m / settings.cell_size_m),
            col - round(truth.spec.x0_m / settings.cell_size_m),
        )
        cells.append((row * truth.spec.cols + col)[kept])
        heights.append(h[kept].astype(np.float32))
        ids.append(sequence.segmentation(index).ids[kept])
        order.append(np.full(kept.sum(), -index))
    cells, heights, ids, order = map(np.concatenate, (cells, heights, ids, order))
    last = np.lexsort((-np.arange(len(ids)), order, heights))
    top = np.zeros(truth.spec.rows * truth.spec.cols, np.int32)
    top[cells[last]] = ids[last]  # later ones win: the highest, of equals the earlier frame and pixel
    return top.reshape(truth.spec.shape)


def test_the_two_seats_are_where_they_are(exact):
    truth = truth_map(exact)
    assert dict(truth.names) == {1: "chair", 2: "chair"} and truth.source == "drawn by the test"
    for number, (xmin, ymin, xmax, ymax) in SEATS_M.items():
        row, col = np.nonzero(truth.instance == number)
        assert len(row) == 16
        low, high = truth.spec.centre_of(row.min(), col.min()), truth.spec.centre_of(row.max(), col.max())
        assert low == pytest.approx((xmin + 0.025, ymin + 0.025)) and high == pytest.approx(
            (xmax - 0.025, ymax - 0.025)
        )
    assert set(np.unique(truth.instance)) == {0, 1, 2}  # the floor is stuff: a class, but no instance
    assert (truth.label == truth.labels.index("floor")).sum() > 100


@pytest.mark.parametrize(
    "settings",
    [ProjectionSettings(), ProjectionSettings(cell_size_m=0.11, cut_height_m=1.1), ProjectionSettings(far_m=3.0)],
)
def test_the_truth_is_that_of_the_plain_twin(small_cafe, settings):
    exact, _ = small_cafe
    truth = truth_map(exact, settings)
    top = plain_truth(exact, truth, settings)
    assert np.array_equal(np.where(np.isin(top, list(truth.names)), top, 0), truth.instance)
    assert len(np.unique(truth.instance)) > 10


def test_a_map_of_exact_masks_has_the_true_labels_and_window(small_cafe):
    exact, _ = small_cafe
    simap = build_map(exact, BuildConfig(projection=ProjectionSettings(cell_size_m=0.08)))
    truth = truth_of(simap, exact)
    assert settings_of(simap).cell_size_m == 0.08
    assert truth.spec == simap.spec and np.array_equal(truth.label, simap.grid.label)
    assert score(simap, truth).overall.label_accuracy == 1.0
    itself = score(truth_as_map(truth), truth)
    assert itself.overall.pq == itself.overall.ap50 == 1.0


def test_fewer_frames_show_less(exact):
    whole, one = truth_map(exact), truth_map(exact, frame_names=[frame_name(0)])
    assert one.grid.observations.max() == 1 and whole.grid.observations.max() == 4
    assert one.spec.cols < whole.spec.cols


def test_another_map_frame_moves_the_truth(exact):
    T = exact.T_map_world.copy()
    T[:2, 3] += (1.0, 2.0)
    truth, moved = truth_map(exact), truth_map(exact, T_map_world=T)
    assert (moved.spec.x0_m, moved.spec.y0_m) == pytest.approx((truth.spec.x0_m + 1.0, truth.spec.y0_m + 2.0))
    assert np.array_equal(moved.instance, truth.instance)


def test_the_truth_on_another_window_keeps_its_place(exact):
    truth = truth_map(exact)
    s = truth.spec
    window = GridSpec(s.rows + 5, s.cols - 3, s.cell_size_m, s.x0_m + 2 * s.cell_size_m, s.y0_m - 4 * s.cell_size_m)
    there = truth.on(window)
    assert there.spec == window and there.instance.shape == there.label.shape == window.shape
    assert np.array_equal(there.instance[4:-1], truth.instance[:, 2:-1])
    assert not there.instance[:4].any() and np.isnan(there.grid.height_m[:4]).all()
    assert whole_cells(s, joint_window(s, window)) == (4, 0)
    far = truth.on(GridSpec(4, 4, s.cell_size_m, s.x0_m + 100.0, s.y0_m))
    assert not far.instance.any()


def test_the_truth_is_found_beside_the_masks_of_a_network(tmp_path, small_cafe):
    exact, light = small_cafe
    assert find_truth(exact) is exact
    assert find_truth(light).path == exact.path
    assert find_truth(light, exact.path).path == exact.path
    with pytest.raises(InputError, match="exact ids"):
        find_truth(exact, light.path)
    alone = open_sequence(write_tiny_sequence(tmp_path / "alone"))
    with pytest.raises(InputError, match=r"--truth.*--counts"):
        find_truth(alone)
    with pytest.raises(InputError, match="expected the frames of"):
        find_truth(alone, exact.path)


def test_masks_that_are_no_truth_are_refused(tmp_path, small_cafe):
    with pytest.raises(InputError, match="expected exact ids"):
        truth_map(small_cafe[1])
    with pytest.raises(InputError, match="expected exact ids"):
        truth_map(WithSimulatedErrors(small_cafe[0], "light"))
    write_tiny_sequence(tmp_path)
    named = {"ids": "ids/{frame}.png", "segments": "segments.json", "source": "hand", "ground_truth": True}
    with pytest.raises(InputError, match="world-wide"):
        truth_map(open_sequence(write_manifest(tmp_path, truth="segments", changes={"segmentation": named})))


def test_errors_in_memory_are_those_written_to_disk(small_cafe):
    exact, light = small_cafe
    spoiled = WithSimulatedErrors(exact, "light", 0)
    told = []
    spoiled.prepare(lambda *step: told.append(step))
    assert [done for _, done, _ in told] == list(range(1, 7)) and "simulating" in told[0][0]
    assert (len(spoiled), spoiled.frame_names, spoiled.labels) == (len(light), light.frame_names, exact.labels)
    for index in range(len(light)):
        here, there = spoiled.segmentation(index), light.segmentation(index)
        assert np.array_equal(here.ids, there.ids) and here.segments == there.segments
        assert here.ids.dtype == np.int32
        assert np.array_equal(spoiled.read(index).depth_m, exact.read(index).depth_m)


def test_simulated_errors_say_so_and_depend_on_level_and_seed(small_cafe):
    exact, _ = small_cafe
    masks = {
        (level, seed): [WithSimulatedErrors(exact, level, seed).segmentation(i).ids for i in (0, 3)]
        for level, seed in (("light", 0), ("light", 1), ("heavy", 0))
    }
    assert all((masks["light", 0][0] != masks[other][0]).any() for other in (("light", 1), ("heavy", 0)))
    spoiled = WithSimulatedErrors(exact, "heavy", 3)
    assert spoiled.simulated and "simulated" in spoiled.name
    assert spoiled.segmentation_source == "simulated network errors, heavy, seed 3"
    assert build_map(spoiled).provenance["simulated"] is True


@pytest.mark.parametrize(("level", "seed", "message"), [("lite", 0, "error level"), ("light", -1, "seed")])
def test_errors_that_do_not_exist_are_refused(small_cafe, level, seed, message):
    with pytest.raises(InputError, match=message):
        WithSimulatedErrors(small_cafe[0], level, seed)


def test_errors_need_exact_ids_and_boxes(small_cafe, exact):
    with pytest.raises(InputError, match="exact world-wide ids"):
        WithSimulatedErrors(small_cafe[1], "light")
    with pytest.raises(InputError, match="aabb_min"):
        WithSimulatedErrors(exact, "light")


def test_an_id_with_two_classes_is_no_truth(tmp_path):
    class Confused:
        ground_truth = True

        def __init__(self, inner):
            self.inner = inner

        def __getattr__(self, name):
            return getattr(self.inner, name)

        def __len__(self):
            return len(self.inner)

    sequence = open_sequence(write_tiny_sequence(tmp_path / "frames", frames=2))
    table = json.loads((tmp_path / "frames" / "segments.json").read_text())
    table[frame_name(1)][0]["label"] = "table"
    shutil.copytree(tmp_path / "frames", tmp_path / "other")
    (tmp_path / "other" / "segments.json").write_text(json.dumps(table))
    for frame in (0, 1):  # the same ids in both frames
        image = cv2.imread(str(tmp_path / "other" / "ids" / f"{frame_name(0)}.png"), cv2.IMREAD_UNCHANGED)
        assert image is not None
        cv2.imwrite(str(tmp_path / "other" / "ids" / f"{frame_name(frame)}.png"), image)
    sequence = open_sequence(tmp_path / "other")
    with pytest.raises(InputError, match="one class for id"):
        truth_map(Confused(sequence))  # pyright: ignore[reportArgumentType]
