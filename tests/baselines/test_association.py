"""The association of masks frame by frame, on the room of plates."""

import numpy as np
import pytest
from worlds import PLATES, write_room

from simaps_viz.baselines.association import _merged, _Object, associated_points
from simaps_viz.datasets.floors import SomeFrames
from simaps_viz.datasets.open import open_sequence
from simaps_viz.mapping.accumulator import ProjectionSettings
from simaps_viz.mapping.in_space import VOXEL_M, voxel_keys


def keys_of(cells):
    return np.sort(voxel_keys((np.array(cells) + 0.5) * VOXEL_M, (0.0, 0.0)))


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    return open_sequence(write_room(tmp_path_factory.mktemp("room")))


def test_plates_become_objects_where_they_hover(room):
    points = associated_points(room, room.T_map_world, (0.0, 0.0), ProjectionSettings())
    found = {}
    for number in np.unique(points.instances).tolist():
        mine = points.instances == number
        (label,) = set(points.classes[mine].tolist())
        found[room.labels[label], *np.round(points.positions[mine, :2].mean(axis=0), 1).tolist()] = number
    expected = {(label, round(x + w / 2, 1), round(y + d / 2, 1)) for label, x, y, w, d in PLATES.values()}
    assert len(found) == len(PLATES)
    for label, x, y in expected:
        assert any(label == one[0] and np.hypot(x - one[1], y - one[2]) < 0.15 for one in found), (label, x, y)


def test_what_few_frames_saw_is_left_out(room):
    points = associated_points(SomeFrames(room, range(2)), room.T_map_world, (0.0, 0.0), ProjectionSettings())
    assert len(points.positions) == 0


def test_objects_in_one_another_are_joined_in_the_end():
    large, inside = keys_of([(x, 0, 0) for x in range(10)]), keys_of([(x, 0, 0) for x in range(7, 11)])
    far = keys_of([(x, 5, 0) for x in range(4)])

    def one(label, keys):
        return _Object(label, keys, np.ones(len(keys), np.int64))

    joined = _merged([one("cup", inside), one("cup", large), one("cup", far), one("book", large[:5])])
    assert sorted((o.label, len(o.keys), o.detections) for o in joined) == [
        ("book", 5, 1), ("cup", 4, 1), ("cup", 11, 2)
    ]  # fmt: skip
