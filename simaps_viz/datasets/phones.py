"""Read what phones and tablets with a LiDAR record: scans of ARKitScenes, and exports of Polycam and Stray Scanner.

ARKitScenes (Apple) has low-resolution depth and colour of an iPad. Polycam's raw exports ("keyframes") have a picture,
a depth image and a camera file for each. Stray Scanner has depth images, a video of the colour, and poses and a camera
in CSV; it turns ARKit's camera axes into OpenCV's itself, the world stays ARKit's, y up. (Record3D: ``record3d.py``.)
"""

import math
import os
import threading
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import match_frames, nearest, posed_pairs, read_lines, read_trajectory
from simaps_viz.datasets.calibration import (
    OPENCV_FROM_OPENGL,
    Lens,
    camera_matrix,
    from_quaternion,
    number_rows,
    numbers,
    pinhole,
)
from simaps_viz.datasets.file_frames import (
    FileFrames,
    by_stem,
    depth_npy,
    depth_png,
    json_number,
    number_of,
    numbered,
)
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose
from simaps_viz.io.limits import MAX_FRAMES, MAX_TEXT_BYTES, check_file, check_picture, read_bytes

ARKIT = FormatFacts(
    title="ARKitScenes",
    recognised_by="`lowres_depth/*.png`, `lowres_wide/*.png`, `lowres_wide_intrinsics/*.pincam`, `lowres_wide.traj`",
    pose="world to camera: time, axis times angle (rad), position",
    up=(0.0, 0.0, 1.0),
)

ARKIT_TOLERANCE_S = 0.02
"""How far colour may be from depth; file names carry milliseconds."""
ARKIT_POSE_GAP_S = 0.25
"""The trajectory has ten poses a second."""


def _is_arkit(path: Path) -> bool:
    return (_arkit_folder(path) / "lowres_wide.traj").is_file() and (_arkit_folder(path) / "lowres_depth").is_dir()


def _open_arkit(path: Path) -> Recording:
    folder = _arkit_folder(path)
    depth_all, color_all = numbered(folder / "lowres_depth", "*.png"), numbered(folder / "lowres_wide", "*.png")
    cameras = numbered(folder / "lowres_wide_intrinsics", "*.pincam")
    for name, files in (("lowres_depth/*.png", depth_all), ("lowres_wide/*.png", color_all),
                        ("lowres_wide_intrinsics/*.pincam", cameras)):  # fmt: skip
        if not files:
            raise InputError(f"{folder / name}: expected files named VIDEO_SECONDS, found none")
    depth_times = _times(depth_all)
    trajectory, no_pose = read_trajectory(folder / "lowres_wide.traj", 7, _arkit_pose)
    pairs, poses = posed_pairs(
        folder, depth_times, _times(color_all), trajectory, tolerance_s=ARKIT_TOLERANCE_S, max_gap_s=ARKIT_POSE_GAP_S
    )
    of_frame = nearest(_times(cameras), depth_times[pairs[:, 0]])
    lenses = [_arkit_lens(cameras[i]) for i in of_frame]
    depth_files, color_files = [depth_all[i] for i in pairs[:, 0]], [color_all[i] for i in pairs[:, 1]]
    files = FileFrames(color_files, depth_files, lenses, lenses, depth_png(ARKIT.depth_unit_m))
    return files.recording(
        ARKIT,
        path,
        name=depth_files[0].stem.rpartition("_")[0] or path.resolve().name,
        poses=poses,
        notes=left_out(
            len(depth_all) - len(pairs), len(depth_all), "depth images have no colour or pose of their time"
        ),
        faults=no_pose,
    )


ARKIT_READER = Reader(ARKIT, _is_arkit, _open_arkit)


def _arkit_folder(path: Path) -> Path:
    """Return the folder of the frames: the 3dod part of the dataset has it one level down."""
    inner = path / f"{path.resolve().name}_frames"
    return inner if inner.is_dir() else path


def _times(files: list[Path]) -> NDArray:
    return np.array([number_of(file) for file in files])


def _arkit_lens(path: Path) -> Lens:
    where, found = number_rows(path, 6)[0]
    width, height, fx, fy, cx, cy = numbers(where, found, count=6)
    if not np.isfinite([width, height]).all():
        raise InputError(f"{where}: expected finite numbers, found {width:g} and {height:g}")
    return Lens(pinhole(str(path), int(width), int(height), fx, fy, cx, cy))


def _arkit_pose(where: str, row: NDArray) -> NDArray:
    """Return T_world_camera of a row: time, axis times angle, position, world to camera."""
    if not (np.abs(row) < 1e15).all():  # NaN is not less
        raise InputError(f"{where}: expected finite numbers, found NaN, infinity or some far too large")
    T_camera_world = np.eye(4)
    T_camera_world[:3, :3] = cv2.Rodrigues(row[1:4])[0]
    T_camera_world[:3, 3] = row[4:]
    return invert_pose(T_camera_world)


POLYCAM = FormatFacts(
    title="Polycam",
    recognised_by="`keyframes/images/*.jpg`, `keyframes/depth/*.png`, `keyframes/cameras/*.json`, or `corrected_...`",
    pose="camera to world: t_00 ... t_23, three rows",
    camera_axes="OpenGL",
    up=(0.0, 1.0, 0.0),
)


def _is_polycam(path: Path) -> bool:
    return (_polycam_folder(path) / "depth").is_dir() and (_polycam_folder(path) / "cameras").is_dir()


def _open_polycam(path: Path) -> Recording:
    """Open an export; raises InputError for anything that is not as the format wants it.

    Where Polycam has optimised the poses, those (``corrected_cameras``) and their pictures are taken.
    """
    folder = _polycam_folder(path)
    corrected = "corrected_" if (folder / "corrected_cameras").is_dir() else ""
    images, cameras = folder / f"{corrected}images", folder / f"{corrected}cameras"
    camera_files = numbered(cameras, "*.json")
    if not camera_files:
        raise InputError(f"{cameras}: expected *.json, found none")
    plain = {file.stem for file in numbered(folder / "cameras", "*.json")}
    uncorrected = plain - {file.stem for file in camera_files}
    depth = by_stem(numbered(folder / "depth", "*.png"))
    with_depth = {file.stem: file for file in camera_files if file.stem in depth}
    color = {stem: file for stem, file in by_stem(numbered(images, "*.jpg")).items() if stem in with_depth}
    if not with_depth:
        raise InputError(f"{folder / 'depth'}: expected *.png named as the cameras, found none; was LiDAR mode on?")
    cameras_of: dict[str, Lens] = {}

    def read_camera(file: Path) -> NDArray:
        content = read_json(file)
        cameras_of[file.stem] = _polycam_lens(str(file), content, color.get(file.stem))
        return _polycam_pose(str(file), content)

    matched = match_frames(folder, {"picture": color}, with_depth, read_camera)
    lenses = [cameras_of[stem] for stem in matched.frames]
    color_files, depth_files = matched.of_each(color, depth)
    files = FileFrames.of_one_view(color_files, depth_files, lenses, depth_png(POLYCAM.depth_unit_m))
    return files.recording(
        POLYCAM,
        path,
        name=folder.resolve().parent.name,
        **matched.members(
            first=(
                *left_out(len(uncorrected), len(plain), "pictures have no corrected camera"),
                *left_out(len(camera_files) - len(with_depth), len(camera_files), "pictures have no depth"),
            )
        ),
    )


POLYCAM_READER = Reader(POLYCAM, _is_polycam, _open_polycam)


def _polycam_folder(path: Path) -> Path:
    return path / "keyframes" if (path / "keyframes").is_dir() else path


def _polycam_lens(where: str, content: object, picture: Path | None) -> Lens:
    fx, fy, cx, cy = (json_number(where, content, key) for key in ("fx", "fy", "cx", "cy"))
    stated = isinstance(content, dict) and "width" in content  # newer corrected cameras have no size
    if stated or picture is None:
        width, height = (json_number(where, content, key) for key in ("width", "height"))
    else:
        width, height = image_size(picture)
    return Lens(pinhole(where, int(width), int(height), fx, fy, cx, cy))


def _polycam_pose(where: str, content: object) -> NDArray:
    T = np.eye(4)
    for row in range(3):
        for column in range(4):
            T[row, column] = json_number(where, content, f"t_{row}{column}")
    return T @ OPENCV_FROM_OPENGL


STRAY = FormatFacts(
    title="Stray Scanner",
    recognised_by="`odometry.csv`, `camera_matrix.csv`, `rgb.mp4`, `depth/*.png` or `depth/*.npy`",
    depth="16-bit PNG, or `.npy` (metres; before 2022)",
    pose="camera to world: frame, position, quaternion x y z w",
    up=(0.0, 1.0, 0.0),
)
_COLUMNS = ("frame", "x", "y", "z", "qx", "qy", "qz", "qw")
_CAMERA = ("fx", "fy", "cx", "cy")
_MAX_VIDEO_BYTES = 1 << 36
_OPENING, _OPTIONS = threading.Lock(), "OPENCV_FFMPEG_CAPTURE_OPTIONS"
_KEPT = 8
"""Pictures of a video that are kept, as a few threads ask for them in nearly the right order."""


def _is_stray(path: Path) -> bool:
    return (path / "odometry.csv").is_file() and (path / "camera_matrix.csv").is_file()


def _open_stray(path: Path) -> Recording:
    table = path / "odometry.csv"
    rows, damaged = _rows(table)
    video = Video(path / "rgb.mp4")
    names = [path / "depth" / f"{int(row['frame']):06d}" for _, row in rows]
    arrays = [name.with_suffix(".npy") for name in names]
    files = [array if array.is_file() else name.with_suffix(".png") for name, array in zip(names, arrays, strict=True)]
    kept = [
        i
        for i, (_, row) in enumerate(rows)
        if all(math.isfinite(row[name]) for name in _COLUMNS) and row["frame"] < video.frames and files[i].is_file()
    ]
    if not kept:
        raise InputError(
            f"{table}: expected poses with a picture in rgb.mp4 and a depth image, found none among {len(rows)} "
            f"poses and {video.frames} pictures"
        )
    default = camera_matrix(path / "camera_matrix.csv", commas=True)
    lenses = [_stray_lens(rows[i][0], rows[i][1], default, video) for i in kept]
    pictures, depths = [int(rows[i][1]["frame"]) for i in kept], [files[i] for i in kept]
    images, in_metres = depth_png(STRAY.depth_unit_m), depth_npy()

    def read(file: Path) -> NDArray:
        return in_metres(file) if file.suffix == ".npy" else images(file)

    return FileFrames.of_one_view(pictures, depths, lenses, read, read_color=video.read).recording(
        STRAY,
        path,
        poses=np.stack([_stray_pose(*rows[i]) for i in kept]),
        stored=lambda i: (video.path, depths[i]),
        faults=(
            *damaged,
            *left_out(len(rows) - len(kept), len(rows), "poses have no picture in rgb.mp4, or no depth image"),
        ),
    )


STRAY_READER = Reader(STRAY, _is_stray, _open_stray)


def _rows(path: Path) -> tuple[list[tuple[str, dict[str, float]]], tuple[str, ...]]:
    """Return (where, numbers by column) of each line, and a note on damaged ones.

    Newer versions of the app write more columns, some empty.
    """
    lines = _lines(path)
    names = lines[0][1] if lines else []
    if not set(_COLUMNS) <= set(names):
        raise InputError(f"{path}: expected columns {', '.join(_COLUMNS)} in the first line, found {names[:12]}")

    def read(line: tuple[str, list[str]]) -> tuple[str, dict[str, float]]:
        where, found = line
        if len(found) != len(names):
            raise InputError(f"{where}: expected {len(names)} numbers, found {len(found)}")
        known = {name: word for name, word in zip(names, found, strict=True) if name in _COLUMNS + _CAMERA}
        stated = [word or ("nan" if name in _CAMERA else "") for name, word in known.items()]
        row = dict(zip(known, numbers(where, stated).tolist(), strict=True))
        if not 0 <= row["frame"] < MAX_FRAMES:
            raise InputError(f"{where}: frame: expected a whole number below {MAX_FRAMES}, found {row['frame']:g}")
        if all(math.isfinite(row[name]) for name in _COLUMNS):
            _stray_pose(where, row)
        return where, row

    return read_lines(lines[1:], read)


def _lines(path: Path) -> list[tuple[str, list[str]]]:
    text = read_bytes(path, MAX_TEXT_BYTES, "a table (CSV)").decode("utf-8-sig", errors="replace")
    found = [(f"{path}, line {i}", line.split(",")) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    return [(where, [word.strip() for word in words]) for where, words in found]


def _stray_lens(where: str, row: dict[str, float], K: NDArray, video: "Video") -> Lens:
    """Return the camera of a picture: its own where the app wrote one, as an iPhone focuses anew all the time."""
    own = [row.get(name, math.nan) for name in _CAMERA]
    fx, fy, cx, cy = own if np.isfinite(own).all() else (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    return Lens(pinhole(where, video.width, video.height, float(fx), float(fy), float(cx), float(cy)))


def _stray_pose(where: str, row: dict[str, float]) -> NDArray:
    return from_quaternion(where, [row[k] for k in "xyz"], [row[f"q{k}"] for k in "xyzw"])


class Video:
    """The pictures of a video file by number, read forwards.

    Also those that its list of edits hides: Stray Scanner's first picture is timed before the video starts.
    """

    def __init__(self, path: Path) -> None:
        check_file(path, _MAX_VIDEO_BYTES, "a video")
        self.path, self._lock = path, threading.Lock()
        self._kept: OrderedDict[int, NDArray] = OrderedDict()
        self._next = 0
        self._capture = self._opened()
        self.width, self.height, count = (
            int(self._capture.get(key))
            for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_COUNT)
        )
        check_picture(path, self.width, self.height)
        self.frames = count if count > 0 else MAX_FRAMES  # some containers do not count them

    def read(self, number: int) -> NDArray:
        """Decode a picture, uint8 [H, W, 3], RGB; raises InputError when the video ends before it or is damaged."""
        with self._lock:
            if number not in self._kept:
                if number < self._next:
                    self._capture.release()
                    self._capture, self._next = self._opened(), 0
                while self._next < number:  # seeking is not exact in every video
                    if not self._capture.grab():
                        raise self._ends(self._next)
                    self._next += 1
                done, bgr = self._capture.read()
                if not done or bgr is None or bgr.shape != (self.height, self.width, 3):
                    raise self._ends(number)
                self._next += 1
                self._kept[number] = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
                while len(self._kept) > _KEPT:
                    self._kept.popitem(last=False)
            return self._kept[number]

    def _opened(self) -> cv2.VideoCapture:
        with _OPENING:  # there is no other way to pass FFmpeg an option
            before = os.environ.get(_OPTIONS)
            os.environ[_OPTIONS] = "ignore_editlist;1"
            capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
            del os.environ[_OPTIONS]
            if before is not None:
                os.environ[_OPTIONS] = before
        if not capture.isOpened():
            found = "no such file" if not self.path.is_file() else "one that cannot be decoded"
            raise InputError(f"{self.path}: expected a video, found {found}")
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # depth is not turned either
        return capture

    def _ends(self, number: int) -> InputError:
        return InputError(f"{self.path}: expected {self.frames} pictures, found damage or the end at picture {number}")
