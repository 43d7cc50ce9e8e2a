"""Read TUM RGB-D recordings (https://cvg.cit.tum.de/data/datasets/rgbd-dataset): Kinect and motion capture.

Colour and depth come at their own times and poses at a hundred a second: each depth image takes the nearest colour
image and the pose interpolated to its own time. Depth is registered to colour already, lens distortion included, so
both are undistorted alike.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import posed_pairs, read_trajectory
from simaps_viz.datasets.calibration import from_quaternion, numbers, words
from simaps_viz.datasets.file_frames import FileFrames, depth_png, present
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, first_readable, left_out
from simaps_viz.datasets.segment_tables import few
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
        color_times, color_paths, no_color = image_list(path / "rgb.txt")
        depth_times, depth_paths, no_depth = image_list(path / "depth.txt")
        trajectory, no_pose = read_trajectory(
            path / "groundtruth.txt", 8, lambda where, row: from_quaternion(where, row[1:4], row[4:])
        )
        pairs, poses = posed_pairs(
            path, depth_times, color_times, trajectory, tolerance_s=COLOR_TOLERANCE_S, max_gap_s=MAX_POSE_GAP_S
        )
        depth_files = [depth_paths[i] for i in pairs[:, 0]]
        color_files = [color_paths[i] for i in pairs[:, 1]]
        readable = first_readable(lambda i: image_size(color_files[i]) and color_files[i], len(color_files))
        lens, unit_m, _ = camera_of(path, readable, by_folder=True)
        files = FileFrames(color_files, depth_files, [lens], [lens], lens.intrinsics, depth_png(unit_m))
        return files.recording(
            FACTS,
            path,
            name=path.resolve().name,
            frame_names=tuple(file.stem for file in depth_files),
            poses=poses,
            depth_unit_m=unit_m,
            notes=left_out(
                len(depth_times) - len(pairs), len(depth_times), "depth images have no colour or pose of their time"
            ),
            faults=(*no_color, *no_depth, *no_pose),
        )


def image_list(path: Path) -> tuple[NDArray, list[Path], tuple[str, ...]]:
    """Read the times and files of a list, by time, and a note on the files that are not there."""
    times: dict[Path, float] = {}
    for place, (line, found) in enumerate(words(path)):
        if place == 0 and found[:1] == ["timestamp"]:  # the names of the columns, which others write without #
            continue
        if len(found) != 2:
            raise InputError(f"{path}, line {line}: expected a time and a file, found {len(found)} words")
        times[path.parent / found[1]] = numbers(f"{path}, line {line}", found[:1], finite=True)[0]
    there = present({file: file for file in times})
    if not there:
        found = f"{len(times)} of which none is there" if times else "none"
        raise InputError(f"{path}: expected lines of a time and a file, found {found}")
    files = sorted(there, key=times.__getitem__)
    lost = [file.name for file in times if file not in there]
    notes = left_out(len(lost), len(times), f"files of {path.name} are not there ({few(lost)})")
    return np.array([times[file] for file in files]), files, notes
