"""Occupancy maps and masks, opened with PyYAML and Pillow and read as map_server reads them, cell by cell."""

import numpy as np
import pytest
import yaml
from PIL import Image
from toy_maps import TOY_SPEC, map_from_drawing, map_of_boxes, toy_map

from simaps_viz import RobotShape, export_map
from simaps_viz.exports.exporter import ExportOptions
from simaps_viz.exports.ros import inflated
from simaps_viz.navigation.planner import Planner
from simaps_viz.structures import GridSpec


def served(path):
    """What map_server publishes of a YAML file: info, and occupancy int [rows, cols], row 0 at the origin (REP 103)."""
    about = yaml.safe_load(path.read_text())
    grey = np.array(Image.open(path.parent / about["image"])).astype(int)
    assert grey.ndim == 2 and about["negate"] == 0
    occupied = (255 - grey) / 255.0
    if about["mode"] == "raw":
        occupancy = np.where(grey <= 100, grey, -1)
    else:
        occupancy = np.where(occupied > about["occupied_thresh"], 100, np.where(occupied < about["free_thresh"], 0, -1))
    return about, occupancy[::-1]


def planner_sees(planner):
    seen = ~np.isnan(planner.grid.height_m)
    return np.where(planner.blocked, 100, np.where(seen, 0, -1))


def test_ros_says_of_every_cell_what_the_planner_says(tmp_path):
    simap = toy_map()
    files = export_map(simap, tmp_path / "toy.yaml")
    assert files == [tmp_path / "toy.yaml", tmp_path / "toy.pgm"]
    about, occupancy = served(files[0])
    planner = Planner(simap.grid)
    np.testing.assert_array_equal(occupancy, planner_sees(planner))
    assert set(np.unique(occupancy)) == {-1, 0, 100}
    assert about["resolution"] == 0.05 and about["origin"] == [-1.0, -2.0, 0.0]
    # a point of the drawing, found as ROS finds it: chair 3 in the south-west, the never-seen corner beyond it
    for (x, y), value in {(-0.3, -0.9): 100, (-0.8, -1.8): -1, (0.5, 0.5): 0, (2.0, 2.9): 100}.items():
        row, col = (int((v - o) / about["resolution"]) for v, o in zip((y, x), about["origin"][1::-1], strict=True))
        assert occupancy[row, col] == value, (x, y)


def test_the_picture_has_north_on_top(tmp_path):
    simap = map_from_drawing("#.\n..", cells=2)
    export_map(simap, tmp_path / "m.pgm")
    grey = np.array(Image.open(tmp_path / "m.pgm"))
    np.testing.assert_array_equal(grey, np.kron([[0, 254], [254, 254]], np.ones((2, 2))))


def test_grey_values_are_those_of_map_saver(tmp_path):
    grey = np.array(Image.open(export_map(toy_map(), tmp_path / "toy.yaml")[1]))
    assert set(np.unique(grey)) == {0, 205, 254}


def test_a_low_robot_drives_under_what_a_high_one_does_not(tmp_path):
    simap = toy_map()
    for height in (0.11, 1.5):
        robot = RobotShape(height_m=height)
        path = export_map(simap, tmp_path / f"m{height:.0f}", "ros", ExportOptions(robot=robot))[0]
        np.testing.assert_array_equal(served(path)[1], planner_sees(Planner(simap.grid, robot)))


@pytest.mark.parametrize("cell_size_m", [0.05, 0.1, 1e-5, 1 / 3])
def test_yaml_reads_back_the_very_numbers(tmp_path, cell_size_m):
    spec = GridSpec(2, 3, cell_size_m, -1e-7, 1234.56789012345)
    path = export_map(map_of_boxes(spec, ()), tmp_path / "a: b #c.yaml")[0]
    about, _ = served(path)
    assert (about["resolution"], about["origin"]) == (cell_size_m, [-1e-7, 1234.56789012345, 0.0])


def test_nav2_keepout_is_the_furniture_and_the_costmap_is_free_where_the_planner_is(tmp_path):
    simap = toy_map()
    robot = RobotShape(radius_m=0.23)
    planner = Planner(simap.grid, robot)
    files = export_map(simap, tmp_path / "toy", "nav2", ExportOptions(robot=robot))
    endings = [p.name.removeprefix("toy") for p in files]
    assert endings == [a + b for a in ("", "-keepout", "-costmap") for b in (".yaml", ".pgm")]
    np.testing.assert_array_equal(served(files[0])[1], planner_sees(planner))
    _, keepout = served(files[2])
    np.testing.assert_array_equal(keepout, np.where(simap.instance > 0, 100, 0))
    _, cost = served(files[4])
    seen = ~np.isnan(simap.grid.height_m)
    np.testing.assert_array_equal((cost >= 0) & (cost < 99), planner.free)
    np.testing.assert_array_equal(cost == 100, planner.blocked)
    np.testing.assert_array_equal(cost == -1, ~seen)


def test_costs_fall_with_distance_as_nav2_computes_them():
    simap = map_of_boxes(GridSpec(1, 40, 0.05, 0.0, 0.0), (), walls=())
    simap.grid.lowest_m[0, 0] = 0.5
    planner = Planner(simap.grid, RobotShape(radius_m=0.2))
    cost = inflated(planner)[0].astype(int)
    expected = [100]
    for col in range(1, 40):
        distance = col * 0.05 - 0.025
        nav2 = int(252 * np.exp(-10 * (distance - 0.2))) if 0.2 <= distance <= 0.55 else 0
        expected.append(99 if distance < 0.2 else 1 + 97 * (nav2 - 1) // 251 if nav2 else 0)
    assert cost.tolist() == expected


def test_a_map_without_obstacles_or_without_anything_seen(tmp_path):
    empty = map_of_boxes(TOY_SPEC, ())
    assert (served(export_map(empty, tmp_path / "e", "nav2")[4])[1] == 0).all()
    empty.grid.height_m[:] = np.nan
    for path in export_map(empty, tmp_path / "n", "nav2")[0::4]:
        assert (served(path)[1] == -1).all()
