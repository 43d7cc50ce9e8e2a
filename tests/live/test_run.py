"""Maps that grow from a source: the same as a build's, cut to what came in time, and placed again when poses change."""

import json
import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from checked_sequences import drawn_room
from fake_page import fake_page
from sequences import CELL_M, lying, write_tiny_sequence
from tiny_networks import TopNetwork
from waiting import until

from simaps_viz import open_sequence
from simaps_viz.app.live import run_source, source_workbench
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.live.run import GrowingMap, LiveRequest, LiveRun, warm_up
from simaps_viz.live.source import Correction, PlayedSequence, Shot, Traffic, times_of
from simaps_viz.mapping.file import load_map

FRAMES = 9


def layers(simap):
    grid = simap.grid
    return grid.spec, grid.label, grid.height_m, grid.lowest_m, grid.observations, simap.instance, simap.views.cells


def same(one, other, *, but=()):
    for i, (a, b) in enumerate(zip(layers(one), layers(other), strict=True)):
        assert i in but or (a == b if i == 0 else np.array_equal(a, b, equal_nan=a.dtype.kind == "f")), i


@pytest.fixture
def tiny(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return open_sequence(tmp_path / "tiny")


def live(source, tmp_path, config=None, **how):
    run = LiveRun(LiveRequest(source, config or BuildConfig(), tmp_path / "live.npz", **how))
    return run.run((), threading.Event()), run


@pytest.mark.parametrize("method", ["evidence", "components"])
def test_a_sequence_played_to_its_end_makes_the_map_of_its_build(tiny, tmp_path, method):
    config = BuildConfig(method=method)
    simap, run = live(PlayedSequence(tiny, at_pace=False), tmp_path, config)
    same(simap, build_map(tiny, config))
    same(load_map(tmp_path / "live.npz"), simap)
    assert run.traffic.placed == run.traffic.named == FRAMES and simap.instances


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_camera_that_lies_on_its_side_makes_the_map_of_one_that_stands_upright(tmp_path, turns):
    room, network = open_sequence(drawn_room(tmp_path / "room", frames=3)), TopNetwork()
    upright, lain = (
        live(PlayedSequence(one, at_pace=False, network=network), tmp_path, network=network, every_frame=True)[0]
        for one in (room, lying(room, turns))
    )
    assert "lamp" in {upright.grid.labels[k] for k in np.unique(upright.grid.label)}
    assert (lain.grid.label != upright.grid.label).mean() < 0.003  # of pixels equally high, another one is the first


def test_frames_that_are_late_show_what_is_free_and_name_nothing(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr("simaps_viz.live.source.LATE_S", -1.0)
    simap, run = live(PlayedSequence(tiny), tmp_path)
    built = build_map(tiny)
    same(simap, built, but=(1, 3, 5, 6))
    assert (np.isnan(built.grid.lowest_m) | ~np.isnan(simap.grid.lowest_m)).all()  # what stands there, stands there
    assert not simap.instances and not simap.grid.label.any() and run.traffic.named == 0
    assert "9 without masks" in run.words()


def test_a_place_that_was_seen_often_takes_no_more_frames_but_their_geometry(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr("simaps_viz.live.run.FRAMES_A_PLACE", 4)
    simap, run = live(PlayedSequence(tiny, at_pace=False), tmp_path)
    assert len(simap.frame_names) == run.growing.frames == 4 < run.traffic.placed
    same(simap, build_map(tiny), but=(6,))


def test_once_something_was_forgotten_the_newest_frames_are_kept_beside_the_first_ones(tiny, monkeypatch):
    monkeypatch.setattr("simaps_viz.live.run.FRAMES_A_PLACE", 4)
    one = GrowingMap(PlayedSequence(tiny), BuildConfig())
    put = lambda: [event.kept for shot in shots(tiny) for event in one.add(shot)]  # noqa: E731
    assert put() == [True] * 4 + [False] * 5 and put() == [False] * 9 and one.frames == 4
    sizes, names = [], []
    for _ in range(6):
        one._taken.clear()  # as when something was forgotten
        assert put() == [True] * 4 + [False] * 5
        assert one.frames == len(one._kept) == 8
        assert one.place_again(Correction(0, 0, lambda stamps: np.repeat(np.eye(4)[None], len(stamps), axis=0))) == 8
        [one.stored.result() for one in one._kept.values()]
        sizes.append(one._scratch._file.size)
        names.append(tuple(one._map.frames.indices))
    assert max(sizes) < 2 * sizes[0]  # what was put aside before is written over
    assert names == [(0, 1, 2, 3, *range(4 * i + 4, 4 * i + 8)) for i in range(6)]
    same(one.map_so_far(), build_map(tiny), but=(2, 3, 4, 6))


def test_frames_that_are_not_kept_show_the_map_too(tiny, monkeypatch):
    monkeypatch.setattr("simaps_viz.live.run.FRAMES_A_PLACE", 4)
    one = GrowingMap(PlayedSequence(tiny), BuildConfig())
    *_, last = [event for shot in shots(tiny) for event in one.add(shot)]
    assert not last.kept and last.map_so_far is not None
    until(last.map_so_far)
    simap = last.map_so_far()
    assert simap is not None and simap.instances


def test_reasons_why_frames_are_dropped_stay_few():
    traffic = Traffic()
    for i in range(1000):
        traffic.drop(f"malformed, number {i}")
    assert len(traffic.dropped) <= 21 and sum(traffic.dropped.values()) == 1000


def test_sequences_without_times_are_played_at_30_hz_and_others_at_their_own():
    assert times_of(("0010", "0011", "0012")).tolist() == [0.0, 1 / 30, 2 / 30]
    assert times_of(("1305031102.175", "1305031102.225", "1305031102.5")) == pytest.approx([0.0, 0.05, 0.325])


TURNED = np.array([[0.0, -1, 0, 7 * CELL_M], [1, 0, 0, -3 * CELL_M], [0, 0, 1, 0], [0, 0, 0, 1]])
"""A quarter turn, and whole cells: cells fall on cells."""


def shots(tiny, correction=None):
    for i in range(len(tiny)):
        frame = tiny.read(i)
        yield Shot(frame, tiny.segmentation(i), i, T_odom_camera=frame.T_world_camera)


def test_frames_placed_again_make_the_map_of_their_new_poses(tiny):
    moved, there = GrowingMap(PlayedSequence(tiny), BuildConfig()), GrowingMap(PlayedSequence(tiny), BuildConfig())
    there.T_map_world = there.T_map_world @ TURNED
    for shot in shots(tiny):
        moved.add(shot)
        there.add(shot)
    assert moved.place_again(Correction(0, 0, lambda stamps: np.repeat(TURNED[None], len(stamps), axis=0))) == FRAMES
    found, expected = moved.map_so_far(), there.map_so_far()
    same(found, expected, but=(2, 3))  # depth is put aside in steps of a tenth of a millimetre
    for layer in ("height_m", "lowest_m"):
        one, other = getattr(found.grid, layer), getattr(expected.grid, layer)
        assert np.allclose(one, other, atol=1e-4, equal_nan=True)
    assert np.allclose(found.T_map_camera, expected.T_map_camera)


def test_only_frames_since_the_correction_move(tiny):
    one = GrowingMap(PlayedSequence(tiny), BuildConfig())
    for shot in shots(tiny):
        one.add(shot)
    before = one.map_so_far().T_map_camera
    assert one.place_again(Correction(6, 0, lambda stamps: np.repeat(TURNED[None], len(stamps), axis=0))) == 3
    after = one.map_so_far().T_map_camera
    assert np.array_equal(after[:6], before[:6]) and np.allclose(after[6:], TURNED @ before[6:])


def test_maps_to_look_at_are_made_beside_the_frames_and_become_newer(tiny, monkeypatch):
    monkeypatch.setattr("simaps_viz.live.run.SHARE", 1.0)
    one = GrowingMap(PlayedSequence(tiny), BuildConfig())
    events = [event for shot in shots(tiny) for event in one.add(shot)]
    newest = events[-1].map_so_far
    assert newest is not None
    assert newest() is None  # nothing waits for the first
    until(newest)
    first = newest()
    assert first is not None and len(first.frame_names) == FRAMES
    until(lambda: newest() is not first)
    same(newest(), build_map(tiny))


class Silent(PlayedSequence):
    """A source that never sends anything more after its first frames."""

    def __init__(self, sequence, frames):
        super().__init__(sequence, at_pace=False)
        self.left = frames

    def take(self, timeout_s):
        self.left -= 1
        return super().take(timeout_s) if self.left >= 0 else None


def test_a_frame_that_takes_longer_than_silence_may_last_ends_nothing(tiny, tmp_path, monkeypatch):
    put, clock = LiveRun._put, [0.0]

    def slow(run, *shot):
        clock[0] += 10.0
        put(run, *shot)

    monkeypatch.setattr(LiveRun, "_put", slow)
    monkeypatch.setattr("simaps_viz.live.run.time", SimpleNamespace(monotonic=lambda: clock[0]))
    simap, _ = live(Silent(tiny, 4), tmp_path, idle_stop_s=5.0)
    assert len(simap.frame_names) == 4


def test_a_silent_source_ends_after_the_time_asked_for_and_one_without_frames_makes_no_map(tiny, tmp_path):
    simap, _ = live(Silent(tiny, 4), tmp_path, idle_stop_s=0.1)
    assert len(simap.frame_names) == 4
    (tmp_path / "live.npz").unlink()
    with pytest.raises(InputError, match="expected frames, found none"):
        run_source(LiveRequest(Silent(tiny, 0), BuildConfig(), tmp_path / "live.npz", idle_stop_s=0.1))
    assert not (tmp_path / "live.npz").exists()


def test_the_page_grows_and_ending_it_there_saves_the_map(tiny, tmp_path):
    request = LiveRequest(Silent(tiny, 5), BuildConfig(), tmp_path / "live.npz")
    with source_workbench(request) as (bench, build, _), fake_page(bench) as page:
        assert page.session.panels.titles[0] == "Progress"
        build.start()
        until(lambda: build.state().done == 5)
        build.stop()
        assert build.wait(60.0) and build.state().status == "done" and "5 frames" not in build.state().error
        assert bench.wait_idle() and len(page.session.simap.frame_names) == 5
        assert "Mend" in page.session.panels.titles
    assert len(load_map(tmp_path / "live.npz").frame_names) == 5


def test_the_command(tiny, tmp_path, capsys):
    output = tmp_path / "m.npz"
    assert main(["live", str(tiny.path), "-o", str(output), "--pace", "fast", "--json"]) == 0
    printed = capsys.readouterr()
    record = json.loads(printed.out)
    assert not printed.err
    assert record["shots"] == record["with_masks"] == FRAMES and record["counts"] == {"chair": 2}
    assert load_map(output).appearance is not None
    assert main(["live", str(tiny.path)]) == 2
    assert main(["live", "nobody://robot", "-o", str(output)]) == 2
    for method in ("paper", "vlmaps"):
        assert main(["live", str(tiny.path), "-o", str(output), "--method", method]) == 2


def test_what_is_compiled_beforehand_votes_and_looks_below_tops():
    """Else it would be compiled, for most of a minute, while the first frames wait."""
    config = BuildConfig()
    simap = warm_up(config)
    assert simap.provenance["disagreement"] >= config.votes.exact_below
    assert simap.surface is not None and "cup" in {one.label for one in (*simap.instances, *simap.hidden)}


def test_a_pose_that_is_far_off_costs_one_frame_also_while_the_floor_is_looked_for(tiny):
    source = PlayedSequence(tiny, at_pace=False)
    source.T_map_world = None
    growing = GrowingMap(source, BuildConfig())
    shots = [shot for _ in range(5) if (shot := source.take(0.0)) is not None]
    lost = shots[2].frame.T_world_camera.copy()
    lost[0, 3] = 1e30
    shots[2] = replace(shots[2], frame=replace(shots[2].frame, T_world_camera=lost))
    events = [event for shot in shots for event in growing.add(shot)]
    assert len(events) == growing.frames == 4 and growing.contradicting == 1
