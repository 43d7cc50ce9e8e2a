"""apps/render_habitat.py with a fake of habitat_sim: what it writes is read, and is what the scene is."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import fake_habitat
import numpy as np
import pytest
import render_habitat
from scans import FRAMES, GL, LABELS, Y_UP, look, map_pose, quaternion, row
from scipy.spatial.transform import Rotation

from simaps_viz import open_sequence
from simaps_viz.cli import main
from simaps_viz.geometry import invert_pose
from simaps_viz.structures import Intrinsics

SCRIPT = Path(render_habitat.__file__)
K = Intrinsics(64, 48, 32.0, 32.0, 31.5, 23.5)
LIFTED = np.eye(4)
LIFTED[1, 3] = 3.0


def base_line(i, T=None):
    """Return a line of VLMaps' poses.txt: base below a camera that looks along -z."""
    T_base_camera = GL.copy()
    T_base_camera[1, 3] = 1.5
    T_world_base = (Y_UP.pose(i) if T is None else T) @ invert_pose(T_base_camera)
    return "\t".join(repr(float(x)) for x in [*T_world_base[:3, 3], *quaternion(T_world_base)])


def camera_line(i):
    """Return a line of HOV-SG's file: the camera's matrix."""
    return row(Y_UP.pose(i) @ GL).replace(" ", "\t")


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "5LpN3gDmAk7.glb").touch()
    (tmp_path / "poses.txt").write_text("\n".join(base_line(i) for i in range(FRAMES)))
    return tmp_path


def render(scene, monkeypatch, *words, made=fake_habitat.matterport, poses="poses.txt"):
    fake, simulators = fake_habitat.module(made)
    monkeypatch.setitem(sys.modules, "habitat_sim", fake)
    line = [str(scene / "5LpN3gDmAk7.glb"), "--poses", str(scene / poses), "--out", str(scene / "out")]
    status = render_habitat.main([*line, "--size", "64", "48", *words])
    assert all(one.closed for one in simulators)
    return status, sum(one.renders for one in simulators)


def check_frames(folder, frames=range(FRAMES)):
    sequence = open_sequence(folder)
    assert len(sequence) == len(frames) and sequence.ground_truth and sequence.simulated
    assert sequence.intrinsics == K and sequence.notes == ()
    for at, i in enumerate(frames):
        depth_m, ids = look(K, map_pose(i))
        assert np.allclose(sequence.poses[at], Y_UP.pose(i), atol=1e-6)
        frame, segmentation = sequence.read(at), sequence.segmentation(at)
        assert np.abs(frame.depth_m - depth_m).max() <= 0.0005 + 1e-6
        labels = {one.id: one.label for one in segmentation.segments}
        for number, label in LABELS.items():
            found = set(np.unique(segmentation.ids[ids == number]))
            assert len(found) == 1 and labels[found.pop()] == label
        assert not segmentation.ids[ids == 0].any()
    return sequence


def test_published_poses_of_both_layouts_give_the_same_exact_frames(scene, monkeypatch):
    assert render(scene, monkeypatch) == (0, FRAMES)
    sequence = check_frames(scene / "out")
    assert np.allclose(sequence.T_map_world @ sequence.poses[0], map_pose(0), atol=0.01)
    written = json.loads((scene / "out/scene.json").read_text())
    assert [one["id"] for one in written["instances"]] == [1, 2, 3]  # Habitat's ids from 0, and 0 is nothing
    assert written["instances"][0] == {
        "id": 1, "label": "chair", "habitat_id": "1_1_0", "region": "1_1", "level": "1",
        "aabb_min": [-0.5, 0.3, -0.5], "aabb_max": [0.5, 0.8, 0.5],
    }  # fmt: skip
    assert written["regions"][0]["label"] == "kitchen" and len(written["levels"]) == 2

    (scene / "walk.txt").write_text("\n".join(camera_line(i) for i in range(FRAMES)))
    (scene / "pose").mkdir()
    for i in range(FRAMES):
        (scene / f"pose/Dd4_{i:06d}.txt").write_text(camera_line(i) + "\n")
    for poses in ("walk.txt", "pose"):
        out = scene / f"out-{poses}"
        assert render(scene, monkeypatch, "--out", str(out), made=fake_habitat.hm3d, poses=poses) == (0, FRAMES)
        check_frames(out)
    assert open_sequence(out).frame_names[0] == "Dd4_000000"
    assert json.loads((out / "scene.json").read_text())["instances"][0]["habitat_id"] == "chair_1"


def test_what_is_written_can_be_checked_built_and_scored(scene, monkeypatch, capsys):
    assert render(scene, monkeypatch) == (0, FRAMES)
    capsys.readouterr()
    assert main.main(["check", str(scene / "out"), "--json"]) in (0, 1)  # four frames are few; it has to read them
    assert json.loads(capsys.readouterr().out)["frames"] == FRAMES
    assert main.main(["build", str(scene / "out"), "-o", str(scene / "m.npz"), "--json"]) == 0
    capsys.readouterr()
    line = ["evaluate", str(scene / "out"), "--methods", "evidence", "--errors", "none", "--json"]
    assert main.main(line) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [(one["mean"]["true"], one["mean"]["matched"]) for one in rows] == [(2, 2)]


def test_storeys_have_a_manifest_each(scene, monkeypatch, capsys):
    lines = [base_line(i) for i in range(FRAMES)] + [base_line(0, LIFTED @ Y_UP.pose(0))]
    (scene / "poses.txt").write_text("\n".join(lines))
    assert render(scene, monkeypatch, made=fake_habitat.hm3d)[0] == 0
    assert "--levels" in capsys.readouterr().err and not list((scene / "out").glob("level-*"))
    assert render(scene, monkeypatch, "--levels", "-0.2", "3.1", "6", made=fake_habitat.hm3d) == (0, 0)
    check_frames(scene / "out/level-0.json")
    upper = json.loads((scene / "out/level-1.json").read_text())
    assert (scene / "out" / upper["poses"]).read_text().count("\n") == 1
    assert json.loads((scene / "out/scene.json").read_text())["instances"][0]["level"] == "0"
    assert render(scene, monkeypatch, "--out", str(scene / "mp3d"))[0] == 0  # there the upper level is called 0
    check_frames(scene / "mp3d/level-1.json")
    assert (scene / "mp3d/poses-level-0.txt").read_text().count("\n") == 1


def test_ctrl_c_and_the_same_command_again(scene, monkeypatch, capsys):
    drawn = fake_habitat.Simulator.get_sensor_observations

    def stops(self):
        if self.renders == 2:
            raise KeyboardInterrupt
        return drawn(self)

    with monkeypatch.context() as patched:
        patched.setattr(fake_habitat.Simulator, "get_sensor_observations", stops)
        assert render(scene, patched) == (130, 2)
    assert "the same command resumes" in capsys.readouterr().err
    assert not (scene / "out/sequence.json").exists()  # nothing half done is offered as a sequence
    assert render(scene, monkeypatch) == (0, FRAMES - 2)
    check_frames(scene / "out")
    assert render(scene, monkeypatch, "--hfov", "79") == (2, 0)
    assert "render.json: expected a folder of these settings" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 2 3\n", "poses.txt, line 1: expected 7 (x y z, quaternion x y z w) or 16 (4x4) finite numbers, found 3"),
        ("0 0 0 0 0 0 1\n0 0 0 0 0 0 2\n", "poses.txt, line 2: expected a quaternion of length 1, found 2"),
        ("0 0 0 0 0 0 nan", "found 7: '0 0 0 0 0 0 nan'"),
        ("a b c d e f g", "poses.txt, line 1: expected numbers, found 'a b c d e f g'"),
        (" ".join("2000020000200001"), "expected a rotation and 0 0 0 1 in the matrix"),
        ("\n\n", "poses.txt: expected a pose on each line, found no line"),
    ],
)
def test_a_wrong_pose_file_is_named_with_its_line(scene, monkeypatch, capsys, text, said):
    (scene / "poses.txt").write_text(text)
    assert render(scene, monkeypatch) == (2, 0)
    assert said in capsys.readouterr().err and not (scene / "out").exists()


def nobody_annotated():
    made, offset = fake_habitat.hm3d()
    made.objects = made.objects[:1]
    return made, offset


def test_scenes_without_annotation_and_missing_programs_are_told_what_to_do(scene, monkeypatch, capsys):
    assert render(scene, monkeypatch, made=nobody_annotated) == (2, 0)
    assert "--dataset-config" in capsys.readouterr().err
    assert render(scene, monkeypatch, "--dataset-config", str(scene / "no.json")) == (2, 0)
    assert "no.json: expected a file, found nothing" in capsys.readouterr().err
    line = [sys.executable, str(SCRIPT), str(scene / "5LpN3gDmAk7.glb"), "--poses", str(scene / "poses.txt")]
    run = subprocess.run([*line, "--out", str(scene / "o")], capture_output=True, text=True, check=False, cwd=scene)
    assert run.returncode == 2 and "conda create -n habitat" in run.stderr and "Traceback" not in run.stderr


def test_it_stands_alone_and_runs_on_habitats_python():
    tree = ast.parse(SCRIPT.read_text(), feature_version=(3, 9))
    imported = {a.name for node in ast.walk(tree) if isinstance(node, ast.Import) for a in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in imported} - set(sys.stdlib_module_names) == {"numpy", "PIL"}


def test_quaternions_are_those_of_their_matrices():
    turns = [*Rotation.random(50), *Rotation.from_rotvec(np.pi * np.eye(3)), Rotation.identity()]
    for turn in turns:
        again = Rotation.from_quat(render_habitat.quaternion(turn.as_matrix()))
        assert np.allclose(again.as_matrix(), turn.as_matrix(), atol=1e-9)
