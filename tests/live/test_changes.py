"""Maps that stay true: what was moved disappears from where it was, is reported as moved, and nothing else is."""

import json
import threading
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from benchmarks.two_drives import Drives, cafe_chair, drive
from sequences import SEATS_M, write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.cli.main import main
from simaps_viz.drawing.legend import facts_html
from simaps_viz.live import forgetting
from simaps_viz.live.forgetting import CLEAR, FRAMES, THERE, UNKNOWN, count_clear, see_through
from simaps_viz.live.run import GrowingMap, LiveRequest, LiveRun
from simaps_viz.live.source import PlayedSequence, Shot
from simaps_viz.mapping.changes import Change, as_json, changes_in
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.tiles import AREA, SIDE

FRAMES_OF_A_DRIVE = 90
CHAIR, BY_M = "west chair 1", (1.7, -1.1)


def run_of(tmp_path, *drives):
    run = LiveRun(LiveRequest(Drives(*drives), BuildConfig(), tmp_path / "m.npz"))
    return run.run((), threading.Event()), run


@cache
def map_of_a_drive(without=()):
    """The map of one drive and its run, which several tests begin with."""
    with TemporaryDirectory() as folder:
        return run_of(Path(folder), drive(FRAMES_OF_A_DRIVE, without=without))


@pytest.mark.slow
def test_a_chair_moved_between_two_drives_is_reported_as_moved_and_nothing_else(tmp_path, capsys):
    before, after = drive(FRAMES_OF_A_DRIVE), drive(FRAMES_OF_A_DRIVE, moves=((CHAIR, BY_M),))
    simap, run = run_of(tmp_path, before, after)
    (change,) = changes_in(simap)
    here = cafe_chair(CHAIR).bounds_m.mean(axis=0)[:2]
    assert (change.kind, change.label) == ("moved", "chair")
    assert change.at_m is not None and change.from_m is not None and change.id is not None
    assert np.linalg.norm(np.subtract(change.from_m, here)) < 0.15
    assert np.linalg.norm(np.subtract(change.at_m, here + BY_M)) < 0.15
    # It stands there and nowhere else, and the map is one of what is there now.
    assert simap.counts()["chair"] == map_of_a_drive()[0].counts()["chair"]
    assert simap.by_id(change.id).label == "chair" and simap.at(*here) is None
    assert f"moved by {np.hypot(*BY_M):.1f} m" in facts_html(simap, simap.by_id(change.id))
    assert "1 moved" in run.words()
    save_map(simap, tmp_path / "m.npz")
    assert changes_in(load_map(tmp_path / "m.npz")) == (change,)
    assert main(["info", str(tmp_path / "m.npz"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["changes"] == as_json((change,))


@pytest.mark.slow
def test_frames_whose_pose_is_wrong_for_a_moment_are_left_out_and_counted(tmp_path, monkeypatch):
    """A metre off for 4 frames of 30, as after a relocalisation that is taken back."""
    right = drive(FRAMES_OF_A_DRIVE)
    away = np.eye(4)
    away[:2, 3] = 0.8, -0.6
    off = [i for i in range(40, len(right)) if i % 30 < 4]
    wrong = [replace(one, frame=replace(one.frame, T_world_camera=away @ one.frame.T_world_camera)) for one in right]
    glitchy = tuple(wrong[i] if i in off else one for i, one in enumerate(right))
    clean, run = map_of_a_drive()
    assert not run.traffic.dropped
    simap, run = run_of(tmp_path, glitchy)
    assert run.traffic.dropped == {"contradicts the map": len(off)}
    assert simap.counts() == clean.counts() and "dropped (contradicts the map)" in run.words()
    monkeypatch.setattr("simaps_viz.live.run.PATIENCE", 0)
    simap, run = run_of(tmp_path, glitchy)
    assert not run.traffic.dropped and simap.counts() != clean.counts()


@pytest.mark.slow
def test_frames_that_contradict_the_map_for_long_are_believed(tmp_path, monkeypatch):
    monkeypatch.setattr("simaps_viz.live.run.PATIENCE", 3)
    here, away = drive(FRAMES_OF_A_DRIVE), np.eye(4)
    away[:2, 3] = 0.8, -0.6
    there = [replace(one, frame=replace(one.frame, T_world_camera=away @ one.frame.T_world_camera)) for one in here]
    run = run_of(tmp_path, here[:40], there[20:60])[1]
    assert 3 <= run.growing.contradicting < 15 and run.traffic.placed == 80 - run.growing.contradicting


ELSEWHERE = np.array([[-0.8, -0.6, 0, 9.0], [0.6, -0.8, 0, 4.0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
"""Where the robot's world lies when it is started the next day."""


def on_another_day(tmp_path, shots, earlier):
    """Let a map grow in another world, with an earlier map at hand."""
    source = Drives(shots, T_map_world=ELSEWHERE)
    run = LiveRun(LiveRequest(source, BuildConfig(), tmp_path / "next.npz", earlier=earlier))
    return run.run((), threading.Event()), run


@pytest.mark.slow
def test_an_earlier_map_is_gone_on_with_in_its_own_frame_and_the_changes_are_named(tmp_path):
    earlier, _ = map_of_a_drive()
    after = drive(FRAMES_OF_A_DRIVE, moves=((CHAIR, BY_M),))
    simap, run = on_another_day(tmp_path, after, earlier)
    assert run.growing.is_placed and run.words().count("on the earlier map") == 1
    off = simap.T_map_world  # both drives have one world, which is the earlier map's frame
    assert np.linalg.norm(off[:2, 3]) < 0.05 and abs(off[1, 0]) < np.deg2rad(0.5)
    (change,) = changes_in(simap)
    here = cafe_chair(CHAIR).bounds_m.mean(axis=0)[:2]
    assert (change.kind, change.label) == ("moved", "chair") and change.at_m is not None
    assert np.linalg.norm(np.subtract(change.at_m, here + BY_M)) < 0.15
    assert simap.counts()["chair"] == earlier.counts()["chair"] and simap.at(*here) is None


@pytest.mark.slow
def test_a_chair_that_was_brought_is_new_and_one_that_was_taken_away_is_gone(tmp_path):
    here = cafe_chair(CHAIR).bounds_m.mean(axis=0)[:2]
    for before, after, kind in (((CHAIR,), (), "new"), ((), (CHAIR,), "gone")):
        shots = drive(FRAMES_OF_A_DRIVE, without=after)
        (change,) = changes_in(on_another_day(tmp_path, shots, map_of_a_drive(before)[0])[0])
        assert (change.kind, change.label) == (kind, "chair")
        assert np.linalg.norm(np.subtract(change.at_m or change.from_m or (0.0, 0.0), here)) < 0.15


@pytest.mark.slow
def test_a_map_of_another_place_is_not_gone_on_with(tmp_path):
    shots = drive(FRAMES_OF_A_DRIVE)
    own, _ = map_of_a_drive()
    flipped = {
        name: np.ascontiguousarray(getattr(own.grid, name)[:, ::-1]) for name in ("label", "height_m", "lowest_m")
    }
    mirror = replace(own, grid=replace(own.grid, **flipped, observations=own.grid.observations[:, ::-1].copy()))
    simap, run = on_another_day(tmp_path, shots, mirror)
    assert not run.growing.is_placed and "not found on the earlier map" in run.words()
    assert simap.provenance["live"]["earlier"]["found"] is False and simap.frame_names == own.frame_names
    assert np.array_equal(simap.T_map_world, ELSEWHERE) and changes_in(simap) == ()


@pytest.mark.slow
def test_a_place_in_which_nothing_moves_forgets_nothing(tmp_path):
    shots = drive(FRAMES_OF_A_DRIVE)
    simap, run = run_of(tmp_path, shots, shots)
    assert not run.growing._forgetting and changes_in(simap) == () and "changes" not in simap.provenance


def tiny_shots(tiny, *, without=()):
    """The tiny frames, without some of the seats: the camera sees the floor there."""
    for i in range(len(tiny)):
        frame, masks = tiny.read(i), tiny.segmentation(i)
        gone = np.zeros(masks.ids.shape, bool)
        for seat in without:
            x0, _, x1, _ = SEATS_M[seat]
            middle = frame.T_world_camera[0, 3] + (np.arange(frame.depth_m.shape[1]) - 15.5) / 40.0
            gone |= (frame.depth_m == 1.0) & (middle > x0)[None] & (middle < x1)[None]
        floor = next(one.id for one in masks.segments if one.label == "floor")
        depth_m = np.where(gone, np.float32(2.0), frame.depth_m)
        yield Shot(replace(frame, depth_m=depth_m), replace(masks, ids=np.where(gone, floor, masks.ids)), i)


def test_a_seat_that_is_taken_away_disappears_and_the_other_one_stays_as_it_was(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=30)
    tiny = open_sequence(tmp_path / "tiny")
    one = GrowingMap(PlayedSequence(tiny), BuildConfig())
    for shot in tiny_shots(tiny):
        one.add(shot)
    whole = one.map_so_far()
    assert whole.counts() == {"chair": 2} and changes_in(whole) == ()
    for shot in tiny_shots(tiny, without=(1,)):
        one.add(shot)
    simap = one.map_so_far()
    (change,) = changes_in(simap)
    assert (change.kind, change.label, change.id) == ("gone", "chair", None)
    assert change.from_m == pytest.approx((-0.2, 0.0), abs=0.01) and change.frame in whole.frame_names[-2:]
    left = (whole.instance > 0) & (whole.instance == whole.instance[simap.spec.cell_of(0.2, 0.0)])
    assert simap.counts() == {"chair": 1} and np.array_equal(simap.instance > 0, left)
    seat = (whole.instance > 0) & ~left
    assert np.isnan(simap.grid.lowest_m[seat]).all() and (simap.grid.height_m[seat] == 0.0).all()
    # It comes back, and is no news for a map that knows no earlier one.
    for shot in tiny_shots(tiny):
        one.add(shot)
    assert one.map_so_far().counts() == {"chair": 2}


def test_the_command_refuses_maps_it_cannot_go_on_with_and_says_when_the_place_is_not_found(tmp_path, capsys):
    write_tiny_sequence(tmp_path / "tiny", frames=4)
    old, output = tmp_path / "old.npz", tmp_path / "m.npz"
    save_map(build_map(open_sequence(tmp_path / "tiny")), old)
    command = ["live", str(tmp_path / "tiny"), "-o", str(output), "--map", str(old), "--pace", "fast", "--json"]
    assert main(command) == 0  # two square metres of floor are no place
    record = json.loads(capsys.readouterr().out)
    assert record["earlier"] == {"name": "tiny", "found": False, "agreement": None} and record["changes"] == []
    assert main([*command, "--cell-size", "0.1"]) == 2
    assert "old.npz: expected cells of 0.1 m, as the new map has, found 0.05 m" in capsys.readouterr().err


def test_changes_that_make_no_sense_are_left_out(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=3)
    simap = build_map(open_sequence(tmp_path / "tiny"))
    chair = simap.instances[0]
    fine = Change("moved", "chair", "0010", (0.0, 1.0), (2.0, 1.0), chair.id)
    amiss = [
        None, 7, {}, {"kind": "moved"}, {"kind": "stolen", "label": "chair", "frame": "a"},
        {"kind": "gone", "label": 3, "frame": "a"}, {"kind": "gone", "label": "chair", "frame": "a", "from_m": [1]},
        {"kind": "gone", "label": "chair", "frame": "a", "from_m": [1, "nan"]},
        {"kind": "gone", "label": "chair", "frame": "a", "from_m": [10**400, 1]},
        {"kind": "new", "label": "cat", "frame": "a", "id": chair.id},
    ]  # fmt: skip
    for entries in (amiss + as_json((fine,)), as_json((fine,))):
        assert changes_in(replace(simap, provenance={"changes": entries})) == (fine,)
    assert changes_in(replace(simap, provenance={"changes": "all"})) == ()


def looked_at(depth, fx, fy, cx, cy, T, near, far, size, x, y, h):
    """Plain twin of the kernel's look at one place."""
    p = T[:3, :3] @ (x, y, h) + T[:3, 3]
    if not near < p[2] < forgetting.REACH_M:
        return UNKNOWN
    u, v = fx * p[0] / p[2] + cx, fy * p[1] / p[2] + cy
    rows, cols = depth.shape
    if not (0 <= u < cols - 0.5 and 0 <= v < rows - 0.5):
        return UNKNOWN
    slack = max(forgetting.SLACK_M, forgetting.SLACK_SHARE * p[2])
    middle = depth[round(np.floor(v + 0.5)), round(np.floor(u + 0.5))]
    if not near < middle < far or middle < p[2] - slack:
        return UNKNOWN
    if middle <= p[2] + slack:
        return THERE
    tilt = abs(T[2, 0]) + abs(T[2, 1])
    du = size / 2 / p[2] * (fx * (abs(T[0, 0]) + abs(T[0, 1])) + abs(u - cx) * tilt) + 1
    dv = size / 2 / p[2] * (fy * (abs(T[1, 0]) + abs(T[1, 1])) + abs(v - cy) * tilt) + 1
    if u - du < 0 or v - dv < 0 or u + du + 1 >= cols or v + dv + 1 >= rows:
        return UNKNOWN
    u0, u1, v0, v1 = int(u - du), int(u + du + 1), int(v - dv), int(v + dv + 1)
    around = depth[v0 : v1 + 1 : max((v1 - v0) // 6, 1), u0 : u1 + 1 : max((u1 - u0) // 6, 1)]
    known = (around > near) & (around < far)
    if (around[known] <= p[2] + slack).any() or 2 * known.sum() < known.size:
        return UNKNOWN
    return CLEAR


def test_the_kernel_sees_through_what_its_plain_twin_does():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(6):
        T_map_camera = np.eye(4)
        turn = np.linalg.qr(rng.normal(size=(3, 3)) * 0.3 + np.diag([1.0, -1.0, -1.0]))[0]
        T_map_camera[:3, :3] = turn * np.sign(np.linalg.det(turn))
        T_map_camera[:3, 3] = 1.6, 1.6, 2.2
        if T_map_camera[2, 2] > 0:
            T_map_camera[:3, 1:3] *= -1
        T = np.linalg.inv(T_map_camera)
        depth = rng.choice(np.array([0.0, 1.2, 1.9, 3.0, 3.0, 3.0, 7.0], np.float32), (12, 16))
        depth = np.repeat(np.repeat(depth, 8, axis=0), 8, axis=1)
        top = rng.choice(np.array([-np.inf, 0.05, 0.3, 0.9, 1.2], np.float32), AREA)
        count = rng.integers(0, FRAMES + 2, AREA).astype(np.uint8)
        expected, seen = count.copy(), np.zeros((1, AREA), np.uint8)
        slots = np.zeros((1, 1), np.int32)
        how = (depth, 100.0, 100.0, 63.5, 47.5, T, 0.1, 6.0, 0.05)
        for at in np.flatnonzero(top >= 0.1).tolist():
            x, y, h = (at % SIDE + 0.5) * 0.05, (at // SIDE + 0.5) * 0.05, float(top[at])
            one = looked_at(*how, x, y, h)
            one = looked_at(*how, x, y, max(h - 0.15, 0.1)) if one == CLEAR else one
            expected[at] = {UNKNOWN: expected[at], THERE: 0, CLEAR: expected[at] + 1}[one]
            found.append(one)
            seen[0, at] = one
        looked = np.zeros((1, AREA), np.uint8)
        assert see_through(*how, 0.1, 0, 0, slots, top, looked) == ((seen == THERE).sum(), (seen == CLEAR).sum())
        assert np.array_equal(looked, seen)
        assert count_clear(slots, looked, count) == (expected[seen[0] == CLEAR] >= FRAMES).any()
        assert np.array_equal(count, expected)
    assert min(np.bincount(found, minlength=3)) > 50
