"""The comparison of methods as a recording: read back, it holds what was compared."""

import numpy as np
import pytest
import rerun.chunk as rc
from recorded_story import rows

from simaps_viz.errors import InputError
from simaps_viz.recorder.whole_map import record_comparison


def pixels(found, entity, dtype):
    """The bytes of the one picture at an entity."""
    columns = rows(found, entity, timeline=None)
    return np.array(columns["buffer"][0][0], np.uint8).view(dtype)


def test_pictures_come_back(tmp_path):
    rng = np.random.default_rng(0)
    pictures = [
        (name, rng.integers(0, 255, (5, 7, 3)).astype(np.uint8), rng.integers(0, 9, (5, 7)).astype(np.int32))
        for name in ("truth", "evidence", "paper")
    ]
    path = tmp_path / "compare.rrd"
    record_comparison("toy", pictures, path)
    found = rc.RrdReader(path).stream().collect()
    for number, (_, colors, instance) in enumerate(pictures):
        shown = pixels(found, f"/{number:02d}/map", np.uint8)
        assert shown.tobytes() == colors[::-1].tobytes()
        ids = pixels(found, f"/{number:02d}/instance", np.uint16)
        assert ids.tolist() == instance[::-1].ravel().tolist()
    assert [p.name for p in tmp_path.iterdir()] == ["compare.rrd"]


def test_no_instance_looks_like_nothing_however_many_there_are(tmp_path):
    """A picture holds 16 bits: numbers past them wrap, none to 0."""
    ids = np.array([[0, 1, 9, 59_999, 60_000, 65_535, 65_536, 65_537, 131_072]], np.int32)
    record_comparison("large", [("truth", np.zeros((1, 9, 3), np.uint8), ids)], tmp_path / "c.rrd")
    shown = pixels(rc.RrdReader(tmp_path / "c.rrd").stream().collect(), "/00/instance", np.uint16)
    assert ((shown == 0) == (ids.ravel() == 0)).all() and shown[:4].tolist() == [0, 1, 9, 59_999]


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"nowhere.*expected a file in a folder that can be written"):
        record_comparison("toy", [], tmp_path / "nowhere" / "x.rrd")
