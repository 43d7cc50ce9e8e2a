"""A recording read back holds exactly what the build told."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rerun as rr
import rerun.chunk as rc
from recorded_story import (
    CELL_M,
    EMPTY,
    FRAMES,
    WHOLE,
    communities,
    finished,
    image,
    palette,
    pose,
    record,
    rgba,
    rows,
    story,
)
from toy_surfaces import toy_with_surface

from simaps_viz.colors.classes import class_color, instance_color
from simaps_viz.events import BuildFinished, CommunitiesFound, FrameProjected, MergesFound
from simaps_viz.geometry import turned_pose
from simaps_viz.recorder.map_log import CLASS_BASE, FLOOR, GROUND, UNPARTED, UNSEEN, WALL
from simaps_viz.recorder.recorder import RerunRecorder
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.recorder.whole_map import log_whole_map
from simaps_viz.structures import (
    MergeLog,
    SIMap,
)

LABELS, IS_THING = ("none", "chair", "floor"), (False, True, False)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return rc.RrdReader(record(tmp_path_factory.mktemp("recording") / "toy.rrd")).stream().collect()


def test_the_ground_is_dark_on_a_dark_page_and_light_on_a_light_one() -> None:
    of = {value: np.array(color) for value, _, color in GROUND}
    for value, most in ((UNSEEN, 0.0), (FLOOR, 0.2)):
        assert of[value][3] <= 255 * most  # so much of its own
    for page in (17.0, 255.0):
        over = {value: page + (color[:3].mean() - page) * color[3] / 255 for value, color in of.items()}
        assert abs(over[FLOOR] - over[UNSEEN]) > 8 and abs(over[WALL] - over[FLOOR]) > 60


def test_timelines_are_those_of_the_build(recording: Any) -> None:
    assert rows(recording, "/world/camera")["frame"] == list(range(FRAMES))
    assert rows(recording, "/map/objects")["frame"] == [1, FRAMES - 1]
    assert rows(recording, "/map/objects", timeline="louvain")["louvain"] == [0, 1]
    assert rows(recording, "/map/objects", timeline="merge")["merge"] == [0, 1]
    names = set(recording.reader(index="frame").to_arrow_table().column_names)
    assert not names & {"log_tick", "log_time"}


def test_poses(recording: Any) -> None:
    found = rows(recording, "/world/camera")
    for step in range(FRAMES):
        assert found["translation"][step][0] == [step, 2.0, 1.0]
        column_major = np.array(found["mat3x3"][step][0]).reshape(3, 3).T
        assert column_major.tolist() == pose(step)[:3, :3].tolist()


def test_every_picture_has_the_camera_of_its_size(recording: Any) -> None:
    for name, divide in (("color", 1), ("depth", 2), ("segmentation", 1)):
        found = rows(recording, f"/world/camera/{name}", at=[0])
        K = np.array(found["image_from_camera"][0][0]).reshape(3, 3).T
        assert K.tolist() == [[10 / divide, 0, 7.5 / divide], [0, 10 / divide, 5.5 / divide], [0, 0, 1]]
        assert found["resolution"][0][0] == [16 / divide, 12 / divide]


def test_pictures_of_a_camera_held_on_its_side_are_recorded_upright(recording: Any, tmp_path: Path) -> None:
    path = tmp_path / "lying.rrd"
    with RerunRecorder(path, settings=WHOLE) as recorder:
        for event in story():
            if isinstance(event, FrameProjected):
                turns = event.frame.index  # another way in each frame
                frame, masks = event.frame.turned(turns), event.segmentation.turned(turns)
                lying = turned_pose(event.T_map_camera, turns)
                event = replace(event, frame=frame, segmentation=masks, T_map_camera=lying)  # noqa: PLW2901
            recorder.on_event(event)
    found = rc.RrdReader(path).stream().collect()
    for name in ("/world/camera", "/world/camera/depth", "/world/camera/segmentation", "/world/camera/color"):
        assert rows(found, name) == rows(recording, name)


def test_color_depth_and_segments(recording: Any) -> None:
    jpeg = rows(recording, "/world/camera/color")["blob"][2][0]
    color = cv2.imdecode(np.array(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert color is not None and color.shape == (12, 16, 3)
    assert np.abs(color.astype(int) - (50, 100, 200)).max() <= 4

    found = rows(recording, "/world/camera/depth")
    depth = image(found, 2, np.uint16)
    assert found["meter"][2] == [1000.0]
    assert depth.shape == (6, 8) and depth[0, 0] == 0 and (np.delete(depth.reshape(-1), 0) == 2000).all()

    found = rows(recording, "/world/camera/segmentation")
    ids = image(found, 2, np.uint8)
    assert (ids[:, :8] == 7).all() and (ids[:, 8:] == 0).all()
    assert palette(found, 2)[7] == ("chair 0.88", rgba(instance_color(7)))


def test_points_are_what_the_depth_says(recording: Any) -> None:
    found = rows(recording, "/world/points")
    points = np.array(found["positions"][3])
    expected = {
        (round(3 + (u - 7.5) / 5, 3), 4.0, round(1 - (v - 5.5) / 5, 3))
        for u in range(16)
        for v in range(12)
        if (u, v) != (0, 0) and -0.3 <= 1 - (v - 5.5) / 5 <= 2.0
    }
    assert {tuple(p) for p in points.round(3).tolist()} == expected and len(points) == len(expected)
    assert set(found["colors"][3]) == {rgba((200, 100, 50))}


def test_the_surface_grows_by_voxels_of_10_cm_each_once_in_the_class_seen_there(recording: Any) -> None:
    found = rows(recording, "/world/surface")
    assert found["frame"] == list(range(FRAMES))
    points = [np.array(part or np.zeros((0, 3))).round(4) for part in found["positions"]]
    seen: set[tuple[float, ...]] = set()
    for step in range(FRAMES):
        pixels = np.array(rows(recording, "/world/points")["positions"][step])
        every = {tuple(one) for one in ((np.floor(pixels * 10 + 1e-4) + 0.5) / 10).round(4).tolist()}
        new = [tuple(one) for one in points[step].tolist()]
        assert set(new) == every - seen and len(set(new)) == len(new)
        seen |= every
    assert len(points[0]) > 50 and 0 < len(points[-1]) < len(points[0])
    # The left half of the picture is the chair, the right one has no name.
    left = np.array(points[0])[:, 0] < 0.0
    classes = np.array(found["class_ids"][0])
    assert (classes[left] == 2).all() and (classes[~left] == 1).all()
    names = rows(recording, "/world/surface", timeline=None)
    assert palette(names, 0)[2] == ("chair", rgba(class_color("chair")))


def test_points_above_the_cut_are_left_out(tmp_path: Path) -> None:
    settings = RecorderSettings(points=4000, cut_height_m=1.0)
    found = rows(rc.RrdReader(record(tmp_path / "low.rrd", settings)).stream().collect(), "/world/points")
    assert 0.8 < np.array(found["positions"][0])[:, 2].max() <= 1.0


def test_map_is_north_up_and_stays_in_place_while_it_grows(recording: Any) -> None:
    found = rows(recording, "/map/classes")
    assert found["frame"] == list(range(FRAMES))
    for step in range(FRAMES):
        assert found["translation"][step][0] == pytest.approx([-CELL_M * step, -1.3, 0.0])
        assert found["scale"][step][0] == pytest.approx([CELL_M, CELL_M, 1.0])
        picture = image(found, step, np.uint8)
        assert picture.shape == (3, 4 + step)
        assert (picture[0] == [3] * (2 + step) + [2, 2]).all(), "the chairs lie in the north, so in the first row"
        assert picture[2, -1] == 0, "never seen"
        ground = image(rows(recording, "/map/ground"), step, np.uint8)
        assert (ground[0] == [FLOOR] * (2 + step) + [UNPARTED, UNPARTED]).all() and ground[2, -1] == UNSEEN
        heights = image(rows(recording, "/map/heights"), step, np.uint8)
        assert (heights[0] == [1] * (2 + step) + [26, 26]).all() and heights[2, -1] == 0
    assert palette(rows(recording, "/map/classes", timeline=None), 0)[2] == ("chair", rgba(class_color("chair")))
    assert palette(rows(recording, "/map/heights", timeline=None), 0)[26][0] == "0.50 m"


def test_edges_are_drawn_where_their_cells_are(recording: Any) -> None:
    found = rows(recording, "/map/edges")
    for step in range(FRAMES - 1):
        assert np.allclose(found["strips"][step], [[[0.25, -1.25], [0.35, -1.25]]], atol=1e-6)
        assert found["colors"][step] == [rgba(class_color("chair"))]
    assert not found["strips"][FRAMES - 1], "the last frame added none"


def test_counts(recording: Any) -> None:
    def series(name: str) -> list[list[float]]:
        return rows(recording, f"/counts/{name}")["scalars"]

    assert series("edges") == [[1.0], [2.0], [3.0], [3.0]]
    assert series("cells/seen") == [[11.0 + 3 * step] for step in range(FRAMES)]
    assert series("cells/named") == series("cells/seen")
    assert series("few/classes") == [[2.0]] * FRAMES
    assert series("few/communities") == [[2.0]]


def test_objects_on_the_way_are_shown_in_place_of_their_pieces(tmp_path: Path) -> None:
    joined = np.where(communities(1) > 0, 4, 0).astype(np.int32)
    path = tmp_path / "joined.rrd"
    with RerunRecorder(path, settings=WHOLE) as recorder:
        for event in story():
            on_the_way = isinstance(event, CommunitiesFound) and not event.final
            recorder.on_event(replace(event, instance=joined) if on_the_way else event)
    found = rc.RrdReader(path).stream().collect()
    assert (image(rows(found, "/map/objects", at=[1]), 0, np.uint16)[0] == [0, 0, 0, 4, 4]).all()
    assert rows(found, "/counts/few/communities")["scalars"] == [[2.0]], "pieces are counted all the same"


def test_objects_have_the_colors_of_their_ids(recording: Any) -> None:
    found = rows(recording, "/map/objects", at=[0, 1, 2, 3])
    assert found["buffer"][0] is None, "nothing is told apart yet"
    for row in (1, 2):
        assert (image(found, row, np.uint16)[0] == [0, 0, 0, 9, 4]).all()
        assert found["translation"][row][0] == pytest.approx([-CELL_M, -1.3, 0.0]), "it keeps the place it was found at"
        name, color = palette(found, row)[9]
        assert name == "chair (id 9)" and color != rgba(instance_color(4)), "4 is the finished chair, this a part of it"
        assert palette(found, row)[4] == ("chair (id 4)", rgba(instance_color(4)))
        assert palette(found, row)[0][1] == 0, "no object: transparent"
    assert (image(found, 3, np.uint16)[0] == [0, 0, 0, 0, 0, 4, 4]).all(), "the finished map, both cells one chair"
    assert palette(found, 3)[4] == ("chair (id 4)", rgba(instance_color(4)))
    cells = rows(recording, "/world/cells", at=[3])
    assert np.allclose(cells["positions"][0], [[0.25, 1.25, 0.5], [0.35, 1.25, 0.5]]) and cells["class_ids"][0] == [
        4,
        4,
    ]


def test_louvain_goes_from_classes_to_communities(recording: Any) -> None:
    found = rows(recording, "/map/objects", timeline="louvain")
    assert (image(found, 0, np.uint16)[0] == [0] * 5 + [CLASS_BASE + 1] * 2).all()
    assert palette(found, 0)[CLASS_BASE + 1] == ("chair", rgba(class_color("chair")))
    assert (image(found, 1, np.uint16)[0] == [0] * 5 + [9, 4]).all()


def test_merge_timeline_ends_at_the_finished_map(recording: Any) -> None:
    found = rows(recording, "/map/objects", timeline="merge", at=[0, 1])
    assert (image(found, 0, np.uint16)[0] == [0] * 5 + [9, 4]).all()
    assert (image(found, 1, np.uint16)[0] == [0] * 5 + [4, 4]).all()
    assert palette(found, 1)[4][1] == rgba(instance_color(4))
    text = rows(recording, "/now", timeline="merge")["text"][1][0]
    joined = "chair: community 9 joins 4, 50 % of the cells of the first neighbour the second."
    assert text == f"**Step 1 of 1**, taken at K = 5 %. {joined}"
    mark = rows(recording, "/map/merge", timeline="merge")["strips"][0]
    assert np.allclose(mark[0], [[0.25, -1.25], [0.35, -1.25]], atol=1e-6)
    assert rows(recording, "/world/cells", timeline="merge", at=[1])["class_ids"][0] == [4, 4]


def test_boxes_and_counts_of_the_finished_map(recording: Any) -> None:
    found = rows(recording, "/world/objects")
    assert found["frame"] == [FRAMES - 1] and found["labels"] == [["chair 4"]]
    assert found["colors"] == [[rgba(instance_color(4))]]
    assert np.allclose(found["centers"][0], [[0.3, 1.25, 0.5]]) and np.allclose(
        found["half_sizes"][0], [[0.1, 0.05, 0]]
    )
    assert np.allclose(rows(recording, "/map/names")["centers"][0], [[0.3, -1.25]])
    about = rows(recording, "/about", timeline=None)["text"][0][0]
    assert "| chair | 1 |" in about and "**paper**" in about


@pytest.mark.parametrize("simulated", [True, False])
def test_simulated_is_said(tmp_path: Path, simulated: bool) -> None:
    found = rc.RrdReader(record(tmp_path / "a.rrd", simulated=simulated)).stream().collect()
    about = rows(found, "/about", timeline=None)["text"][0][0]
    assert ("imulated" in about) == simulated
    assert ("simulated" in rows(found, "/now")["text"][0][0]) == simulated


def test_thinning_keeps_what_it_says(tmp_path: Path) -> None:
    settings = RecorderSettings(color_every=3, color_divide=2, depth_every=2, points=5, edges=0, map_every=2)
    found = rc.RrdReader(record(tmp_path / "a.rrd", settings)).stream().collect()
    assert rows(found, "/world/camera/color")["frame"] == [0, 3]
    assert rows(found, "/world/camera/depth")["frame"] == [0, 2]
    assert rows(found, "/map/classes")["frame"] == [0, 2, 3], "the last frame's map is always there"
    assert rows(found, "/counts/edges")["scalars"][-1] == [3.0], "all edges count, drawn or not"
    assert all(len(points) <= 5 for points in rows(found, "/world/points")["positions"])
    jpeg = np.array(rows(found, "/world/camera/color")["blob"][0][0], np.uint8)
    picture = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
    assert picture is not None and picture.shape == (6, 8, 3)


def test_map_without_objects(tmp_path: Path) -> None:
    """Nothing countable, nothing merged: the recording is short but whole."""
    empty = finished()
    none = np.zeros_like(empty.instance)
    log = MergeLog(np.zeros(0, np.int16), EMPTY, EMPTY, np.zeros(0, np.float32))
    bare = SIMap(**{**vars(empty), "instance": none, "instances": (), "community": none, "merges": log})
    with RerunRecorder(tmp_path / "a.rrd") as recorder:
        recorder.on_event(next(story()))
        recorder.on_event(CommunitiesFound(bare.grid, none, 3, final=True))
        recorder.on_event(MergesFound(bare.grid, none, log, np.zeros(0, bool)))
        recorder.on_event(BuildFinished(bare))
    found = rc.RrdReader(tmp_path / "a.rrd").stream().collect()
    assert rows(found, "/map/objects", timeline="merge")["merge"] == [0]


def test_objects_of_a_map_with_voxels_have_turned_boxes_in_the_room_as_it_looked(tmp_path: Path) -> None:
    simap = toy_with_surface()
    stream = rr.RecordingStream("test")
    stream.set_sinks(rr.FileSink(str(tmp_path / "map.rrd")))
    log_whole_map(stream, simap)
    stream.flush()
    stream.disconnect()
    found = rc.RrdReader(tmp_path / "map.rrd").stream().collect()
    boxes = rows(found, "/world/objects")
    ones = (*simap.instances, *simap.hidden)
    assert boxes["labels"][0] == [one.name for one in ones] and boxes["labels"][0][0] == "chair 1"
    for number, one in enumerate(ones):
        assert one.box is not None
        assert np.allclose(boxes["centers"][0][number], one.box.center_m, atol=1e-5)
        assert np.allclose(np.multiply(boxes["half_sizes"][0][number], 2), one.box.size_m, atol=1e-5)
        x, y, z, w = boxes["quaternions"][0][number]
        assert (x, y) == (0, 0) and 2 * np.arctan2(z, w) == pytest.approx(one.box.yaw_rad, abs=1e-5)
    surface = rows(found, "/world/surface")
    assert np.allclose(surface["positions"][0], simap.points().positions)
    assert surface["colors"][0][-1] == rgba(tuple(simap.points().colors[-1].tolist()))
