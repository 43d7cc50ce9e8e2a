"""Read TUM RGB-D recordings (https://cvg.cit.tum.de/data/datasets/rgbd-dataset): Kinect and motion capture.

Colour and depth come at their own times and poses at a hundred a second: each depth image takes the nearest colour
image and the pose interpolated to its own time. Depth is registered to colour already, lens distortion included, so
both are undistorted alike.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import posed_pairs
from simaps_viz.datasets.calibration import Lens, from_quaternion, number_rows, numbers, words
from simaps_viz.datasets.file_frames import FileFrames, depth_png
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.datasets.slam_cameras import camera_of
from simaps_viz.errors import InputError

FACTS = FormatFacts(
    title="TUM RGB-D",
    recognised_by="`rgb.txt`, `depth.txt`, `groundtruth.txt`",
    depth_unit_m=1 / 5000,
    pose="camera to world: time, position, quaternion x y z w",
    up=(0.0, 0.0, 1.0),
)

COLOR_TOLERANCE_S = 0.02
"""Colour farther than this from a depth image is not its colour."""
MAX_POSE_GAP_S = 0.2


class TumReader(Reader):
    """The reader of TUM RGB-D recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        return all((path / name).is_file() for name in ("rgb.txt", "depth.txt", "groundtruth.txt"))

    def open(self, path: Path) -> Recording:
        """Open a recording; raises InputError for anything that is not as the format wants it."""
        color_times, color_paths = _image_list(path / "rgb.txt")
        depth_times, depth_paths = _image_list(path / "depth.txt")
        trajectory = _trajectory(path / "groundtruth.txt")
        pairs, poses = posed_pairs(
            path, depth_times, color_times, trajectory, tolerance_s=COLOR_TOLERANCE_S, max_gap_s=MAX_POSE_GAP_S
        )
        depth_files = [depth_paths[i] for i in pairs[:, 0]]
        color_files = [color_paths[i] for i in pairs[:, 1]]
        lens = _lens(path, color_files[0])
        files = FileFrames(color_files, depth_files, [lens], [lens], lens.intrinsics, depth_png(FACTS.depth_unit_m))
        return files.recording(
            FACTS,
            path,
            name=path.resolve().name,
            frame_names=tuple(file.stem for file in depth_files),
            poses=poses,
            notes=left_out(
                len(depth_times) - len(pairs), len(depth_times), "depth images have no colour or pose of their time"
            ),
        )


def _image_list(path: Path) -> tuple[NDArray, list[Path]]:
    times, files = [], []
    for line, found in words(path):
        if len(found) != 2:
            raise InputError(f"{path}, line {line}: expected a time and a file, found {len(found)} words")
        times.append(numbers(f"{path}, line {line}", found[:1])[0])
        files.append(path.parent / found[1])
    if not files:
        raise InputError(f"{path}: expected lines of a time and a file, found none")
    order = np.argsort(times, kind="stable")
    return np.array(times)[order], [files[i] for i in order]


def _trajectory(path: Path) -> tuple[NDArray, NDArray]:
    rows = number_rows(path, 8)
    times = np.array([row[0] for _, row in rows])
    poses = np.stack([from_quaternion(where, row[1:4], row[4:]) for where, row in rows])
    times, first = np.unique(times, return_index=True)
    return times, poses[first]


def _lens(path: Path, color_file: Path) -> Lens:
    return camera_of(path, color_file, by_folder=True)[0]
