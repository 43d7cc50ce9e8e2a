"""Finding and planning from Python, with answers worked out on the drawing in toy_maps."""

import sys

import pytest
from toy_maps import TOY_POSE, toy_map

from simaps_viz import CommandError, InputError, PlanningError, Pose2, RobotShape, find, plan, to_pandas


@pytest.fixture(scope="module")
def simap():
    return toy_map()


def ids(found):
    return [one.id for one in found]


@pytest.mark.parametrize(
    ("name", "near", "expected"),
    [
        ("chair", None, [1, 3, 4]),
        ("chair", (4.5, -0.5), [4, 1, 3]),
        ("chairs", TOY_POSE, [3, 1, 4]),
        ("chair", "potted plant", [4, 1, 3]),
        ("sofa", None, [5]),
        ("dining table", "couch", [8, 6]),
        ("dining table", "chair", [6, 8]),
    ],
)
def test_find(simap, name, near, expected):
    assert ids(find(simap, name, near=near)) == expected


def test_methods_of_the_map_are_the_functions(simap):
    assert simap.find("chairs", near="sofa") == find(simap, "chairs", near="sofa")
    robot = RobotShape(radius_m=0.25)
    ways = simap.plan(TOY_POSE, "sofa", robot=robot), plan(simap, TOY_POSE, "sofa", robot=robot)
    assert ways[0].points_m.tolist() == ways[1].points_m.tolist() != simap.plan(TOY_POSE, "sofa").points_m.tolist()
    assert simap.to_pandas().equals(to_pandas(simap))


def test_near_an_instance_leaves_it_out(simap):
    assert ids(find(simap, "chair", near=simap.by_id(4))) == [1, 3]
    assert find(simap, "chair", near="chair") == ()


def test_find_names_what_there_is(simap):
    with pytest.raises(CommandError, match=r"no piano on this map. It has: chair \(3\)"):
        find(simap, "piano")


@pytest.mark.parametrize(("name", "near"), [("", None), (" ", None), (3, None), (None, None), ("chair", "")])
def test_names_are_checked(simap, name, near):
    with pytest.raises(InputError, match="expected the name of objects, found"):
        find(simap, name, near=near)


@pytest.mark.parametrize("place", [(float("nan"), 0.0), ("a", 1.0), (None, 1.0), (float("inf"), 0.0)])
def test_a_spot_is_two_numbers(simap, place):
    with pytest.raises(InputError, match="place: expected x and y in metres"):
        simap.at(*place)


def test_plan_to_a_point_an_object_and_a_name(simap):
    way = plan(simap, (0.5, 0.5), (4.0, 0.9))
    assert way.points_m[0].tolist() == [0.5, 0.5] and way.points_m[-1] == pytest.approx([4.0, 0.9])
    assert way.length_m >= 3.5
    couch = simap.of_class("couch")[0]
    by_instance, by_name = plan(simap, TOY_POSE, couch), plan(simap, TOY_POSE, "sofa")
    assert by_instance.points_m.tolist() == by_name.points_m.tolist()
    (x_low, y_low, _), (x_high, _, _) = couch.aabb_m
    x, y = by_name.points_m[-1]
    assert x_low - 0.5 < x < x_high + 0.5 and y_low - 0.5 < y < y_low + 0.1
    assert plan(simap, couch, Pose2(0.5, 0.5, 0.0)).points_m[-1].tolist() == [0.5, 0.5]


def test_plan_says_why_not(simap):
    with pytest.raises(PlanningError, match="not free floor"):
        plan(simap, (0.5, 0.5), (0.5, 1.8))
    with pytest.raises(PlanningError):
        plan(simap, (0.5, 0.5), (4.0, 0.5), robot=RobotShape(radius_m=0.9))
    with pytest.raises(CommandError, match="piano"):
        plan(simap, (0.5, 0.5), "piano")


@pytest.mark.parametrize("wrong", [(1.0,), (1.0, float("nan")), (1.0, "x"), None])
def test_places_are_checked(simap, wrong):
    with pytest.raises(InputError, match="place: expected"):
        plan(simap, wrong, (0.5, 0.5))


def test_frame(simap):
    frame = to_pandas(simap)
    assert frame.index.name == "id" and frame.groupby("label").size().to_dict() == simap.counts()
    assert frame.loc[3, "area_m2"] == pytest.approx(64 * 0.0025)


def test_frame_without_pandas(simap, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"to_pandas: expected the package pandas, .*simaps-viz\[pandas\]"):
        to_pandas(simap)
