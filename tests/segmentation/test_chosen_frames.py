"""Frames that a network looks at: chosen by what they show; the others add geometry to the map and vote for nothing."""

from dataclasses import replace

import numpy as np
import pytest
from checked_sequences import drawn_room
from hypothesis import given, settings
from hypothesis import strategies as st
from sequences import write_tiny_sequence
from tiny_networks import CHAIR, OwnNetwork, write_yolo

from simaps_viz import BuildConfig, build_map, load_map, open_sequence
from simaps_viz.app.workbench import sequence_of
from simaps_viz.build.workers import reopening
from simaps_viz.cli.main import main
from simaps_viz.datasets.source import OtherMasks
from simaps_viz.errors import InputError
from simaps_viz.mapping.history import MapHistory
from simaps_viz.segmentation.chosen_frames import WORTH, choose_frames, choose_views, config_for
from simaps_viz.segmentation.sequences import segment_sequence

FRAMES = 6


@pytest.fixture
def sequence(tmp_path):
    return open_sequence(write_tiny_sequence(tmp_path / "tiny", frames=FRAMES))


class Partly(OtherMasks):
    """A sequence whose masks were made for some frames only."""

    def __init__(self, sequence, frames):
        super().__init__(sequence)
        self.frames, self.segmentation_source = set(frames), sequence.segmentation_source

    def segmentation(self, index):
        masks = self._sequence.segmentation(index)
        return masks if index in self.frames else replace(masks, ids=masks.ids * 0, segments=(), segmented=False)


def known(chosen, views, worth):
    """How much of all cells these frames make known."""
    shown = {}
    for i in chosen:
        for cell, well in zip(views[i], worth[i], strict=True):
            shown[cell] = shown.get(cell, 0.0) + well
    return sum(1.0 - np.exp(-so_well) for so_well in shown.values())


def slowly(views, worth, most):
    """What `choose_views` does, counting all frames anew for each choice."""
    chosen = []
    for _ in range(most):
        left = [i for i in range(len(views)) if i not in chosen and len(views[i])]
        if not left:
            break
        chosen.append(max(left, key=lambda i: (known([*chosen, i], views, worth), -i)))
    return sorted(chosen)


# which of two frames that add as much comes first depends on rounding, so what is compared is how much they add
@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.dictionaries(st.integers(0, 12), st.sampled_from(WORTH), max_size=6), min_size=1, max_size=7),
    st.integers(1, 5),
)
def test_frames_are_chosen_as_by_counting_all_anew(frames, most):
    views = [np.array(list(one), np.int32) for one in frames]
    worth = [np.array(list(one.values()), np.float32) for one in frames]
    chosen, expected = choose_views(views, worth, most), slowly(views, worth, most)
    assert len(chosen) == len(expected)
    assert known(chosen, views, worth) == pytest.approx(known(expected, views, worth), rel=1e-5)


def test_what_shows_nothing_is_not_chosen_and_ties_go_to_the_earlier():
    views = [np.arange(5), np.arange(5), np.arange(5, 8), np.zeros(0, np.int32)]
    assert choose_views(views, [np.ones(len(view), np.float32) for view in views], 2) == [0, 2]
    assert choose_views(views, [np.ones(len(view), np.float32) for view in views], 4) == [0, 1, 2]
    assert choose_views(views[:2], [np.full(5, WORTH[-1]), np.ones(5)], 1) == [1]  # that sees the tops themselves
    assert choose_views([], [], 3) == []


def test_where_fewer_frames_are_looked_at_a_belief_weighs_less():
    config = BuildConfig()
    assert config_for("1", config) == config
    assert config_for("4", config).pooling.imagined_pairs == config.pooling.imagined_pairs / 4
    assert config_for("auto", config).pooling.imagined_pairs == pytest.approx(0.3 * config.pooling.imagined_pairs)


def test_a_camera_that_stands_is_looked_at_less_than_one_that_walks(tmp_path):
    room = open_sequence(drawn_room(tmp_path / "room"))
    poses = room.poses.copy()
    half = len(poses) // 2
    poses[:half] = poses[0]

    class Standing(OtherMasks):
        segmentation_source = ""

        def segmentation(self, index):
            raise AssertionError(index)

        def read(self, index, *, color=False):
            return replace(room.read(0 if index < half else index), T_world_camera=poses[index])

    chosen = choose_frames(Standing(room), "auto")
    assert chosen is not None and len(chosen) == int(0.3 * len(poses))
    assert sum(index < half for index in chosen) < len(chosen) / 2


def test_every_nth_frame_can_be_asked_for(sequence):
    assert choose_frames(sequence, "1") is None
    assert choose_frames(sequence, "4") == [0, 4]
    for wrong in ("0", "-2", "often", "1.5", ""):
        with pytest.raises(InputError, match=r"--segment-every: expected auto or a whole number from 1, found '"):
            choose_frames(sequence, wrong)


def test_the_network_looks_at_the_chosen_frames_only(sequence, tmp_path):
    network, steps = OwnNetwork(), []
    masks = segment_sequence(
        sequence, network, tmp_path, stuff=False, frames=[1, 4], progress=lambda *step: steps.append(step)
    )
    assert network.runs == 2 and steps[-1] == ("segmenting, own", 2, 2)
    np.testing.assert_array_equal(masks.segmentation(4).ids, CHAIR)
    assert masks.segmentation(4).segmented
    other = masks.segmentation(0)
    assert not other.segmented and not other.segments and not other.ids.any() and other.ids.shape == CHAIR.shape
    assert masks.segmentation_source.startswith(f"own, 2 of {FRAMES} frames [")
    # other frames are other masks, and all of them others again
    assert len({segment_sequence(sequence, network, tmp_path, stuff=False, frames=f).segmentation_source
                for f in ([1, 4], [1, 3], None)}) == 3  # fmt: skip


@pytest.mark.parametrize("method", ["evidence", "paper", "components"])
def test_frames_nobody_looked_at_add_geometry_and_vote_for_nothing(sequence, method):
    config = BuildConfig(method=method)
    chosen = [0, 2, 3]
    partly = build_map(Partly(sequence, chosen), config)
    every, none = build_map(sequence, config), build_map(Partly(sequence, ()), config)
    assert none.counts() == {} and not none.grid.label.any()
    np.testing.assert_array_equal(none.grid.height_m, every.grid.height_m)
    np.testing.assert_array_equal(partly.grid.observations > 0, every.grid.observations > 0)
    assert len(partly.frame_names) == FRAMES and not set(partly.views.frame.tolist()) - set(chosen)

    class Only(Partly):
        """The chosen frames alone."""

        def __init__(self):
            super().__init__(sequence, range(FRAMES))
            self.frame_names = tuple(sequence.frame_names[i] for i in chosen)
            self.poses = sequence.poses[chosen]

        def read(self, index, *, color=False):
            return replace(sequence.read(chosen[index]), index=index)

        def segmentation(self, index):
            return sequence.segmentation(chosen[index])

    alone = build_map(Only(), config)
    assert partly.counts() == alone.counts()
    row = round((alone.spec.y0_m - partly.spec.y0_m) / 0.05)
    col = round((alone.spec.x0_m - partly.spec.x0_m) / 0.05)
    part = np.s_[row : row + alone.spec.rows, col : col + alone.spec.cols]
    looked_at = partly.grid.height_m[part] == alone.grid.height_m
    assert looked_at.mean() > 0.3
    np.testing.assert_array_equal(partly.grid.label[part][looked_at], alone.grid.label[looked_at])


def test_such_a_build_resumes_and_its_history_shows_the_same(sequence, tmp_path):
    partly = Partly(sequence, [0, 2, 5])
    expected = build_map(partly)
    build_map(partly, log=tmp_path / "log")
    same_maps_of(build_map(partly, log=tmp_path / "log", resume=True), expected)
    history = MapHistory.open(tmp_path / "log")
    same_maps_of(history.map_at(FRAMES - 1), expected)
    same_maps_of(history.map_at(3), build_map(First(partly, 4)))
    np.testing.assert_array_equal(history.look_at(FRAMES - 1).grid.label, expected.grid.label)


class First(OtherMasks):
    def __init__(self, sequence, count):
        super().__init__(sequence)
        self.segmentation, self.segmentation_source = sequence.segmentation, sequence.segmentation_source
        self.frame_names, self.poses = sequence.frame_names[:count], sequence.poses[:count]


def same_maps_of(found, expected):
    for layer in ("label", "height_m", "lowest_m", "observations"):
        np.testing.assert_array_equal(getattr(found.grid, layer), getattr(expected.grid, layer))
    np.testing.assert_array_equal(found.instance, expected.instance)


def test_the_command_line_builds_of_chosen_frames_and_opens_their_masks_again(tmp_path, monkeypatch, capsys):
    cache = tmp_path / "cache"
    monkeypatch.setenv("SIMAPS_CACHE", str(cache))
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    net = write_yolo(tmp_path / "n.onnx", [(2.0, 6.0, 12.0, 18.0, 0, 0.9)])
    command = ["build", str(tmp_path / "tiny"), "--segmentation", str(net), "--providers", "cpu"]
    assert main([*command, "--segment-every", "auto", "-o", str(tmp_path / "auto.npz")]) == 0
    simap = load_map(tmp_path / "auto.npz")
    assert f", 1 of {FRAMES} frames [" in simap.provenance["segmentation"] and "chair" in simap.counts()
    assert simap.parameters["pooling"]["imagined_pairs"] == pytest.approx(0.9)
    masks = sequence_of(simap)
    assert masks is not None and sum(masks.segmentation(i).segmented for i in range(FRAMES)) == 1
    again = reopening(masks, cache)()
    assert [again.segmentation(i).segmented for i in range(FRAMES)] == [
        masks.segmentation(i).segmented for i in range(FRAMES)
    ]
    assert main([*command, "--segment-every", "3", "-o", str(tmp_path / "third.npz"), "--method", "vlmaps"]) == 0
    capsys.readouterr()
    wrongs = (
        (["--segment-every", "some"], "expected auto or a whole number from 1"),
        (["--segment-every", "auto", "--segmentation", "precomputed"], "NETWORK.onnx with it"),
    )
    for wrong, words in wrongs:
        assert main([*command, *wrong, "-o", str(tmp_path / "no.npz")]) == 2
        assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "no.npz").exists()
