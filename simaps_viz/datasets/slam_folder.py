"""Read folders as people record them for RGB-D SLAM: lists as TUM's, but a trajectory of their own.

Colour and depth are paired by a list of both (``associations.txt``, as TUM's associate.py prints it), else by the two
lists; poses are those that ORB-SLAM saved beside them. The world is the first camera's, so up is estimated.
"""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import interpolate_poses, posed_pairs, read_trajectory
from simaps_viz.datasets.calibration import from_quaternion, numbers, words
from simaps_viz.datasets.file_frames import FileFrames, depth_png
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.datasets.slam_cameras import camera_of
from simaps_viz.datasets.tum import COLOR_TOLERANCE_S, MAX_POSE_GAP_S, TumReader, image_list
from simaps_viz.errors import InputError

FACTS = FormatFacts(
    title="RGB-D SLAM folder",
    recognised_by="`associations.txt`, or `rgb.txt`, `depth.txt`; with `CameraTrajectory.txt` or another trajectory",
    depth_unit_m=1 / 5000,
    pose="camera to world: time, position, quaternion x y z w",
)
LISTS = ("associations.txt", "*assoc*.txt", "rgb-depth*.txt")
"""Names that people give what associate.py prints; the first that is there counts."""
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
        stamped, lost = read_trajectory(poses_file, 8, lambda where, row: from_quaternion(where, row[1:4], row[4:]))
        if both is not None:
            stamps, color_files, depth_files, missing = _pairs(both)
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
            color_times, colors, no_color = image_list(path / "rgb.txt")
            depth_times, depths, no_depth = image_list(path / "depth.txt")
            missing = (*no_color, *no_depth)
            pairs, poses = posed_pairs(
                path, depth_times, color_times, stamped, tolerance_s=COLOR_TOLERANCE_S, max_gap_s=MAX_POSE_GAP_S
            )
            color_files, depth_files = [colors[i] for i in pairs[:, 1]], [depths[i] for i in pairs[:, 0]]
            total = len(depths)
        lens, unit_m, source = camera_of(path, color_files[0])
        notes = (
            f"camera: {source}; depth: {unit_m:g} m a step",
            *left_out(total - len(poses), total, f"pictures have no pose of their time in {poses_file.name}"),
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
            faults=(*missing, *lost),
        )


def _first(path: Path, names: tuple[str, ...]) -> Path | None:
    found = (file for name in names for file in sorted(path.glob(name)))
    return next((file for file in found if file.is_file()), None)


def _pairs(path: Path) -> tuple[tuple[NDArray, NDArray], list[Path], list[Path], tuple[str, ...]]:
    """Return times (of depth, of colour), the files of colour and depth, and a note on those that are not there.

    Either may come first in a line.
    """
    rows = []
    for line, found in words(path):
        where = f"{path}, line {line}"
        if len(found) != 4:
            raise InputError(f"{where}: expected time, file, time, file, found {len(found)} words")
        both = numbers(where, [found[0], found[2]], finite=True), (found[1], found[3])
        first, second = ("depth" in name.lower() for name in both[1])
        rows.append((both[0][::-1], both[1][::-1]) if first and not second else both)  # colour, then depth
    named = [(stamps, path.parent / color, path.parent / depth) for stamps, (color, depth) in rows]
    there = [row for row in named if os.path.isfile(row[1]) and os.path.isfile(row[2])]
    if not there:
        raise InputError(f"{path}: expected lines of time, file, time, file with files that are there, found none")
    stamps = np.array([stamps for stamps, _, _ in there])
    missing = left_out(len(rows) - len(there), len(rows), f"pairs of {path.name} lack a file")
    return (stamps[:, 1], stamps[:, 0]), [color for _, color, _ in there], [depth for _, _, depth in there], missing
