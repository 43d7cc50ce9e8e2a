"""Read TUM RGB-D recordings (https://cvg.cit.tum.de/data/datasets/rgbd-dataset) and folders in their layout.

Colour and depth come at their own times and poses at a hundred a second: each depth image takes the nearest colour
image and the pose interpolated to its own time. Depth is registered to colour already, lens distortion included, so
both are undistorted alike.

People who record for RGB-D SLAM have the same lists, but a trajectory of their own, such as ORB-SLAM saves. Colour and
depth are paired by a list of both (``associations.txt``, as TUM's associate.py prints it), else by the two lists. The
world is the first camera's, so up is estimated. Where there is no list, a trajectory without times (``pose.txt`` or
``poses.txt``: seven numbers a line, as in slambook's examples, or a matrix, as in DeepVideoMVS's) has a line for each
picture. All these folders have to hold their camera.
"""

import os
import re
from pathlib import Path
from statistics import mode

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import interpolate_poses, match_frames, posed_pairs, read_lines, read_trajectory
from simaps_viz.datasets.calibration import (
    Lens,
    from_quaternion,
    nearest_rotation,
    number_rows,
    numbers,
    pinhole,
    read_intrinsics,
    rigid,
    words,
)
from simaps_viz.datasets.file_frames import FileFrames, by_line, depth_png, number_of, numbered, present
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.manifest import few
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, first_readable, left_out
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_TEXT_BYTES, read_bytes

DEPTH_UNIT_M = 1 / 5000
TUM = FormatFacts(
    title="TUM RGB-D",
    recognised_by="`rgb.txt`, `depth.txt`, `groundtruth.txt`",
    depth_unit_m=DEPTH_UNIT_M,
    pose="camera to world: time, position, quaternion x y z w",
    up=(0.0, 0.0, 1.0),
)
SLAM = FormatFacts(
    title="RGB-D SLAM folder",
    recognised_by="`associations.txt`, or `rgb.txt`, `depth.txt`; with `CameraTrajectory.txt` or another trajectory; "
    "or `pose.txt` or `poses.txt`, `depth/`, `color/` or `rgb/` or `images/`",
    depth="16-bit PNG or PGM",
    depth_unit_m=DEPTH_UNIT_M,
    pose=TUM.pose,
)
NUMBERED, NUMBERED_UNIT_M = ("pose.txt", "poses.txt"), 0.001
"""Names of the trajectory without times, a line for each picture, and the unit of depth that goes with it."""
NUMBERED_COLUMNS = (7, 12, 16)
"""Numbers in its lines: position and quaternion, or three or four rows of a matrix."""
NAMED_COLUMNS = 17
"""Words in the lines of posed-frames/1: a frame's name and a matrix. Without a manifest it is no recording."""
PICTURES, DEPTH_IMAGES = ("color", "rgb", "images"), "*.p[ng][gm]"
MATRICES = ("intrinsics.txt", "intrinsic.txt", "K.txt")
LISTS = ("associations.txt", "*assoc*.txt", "rgb-depth*.txt")
"""Names that people give what associate.py prints; the first that is there counts."""
ICL = ".gt.freiburg"
"""How ICL-NUIM's trajectories end, whose world is left-handed."""
ICL_FLIP = np.diag([1.0, -1.0, 1.0, 1.0])
TRAJECTORIES = ("groundtruth.txt", "CameraTrajectory.txt", "KeyFrameTrajectory.txt", "trajectory.txt", f"*{ICL}")
NANOSECONDS = 1e11
"""Times from there on are no seconds: ORB-SLAM3 saves nanoseconds as EuRoC has them."""
FEW_LINES = 20
"""Lines by which a trajectory of another name is known."""
COLOR_TOLERANCE_S = 0.02
"""Colour farther than this from a depth image is not its colour."""
MAX_POSE_GAP_S = 0.2


BONN = "rgbd_bonn"
BONN_WORLD = np.array([[-1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
BONN_CAMERA = np.eye(4)
BONN_CAMERA[:3, :3] = nearest_rotation(
    np.array([[1.0157, 0.1828, -0.2389], [0.0009, -0.8431, -0.6413], [-0.3009, 0.6147, -0.8085]])
)
BONN_CAMERA[:3, 3] = 0.0113, -0.0098, 0.0111
"""From the motion capture's axes to its world's, and from the camera to the markers, as Bonn's page has them.

The latter also scales by 1.059 there, which poses do not need.
"""
BONN_NOTE = "poses are of markers on the camera, as Bonn records them: they are carried over to the camera"


def _is_tum(path: Path) -> bool:
    return all((path / name).is_file() for name in ("rgb.txt", "depth.txt", "groundtruth.txt"))


def _open_tum(path: Path) -> Recording:
    trajectory, lost = _trajectory(path / "groundtruth.txt")
    color_files, depth_files, poses, notes, missing = _by_two_lists(path, trajectory)
    readable = first_readable(lambda i: image_size(color_files[i]) and color_files[i], len(color_files))
    lens, unit_m, _ = camera_of(path, readable, by_folder=True)
    if BONN in _head(path / "rgb.txt") or BONN in path.resolve().name.lower():
        poses, notes = BONN_WORLD @ poses @ BONN_WORLD @ BONN_CAMERA, (*notes, BONN_NOTE)
    return FileFrames(color_files, depth_files, [lens], [lens], depth_png(unit_m)).recording(
        TUM,
        path,
        poses=poses,
        depth_unit_m=unit_m,
        notes=notes,
        faults=(*missing, *lost),
    )


TUM_READER = Reader(TUM, _is_tum, _open_tum)


def _is_slam(path: Path) -> bool:
    return path.is_dir() and (_has_lists(path) or _is_numbered(path)) and not _is_tum(path)


def _has_lists(path: Path) -> bool:
    return _first(path, LISTS) is not None or all((path / name).is_file() for name in ("rgb.txt", "depth.txt"))


def _is_numbered(path: Path) -> bool:
    depth = next((path / "depth").glob(DEPTH_IMAGES), None)  # VLMaps' are .npy
    if (poses := _first(path, NUMBERED)) is None or depth is None or not _pictures(path).is_dir():
        return False
    return _columns(poses) != NAMED_COLUMNS


def _pictures(path: Path) -> Path:
    return next((path / name for name in PICTURES if (path / name).is_dir()), path / PICTURES[0])


def _open_slam(path: Path) -> Recording:
    if not _has_lists(path):
        return _open_numbered(path)
    poses_file, both = _first(path, TRAJECTORIES) or _other_trajectory(path), _first(path, LISTS)
    trajectory, lost = _trajectory(poses_file)
    if both is None:
        color_files, depth_files, poses, notes, missing = _by_two_lists(path, trajectory)
    else:
        stamps, color_files, depth_files, missing = _pairs(both)
        # Whoever tracked them stamps poses with either time; a pose at exactly one of them is it.
        found = [
            interpolate_poses(*trajectory, times, max_gap_s=MAX_POSE_GAP_S, beyond_s=COLOR_TOLERANCE_S)
            for times in stamps
        ]
        exact = [np.isin(np.round(times, 6), np.round(trajectory[0], 6)) for times in stamps]
        theirs = int(exact[1].sum() > exact[0].sum())
        poses, known = found[theirs]
        if exact[theirs].sum() == len(trajectory[0]) > len(known) / 2:  # not key frames only: others were lost
            known &= exact[theirs]
        if not known.any():
            raise InputError(
                f"{path}: expected poses at the times of {both.name}, found none within {MAX_POSE_GAP_S:g} s among "
                f"{len(trajectory[0])} poses ({poses_file.name})"
            )
        poses = poses[known]
        total = len(color_files)
        notes = left_out(total - len(poses), total, f"pictures have no pose of their time in {poses_file.name}")
        color_files, depth_files = (
            [file for file, kept in zip(files, known, strict=True) if kept] for files in (color_files, depth_files)
        )
    is_icl = poses_file.name.endswith(ICL)
    lens, unit_m, source = camera_of(path, color_files[0], known="icl-nuim" if is_icl else "")
    return FileFrames(color_files, depth_files, [lens], [lens], depth_png(unit_m)).recording(
        SLAM,
        path,
        poses=ICL_FLIP @ poses @ ICL_FLIP if is_icl else poses,
        depth_unit_m=unit_m,
        notes=(f"camera: {source}; depth: {unit_m:g} m a step", *notes),
        faults=(*missing, *lost),
    )


SLAM_READER = Reader(SLAM, _is_slam, _open_slam)


def _open_numbered(path: Path) -> Recording:
    """Open pictures whose poses are in the order of their numbers, which start at 0 or 1."""
    poses_file = _first(path, NUMBERED) or path / NUMBERED[0]
    columns = _columns(poses_file) or NUMBERED_COLUMNS[0]
    if columns not in NUMBERED_COLUMNS:
        expected = "lines of 7 numbers (position, quaternion x y z w) or of a matrix of 12 or 16"
        raise InputError(f"{poses_file}: expected {expected}, found {columns}")
    rows = number_rows(poses_file, columns)
    folders = path / "depth", _pictures(path)
    files = [numbered(folder, DEPTH_IMAGES) or numbered(folder, "*.jpg") for folder in folders]
    first = min((int(number_of(file)) for file in files[0]), default=0)
    depth, color = (by_line(kind, len(rows), first=min(first, 1)) for kind in files)
    matched = match_frames(
        path,
        {"depth image": depth, "picture": color},
        dict(enumerate(rows)),
        lambda row: _numbered_pose(row[0], numbers(*row, count=columns)),
        place=lambda row: row[0],
    )
    depth_files, color_files = matched.of_each(depth, color)
    lens, unit_m, source = camera_of(path, color_files[0], unit_m=NUMBERED_UNIT_M)
    return FileFrames(color_files, depth_files, [lens], [lens], depth_png(unit_m)).recording(
        SLAM,
        path,
        depth_unit_m=unit_m,
        **matched.members(first=(f"camera: {source}; depth: {unit_m:g} m a step",)),
    )


def _columns(path: Path) -> int:
    """Return how many words most lines of a text have; 0 when there is none or it cannot be read."""
    try:
        lines = words(path, commas=True)
    except InputError:
        return 0
    return mode(len(line) for _, line in lines) if lines else 0


def _numbered_pose(where: str, values: NDArray) -> NDArray:
    if len(values) == NUMBERED_COLUMNS[0]:
        return from_quaternion(where, values[:3], values[3:])
    return rigid(where, np.vstack([values.reshape(-1, 4), (0, 0, 0, 1)])[:4])


def _trajectory(path: Path) -> tuple[tuple[NDArray, NDArray], tuple[str, ...]]:
    (times, poses), lost = read_trajectory(path, 8, lambda where, row: from_quaternion(where, row[1:4], row[4:]))
    return (times * 1e-9 if times[0] > NANOSECONDS else times, poses), lost


def _by_two_lists(
    path: Path, trajectory: tuple[NDArray, NDArray]
) -> tuple[list[Path], list[Path], NDArray, tuple[str, ...], tuple[str, ...]]:
    """Return files of colour and depth, poses, notes on frames left out, and notes on files not there."""
    color_times, colors, no_color = _image_list(path / "rgb.txt")
    depth_times, depths, no_depth = _image_list(path / "depth.txt")
    times, poses = trajectory
    apart = depth_times[-1] < times[0] - COLOR_TOLERANCE_S or depth_times[0] > times[-1] + COLOR_TOLERANCE_S
    if apart and len(times) == len(depths) == len(colors):  # lists that number the pictures, such as of key frames
        return colors, depths, poses, ("pictures are listed at other times than poses: paired in their order",), ()
    pairs, poses = posed_pairs(
        path, depth_times, color_times, trajectory, tolerance_s=COLOR_TOLERANCE_S, max_gap_s=MAX_POSE_GAP_S
    )
    color_files, depth_files = [colors[i] for i in pairs[:, 1]], [depths[i] for i in pairs[:, 0]]
    notes = left_out(len(depths) - len(poses), len(depths), "depth images have no colour or pose of their time")
    return color_files, depth_files, poses, notes, (*no_color, *no_depth)


def _other_trajectory(path: Path) -> Path:
    """Return the only text of eight numbers a line, whatever it is called; raises InputError when it is not one."""
    found = [file for file in sorted(path.glob("*.txt")) if _is_trajectory(file)]
    if len(found) != 1:
        others = f"{few([file.name for file in found])}; call the one that is meant {TRAJECTORIES[1]}"
        expected = f"{path}: expected a trajectory ({', '.join(TRAJECTORIES)})"
        raise InputError(f"{expected}, found {others if found else 'none'}")
    return found[0]


def _is_trajectory(path: Path) -> bool:
    try:
        lines = [line for _, line in words(path)[:FEW_LINES]]
    except InputError:  # a text of another kind
        return False
    number = re.compile(r"[-+.\de]+|[-+]?(nan|inf)", re.IGNORECASE)
    posed = [len(line) == 8 and all(map(number.fullmatch, line)) for line in lines]
    return len(lines) > 1 and 2 * sum(posed) > len(lines)


def _image_list(path: Path) -> tuple[NDArray, list[Path], tuple[str, ...]]:
    """Read the times and files of a list, by time, and a note on the files that are not there."""

    def read(numbered_line: tuple[int, list[str]]) -> tuple[Path, float]:
        line, found = numbered_line
        if len(found) != 2:
            raise InputError(f"{path}, line {line}: expected a time and a file, found {len(found)} words")
        return path.parent / found[1], float(numbers(f"{path}, line {line}", found[:1], finite=True)[0])

    lines = words(path)
    if lines and lines[0][1][:1] == ["timestamp"]:  # the names of the columns, which others write without #
        del lines[0]
    listed, damaged = read_lines(lines, read, what=f"lines of {path.name}")
    times = dict(listed)
    there = present({file: file for file in times})
    if not there:
        found = f"{len(times)} of which none is there" if times else "none"
        raise InputError(f"{path}: expected lines of a time and a file, found {found}")
    files = sorted(there, key=times.__getitem__)
    lost = [file.name for file in times if file not in there]
    notes = left_out(len(lost), len(times), f"files of {path.name} are not there ({few(lost)})")
    return np.array([times[file] for file in files]), files, (*damaged, *notes)


def _first(path: Path, names: tuple[str, ...]) -> Path | None:
    found = (file for name in names for file in sorted(path.glob(name)))
    return next((file for file in found if file.is_file()), None)


def _pairs(path: Path) -> tuple[tuple[NDArray, NDArray], list[Path], list[Path], tuple[str, ...]]:
    """Return times (of depth, of colour), the files of colour and depth, and a note on those that are not there.

    Either may come first in a line.
    """

    def read(numbered_line: tuple[int, list[str]]) -> tuple[NDArray, tuple[str, ...]]:
        line, found = numbered_line
        where = f"{path}, line {line}"
        if len(found) != 4:
            raise InputError(f"{where}: expected time, file, time, file, found {len(found)} words")
        both = numbers(where, [found[0], found[2]], finite=True), (found[1], found[3])
        first, second = ("depth" in name.lower() for name in both[1])
        return (both[0][::-1], both[1][::-1]) if first and not second else both  # colour, then depth

    rows, damaged = read_lines(words(path), read, what=f"lines of {path.name}")
    named = [(stamps, path.parent / color, path.parent / depth) for stamps, (color, depth) in rows]
    there = [row for row in named if os.path.isfile(row[1]) and os.path.isfile(row[2])]
    if not there:
        raise InputError(f"{path}: expected lines of time, file, time, file with files that are there, found none")
    stamps = np.array([stamps for stamps, _, _ in there])
    missing = left_out(len(rows) - len(there), len(rows), f"pairs of {path.name} lack a file")
    files = [color for _, color, _ in there], [depth for _, _, depth in there]
    return (stamps[:, 1], stamps[:, 0]), *files, (*damaged, *missing)


CAMERAS: dict[str, tuple[float, ...]] = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "freiburg2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
    "icl-nuim": (481.2, 480.0, 319.5, 239.5),
    BONN: (542.822841, 542.576870, 315.593520, 237.756098, 0.039903, -0.099343, -0.000730, -0.000144, 0.0),
}
"""fx, fy, cx, cy, then k1, k2, p1, p2, k3, as the pages of TUM's, ICL-NUIM's and Bonn's datasets give them.

ICL-NUIM's has -480 for fy, with its left-handed world: turned right-handed, it is 480.
"""
CALIBRATED_SIZE = (640, 480)
FOLDER = "the folder's name"


def camera_of(
    path: Path, color_file: Path, *, by_folder: bool = False, known: str = "", unit_m: float = DEPTH_UNIT_M
) -> tuple[Lens, float, str]:
    """Return the camera of a folder's pictures, the unit of its depth in metres, and who says so.

    Looked at in this order: ``intrinsics.txt``, ``intrinsic.txt`` or ``K.txt`` (3x3), ``calibration.txt`` (fx fy cx cy,
    as ETH3D writes it), settings of ORB-SLAM (``*.yaml``), and the recording that the head of ``rgb.txt`` names, or the
    folder's name.
    No camera is made up: a wrong one gives a map that looks right.

    Args:
        path: the folder.
        color_file: a picture in it.
        by_folder: the folder's name counts; people call theirs as TUM's, too, so that programs take them.
        known: the recording's name in `CAMERAS`, where something else tells it.
        unit_m: the unit where none is said.

    Raises:
        InputError: None of them says it, or one is not as it should be.
    """
    width, height = image_size(color_file)
    if (file := _first(path, MATRICES)) is not None:
        return Lens(read_intrinsics(file, width=width, height=height)), unit_m, file.name
    if (file := path / "calibration.txt").is_file():
        found = [word for _, line in words(file) for word in line]
        if len(found) not in (4, 8, 9):
            raise InputError(f"{file}: expected fx fy cx cy, and k1 k2 p1 p2 (k3) or not, found {len(found)} numbers")
        return _lens(str(file), (width, height), numbers(str(file), found, finite=True)), unit_m, file.name
    for file in sorted([*path.glob("*.yaml"), *path.glob("*.yml")]):
        if (settings := _orb_slam(file, (width, height))) is not None:
            return *settings, file.name
    named = [(_head(path / "rgb.txt"), "rgb.txt"), (known, f"{known.upper()}'s"), (path.resolve().name.lower(), FOLDER)]
    for text, source in named:
        key = next((k for k in CAMERAS if k in text or k.replace("freiburg", "fr") + "_" in text), None)
        if key is None or (source == FOLDER and not by_folder):
            continue
        if (width, height) != CALIBRATED_SIZE:
            expected = "x".join(map(str, CALIBRATED_SIZE))
            raise InputError(
                f"{color_file}: expected {expected} pixels, as {key} has ({source}), found {width}x{height}; for "
                "another camera put its 3x3 matrix in intrinsics.txt beside rgb.txt"
            )
        return _lens(str(path), CALIBRATED_SIZE, np.array(CAMERAS[key])), unit_m, source
    raise InputError(
        f"{path}: expected something that says which camera it was, found none of intrinsics.txt (3x3 matrix), "
        "calibration.txt (fx fy cx cy), ORB-SLAM's settings (*.yaml) or a TUM recording's name in rgb.txt"
    )


def _lens(where: str, size: tuple[int, int], values: NDArray) -> Lens:
    """Return the camera of fx, fy, cx, cy and what distortion follows them."""
    fx, fy, cx, cy, *distortion = map(float, values)
    return Lens(pinhole(where, *size, fx, fy, cx, cy), tuple(distortion) if any(distortion) else ())


def _head(path: Path) -> str:
    """Return the comments of a list, which name the recording it was made of."""
    if not path.is_file():
        return ""
    lines = read_bytes(path, MAX_TEXT_BYTES, "a text file")[:1000].decode("utf-8", errors="replace").splitlines()
    return " ".join(line for line in lines if line.startswith("#")).lower()


def _orb_slam(path: Path, size: tuple[int, int]) -> tuple[Lens, float] | None:
    """Read camera and depth unit of ORB-SLAM's settings (2: ``Camera.fx``; 3: ``Camera1.fx``); None for other YAML."""
    text = read_bytes(path, MAX_TEXT_BYTES, "settings").decode("utf-8", errors="replace")
    found = dict(re.findall(r"^\s*(?:Camera1?|RGBD)\.(\w+)\s*:\s*\"?([^\s\"#]+)", text, re.MULTILINE))
    found |= dict(re.findall(r"^\s*(DepthMapFactor)\s*:\s*([^\s#]+)", text, re.MULTILINE))
    if not {"fx", "fy", "cx", "cy"} <= set(found):
        return None
    if found.get("type", "PinHole").lower() not in ("pinhole", "rectified"):
        raise InputError(f"{path}: Camera.type: expected PinHole or Rectified, found {found['type'][:30]!r}")
    keys = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    values = numbers(str(path), [found.get(key, "0") for key in keys], finite=True)
    stated = [found.get(key, str(own)) for key, own in zip(("width", "height"), size, strict=True)]
    width, height = (int(x) for x in numbers(str(path), stated, finite=True))
    factor = float(numbers(str(path), [found.get("DepthMapFactor", f"{1 / DEPTH_UNIT_M:g}")], finite=True)[0])
    if factor <= 0:
        raise InputError(f"{path}: DepthMapFactor: expected a number over 0, found {factor:g}")
    return _lens(str(path), (width, height), values).scaled(*size), 1 / factor
