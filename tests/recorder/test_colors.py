"""An object has one colour all through a recording, the one it has on the finished map's page."""

from dataclasses import replace

import numpy as np
import pytest
import rerun.chunk as rc
from recorded_story import FRAMES, communities, finished, grid, image, palette, projected, record, rgba, rows, story
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import build_complete
from simaps_viz.colors.instances import Colored, colors_like, instance_colors, take_over
from simaps_viz.colors.palette import PALETTE
from simaps_viz.console.progress import stage_progress
from simaps_viz.events import BuildFinished, CommunitiesFound
from simaps_viz.mapping.timeline import CLASSES, Timeline
from simaps_viz.recorder.facts import read_levels
from simaps_viz.recorder.recorder import RerunRecorder
from simaps_viz.structures import GridSpec


def spec(rows_: int, cols: int, x0_m: float = 0.0) -> GridSpec:
    return GridSpec(rows=rows_, cols=cols, cell_size_m=0.5, x0_m=x0_m, y0_m=0.0)


def test_what_was_there_before_keeps_its_color_wherever_the_grid_begins():
    before_ids = np.array([[1, 1, 0, 0, 0, 0, 2, 2, 2]], np.int32)
    worn = np.array([(0, 0, 0), PALETTE[5], PALETTE[7]], np.uint8)
    before = Colored(spec(1, 9), before_ids, worn)
    ids = np.array([[0, 8, 8, 0, 0, 0, 0, 3, 3, 3]], np.int32)  # one cell more in the west, other numbers
    colors = colors_like(spec(1, 10, x0_m=-0.5), ids, before)
    assert colors[8].tolist() == list(PALETTE[5]) and colors[3].tolist() == list(PALETTE[7])
    assert colors[0].tolist() == [0, 0, 0]


def test_of_two_pieces_the_larger_has_the_color_and_the_other_is_told_from_it():
    before = Colored(spec(1, 6), np.full((1, 6), 4, np.int32), np.array([PALETTE[3]] * 5, np.uint8))
    colors = colors_like(spec(1, 6), np.array([[1, 1, 2, 2, 2, 2]], np.int32), before)
    assert colors[2].tolist() == list(PALETTE[3]) and colors[1].tolist() != list(PALETTE[3])


def test_who_had_a_color_has_it_before_a_larger_newcomer():
    before = Colored(spec(1, 5), np.array([[1, 1, 0, 0, 0]], np.int32), np.array([(0, 0, 0), PALETTE[1]], np.uint8))
    colors = colors_like(spec(1, 5), np.array([[5, 5, 2, 2, 2]], np.int32), before)  # the newcomer wishes for it too
    assert colors[5].tolist() == list(PALETTE[1]) != colors[2].tolist()


def found_after(frame: int, ids: dict[int, int]) -> CommunitiesFound:
    """The two chair cells, communities 9 and 4, under other numbers."""
    was = communities(frame)
    now = np.zeros_like(was)
    for old, new in ids.items():
        now[was == old] = new
    return CommunitiesFound(grid(frame), now, frame, final=False)


def test_before_the_end_is_known_colors_stay_from_one_finding_to_the_next(tmp_path):
    with RerunRecorder(tmp_path / "cut.rrd") as recorder:
        recorder.on_event(next(story()))
        for step, ids in enumerate(({9: 9, 4: 4}, {9: 1, 4: 2}, {9: 2, 4: 1})):
            recorder.on_event(projected(step))
            recorder.on_event(found_after(step, ids))
    found = rows(rc.RrdReader(tmp_path / "cut.rrd").stream().collect(), "/map/objects", at=[0, 1, 2])
    colors = [palette(found, step) for step in range(3)]
    west = [colors[0][9][1], colors[1][1][1], colors[2][2][1]]
    east = [colors[0][4][1], colors[1][2][1], colors[2][1][1]]
    assert len(set(west)) == len(set(east)) == 1 and west != east


def test_at_the_end_all_frames_get_the_colors_of_the_finished_map(tmp_path):
    simap = finished()
    apart = replace(simap, instance=communities(FRAMES - 1))
    with RerunRecorder(tmp_path / "whole.rrd") as recorder:
        for event in story():
            if isinstance(event, CommunitiesFound) and not event.final:
                recorder.on_event(found_after(1, {9: 7, 4: 3}))
            else:
                recorder.on_event(BuildFinished(apart) if isinstance(event, BuildFinished) else event)
    found = rc.RrdReader(tmp_path / "whole.rrd").stream().collect()
    wanted = instance_colors(apart)
    for path in ("/map/objects", "/world/cells"):
        colors = palette(rows(found, path, at=[1]), 0)
        assert colors[7] == ("chair (id 7)", rgba(tuple(wanted[9].tolist())))
        assert colors[3] == ("chair (id 3)", rgba(tuple(wanted[4].tolist())))


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    sequence = open_sequence(write_tiny_sequence(folder / "tiny", frames=6))
    with stage_progress(quiet=True) as progress:
        simap = build_complete(sequence, "evidence", BuildConfig(), folder / "m.npz", folder / "m.rrd", progress)
    return simap, folder / "m.rrd"


def test_every_level_of_louvain_is_recorded_as_the_page_shows_it(built):
    simap, path = built
    steps = Timeline(simap)
    assert steps.levels > 1 and read_levels(path) == steps.levels
    found = rows(rc.RrdReader(path).stream().collect(), "/map/objects", timeline="louvain")
    assert found["louvain"] == list(range(steps.levels + 1))
    for position in range(CLASSES + 1, steps.levels + 1):
        then = steps.map_at(position)
        take_over(then, simap)
        assert (image(found, position, np.uint16) == then.instance[::-1]).all()
        there, wanted = palette(found, position), instance_colors(then)
        for one in np.unique(then.instance[then.instance > 0]).tolist():
            assert there[one][1] == rgba(tuple(wanted[one].tolist()))


def test_a_recording_that_does_not_say_has_only_the_last_level(tmp_path):
    path = record(tmp_path / "a.rrd")
    assert read_levels(path) == 1  # its map has no graphs to find more in
    (tmp_path / "broken.rrd").write_bytes(path.read_bytes()[:400])
    assert read_levels(tmp_path / "broken.rrd") == 1
