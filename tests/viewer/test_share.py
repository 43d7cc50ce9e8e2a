"""Files to send: what the sheets show, cell by cell, and that refusals come in one line."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from shared_rides import COMMAND, couch_of, late_map, toy_drive
from toy_maps import TOY_POSE, toy_map

from simaps_viz.cli.main import main
from simaps_viz.colors.instances import instance_colors
from simaps_viz.drawing.legend import title_of
from simaps_viz.drawing.texture import FLOOR
from simaps_viz.errors import CommandError
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.history import cut_as
from simaps_viz.mapping.partition import empty_log
from simaps_viz.viewer.page.share import (
    ENDINGS,
    MAX_TIME_STEPS,
    MapSheet,
    gif_bytes,
    key_picture,
    origin_text,
    overlay_html,
    share_bytes,
    shots,
    time_steps,
)
from simaps_viz.viewer.scene.map_scene import PATH, ROBOT


def test_the_story_grows_and_counts():
    simap = late_map()
    told = list(time_steps(simap, 40))
    assert [m.frame for m in told] == [0, 1, 2, 3, 4]
    assert [m.words.split(" · ")[1] for m in told] == ["6 objects", "6 objects", "6 objects", "7 objects", "7 objects"]
    assert [5 in m.hidden for m in told] == [True, True, True, False, False]
    assert told[-1].simap is simap
    few = list(time_steps(simap, 2))
    assert [m.frame for m in few] == [0, 4]


def test_a_map_of_that_time_is_shown_where_it_is_known():
    simap = toy_map()
    small = replace(simap, instances=simap.instances[:2])
    told = list(time_steps(simap, 5, lambda frame: small if frame == 1 else None))
    assert [m.words for m in told][1] == "Frame 1, the last is 4 · 2 objects"
    assert told[1].simap.instances == small.instances and not len(told[1].hidden)
    assert told[2].simap is simap


def test_objects_keep_their_colours_while_the_map_grows():
    simap = toy_map()
    early = np.where(np.arange(simap.spec.cols) < 45, simap.instance, 0).astype(np.int32)
    kept = tuple(one for one in simap.instances if (early == one.id).any())
    # As a history returns it: the finished map's ids, but neither its communities nor its merges.
    then = replace(simap, instance=early, instances=kept, community=early, graphs=(), merges=empty_log())
    step = next(time_steps(simap, 5, lambda frame: cut_as(then, simap) if frame == 0 else None))
    finished, shown = instance_colors(simap), instance_colors(step.simap)
    assert len(kept) > 2 and step.simap.instances == kept
    assert all((finished[one.id] == shown[one.id]).all() for one in kept)


def test_a_sheet_shows_every_object_in_its_place_and_north_up():
    simap = toy_map()
    sheet = MapSheet(simap)
    picture = sheet.draw()
    assert picture.shape == (*sheet.size, 3) and picture.shape[0] % 2 == picture.shape[1] % 2 == 0
    colors = instance_colors(simap)
    for one in simap.instances:
        row, col = sheet.pixel_of(*one.centroid_m[:2])
        assert tuple(picture[row, col]) == tuple(colors[one.id])
    south, north = sheet.pixel_of(0.0, -1.0), sheet.pixel_of(0.0, 2.0)
    assert south[0] > north[0] and south[1] == north[1]


def test_what_nobody_has_named_yet_is_floor():
    simap = late_map()
    couch, color = couch_of(simap)
    sheet = MapSheet(simap)
    first, *_, last = time_steps(simap, 5)
    place = sheet.pixel_of(*couch.centroid_m[:2])
    assert tuple(sheet.draw(first)[place]) == FLOOR
    assert tuple(sheet.draw(last)[place]) == color


def test_the_robot_stands_where_it_should_and_looks_its_way():
    simap = toy_map()
    sheet = MapSheet(simap)
    drive = toy_drive(simap)
    picture = sheet.draw(robot=TOY_POSE, path_m=drive.path_m)
    x, y = TOY_POSE.x_m, TOY_POSE.y_m
    assert tuple(picture[sheet.pixel_of(x - 0.17, y)]) == ROBOT
    assert tuple(picture[sheet.pixel_of(x + 0.08, y)]) == (255, 255, 255)  # its nose, to the east
    middle = drive.path_m[len(drive.path_m) // 2]
    assert (np.abs(picture.astype(int) - PATH).max(axis=-1) < 8).any()
    row, col = sheet.pixel_of(*middle)
    near = picture[row - 3 : row + 4, col - 3 : col + 4].astype(int)
    assert (np.abs(near - PATH).max(axis=-1) < 8).any()


def test_a_film_begins_without_the_couch_and_ends_with_the_robot_at_it():
    simap = late_map()
    drive = toy_drive(simap)
    film = Image.open(io.BytesIO(gif_bytes(shots(simap, drive=drive), key_picture(simap, drive=drive))))
    frames = getattr(film, "n_frames", 1)
    assert frames > min(MAX_TIME_STEPS, 5) + 5 and film.info.get("loop") == 0
    couch, color = couch_of(simap)
    sheet = MapSheet(simap)
    place = sheet.pixel_of(*couch.centroid_m[:2])
    seen = []
    for frame in (0, 4, frames - 1):
        film.seek(frame)
        seen.append(np.asarray(film.convert("RGB")).astype(int))
    assert seen[0].shape == (*sheet.size, 3)
    assert np.abs(seen[0][place] - FLOOR).max() < 8
    assert np.abs(seen[1][place] - color).max() < 8 and np.abs(seen[2][place] - color).max() < 8
    end = drive.trajectory.at(drive.trajectory.duration_s)
    behind = sheet.pixel_of(end.x_m - 0.17 * np.cos(end.yaw_rad), end.y_m - 0.17 * np.sin(end.yaw_rad))
    assert np.abs(seen[2][behind] - ROBOT).max() < 10 and np.abs(seen[1][behind] - ROBOT).max() > 60


def test_progress_reaches_its_end_and_work_can_be_given_up():
    simap = toy_map()
    told = []
    share_bytes(".gif", simap, progress=lambda what, done, total: told.append((done, total)))
    assert told[-1][0] == told[-1][1] == len(told)

    def give_up(what, done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        share_bytes(".gif", simap, progress=give_up)


def test_refused_commands_say_why():
    with pytest.raises(CommandError, match='"go to the piano": There is no piano'):
        toy_drive(toy_map(), "go to the piano")


def test_words_are_escaped_and_tell_what_is_simulated():
    nasty = "<script>alert(1)</script>"
    simap = replace(toy_map(), provenance={"name": nasty, "segmentation": nasty, "simulated": True})
    html = overlay_html(simap)
    assert nasty not in html and "&lt;script&gt;" in html
    assert "simulated" in html and "5 classes" not in html
    assert "7 instances" in html and "chair <b>3</b>" in html
    plain = overlay_html(replace(simap, provenance={"name": "attic"}))
    assert "badge" not in plain and "<h1>attic</h1>" in plain
    assert title_of(simap) == nasty
    assert origin_text(toy_map()) == "method paper, K = 5 % · 5 frames · cells of 5 cm · masks: simulated by hand"


@pytest.mark.slow
def test_the_command_writes_one_file_or_none(tmp_path, capsys):
    source = tmp_path / "toy.npz"
    save_map(toy_map(), source)
    for ending in ENDINGS:
        output = tmp_path / f"out{ending}"
        arguments = ["share", str(source), "-o", str(output), "--pose", "0.5", "0.5", "90", "--command", COMMAND]
        assert main([*arguments, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert said["bytes"] == output.stat().st_size > 5_000 and said["done"] is True and said["instances"] == 7
    with Image.open(tmp_path / "out.png") as picture:
        assert picture.size[0] > 2500
    for wrong, words in (
        (["-o", str(tmp_path / "out.avi")], "out.avi: expected a name that ends in .html, .gif, .png, found .avi"),
        (["-o", str(tmp_path / "no" / "out.gif")], "expected a file in a folder that can be written"),
        (["-o", str(tmp_path / "new.gif"), "--command", "go to the piano"], "There is no piano on this map"),
    ):
        assert main(["share", str(source), *wrong]) == 2
        said = capsys.readouterr().err
        assert words in " ".join(said.split()) and "Traceback" not in said
    assert not (tmp_path / "new.gif").exists()
