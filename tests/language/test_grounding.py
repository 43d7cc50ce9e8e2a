import numpy as np
import pytest
from toy_maps import TOY_POSE, Box, map_from_drawing, map_of_boxes, toy_map

from simaps_viz.errors import CommandError
from simaps_viz.language.grounding import ordinal
from simaps_viz.language.sets import Sets
from simaps_viz.structures import GridSpec, Pose2


@pytest.fixture(scope="module")
def ground() -> Sets:
    return Sets(toy_map(), TOY_POSE)


def ids(instances) -> list[int]:
    return [instance.id for instance in instances]


def test_ranks_are_by_nearest_cell(ground: Sets) -> None:
    chairs = ground.candidates("chair")
    assert [(c.rank, c.instance.id) for c in chairs] == [(1, 3), (2, 1), (3, 4)]
    # chair 3: its nearest cell is centred at (-0.025, -0.625); the viewer stands at (0.5, 0.5)
    assert chairs[0].distance_m == pytest.approx(np.hypot(0.525, 1.125), abs=1e-6)
    assert chairs[1].distance_m == pytest.approx(np.hypot(0.575, 1.225), abs=1e-6)


def test_rank_is_of_the_viewer() -> None:
    east = Sets(toy_map(), Pose2.from_heading(3.8, -1.5, 0.0))
    assert ids(east.instances("chair")) == [4, 3, 1]
    assert east.pick("dining table").id == 8


def test_nearest_cell_not_centroid_decides() -> None:
    """A long couch whose end is near beats a chair whose centroid is nearer."""
    simap = map_from_drawing("AAAAAAAAAA..\n............\n............\n....B.......", {"A": "couch", "B": "couch"})
    assert Sets(simap, Pose2(1.85, 0.5, 0.0)).pick("couch").id == 1


@pytest.mark.parametrize(
    ("side", "expected"),
    [
        ("left", [1, 4, 3]),  # looking east, left is north
        ("right", [3, 4, 1]),
        ("north", [1, 4, 3]),
        ("south", [3, 4, 1]),
        ("east", [4, 1, 3]),
        ("west", [3, 1, 4]),
    ],
)
def test_nth_from_each_side(ground: Sets, side: str, expected: list[int]) -> None:
    assert [ground.nth_from("chair", side, n).id for n in (1, 2, 3)] == expected


def test_left_turns_with_the_viewer() -> None:
    west = Sets(toy_map(), Pose2.from_heading(0.5, 0.5, 270.0))
    assert [west.nth_from("chair", "left", n).id for n in (1, 2, 3)] == [3, 4, 1]
    south = Sets(toy_map(), Pose2.from_heading(0.5, 0.5, 180.0))
    assert [south.nth_from("chair", "left", n).id for n in (1, 2, 3)] == [4, 1, 3]


def test_closest_to(ground: Sets) -> None:
    assert ground.closest_to("chair", "couch").id == 1  # 1.55 m east of chair 1, 2.6 m north of chair 4
    assert ground.closest_to("chair", "potted plant").id == 4
    assert ground.closest_to("chair", "dining table", 1).id == 1
    assert ground.closest_to("chair", "dining table", 2).id == 4
    assert ground.closest_to("dining table", "couch").id == 8
    assert ground.closest_to("chair", "chair").id == 1  # the closest chair is 3, the chair nearest to it is 1


def test_between(ground: Sets) -> None:
    assert ground.between("chair", "dining table", "couch").id == 1
    assert ground.between("chair", ground.pick("dining table", 2), "potted plant").id == 4
    with pytest.raises(CommandError, match=r"^There is no couch between the chair and the dining table\.$"):
        ground.between("couch", "chair", "dining table")


def test_pair(ground: Sets) -> None:
    assert ids(ground.pair("chair", "chair")) == [3, 1]
    assert ids(ground.pair(ground.pick("chair", 2), "chair")) == [1, 3]
    with pytest.raises(CommandError, match="There is only 1 couch on this map; the 2nd was asked for"):
        ground.pair("couch", "couch")


def test_in_view_through_the_doorway_only() -> None:
    simap = toy_map()
    assert ids(Sets(simap, TOY_POSE).in_view("chair")) == [4]
    assert ids(Sets(simap, TOY_POSE).in_view("dining table")) == [8]
    assert ids(Sets(simap, Pose2.from_heading(0.5, 0.5, 0.0)).in_view("chair")) == [1]
    assert ids(Sets(simap, Pose2.from_heading(0.5, 0.5, 225.0)).in_view("chair")) == [3]
    # the couch lies within the 90 degrees ahead, but the wall north of the doorway hides it
    assert Sets(simap, TOY_POSE).in_view("couch").items == ()
    assert ids(Sets(simap, Pose2.from_heading(2.2, 0.9, 45.0)).in_view("couch")) == [5]


def test_tall_furniture_hides_and_low_does_not() -> None:
    spec = GridSpec(20, 60, 0.05, 0.0, 0.0)
    chair = Box("chair", 6, 50, 6, 6, 0.8)
    for height, seen in ((0.75, True), (1.9, False)):
        simap = map_of_boxes(spec, [Box("dining table", 0, 25, 20, 8, height), chair])
        assert bool(Sets(simap, Pose2(0.5, 0.5, 0.0)).in_view("chair")) is seen


def plainly_seen(simap, viewer: Pose2, number: int, eye_m: float) -> bool:
    """The same rule as ``sight``, one ray and one centimetre at a time, to every cell of the object."""
    spec, grid = simap.spec, simap.grid
    for row, col in np.argwhere(simap.instance == number):
        x, y = spec.centre_of(row, col)
        far = float(np.hypot(x - viewer.x_m, y - viewer.y_m))
        bearing = np.arctan2(y - viewer.y_m, x - viewer.x_m) - viewer.yaw_rad
        if abs((bearing + np.pi) % (2 * np.pi) - np.pi) > np.pi / 4:
            continue
        free = True
        for along in np.arange(0.2, far, 0.01):
            at = spec.cell_of(viewer.x_m + along / far * (x - viewer.x_m), viewer.y_m + along / far * (y - viewer.y_m))
            height = eye_m + along / far * (float(grid.height_m[row, col]) - eye_m)
            wall = grid.labels[grid.label[at]] == "wall"
            hangs = grid.lowest_m[at] > 1.0 and not wall
            low = float(grid.lowest_m[at]) if hangs else 0.0
            stops = wall or low <= height <= float(grid.height_m[at])
            free &= not (stops and simap.instance[at] != number)
        if free:
            return True
    return False


@pytest.mark.parametrize("heading", [0.0, 45.0, 90.0, 135.0, 200.0, 290.0])
@pytest.mark.parametrize("place", [(0.5, 0.5), (2.6, 0.4), (3.2, -1.2)])
def test_what_is_seen_is_what_a_plain_ray_caster_sees(place: tuple[float, float], heading: float) -> None:
    simap, viewer = toy_map(), Pose2.from_heading(*place, heading)
    ground = Sets(simap, viewer)
    assert ground.sight.eye_height_m == 1.2  # of the toy's cameras
    for instance in simap.instances:
        seen = instance.id in ids(ground.in_view(instance.label))
        assert seen == plainly_seen(simap, viewer, instance.id, 1.2), instance


def test_a_higher_camera_looks_over_more_and_a_lamp_or_lintel_hides_nothing_below() -> None:
    spec = GridSpec(20, 80, 0.05, 0.0, 0.0)
    chair, here = Box("chair", 6, 60, 6, 6, 0.8), Pose2(0.5, 0.45, 0.0)
    shelf = map_of_boxes(spec, [Box("dining table", 0, 40, 20, 4, 1.1), chair])
    assert not Sets(shelf, here, eye_height_m=1.2).in_view("chair")
    assert Sets(shelf, here, eye_height_m=1.8).in_view("chair")
    lamp = map_of_boxes(spec, [Box("dining table", 0, 40, 20, 4, 2.0, lowest_m=1.7), chair])
    assert Sets(lamp, here, eye_height_m=1.2).in_view("chair")
    low_lamp = map_of_boxes(spec, [Box("dining table", 0, 40, 20, 4, 2.0, lowest_m=0.6), chair])
    assert not Sets(low_lamp, here, eye_height_m=1.2).in_view("chair")


def test_a_low_thing_hides_behind_a_higher_one_but_not_the_other_way_round() -> None:
    spec = GridSpec(20, 80, 0.05, 0.0, 0.0)
    near, far = Box("couch", 0, 50, 20, 8, 0.9), Box("chair", 6, 60, 6, 6, 0.3)
    assert not Sets(map_of_boxes(spec, [near, far]), Pose2(0.5, 0.45, 0.0)).in_view("chair")
    tall = Box("chair", 6, 60, 6, 6, 1.0)
    assert Sets(map_of_boxes(spec, [near, tall]), Pose2(0.5, 0.45, 0.0)).in_view("chair")


def test_generic_names_take_classes_together(ground: Sets) -> None:
    assert ground.labels_of("seat") == ("chair", "couch")
    assert ids(ground.instances("seats")) == [3, 1, 5, 4]
    assert ground.pick("seat", 3).id == 5
    assert ground.pick("seat", ground.pick("couch")).id == 5
    assert ground.nth_from("seat", "north", 1).id == 5
    assert ground.closest_to("seat", "dining table").id == 1
    assert ground.closest_to("furniture", "potted plant").id == 4
    with pytest.raises(CommandError) as error:
        ground.pick("seat", 5)
    assert str(error.value) == "There are only 4 seats on this map; the 5th was asked for."
    with pytest.raises(CommandError, match="instance 9 is a potted plant, but a seat was asked for"):
        ground.pick("seat", ground.pick("plant"))


def test_field_of_view_edges() -> None:
    simap = map_of_boxes(GridSpec(80, 80, 0.05, 0.0, 0.0), [Box("chair", 60, 20, 4, 4, 0.8)])  # at (1.1, 3.1)
    viewer = (1.1, 1.1)
    for heading, seen in ((0.0, True), (40.0, True), (60.0, False), (180.0, False), (310.0, False), (325.0, True)):
        assert bool(Sets(simap, Pose2.from_heading(*viewer, heading)).in_view("chair")) is seen, heading


def test_what_is_missing_is_refused_by_name(ground: Sets) -> None:
    with pytest.raises(CommandError) as error:
        ground.pick("piano")
    assert str(error.value) == ("There is no piano on this map.")
    with pytest.raises(CommandError) as error:
        ground.pick("chair", 4)
    assert str(error.value) == "There are only 3 chairs on this map; the 4th was asked for."
    with pytest.raises(CommandError) as error:
        ground.nth_from("couch", "left", 2)
    assert str(error.value) == "There is only 1 couch on this map; the 2nd was asked for."
    with pytest.raises(CommandError, match="instance 5 is a couch, but a chair was asked for"):
        ground.pick("chair", ground.pick("couch"))
    with pytest.raises(CommandError, match="Did you mean chair"):
        ground.pick("chiar")


def test_a_map_without_objects() -> None:
    empty = Sets(map_of_boxes(GridSpec(4, 4, 0.05, 0.0, 0.0), []), Pose2(0.1, 0.1, 0.0))
    with pytest.raises(CommandError, match=r"There is no chair on this map\. It has no objects at all\."):
        empty.pick("chair")


def test_synonyms_ground(ground: Sets) -> None:
    assert ground.pick("sofa").id == 5
    assert ground.pick("tables").label == "dining table"
    assert ground.pick("plant").id == 9


@pytest.mark.parametrize(("n", "word"), [(1, "1st"), (2, "2nd"), (3, "3rd"), (4, "4th"), (11, "11th"), (22, "22nd")])
def test_ordinal(n: int, word: str) -> None:
    assert ordinal(n) == word
