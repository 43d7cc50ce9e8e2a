"""The simulated building: exact, the same every time, no larger in memory than the rooms around a camera."""

import numpy as np
import pytest
from benchmarks.building import bench_building, score
from benchmarks.large_building import FRAMES_A_ROOM, SimulatedBuilding

from simaps_viz import build_map
from simaps_viz.datasets.source import FrameSource
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project, transform_points


def test_a_frame_follows_from_the_seed_and_its_index_alone():
    one, two = SimulatedBuilding(40.0, seed=3), SimulatedBuilding(40.0, 5000, seed=3)
    source: FrameSource = one
    assert source.simulated and "simulated" in source.name and len(one) == 16 * FRAMES_A_ROOM and len(two) == 5000
    for index in (1000, 17, 0, 500):
        a, b, again = one.read(index), two.read(index), two.read(index + len(one))
        assert a.depth_m.tobytes() == b.depth_m.tobytes() == again.depth_m.tobytes()
        assert np.array_equal(a.T_world_camera, again.T_world_camera)
        ids = one.segmentation(index)
        assert ids.ids.tobytes() == two.segmentation(index).ids.tobytes()
        assert {s.id for s in ids.segments} == set(np.unique(ids.ids).tolist()) - {0}
    other = SimulatedBuilding(40.0, seed=4)
    assert [other.room(1, c).names for c in range(4)] != [one.room(1, c).names for c in range(4)]


@pytest.mark.parametrize("index", [3, 14, 25, 47, 70])
def test_every_pixel_lies_on_what_its_mask_says(index):
    building = SimulatedBuilding(30.0, seed=1)
    index += 4 * FRAMES_A_ROOM  # the room in the middle
    frame, masks, k = building.read(index), building.segmentation(index), building.intrinsics
    points = transform_points(frame.T_world_camera, back_project(frame.depth_m, k.fx, k.fy, k.cx, k.cy))
    names = {s.id: s.label for s in masks.segments}
    assert "floor" in names.values() and "wall" in names.values()
    checked = edges = 0
    for v, u in np.argwhere(frame.depth_m > 0)[::31].tolist():
        x, y, z = points[v, u]
        row, col = int((y + 15.0) // 10.0), int((x + 15.0) // 10.0)
        if not (0 <= row < 3 and 0 <= col < 3) or min(x % 0.1, -x % 0.1, y % 0.1, -y % 0.1) < 1e-5:
            continue
        room, (x0, y0) = building.room(row, col), building.origin_of(row, col)
        at = int((y - y0) / 0.1), int((x - x0) / 0.1)
        height, number = room.height_m[at], int(room.object[at])
        if z > height + 1e-4:  # a ray that passes an edge ends behind it
            edges += 1
            continue
        assert z > -0.005  # rays end up to 4 mm inside
        assert names[int(masks.ids[v, u])] == (room.names[number - 1] if number else "wall" if height else "floor")
        checked += 1
    assert checked > 100 and edges <= 2


def test_its_map_has_every_object_once():
    building = SimulatedBuilding(20.0, seed=2)
    simap = build_map(building)
    found = score(building, simap)
    assert found.found == found.true == found.right > 20 and found.quality > 0.95
    assert simap.spec.x0_m == pytest.approx(-10.0, abs=0.3) and simap.provenance["simulated"]
    names = [name for row in range(2) for col in range(2) for name in building.room(row, col).names]
    assert simap.counts() == {name: names.count(name) for name in set(names)}


@pytest.mark.parametrize(("side", "frames"), [(5.0, None), (2000.0, None), (float("nan"), None), (20.0, 0)])
def test_a_building_that_makes_no_sense_is_refused(side, frames):
    with pytest.raises(InputError, match="building: expected"):
        SimulatedBuilding(side, frames)


def test_the_bench_says_what_it_measured(tmp_path):
    lines = list(bench_building(SimulatedBuilding(10.0, 40), scratch=tmp_path))
    text = "\n".join(lines)
    assert lines[0].startswith("simulated building, 10 m x 10 m: 40 frames, 1 rooms")
    for words in ("area seen", "after 10, 50 and 100 %", "peak while frames came", "objects:", "map file"):
        assert words in text
