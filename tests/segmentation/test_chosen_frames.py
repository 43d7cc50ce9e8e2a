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
from simaps_viz.segmentation.chosen_frames import OFTEN, choose_frames, choose_views
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


def slowly(views, most):
    """What `choose_views` does, counting all frames anew for each choice."""
    seen, chosen = {}, []
    for _ in range(most):
        worth = {
            i: sum(1 / (seen.get(v, 0) + 1) for v in view if seen.get(v, 0) < OFTEN)
            for i, view in enumerate(views) if i not in chosen
        }  # fmt: skip
        best = max(worth, key=lambda i: (worth[i], -i), default=None)
        if best is None or worth[best] == 0:
            break
        chosen.append(best)
        for view in views[best]:
            seen[view] = seen.get(view, 0) + 1
    return sorted(chosen)


# which of two frames that add as much comes first depends on rounding, so what is compared is how much they add
@settings(max_examples=60, deadline=None)
@given(st.lists(st.sets(st.integers(0, 12), max_size=6), min_size=1, max_size=7), st.integers(1, 5))
def test_frames_are_chosen_as_by_counting_all_anew(sets, most):
    views = [np.array(sorted(one), np.int64) * 10**12 for one in sets]
    chosen, expected = choose_views(views, most), slowly([view.tolist() for view in views], most)
    assert len(chosen) == len(expected)
    value = [
        sum(1 / n for v in range(13) for n in range(1, 1 + sum(v in sets[i] for i in c))) for c in (chosen, expected)
    ]
    assert value[0] == pytest.approx(value[1])


def test_what_shows_nothing_new_is_not_chosen_and_ties_go_to_the_earlier():
    one, other = np.arange(5), np.arange(5, 8)
    assert choose_views([one, one, other, np.zeros(0, np.int64)], 2) == [0, 2]
    assert choose_views([one] * 20, 20) == list(range(OFTEN))
    assert choose_views([], 3) == []


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
