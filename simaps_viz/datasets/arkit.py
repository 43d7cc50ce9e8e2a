"""Read ARKitScenes scans (Apple): low-resolution depth and colour of an iPad, a camera of its own for each frame."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import nearest, posed_pairs, read_trajectory
from simaps_viz.datasets.calibration import Lens, number_rows, pinhole
from simaps_viz.datasets.file_frames import FileFrames, depth_png, number_of, numbered
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose

FACTS = FormatFacts(
    title="ARKitScenes",
    recognised_by="`lowres_depth/*.png`, `lowres_wide/*.png`, `lowres_wide_intrinsics/*.pincam`, `lowres_wide.traj`",
    pose="world to camera: time, axis times angle (rad), position",
    up=(0.0, 0.0, 1.0),
)

TOLERANCE_S = 0.02
"""How far colour may be from depth; file names carry milliseconds."""
MAX_POSE_GAP_S = 0.25
"""The trajectory has ten poses a second."""


class ArkitReader(Reader):
    """The reader of ARKitScenes recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        return (_folder(path) / "lowres_wide.traj").is_file() and (_folder(path) / "lowres_depth").is_dir()

    def open(self, path: Path) -> Recording:
        """Open a scan; raises InputError for anything that is not as the format wants it."""
        folder = _folder(path)
        depth_all, color_all = numbered(folder / "lowres_depth", "*.png"), numbered(folder / "lowres_wide", "*.png")
        cameras = numbered(folder / "lowres_wide_intrinsics", "*.pincam")
        for name, files in (("lowres_depth/*.png", depth_all), ("lowres_wide/*.png", color_all),
                            ("lowres_wide_intrinsics/*.pincam", cameras)):  # fmt: skip
            if not files:
                raise InputError(f"{folder / name}: expected files named VIDEO_SECONDS, found none")
        depth_times = _times(depth_all)
        trajectory, no_pose = read_trajectory(folder / "lowres_wide.traj", 7, _pose)
        pairs, poses = posed_pairs(
            folder, depth_times, _times(color_all), trajectory, tolerance_s=TOLERANCE_S, max_gap_s=MAX_POSE_GAP_S
        )
        of_frame = nearest(_times(cameras), depth_times[pairs[:, 0]])
        lenses = [_lens(cameras[i]) for i in of_frame]
        depth_files, color_files = [depth_all[i] for i in pairs[:, 0]], [color_all[i] for i in pairs[:, 1]]
        files = FileFrames(color_files, depth_files, lenses, lenses, depth_png(FACTS.depth_unit_m))
        return files.recording(
            FACTS,
            path,
            name=depth_files[0].stem.rpartition("_")[0] or path.resolve().name,
            poses=poses,
            notes=left_out(
                len(depth_all) - len(pairs), len(depth_all), "depth images have no colour or pose of their time"
            ),
            faults=no_pose,
        )


def _folder(path: Path) -> Path:
    """Return the folder of the frames: the 3dod part of the dataset has it one level down."""
    inner = path / f"{path.resolve().name}_frames"
    return inner if inner.is_dir() else path


def _times(files: list[Path]) -> NDArray:
    return np.array([number_of(file) for file in files])


def _lens(path: Path) -> Lens:
    where, (width, height, fx, fy, cx, cy) = number_rows(path, 6)[0]
    if not np.isfinite([width, height]).all():
        raise InputError(f"{where}: expected finite numbers, found {width:g} and {height:g}")
    return Lens(pinhole(str(path), int(width), int(height), fx, fy, cx, cy))


def _pose(where: str, row: NDArray) -> NDArray:
    """Return T_world_camera of a row: time, axis times angle, position, world to camera."""
    if not (np.abs(row) < 1e15).all():  # NaN is not less
        raise InputError(f"{where}: expected finite numbers, found NaN, infinity or some far too large")
    T_camera_world = np.eye(4)
    T_camera_world[:3, :3] = cv2.Rodrigues(row[1:4])[0]
    T_camera_world[:3, 3] = row[4:]
    return invert_pose(T_camera_world)
