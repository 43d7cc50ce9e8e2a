"""What a recording that is made while a map is built says of it."""

from dataclasses import replace

import numpy as np
import rerun.chunk as rc
from recorded_story import finished, image, projected, rows, story

from simaps_viz.colors.instances import instance_colors
from simaps_viz.recorder.recorder import RerunRecorder


def test_communities_are_counted_also_where_they_are_joined_already(tmp_path):
    simap = finished()  # one object of two communities
    begun = replace(simap, frame_names=simap.frame_names[:2], T_map_camera=simap.T_map_camera[:2])
    with RerunRecorder(tmp_path / "cut.rrd") as recorder:
        recorder.on_event(next(story()))
        for step in range(2):
            recorder.on_event(projected(step))
        recorder.show_objects(begun, instance_colors(begun))
    found = rc.RrdReader(tmp_path / "cut.rrd").stream().collect()
    counted = rows(found, "/counts/few/communities")
    assert counted["frame"] == [1] and counted["scalars"] == [[2.0]]
    assert "Louvain after frame 2: 2 communities" in rows(found, "/log")["text"][0]
    ids = image(rows(found, "/map/objects", at=[1]), 0, np.uint16)
    assert set(np.unique(ids[ids > 0])) == {4}, "the objects are shown, not their communities"
