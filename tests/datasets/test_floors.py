"""Floors of a recording: found where there are several, and nowhere else."""

import numpy as np
import pytest
from two_storeys import CAMERA_M, HEAD_M, STOREY_M, Cast, house, poses

from simaps_viz.datasets.floors import find_floors, find_stairs, floor_of_cameras, indices_of, split_floors
from simaps_viz.datasets.source import JoinedFrames
from simaps_viz.errors import InputError
from simaps_viz.scenes.building import slab
from simaps_viz.scenes.materials import OAK, WALNUT, WHITE
from simaps_viz.scenes.scene import assemble, build
from simaps_viz.scenes.shapes import box
from simaps_viz.scenes.walk import camera_pose

pytestmark = pytest.mark.slow  # walks through a house of two storeys are cast

PITCH = np.deg2rad(28.0)


def looks(points, *, turns=6):
    """Return poses that look around at each point (x, y, z)."""
    return np.stack([camera_pose(np.array(p), yaw, PITCH) for p in points for yaw in np.linspace(0, 2 * np.pi, turns)])


def room(*more, wide=8.0, deep=6.0):
    return assemble([build("floor", "floor", slab(0, 0, wide, deep, OAK, top=0.0)), *more])


@pytest.fixture(scope="module")
def walked():
    return Cast(house(), poses(back=True))


def test_two_storeys_are_found_with_their_stairs(walked):
    floors = find_floors(walked)
    assert floors == pytest.approx((0.0, STOREY_M), abs=0.01) and floors[0] == 0.0
    # The stairs were used twice, up and down, and are one.
    ((lower, foot, head),) = find_stairs(walked, floors)
    assert lower == 0
    # Clear of the steps, which begin at x = 2 and end at x = 6, and not far from them.
    assert 1.3 < foot[0] < 2.0 and 6.0 < head[0] < 6.8
    assert [foot[1], head[1]] == pytest.approx([1.0, HEAD_M[1]], abs=0.2)


def test_each_frame_is_of_one_floor_and_its_map_frame_has_that_floor_at_zero(walked):
    below, above = split_floors(walked, (0.0, STOREY_M))
    assert sorted(below.indices + above.indices) == list(range(len(walked)))
    assert below.frame_names + above.frame_names != walked.frame_names  # below is visited twice
    assert np.array_equal(below.T_map_world, walked.T_map_world)
    heights = [(part.T_map_world @ part.poses)[:, 2, 3] for part in (below, above)]
    assert heights[0].max() < STOREY_M + 0.1 <= heights[1].min() + STOREY_M
    assert np.median(heights[1]) == pytest.approx(CAMERA_M, abs=0.01)
    frame = above.read(3)
    assert (frame.index, frame.name) == (3, above.frame_names[3])
    assert np.array_equal(frame.T_world_camera, above.poses[3])
    assert indices_of(above.frame_names, walked) == list(above.indices)
    assert indices_of(walked.frame_names, walked) is None and indices_of(walked.frame_names[:7], walked) is None
    assert indices_of(("elsewhere",), walked) is None


@pytest.mark.parametrize("sway_m", [0.1, 0.2])
def test_a_hand_that_goes_up_and_down_moves_neither_floors_nor_stairs(sway_m):
    swayed = Cast(house(), poses(sway_m=sway_m))
    floors = find_floors(swayed)
    assert floors == pytest.approx((0.0, STOREY_M), abs=0.01)
    ((_, foot, head),) = find_stairs(swayed, floors)
    assert 0.8 < foot[0] < 2.3 and 5.7 < head[0] < 7.2


def test_backwards_the_floors_and_stairs_are_the_same():
    there, back = Cast(house(), poses()), Cast(house(), poses()[::-1])
    floors = find_floors(there)
    assert find_floors(back) == pytest.approx(floors, abs=0.002)
    (one,), (other,) = find_stairs(there, floors), find_stairs(back, floors)
    assert np.array_equal(one[1], other[1]) and np.array_equal(one[2], other[2])


def test_who_turns_back_on_the_stairs_or_never_climbs_them_has_shown_none():
    cameras = poses()
    heights = cameras[:, 2, 3]
    on_stairs = np.flatnonzero((heights > STOREY_M + 0.2) & (heights < STOREY_M + 0.8))
    assert len(on_stairs)
    start = int(np.flatnonzero(heights > CAMERA_M + 0.01)[0])
    up = cameras[: on_stairs[-1] + 1]
    above = cameras[np.flatnonzero(heights > STOREY_M + CAMERA_M - 0.01)[4] :]
    turned_back = Cast(house(), np.concatenate([above, up, up[start - 6 :][::-1]]))
    assert find_floors(turned_back) == pytest.approx((0.0, STOREY_M), abs=0.01)
    assert find_stairs(turned_back, find_floors(turned_back)) == []
    # A camera switched off on the stairs: the floors are known, not how one gets from one to the other.
    gap = Cast(house(), np.concatenate([cameras[: start - 12], cameras[on_stairs[-1] + 12 :]]))
    assert find_floors(gap) == pytest.approx((0.0, STOREY_M), abs=0.01)
    assert find_stairs(gap, find_floors(gap)) == []


def test_three_floors_and_a_lift():
    tops = (0.0, 2.4, 5.2)
    plates = [build(f"floor {t}", "floor", slab(0, 0, 7, 6, OAK, top=t)) for t in tops]
    lift = [(7.5, 3.0, z) for z in np.arange(1.5, 6.8, 0.4)]
    around = [[(x, y, t + 1.5) for x, y in ((3, 3), (1, 2), (5, 4))] for t in tops]
    way = [*looks(around[0]), *looks([(6.5, 3.0, 1.5)]), *looks(lift, turns=1), *looks(around[2]), *looks(around[1])]
    frames = Cast(assemble(plates), np.stack(way))
    floors = find_floors(frames)
    assert floors == pytest.approx(tops, abs=0.01)
    assert sorted(int(n) for n in np.unique(floor_of_cameras(frames.poses[:, 2, 3], floors))) == [0, 1, 2]
    # The lift passes the middle floor: both ways are in the same shaft.
    stairs = find_stairs(frames, floors)
    assert [lower for lower, _, _ in stairs][:1] == [0]
    for _, foot, head in stairs:
        assert abs(foot[1] - 3.0) < 0.01 and abs(head[1] - 3.0) < 0.01


def swaying(scene, low, high):
    """Look around in a room at heights from one to another: crouched, and with the camera held up."""
    points = [(x, y, z) for x, y in ((2, 2), (4, 3), (6, 4)) for z in np.linspace(low, high, 6)]
    return Cast(scene, looks(points))


def test_one_floor_stays_one():
    wardrobes = [
        build(f"wardrobe {i}", "wardrobe", [box((2.0, 0.6, 2.0), (1.5 + 2.2 * i, 5.6, 1.0), WALNUT)]) for i in range(3)
    ]
    gallery = build("gallery", "floor", [box((3.0, 6.0, 1.0), (6.5, 3.0, 0.5), OAK)])
    table = build("tables", "table", [box((6.0, 4.0, 0.75), (4.0, 3.0, 0.375), WHITE)])
    for scene, low, high in [
        (room(), 0.4, 2.5),
        (room(*wardrobes), 0.4, 2.6),
        (room(gallery), 0.4, 2.6),
        (room(table), 0.9, 2.9),
    ]:
        frames = swaying(scene, low, high)
        assert np.ptp(frames.poses[:, 2, 3]) > 1.9  # so much that frames are looked at
        assert find_floors(frames) == (0.0,)


def test_a_ramp_a_landing_and_one_wrong_pose_are_no_floors():
    ramp = build("ramp", "floor", [box((12.0, 3.0, 0.1), (6.0, 1.5, 1.5), OAK, tilt_rad=-0.25)])
    up = [(x, 1.5, 1.5 + (x - 6.0) * np.tan(0.25) + 1.5) for x in np.linspace(1, 11, 15)]
    assert find_floors(Cast(assemble([ramp]), looks(up))) == (0.0,)

    landing = build("landing", "floor", slab(6.8, 4.8, 8, 6, OAK, top=2.0))
    frames = Cast(room(landing), np.concatenate([looks([(2, 2, 1.5), (4, 3, 1.5)]), looks([(6, 4, 3.3)])]))
    assert find_floors(frames) == (0.0,)

    cameras = poses()[:60].copy()
    cameras[30, 2, 3] = STOREY_M + CAMERA_M  # through the ceiling, for one frame
    assert find_floors(Cast(house(), cameras)) == (0.0,)


def test_a_camera_that_stays_level_costs_no_frame(walked):
    level = Cast(house(), poses()[:40])
    level.read = None  # pyright: ignore[reportAttributeAccessIssue] - reading would fail
    assert find_floors(level) == (0.0,)


def test_recordings_of_two_floors_are_joined_for_a_building_only(walked):
    parts = split_floors(walked, (0.0, STOREY_M))
    with pytest.raises(InputError, match=r"found a floor 3\.00 m off; a map has one floor"):
        JoinedFrames(parts)
    joined = JoinedFrames(parts, floors=True)
    floors = find_floors(joined)
    assert floors == pytest.approx((0.0, STOREY_M), abs=0.01)
    assert find_stairs(joined, floors) == []  # the one recording ends, the other begins
