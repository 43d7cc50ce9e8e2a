"""Read folders as people record them for RGB-D SLAM: lists as TUM's, but a trajectory of their own.

Colour and depth are paired by a list of both (``associations.txt``, as TUM's associate.py prints it), else by the two
lists; poses are those that ORB-SLAM saved beside them. The world is the first camera's, so up is estimated.
"""

import os
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import interpolate_poses, posed_pairs
from simaps_viz.datasets.calibration import Lens, from_quaternion, number_rows, numbers, pinhole, read_intrinsics, words
from simaps_viz.datasets.file_frames import FileFrames, depth_png
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.datasets.tum import CALIBRATED_SIZE, CAMERAS, COLOR_TOLERANCE_S, MAX_POSE_GAP_S, TumReader
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_TEXT_BYTES, read_bytes

FACTS = FormatFacts(
    title="RGB-D SLAM folder",
    recognised_by="`associations.txt`, or `rgb.txt`, `depth.txt`; with `CameraTrajectory.txt` or another trajectory",
    depth_unit_m=1 / 5000,
    pose="camera to world: time, position, quaternion x y z w",
)
LISTS = ("associations.txt", "associated.txt", "associate.txt", "association.txt", "assoc.txt")
TRAJECTORIES = ("groundtruth.txt", "CameraTrajectory.txt", "KeyFrameTrajectory.txt", "trajectory.txt")


class SlamFolderReader(Reader):
    """The reader of folders recorded for RGB-D SLAM."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        lists = _first(path, LISTS) is not None or all((path / name).is_file() for name in ("rgb.txt", "depth.txt"))
        return path.is_dir() and lists and not TumReader().recognise(path)

    def open(self, path: Path) -> Recording:
        """Open a folder; raises InputError for anything that is not as the format wants it."""
        poses_file, both = _first(path, TRAJECTORIES), _first(path, LISTS)
        if poses_file is None:
            raise InputError(f"{path}: expected a trajectory ({', '.join(TRAJECTORIES)}), found none")
        stamped, lost = _stamped_poses(poses_file)
        if both is not None:
            stamps, color_files, depth_files = _pairs(both)
            # Whoever tracked them stamps poses with either time; a pose at exactly one of them is it.
            found = [
                interpolate_poses(*stamped, times, max_gap_s=MAX_POSE_GAP_S, beyond_s=COLOR_TOLERANCE_S)
                for times in stamps
            ]
            exact = [np.isin(np.round(times, 6), np.round(stamped[0], 6)).sum() for times in stamps]
            poses, known = found[int(exact[1] > exact[0])]
            kept = [int(i) for i in np.flatnonzero(known)]
            total = len(color_files)
            if not kept:
                raise InputError(
                    f"{path}: expected poses at the times of {both.name}, found none within {MAX_POSE_GAP_S:g} s among "
                    f"{len(stamped[0])} poses ({poses_file.name})"
                )
            poses = poses[kept]
            color_files, depth_files = ([files[i] for i in kept] for files in (color_files, depth_files))
        else:
            (color_times, colors), (depth_times, depths) = _list(path / "rgb.txt"), _list(path / "depth.txt")
            pairs, poses = posed_pairs(
                path, depth_times, color_times, stamped, tolerance_s=COLOR_TOLERANCE_S, max_gap_s=MAX_POSE_GAP_S
            )
            color_files, depth_files = [colors[i] for i in pairs[:, 1]], [depths[i] for i in pairs[:, 0]]
            total = len(depths)
        lens, unit_m, source = camera_of(path, color_files[0])
        notes = (
            f"camera: {source}; depth: {unit_m:g} m a step",
            *left_out(total - len(poses), total, f"pictures have no pose of their time in {poses_file.name}"),
            *left_out(lost, lost + len(stamped[0]), f"lines of {poses_file.name} are no pose"),
        )
        files = FileFrames(color_files, depth_files, [lens], [lens], lens.intrinsics, depth_png(unit_m))
        stems = [file.stem for file in depth_files]
        return files.recording(
            FACTS,
            path,
            name=path.resolve().name,
            frame_names=tuple(stems) if len(set(stems)) == len(stems) else tuple(f"{i:06d}" for i in range(len(stems))),
            poses=poses,
            depth_unit_m=unit_m,
            notes=notes,
        )


def _first(path: Path, names: tuple[str, ...]) -> Path | None:
    return next((path / name for name in names if (path / name).is_file()), None)


def _stamped_poses(path: Path) -> tuple[tuple[NDArray, NDArray], int]:
    """Return times, ascending, and poses [n, 4, 4]; and how many lines hold no pose, where tracking was lost."""
    rows = number_rows(path, 8)
    whole = [(where, row) for where, row in rows if np.isfinite(row).all()]
    if not whole:
        raise InputError(f"{path}: expected poses, found none of finite numbers in {len(rows)} lines")
    poses = np.stack([from_quaternion(where, row[1:4], row[4:]) for where, row in whole])
    times, first = np.unique([row[0] for _, row in whole], return_index=True)
    return (times, poses[first]), len(rows) - len(whole)


def _list(path: Path) -> tuple[NDArray, list[Path]]:
    """Return the times and files of a list, by time, but those that are not there."""
    rows = []
    for line, found in words(path):
        if len(found) != 2:
            raise InputError(f"{path}, line {line}: expected a time and a file, found {len(found)} words")
        rows.append((float(numbers(f"{path}, line {line}", found[:1], finite=True)[0]), path.parent / found[1]))
    rows = sorted(row for row in rows if os.path.isfile(row[1]))
    if not rows:
        raise InputError(f"{path}: expected lines of a time and a file that is there, found none")
    return np.array([time for time, _ in rows]), [file for _, file in rows]


def _pairs(path: Path) -> tuple[tuple[NDArray, NDArray], list[Path], list[Path]]:
    """Return times (of depth, of colour) and the files of colour and depth; either may come first in a line."""
    times, files = [], []
    for line, found in words(path):
        where = f"{path}, line {line}"
        if len(found) != 4:
            raise InputError(f"{where}: expected time, file, time, file, found {len(found)} words")
        stamps, pair = (
            numbers(where, [found[0], found[2]], finite=True),
            (path.parent / found[1], path.parent / found[3]),
        )
        if all(map(os.path.isfile, pair)):
            times.append(stamps)
            files.append(pair)
    if not files:
        raise InputError(f"{path}: expected lines of time, file, time, file with files that are there, found none")
    depth = 0 if "depth" in str(files[0][0].relative_to(path.parent)).lower() else 1
    stamps = np.array(times)
    chosen = [pair[1 - depth] for pair in files], [pair[depth] for pair in files]
    return (stamps[:, depth], stamps[:, 1 - depth]), *chosen


def camera_of(path: Path, color_file: Path) -> tuple[Lens, float, str]:
    """Return the camera of a folder's pictures, the unit of its depth in metres, and who says so.

    Looked at in this order: ``intrinsics.txt`` (3x3), ``calibration.txt`` (fx fy cx cy, as ETH3D writes it), settings
    of ORB-SLAM (``*.yaml``), the recording that the head of ``rgb.txt`` names, and the folder's name. No camera is made
    up: a wrong one gives a map that looks right.

    Raises:
        InputError: None of them says it, or one is not as it should be.
    """
    width, height = image_size(color_file)
    unit_m = FACTS.depth_unit_m
    if (file := path / "intrinsics.txt").is_file():
        return Lens(read_intrinsics(file, width=width, height=height)), unit_m, file.name
    if (file := path / "calibration.txt").is_file():
        found = [word for _, line in words(file) for word in line]
        if len(found) not in (4, 8, 9):
            raise InputError(f"{file}: expected fx fy cx cy, and k1 k2 p1 p2 (k3) or not, found {len(found)} numbers")
        return _lens(str(file), (width, height), numbers(str(file), found, finite=True)), unit_m, file.name
    for file in sorted([*path.glob("*.yaml"), *path.glob("*.yml")]):
        if (settings := _orb_slam(file, (width, height))) is not None:
            return *settings, file.name
    named = path.resolve().name.lower()
    for text, source in ((_head(path / "rgb.txt"), "rgb.txt"), (named, "the folder's name")):
        key = next((k for k in CAMERAS if k in text or k.replace("freiburg", "fr") + "_" in text), None)
        if key is not None and (width, height) == CALIBRATED_SIZE:
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
    factor = float(numbers(str(path), [found.get("DepthMapFactor", "5000")], finite=True)[0])
    if factor <= 0:
        raise InputError(f"{path}: DepthMapFactor: expected a number over 0, found {factor:g}")
    return _lens(str(path), (width, height), values).scaled(*size), 1 / factor
