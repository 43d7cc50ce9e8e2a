"""`export_map` and `simaps export`: which format, which files, all or none; and the trajectory."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from toy_maps import TOY_POSE, toy_map

from simaps_viz import CommandError, ExportOptions, InputError, Pose2, RobotShape, export_map, plan, save_map
from simaps_viz.cli.main import main
from simaps_viz.exports.exporter import Exporter
from simaps_viz.exports.formats import EXPORTERS, choose_format
from simaps_viz.exports.trajectory import driven_poses
from simaps_viz.navigation.planner import Planner
from simaps_viz.structures import SIMap

COMMAND = ExportOptions(command="go to the couch", pose=TOY_POSE)


@pytest.fixture
def saved(tmp_path):
    save_map(toy_map(), tmp_path / "toy.npz")
    return tmp_path / "toy.npz"


@pytest.mark.parametrize(
    ("name", "expected"),
    [("a.yaml", "ros"), ("a.pgm", "ros"), ("a.geojson", "geojson"), ("a.csv", "csv"), ("a.glb", "glb"),
     ("a.ply", "ply"), ("a.graphml", "graphml"), ("a.tum", "tum")],
)  # fmt: skip
def test_the_ending_tells_the_format(tmp_path, name, expected):
    assert choose_format(tmp_path / name) == expected


@pytest.mark.parametrize(
    ("name", "format", "words"),
    [("a.json", None, r"\.json, which may be geojson or coco or spark-dsg"), ("a", None, "no ending"),
     ("a.obj", None, r"\.obj"), ("a.png", "glb", r"\.glb for glb, found \.png"), ("a.glb", "gltf", "'gltf'")],
)  # fmt: skip
def test_what_does_not_tell_is_refused(tmp_path, name, format, words):
    with pytest.raises(InputError, match=words):
        export_map(toy_map(), tmp_path / name, format)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("format", EXPORTERS)
def test_every_format_twice_gives_the_same_bytes_and_nothing_else(tmp_path, format):
    options = COMMAND if format == "tum" else None
    contents = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        files = export_map(toy_map(), tmp_path / folder / "toy", format, options)
        assert sorted(files) == sorted((tmp_path / folder).iterdir())
        assert files[0].name == "toy" + EXPORTERS[format].endings[0]
        contents.append([path.read_bytes() for path in files])
    assert contents[0] == contents[1]


@pytest.mark.parametrize(
    ("format", "options"),
    [("glb", ExportOptions(label="chair")), ("csv", COMMAND), ("ros", ExportOptions(label="chair")), ("tum", None)],
)
def test_options_of_other_formats_are_refused(tmp_path, format, options):
    with pytest.raises(InputError, match=f"^{format}: expected"):
        export_map(toy_map(), tmp_path / "a", format, options)


class Sizes(Exporter):
    """A format that no release has: the size of each instance."""

    endings = (".sizes",)
    own_endings = (".sizes",)

    def files(self, simap: SIMap, path: Path, options: ExportOptions) -> dict[Path, bytes]:
        return {path: "\n".join(f"{one.label} {one.cells}" for one in simap.instances).encode()}


def test_a_new_format_is_one_object_in_the_registry(tmp_path, monkeypatch):
    monkeypatch.setitem(EXPORTERS, "sizes", Sizes())
    simap = toy_map()
    (path,) = export_map(simap, tmp_path / "toy.sizes")
    assert path.read_text().splitlines() == [f"{one.label} {one.cells}" for one in simap.instances]
    assert export_map(simap, tmp_path / "other", "sizes") == [tmp_path / "other.sizes"]
    with pytest.raises(InputError, match=r"^sizes: expected no class"):
        export_map(simap, tmp_path / "third", "sizes", ExportOptions(label="chair"))


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / "m.pgm").mkdir()
    with pytest.raises(InputError, match=r"m\.pgm: expected a file name to write, found a folder"):
        export_map(toy_map(), tmp_path / "m.yaml")
    assert [p.name for p in tmp_path.iterdir()] == ["m.pgm"]
    with pytest.raises(InputError, match="expected a folder to write in"):
        export_map(toy_map(), tmp_path / "nowhere" / "m.yaml")


def test_the_trajectory_is_the_planned_way(tmp_path):
    simap = toy_map()
    (path,) = export_map(simap, tmp_path / "a.tum", options=COMMAND)
    time, x, y, z, qx, qy, qz, qw = np.loadtxt(path).T
    np.testing.assert_allclose(np.diff(time), 0.05, atol=1e-5)
    assert (z == 0).all() and (qx == 0).all() and (qy == 0).all()
    np.testing.assert_allclose(qz**2 + qw**2, 1.0, atol=1e-8)
    assert (x[0], y[0]) == pytest.approx((TOY_POSE.x_m, TOY_POSE.y_m), abs=1e-6)
    steps = np.hypot(np.diff(x), np.diff(y))
    assert steps.max() <= 0.8 * 0.05 + 1e-5
    way = plan(simap, TOY_POSE, simap.of_class("couch")[0])
    assert steps.sum() >= way.length_m - 0.3
    planner = Planner(simap.grid)
    assert all(planner.free[simap.spec.cell_of(a, b)] for a, b in zip(x, y, strict=True))
    ahead = steps > 1e-4  # it drives the way it looks
    yaw = 2 * np.arctan2(qz, qw)
    np.testing.assert_allclose(np.diff(x)[ahead], steps[ahead] * np.cos(yaw[1:][ahead]), atol=1e-5)
    np.testing.assert_allclose(np.diff(y)[ahead], steps[ahead] * np.sin(yaw[1:][ahead]), atol=1e-5)


def test_a_trajectory_of_several_statements_goes_on_where_the_last_ended():
    poses = driven_poses(toy_map(), "robot.turn(90)\nrobot.turn(90)\nrobot.turn(-180)", Pose2(0.5, 0.5, 0.0))
    assert np.unique(poses[:, 1:3], axis=0).tolist() == [[0.5, 0.5]] and poses[-1, 3] == pytest.approx(0.0)
    assert (np.abs(np.diff(poses[:, 3])) > 0).all() and poses[1, 0] == 0.05


@pytest.mark.parametrize(("command", "words"), [("go to the piano", "no piano"), ("robot.turn(0)", "leaves it")])
def test_a_refused_trajectory_writes_nothing(tmp_path, command, words):
    with pytest.raises(CommandError, match=words):
        export_map(toy_map(), tmp_path / "a.tum", options=ExportOptions(command=command, pose=TOY_POSE))
    assert not list(tmp_path.iterdir())


def test_cli_writes_and_says_what(saved, tmp_path, capsys):
    out = tmp_path / "toy.yaml"
    assert main(["export", str(saved), "-o", str(out), "--format", "nav2", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["format"] == "nav2" and said["files"][0] == str(out) and len(said["files"]) == 6
    assert all(os.path.isfile(path) for path in said["files"])
    assert main(["export", str(saved), "-o", str(tmp_path / "toy.geojson")]) == 0
    captured = capsys.readouterr()
    assert captured.out == "" and f"geojson: wrote {tmp_path / 'toy.geojson'}" in captured.err.replace("\n", "")


def test_cli_trajectory_class_and_robot(saved, tmp_path, capsys):
    base = ["export", str(saved), "-o"]
    assert main([*base, str(tmp_path / "a.txt"), "--trajectory", "go to the couch", "--pose", "0.5", "0.5", "90"]) == 0
    assert (tmp_path / "a.txt").read_text().splitlines()[2].startswith("0.000000 0.500000 0.500000 0.000000 0 0 0.0")
    assert main([*base, str(tmp_path / "a.graphml"), "--class", "couch"]) == 0
    assert "chair" not in (tmp_path / "a.graphml").read_text()
    assert main([*base, str(tmp_path / "a.yaml"), "--robot-height", "0.11"]) == 0
    low = export_map(toy_map(), tmp_path / "b.yaml", options=ExportOptions(robot=RobotShape(height_m=0.11)))
    assert (tmp_path / "a.pgm").read_bytes() == low[1].read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "x.json"], "coco or spark-dsg"),
        (["-o", "x.glb", "--points"], "expected the sequence it was built from at toy"),
        (["-o", "x.tum"], "--trajectory"),
        (["-o", "x.tum", "--trajectory", "go to the piano"], "There is no piano"),
        (["-o", "x.yaml", "--robot-radius", "-1"], "robot radius_m"),
    ],
)
def test_cli_faults_are_one_line_with_status_2(saved, tmp_path, monkeypatch, arguments, words, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(saved), *arguments]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if line.strip()]
    assert len(lines) == 1 and lines[0].startswith("simaps: ") and words in lines[0]
    assert [p.name for p in tmp_path.iterdir()] == ["toy.npz"]
