"""`simaps check`: each way of spoiling a sequence is named, and repaired so that it is the clean one again."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from checked_sequences import (
    SHARED,
    Spoiling,
    _walk,
    drawn_room,
    read_poses,
    spoiled_copy,
    standing,
    tilted,
    turn,
)
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from simaps_viz.checking.agreement import Views, relative_poses, residuals
from simaps_viz.checking.recording import (
    OPENGL,
    ROS,
    Convention,
    Reading,
    conventions,
    in_views,
    load_views,
    neighbour_pairs,
    open_recording,
    signed_permutations,
)
from simaps_viz.checking.run import Diagnosis, _unit_without_motion, diagnose, draw, write_fixed
from simaps_viz.checking.search import likely_units
from simaps_viz.cli.main import main
from simaps_viz.datasets.open import open_sequence
from simaps_viz.drawing.sheet import save_png
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project, invert_pose, project, transform_points

pytestmark = pytest.mark.slow

EVERY = {"drawn room": 1, "hololens-breakroom": 6}
SOURCES = tuple(EVERY)
FOCAL_TOLERANCE, CENTRE_TOLERANCE, AGREEMENT_TOLERANCE = 0.01, 0.005, 0.01
"""A repaired camera is off by less than these shares of the focal length; agreement is that of the clean copy."""


def scaled(fx: float = 1, fy: float = 1, cx: float = 1, cy: float = 1) -> Spoiling:
    return Spoiling(camera=lambda K: K * np.array([[fx, 1, cx], [1, fy, cy], [1, 1, 1]]))


def moved(change: NDArray, *, inverse: bool = False) -> Spoiling:
    """Poses times a 4x4 matrix, perhaps inverted after."""
    return Spoiling(poses=lambda names, T: (names, np.linalg.inv(T @ change) if inverse else T @ change))


def dropped(names: list[str], T: NDArray) -> tuple[list[str], NDArray]:
    at = len(names) // 3
    return names[:at] + names[at + 1 :], T[:-1]


INVERTED = moved(np.eye(4), inverse=True)
SPOILED: dict[str, tuple[Spoiling, list[str]]] = {
    "clean": (Spoiling(), []),
    "inverted, y and z flipped": (moved(turn(OPENGL), inverse=True), ["inverted_poses", "camera_axes"]),
    "ROS axes": (moved(turn(np.transpose(ROS))), ["camera_axes"]),
    "values x0.1": (Spoiling(depth=lambda steps: steps // 10), ["depth_unit"]),
    "focal x1.15": (scaled(1.15, 1.15), ["intrinsics"]),
    "centre x1.15": (scaled(cx=1.15, cy=1.15), ["intrinsics"]),
    "matrix of a larger image": (scaled(2, 2, 2, 2), ["intrinsics"]),
    "shifted by one": (Spoiling(poses=lambda names, T: (names[:-1], T[1:])), ["frame_shift"]),
    "one dropped": (Spoiling(poses=dropped), ["dropped_frame"]),
    "mirrored world": (
        Spoiling(poses=lambda names, T: (names, turn([[1, 0, 0], [0, 0, 1], [0, 1, 0]]) @ T)), ["mirrored_world"],
    ),
    "three at once": (
        Spoiling(
            poses=lambda names, T: (names, np.linalg.inv(T)),
            camera=scaled(1.15, 1.15).camera,
            keys={"depth_unit_m": 1.0},
        ),
        ["inverted_poses", "depth_unit", "intrinsics"],
    ),
}  # fmt: skip


@pytest.fixture(scope="session")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn_room(tmp_path_factory.mktemp("room") / "room")


def source_of(name: str, room: Path) -> Path:
    if name == "drawn room":
        return room
    if not (SHARED / name).is_dir():
        pytest.skip("the sequences in ../shared/data are not here")
    return SHARED / name


_CLEAN: dict[str, Diagnosis] = {}


def clean(name: str, room: Path, tmp_path: Path) -> Diagnosis:
    if name not in _CLEAN:
        folder = spoiled_copy(source_of(name, room), tmp_path / "clean", Spoiling(), every=EVERY[name])
        _CLEAN[name] = diagnose(open_recording(folder))
    return _CLEAN[name]


def kinds(diagnosis: Diagnosis) -> list[str]:
    return [finding.kind for finding in diagnosis.findings if finding.severity == "error"]


def assert_repaired(fixed: Path, folder: Path, wanted: Diagnosis, unit_m: float) -> None:
    """The corrected manifest opens strictly, and holds the clean poses, camera, unit, up and floor."""
    sequence = open_sequence(fixed)
    poses = dict(zip(wanted.recording.names, wanted.recording.matrices, strict=True))
    assert len(sequence) >= len(read_poses(folder / "poses.txt")[0]) - 2
    for name, pose in zip(sequence.frame_names, sequence.poses, strict=True):
        np.testing.assert_allclose(pose, poses[name], atol=2e-5 * (1 + np.abs(poses[name]).max()))
    fx, fy, cx, cy = wanted.recording.camera
    k = sequence.intrinsics
    np.testing.assert_allclose([k.fx, k.fy], [fx, fy], rtol=FOCAL_TOLERANCE)
    np.testing.assert_allclose([k.cx, k.cy], [cx, cy], atol=CENTRE_TOLERANCE * fx)
    assert sequence.depth_unit_m == pytest.approx(unit_m)


CASES = {"drawn room": tuple(SPOILED), "hololens-breakroom": ("clean", "focal x1.15")}
"""What the sequences are spoiled by here: real depth is harder than what was drawn. All of it was tried on all."""


@pytest.mark.parametrize(("name", "case"), [(name, case) for name, cases in CASES.items() for case in cases])
def test_diagnosed_and_repaired(name: str, case: str, room: Path, tmp_path: Path) -> None:
    source = source_of(name, room)
    spoiling, expected = SPOILED[case]
    folder = spoiled_copy(source, tmp_path / "spoiled", spoiling, every=EVERY[name])
    diagnosis = diagnose(open_recording(folder)) if expected else clean(name, room, tmp_path)
    assert kinds(diagnosis) == expected
    assert diagnosis.ok == (not expected)
    assert (diagnosis.correction is not None) == bool(expected)
    if not expected:
        return
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    wanted = clean(name, room, tmp_path)
    assert diagnosis.after.share == pytest.approx(wanted.after.share, abs=0.025 if "dropped" in case else 0.01)
    fixed = write_fixed(diagnosis)
    assert fixed == folder / "sequence-fixed.json"
    if case == "one dropped":
        assert diagnosis.reading.shift_from == len(wanted.recording) // 3
        assert len(open_sequence(fixed)) == len(diagnosis.recording) - 1
    else:
        assert_repaired(fixed, folder, wanted, 0.01 if case == "values x0.1" else 0.001)
    for path, content in files.items():
        assert (folder / path).read_bytes() == content
    written = {path.name for path in folder.iterdir() if path.is_file()} - set(files)
    assert written <= {"sequence-fixed.json", "sequence-fixed-poses.txt", "sequence-fixed-intrinsics.txt"}


@pytest.mark.parametrize(("name", "degrees"), [(SOURCES[0], 180.0), (SOURCES[1], 10.0)])
def test_gravity_off_axis(name: str, degrees: float, room: Path, tmp_path: Path) -> None:
    keys = json.loads((source_of(name, room) / "sequence.json").read_text())
    spoiling = Spoiling(keys={"up": tilted(keys["up"], degrees)})
    folder = spoiled_copy(source_of(name, room), tmp_path / "spoiled", spoiling, every=EVERY[name])
    diagnosis = diagnose(open_recording(folder))
    assert kinds(diagnosis) == ["gravity"]
    fixed = json.loads(write_fixed(diagnosis).read_text())
    up = np.array(keys["up"], float)
    assert np.rad2deg(np.arccos(np.clip(np.array(fixed["up"]) @ up, -1, 1))) < 1.0
    assert fixed["floor_height_m"] == pytest.approx(keys["floor_height_m"], abs=0.03)


@pytest.mark.parametrize(
    "poses",
    [
        [standing((-1.0 + 0.05 * i, 0.5, 1.6), np.deg2rad(90 + 2 * np.sin(i)), 0.0) for i in range(24)],
        [standing((0.05 * i - 0.5, 0.0, 1.5), np.deg2rad(12 * i), np.deg2rad(-35)) for i in range(30)],
    ],
    ids=["nothing but a wall", "walls and the ceiling"],
)
def test_no_alarm_where_the_floor_was_never_seen(poses: list[NDArray], tmp_path: Path) -> None:
    diagnosis = diagnose(open_recording(drawn_room(tmp_path / "room", poses=poses)))
    assert diagnosis.ok and diagnosis.correction is None
    assert [finding.kind for finding in diagnosis.findings] == ["level_unjudged"]


def test_no_alarm_where_frames_hardly_overlap(room: Path, tmp_path: Path) -> None:
    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "few", Spoiling(), every=7)))
    assert diagnosis.ok and diagnosis.correction is None


def test_floor_at_another_height(room: Path, tmp_path: Path) -> None:
    diagnosis = diagnose(
        open_recording(spoiled_copy(room, tmp_path / "spoiled", Spoiling(keys={"floor_height_m": 0.3})))
    )
    assert kinds(diagnosis) == ["floor_height"]
    assert json.loads(write_fixed(diagnosis).read_text())["floor_height_m"] == pytest.approx(0, abs=0.03)


def test_gravity_and_floor_without_being_told(room: Path, tmp_path: Path) -> None:
    keys = json.loads((room / "sequence.json").read_text())
    silent = Spoiling(keys={"up": None, "floor_height_m": None})
    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "silent", silent)))
    assert diagnosis.ok and diagnosis.correction is None and diagnosis.level is not None
    assert np.rad2deg(np.arccos(np.clip(diagnosis.level.up @ np.array(keys["up"], float), -1, 1))) < 1.0
    assert diagnosis.level.floor_height_m == pytest.approx(keys["floor_height_m"], abs=0.03)


def drifting(names: list[str], T: NDArray) -> tuple[list[str], NDArray]:
    out = T.copy()
    for i in range(len(T)):
        angle = np.deg2rad(9) * i / len(T)
        c, s = np.cos(angle), np.sin(angle)
        out[i] = turn([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ T[i]
        out[i, :3, 3] += np.array([0.5, 0.4, 0]) * i / len(T)
    return names, out


@pytest.mark.parametrize(
    ("spoiling", "kind", "words"),
    [
        (Spoiling(poses=drifting), "drift", "visited again"),
        (Spoiling(depth=lambda steps: np.roll(steps, 9, axis=1)), "unregistered_depth", "pixels left"),
        (Spoiling(depth=lambda steps: cv2.resize(steps, (80, 60), interpolation=cv2.INTER_NEAREST)),
         "unregistered_depth", "80x60"),
        (Spoiling(poses=lambda names, T: (names, np.repeat(T[:1], len(T), axis=0))), "disagreement", "stands still"),
        (Spoiling(poses=lambda names, T: (names, T[::-1])), "disagreement", "no known mistake"),
    ],
)  # fmt: skip
def test_what_cannot_be_corrected(room: Path, tmp_path: Path, spoiling: Spoiling, kind: str, words: str) -> None:
    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "spoiled", spoiling)))
    found = [finding for finding in diagnosis.findings if finding.kind == kind]
    assert len(found) == 1 and words in found[0].message
    assert not diagnosis.ok and "intrinsics" not in kinds(diagnosis)
    if kind == "unregistered_depth":
        assert diagnosis.correction is None


def test_repeated_images_are_left_out(room: Path, tmp_path: Path) -> None:
    folder = spoiled_copy(room, tmp_path / "spoiled", Spoiling(depth=lambda steps: steps))
    (folder / "depth" / "020.png").write_bytes((folder / "depth" / "019.png").read_bytes())
    diagnosis = diagnose(open_recording(folder))
    assert kinds(diagnosis) == ["duplicate_frames"]
    assert "020" not in open_sequence(write_fixed(diagnosis)).frame_names


@pytest.mark.parametrize(("frames", "unit_m"), [(1, 0.001), (1, 1.0), (2, 0.001), (3, 1.0)])
def test_few_frames(room: Path, tmp_path: Path, frames: int, unit_m: float) -> None:
    """Too few to judge poses is no fault; a depth unit that no room has is one all the same."""
    spoiling = Spoiling(poses=lambda names, T: (names[:frames], T[:frames]), keys={"depth_unit_m": unit_m})
    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "few", spoiling)))
    assert kinds(diagnosis) == ([] if unit_m == 0.001 else ["depth_unit"])
    assert ("unjudged" in [f.kind for f in diagnosis.findings]) == (frames == 1)


def test_a_camera_that_only_turns_or_stands_still(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import checked_sequences  # noqa: PLC0415

    walk = checked_sequences._walk

    def turning(frames: int) -> list[NDArray]:
        poses = walk(frames)
        for pose in poses:
            pose[:3, 3] = poses[0][:3, 3]
        return poses

    monkeypatch.setattr(checked_sequences, "_walk", turning)
    folder = drawn_room(tmp_path / "turning", frames=20)
    assert diagnose(open_recording(folder)).ok
    spoiled = spoiled_copy(folder, tmp_path / "spoiled", Spoiling(keys={"depth_unit_m": 1.0}))
    assert kinds(diagnose(open_recording(spoiled))) == ["depth_unit"]
    monkeypatch.setattr(checked_sequences, "_walk", lambda frames: walk(frames)[:1] * frames)
    diagnosis = diagnose(open_recording(drawn_room(tmp_path / "still", frames=4)))
    assert diagnosis.ok and [f.kind for f in diagnosis.findings] == ["unjudged"]


@pytest.mark.parametrize(("share", "severity"), [(0.08, "warning"), (0.005, "error")])
def test_depth_of_few_pixels_is_not_called_wrong_poses(room: Path, tmp_path: Path, share: float, severity: str) -> None:
    """A LiDAR's depth has some pixels in a hundred, the points of a reconstruction fewer than one."""

    def thinned(steps: NDArray) -> NDArray:
        return np.where(np.random.default_rng(0).random(steps.shape) < share, steps, 0).astype(steps.dtype)

    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "spoiled", Spoiling(depth=thinned))))
    found = [finding for finding in diagnosis.findings if "of the pixels have depth" in finding.message]
    assert [(finding.kind, finding.severity) for finding in found] == [("unjudged", severity)]
    assert "disagreement" not in kinds(diagnosis) and diagnosis.correction is None


def test_of_the_units_that_make_a_room_the_one_that_frames_agree_with_is_taken(room, tmp_path) -> None:
    """TUM's fr1/rpy hardly moves: the first that makes a room of it, 1 mm, agrees nearly as well as its own 0.2 mm."""
    spoiling = Spoiling(depth=lambda steps: steps * 2, keys={"depth_unit_m": 0.5})
    recording = open_recording(spoiled_copy(room, tmp_path / "spoiled", spoiling))
    frames = neighbour_pairs(recording.matrices)
    views = load_views(recording, np.unique(frames), lambda *_: None)
    assert likely_units(views, 0.5)[0] == 0.001
    found = _unit_without_motion(recording, views, in_views(views, frames), Reading())
    assert found.unit_m(recording) == pytest.approx(0.0005)


@pytest.mark.parametrize(("least", "found"), [(0.8, ["camera_axes", "gravity"]), (1.01, ["disagreement"])])
def test_other_axes_that_put_the_stated_up_on_its_head_have_to_agree(room, tmp_path, monkeypatch, least, found) -> None:
    """Poses in reverse look like those of a camera upside down, as far as neighbouring frames can tell (64 %)."""
    monkeypatch.setattr("simaps_viz.checking.run.ON_ITS_HEAD", least)
    spoiling = Spoiling(poses=moved(turn(OPENGL)).poses, keys={"up": [0, 0, -1], "floor_height_m": None})
    assert kinds(diagnose(open_recording(spoiled_copy(room, tmp_path / "spoiled", spoiling)))) == found


def test_residuals_are_those_of_plain_geometry() -> None:
    """The fast kernel against projection one point at a time, on a plane seen from two places."""
    camera = (100.0, 90.0, 31.0, 22.0)
    rng = np.random.default_rng(3)
    steps = np.round(1000 * (2 + 0.3 * np.linspace(0, 1, 48)[:, None] + 0.2 * np.linspace(0, 1, 64)[None])).astype(
        np.uint16
    )
    steps[10:14, 20:30] = 0
    pixels = np.stack([rng.integers(0, 64, 300), rng.integers(0, 48, 300)], axis=1).astype(np.int32)
    pixels[7] = -1
    views = Views(np.array([0, 1]), np.stack([steps, steps]), 1, np.stack([pixels, pixels]))
    poses = np.stack([np.eye(4), turn(cv2.Rodrigues(np.array([0.02, -0.06, 0.01]))[0])])
    poses[1, :3, 3] = 0.1, 0.05, -0.02
    pairs = np.array([[0, 1]])
    T = relative_poses(poses, views.frames, pairs)
    np.testing.assert_allclose(T[0], invert_pose(poses[1]) @ poses[0], atol=1e-12)
    found = residuals(views, pairs, T, np.array(camera), 0.001)[0]
    points = transform_points(T[0], back_project(steps / 1000, *camera))
    for index, (u, v) in enumerate(pixels):
        if u < 0:
            assert np.isnan(found[index])
            continue
        column, row = project(points[v, u], *camera)
        if not (0 <= column < 63 and 0 <= row < 47):
            assert np.isinf(found[index])
            continue
        c, r = int(column), int(row)
        corners = steps[r : r + 2, c : c + 2] / 1000
        if not corners.all():
            assert np.isinf(found[index])
            continue
        du, dv = column - c, row - r
        measured = np.array([1 - dv, dv]) @ corners @ np.array([1 - du, du])
        if steps[v, u]:
            assert found[index] == pytest.approx((points[v, u, 2] - measured) / measured, abs=1e-5)


def test_every_convention_is_undone_by_its_own_reading() -> None:
    """Each way of writing can be told from the others: applied to poses written that way it gives them back."""
    pose = turn(cv2.Rodrigues(np.array([0.3, -0.5, 0.9]))[0])
    pose[:3, 3] = 0.4, -1.2, 2.0
    assert len(signed_permutations(1)) == len(signed_permutations(-1)) == 24
    written = {
        Convention(): pose,
        Convention("world-to-camera"): np.linalg.inv(pose),
        Convention(axes=OPENGL): pose @ np.linalg.inv(turn(OPENGL)),
        Convention("world-to-camera", ROS): np.linalg.inv(pose @ np.linalg.inv(turn(ROS))),
    }
    for convention, matrix in written.items():
        np.testing.assert_allclose(convention.apply(matrix[None])[0], pose, atol=1e-12)
    for mirrored in (False, True):
        ways = conventions(mirrored=mirrored)
        assert len(set(ways)) == len(ways)
        rotations = np.stack([way.apply((pose @ np.diag([1, 1, -1.0 if mirrored else 1, 1]))[None])[0] for way in ways])
        np.testing.assert_allclose(np.linalg.det(rotations[:, :3, :3]), 1, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("000 1 0 0", "line 1, frame 000: expected 16 numbers, found 3"),
        ("000 " + "1 " * 16, "expected an orthonormal rotation"),
        ("000 1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1", "expected finite numbers"),
        ("000 1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1", "column by column"),
        ("", "expected a pose per frame"),
    ],
)
def test_what_cannot_be_worked_with(room: Path, tmp_path: Path, content: str, message: str) -> None:
    folder = spoiled_copy(room, tmp_path / "spoiled", Spoiling())
    (folder / "poses.txt").write_text(content)
    with pytest.raises(InputError, match=message):
        open_recording(folder)


def as_written(text: str) -> list[str]:
    """The lines of a pose file, of millimetres: positions are for the check to judge, not a camera far away."""
    rows = [line.split() for line in text.splitlines()]
    for one in rows:
        one[4::4] = [f"{float(value) * 1e6:g}" for value in one[4:13:4]] + one[16:]
    return [" ".join(one) for one in rows]


DAMAGED = {
    "cut off": (lambda name, numbers: f"{name} {numbers[:20]}", "16 numbers"),
    "no rotation": (lambda name, _: name + " 7" * 16, "orthonormal"),
    "NaN": (lambda name, _: name + " nan" * 16, "finite numbers"),
    "no picture": (lambda name, numbers: f"{name}-later {numbers}", "colour file"),
}


@pytest.mark.parametrize("kind", DAMAGED)
def test_one_bad_item_costs_one_frame(kind: str, room: Path, tmp_path: Path, capsys) -> None:
    change, words = DAMAGED[kind]
    folder = spoiled_copy(room, tmp_path / "spoiled", Spoiling())
    whole = open_recording(folder)
    rows = as_written((folder / "poses.txt").read_text())
    (folder / "poses.txt").write_text("\n".join([rows[0], change(*rows[1].split(" ", 1)), *rows[2:]]))
    found = open_recording(folder)
    assert found.names == (whole.names[0], *whole.names[2:])
    assert words in found.notes[0] and f"1 of {len(whole)}" in found.notes[0]
    np.testing.assert_allclose(found.matrices[:, :3, :3], np.delete(whole.matrices, 1, axis=0)[:, :3, :3], atol=1e-9)
    main(["check", str(folder)])
    assert f"note: {found.notes[0]}" in capsys.readouterr().out


def run_json(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    status = main(arguments)
    return status, json.loads(capsys.readouterr().out)


def test_command_line(room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = spoiled_copy(room, tmp_path / "spoiled", INVERTED)
    picture = tmp_path / "evidence.png"
    status, record = run_json(["check", str(folder), "--json", "--fix", "--picture", str(picture)], capsys)
    assert status == 1 and record["ok"] is False
    assert [finding["kind"] for finding in record["findings"]] == ["inverted_poses"]
    assert "world-to-camera" in record["findings"][0]["message"]
    assert record["correction"]["written"] == str(folder / "sequence-fixed.json")
    image = cv2.imread(str(picture))
    assert image is not None and image.shape[1] == 1500
    assert main(["check", str(folder)]) == 1
    assert "Write it with --fix" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "nowhere")]) == 2
    assert main(["check", str(folder), "--picture", "evidence.txt"]) == 2


def test_nothing_half_written(room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = spoiled_copy(room, tmp_path / "spoiled", INVERTED, every=2)
    diagnosis = diagnose(open_recording(folder))
    before = sorted(path.name for path in folder.iterdir())

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(InputError, match="could not write the correction: No space left"):
        write_fixed(diagnosis)
    with pytest.raises(InputError, match="could not write the picture"):
        save_png(draw(diagnosis), folder / "evidence.png")
    assert sorted(path.name for path in folder.iterdir()) == before


def as_tum(source: Path, folder: Path, poses: NDArray) -> Path:
    """Write a drawn room as a TUM recording, thirty frames a second, with these poses."""
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for index, pose in enumerate(poses):
        time, name = f"{100 + index / 30:.6f}", f"{index:03d}"
        for kind, images, factor in (("rgb", "color", 1), ("depth", "depth", 5)):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            image = cv2.imread(str(source / images / f"{name}.png"), cv2.IMREAD_UNCHANGED)
            assert image is not None
            cv2.imwrite(str(folder / kind / f"{time}.png"), image * factor)
            lists[kind].append(f"{time} {kind}/{time}.png")
        numbers = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
        lists["groundtruth"].append(f"{time} " + " ".join(f"{x:.9f}" for x in numbers))
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text("\n".join(lines))
    (folder / "intrinsics.txt").write_bytes((source / "intrinsics.txt").read_bytes())
    return folder


def test_other_formats_are_read_and_repaired_as_they_are(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = read_poses(room / "poses.txt")[1]
    folder = as_tum(room, tmp_path / "inverted", np.linalg.inv(poses))
    before = sorted(tmp_path.rglob("*"))
    status, record = run_json(["check", str(folder), "--json", "--fix"], capsys)
    assert status == 1 and [finding["kind"] for finding in record["findings"]] == ["inverted_poses"]
    assert record["frames"] == len(poses)
    written = Path(record["correction"]["written"])
    assert written == tmp_path / "inverted-fixed" / "sequence.json"
    assert sorted(path for path in tmp_path.rglob("*") if written.parent not in (path, *path.parents)) == before
    fixed = open_sequence(written)
    np.testing.assert_allclose(fixed.poses, poses, atol=1e-6)
    np.testing.assert_allclose(fixed.read(7).depth_m, open_sequence(room).read(7).depth_m, rtol=1e-6)
    np.testing.assert_allclose(fixed.T_map_world, open_sequence(room).T_map_world, atol=0.03)


def test_poses_that_come_a_fraction_of_a_frame_early_are_interpolated(tmp_path: Path) -> None:
    frames, early = 60, 0.4
    room = drawn_room(tmp_path / "room", frames=frames)
    right = read_poses(room / "poses.txt")[1]
    folder = as_tum(room, tmp_path / "early", np.stack(_walk(frames, later=early)))
    diagnosis = diagnose(open_recording(folder))
    assert diagnosis.ok and diagnosis.correction is not None
    (finding,) = diagnosis.findings
    assert (finding.kind, finding.severity) == ("time_offset", "warning")
    assert finding.measure["shift_ms"] == pytest.approx(-1000 * early / 30, abs=3)
    assert f"Poses come {-finding.measure['shift_ms']:.0f} ms too early for their images" in finding.message
    fixed = open_sequence(write_fixed(diagnosis))
    index = [round((float(name) - 100) * 30) for name in fixed.frame_names]
    off_m, was_off_m = (
        np.linalg.norm(poses[:, :3, 3] - right[index][:, :3, 3], axis=1).mean()
        for poses in (fixed.poses, np.stack(_walk(frames, later=early))[index])
    )
    assert len(fixed) >= frames - 2 and off_m < 0.25 * was_off_m


def test_no_alarm_for_people_who_walk_through_the_picture(room: Path, tmp_path: Path) -> None:
    shown = iter(range(1000))

    def with_person(steps: NDArray) -> NDArray:
        left = 20 * next(shown) % 130
        steps = steps.copy()
        steps[20:, left : left + 30] = np.minimum(steps[20:, left : left + 30], 900)
        return steps

    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "people", Spoiling(depth=with_person))))
    assert kinds(diagnosis) == [] and diagnosis.correction is None


def test_no_alarm_for_a_camera_matrix_that_is_nearly_right(room: Path, tmp_path: Path) -> None:
    diagnosis = diagnose(open_recording(spoiled_copy(room, tmp_path / "nearly", scaled(1.015, 1.015))))
    assert diagnosis.ok and diagnosis.correction is None
