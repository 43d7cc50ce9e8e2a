"""Read Stray Scanner recordings (an iPhone's LiDAR): depth images, a video of the colour, poses and a camera in CSV.

The app turns ARKit's axes into a camera's (x right, y down, z forward) itself; the world stays ARKit's, y up.
"""

import math
import threading
from collections import OrderedDict
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, camera_matrix, from_quaternion, numbers, pinhole, see_through
from simaps_viz.datasets.file_frames import check_size, depth_png
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, left_out
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_FRAMES, MAX_TEXT_BYTES, check_file, check_picture, read_bytes

FACTS = FormatFacts(
    title="Stray Scanner",
    recognised_by="`odometry.csv`, `camera_matrix.csv`, `rgb.mp4`, `depth/*.png`",
    pose="camera to world: frame, position, quaternion x y z w",
    up=(0.0, 1.0, 0.0),
)
_COLUMNS = ("frame", "x", "y", "z", "qx", "qy", "qz", "qw")
_CAMERA = ("fx", "fy", "cx", "cy")
_MAX_VIDEO_BYTES = 1 << 36
_KEPT = 8
"""Pictures of a video that are kept, as a few threads ask for them in nearly the right order."""


class StrayScannerReader(Reader):
    """The reader of Stray Scanner recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        return (path / "odometry.csv").is_file() and (path / "camera_matrix.csv").is_file()

    def open(self, path: Path) -> Recording:
        """Open a recording; raises InputError for anything that is not as the format wants it."""
        table = path / "odometry.csv"
        rows = _rows(table)
        video = Video(path / "rgb.mp4")
        read = depth_png(FACTS.depth_unit_m)
        files = [path / "depth" / f"{int(row['frame']):06d}.png" for _, row in rows]
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
        lenses = [_lens(rows[i][0], rows[i][1], default, video) for i in kept]
        height, width = read(files[kept[0]]).shape
        depth_lenses = [lens.scaled(width, height) for lens in lenses]
        target = depth_lenses[0].intrinsics

        def depth(i: int) -> NDArray:
            image = read(files[kept[i]])
            check_size(files[kept[i]], image, depth_lenses[i].intrinsics)
            return see_through(image, depth_lenses[i], target, exact=True)

        def color(i: int) -> NDArray:
            return see_through(video.read(int(rows[kept[i]][1]["frame"])), lenses[i], target, exact=False)

        return Recording(
            facts=FACTS,
            path=path,
            name=path.resolve().name,
            frame_names=tuple(files[i].stem for i in kept),
            poses=np.stack([_pose(*rows[i]) for i in kept]),
            intrinsics=target,
            depth=depth,
            color=color,
            stored=lambda i: (video.path, files[kept[i]]),
            faults=left_out(len(rows) - len(kept), len(rows), "poses have no picture in rgb.mp4, or no depth image"),
        )


def _rows(path: Path) -> list[tuple[str, dict[str, float]]]:
    """Return (where, numbers by column) of each line; newer versions of the app write more columns, some empty."""
    lines = _lines(path)
    names = lines[0][1] if lines else []
    if not set(_COLUMNS) <= set(names):
        raise InputError(f"{path}: expected columns {', '.join(_COLUMNS)} in the first line, found {names[:12]}")
    rows = []
    for where, found in lines[1:]:
        if len(found) != len(names):
            raise InputError(f"{where}: expected {len(names)} numbers, found {len(found)}")
        known = {name: word for name, word in zip(names, found, strict=True) if name in _COLUMNS + _CAMERA}
        stated = [word or ("nan" if name in _CAMERA else "") for name, word in known.items()]
        row = dict(zip(known, numbers(where, stated).tolist(), strict=True))
        if not 0 <= row["frame"] < MAX_FRAMES:
            raise InputError(f"{where}: frame: expected a whole number below {MAX_FRAMES}, found {row['frame']:g}")
        rows.append((where, row))
    return rows


def _lines(path: Path) -> list[tuple[str, list[str]]]:
    text = read_bytes(path, MAX_TEXT_BYTES, "a table (CSV)").decode("utf-8-sig", errors="replace")
    found = [(f"{path}, line {i}", line.split(",")) for i, line in enumerate(text.splitlines(), 1) if line.strip()]
    return [(where, [word.strip() for word in words]) for where, words in found]


def _lens(where: str, row: dict[str, float], K: NDArray, video: "Video") -> Lens:
    """Return the camera of a picture: its own where the app wrote one, as an iPhone focuses anew all the time."""
    own = [row.get(name, math.nan) for name in _CAMERA]
    fx, fy, cx, cy = own if np.isfinite(own).all() else (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    return Lens(pinhole(where, video.width, video.height, float(fx), float(fy), float(cx), float(cy)))


def _pose(where: str, row: dict[str, float]) -> NDArray:
    return from_quaternion(where, [row[k] for k in "xyz"], [row[f"q{k}"] for k in "xyzw"])


class Video:
    """The pictures of a video file by number, read forwards."""

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
        capture = cv2.VideoCapture(str(self.path), cv2.CAP_FFMPEG)
        if not capture.isOpened():
            found = "no such file" if not self.path.is_file() else "one that cannot be decoded"
            raise InputError(f"{self.path}: expected a video, found {found}")
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # depth is not turned either
        return capture

    def _ends(self, number: int) -> InputError:
        return InputError(f"{self.path}: expected {self.frames} pictures, found damage or the end at picture {number}")
