"""Read 7-Scenes recordings (Microsoft Research) and those written in their way: three files a frame.

3DMatch, BundleFusion, 12-Scenes, 3RScan and many tools write ``frame-000000.color.jpg``, ``.depth.png`` and
``.pose.txt`` too, with depth in the camera of the colour pictures or of one that stands at the same place, and say
which camera it was; MIT and Princeton's Amazon challenge may have poses and camera in one ``cam.info.txt``. 7-Scenes
itself, and 3DMatch's copies of it, have the raw pictures of a Kinect: its two cameras stand 25 mm apart, so depth is
carried over to the colour camera. SUN3D, from which 3DMatch took many, has folders of its own.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import associate, match_frames
from simaps_viz.datasets.calibration import (
    Lens,
    camera_matrix,
    matrix4,
    matrix_lens,
    number_rows,
    numbers,
    pinhole,
    words,
)
from simaps_viz.datasets.clouds import register_depth
from simaps_viz.datasets.file_frames import FileFrames, depth_png, first_size, names_of, number_of, numbered
from simaps_viz.datasets.images import read_depth
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, first_readable
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose
from simaps_viz.io.limits import MAX_TEXT_BYTES, read_bytes

FACTS = FormatFacts(
    title="7-Scenes",
    recognised_by="`frame-*.depth.png` or `frame-*.depth.pgm`, `frame-*.color.png` or `frame-*.color.jpg`, "
    "`frame-*.pose.txt` or `cam.info.txt` (the camera in `camera-intrinsics.txt` or `info.txt`, there or above)",
    depth="16-bit PNG or PGM",
    invalid="0, 65535",
    pose="camera to world: 4x4; infinite where tracking was lost, left out",
)

INVALID = 65535
KINECT_DEPTH = (640, 480, 585.0, 585.0, 320.0, 240.0)
"""Width, height, fx, fy, cx, cy of the depth camera that 7-Scenes' poses were made with, as its page has them."""
KINECT_COLOR_FOCAL = 525.0
KINECT_BASELINE_M = 0.025
"""The colour camera stands so far to the right of the depth camera."""
KINECT_NOTE = "depth and colour are of a Kinect's two cameras: depth is registered to colour, 25 mm beside it"
APC_CAMERA, APC_UNIT_M = "camera-intrinsics.color.txt", 0.0001
"""The camera as MIT and Princeton's Amazon challenge recordings name it, and their metres a step of depth."""
APC_INFO, APC_INFO_CAMERA = "cam.info.txt", "Color camera intrinsic matrix"
"""Where they have all matrices in one file, each below its title; depth is registered to colour."""
APC_UP = (0.0, 0.0, 1.0)
"""Of the robot's world, in which that file has its poses."""
CAMERA_FILES = ("camera-intrinsics.txt", "info.txt", "_info.txt", "intrinsics.txt", APC_CAMERA, "intrinsics.K.txt")
ROTATED_BITS = 3
"""SUN3D's depth images, and those of its authors' later datasets, have their bits rotated left by so many."""
ROTATED_NOTE = "depth has its bits rotated by three, as SUN3D stores it: they are rotated back"
ROTATED_SHARE, ROTATED_DISTINCT = 0.9, 64
"""Of a picture's distinct values, at least so many, this share has 0 or 1 in its lowest bits; of others a quarter."""


def _recognise(path: Path) -> bool:
    return path.is_dir() and next(path.glob("frame-*.depth.p[ng][gm]*"), None) is not None


def _open(path: Path) -> Recording:
    depth, color, poses = (_files(path, kind) for kind in ("depth", "color", "pose"))
    images = {"depth image": depth, "colour image": color}
    info = _titled(path / APC_INFO) if not poses and (path / APC_INFO).is_file() else {}
    stated = {title.rpartition(" for ")[2]: T for title, T in info.items() if " for frame-" in title}
    if stated:
        matched = match_frames(path, images, stated, lambda T: T, place=lambda _: str(path / APC_INFO))
    else:
        matched = match_frames(path, images, poses, matrix4)
    names, (depth_files, color_files) = tuple(matched.frames), matched.of_each(depth, color)
    camera = _camera(path, *first_size(color_files), info.get(APC_INFO_CAMERA))
    unit_m = camera.unit_m or FACTS.depth_unit_m
    raw, notes = depth_png(unit_m, invalid=INVALID), camera.notes
    sample = first_readable(lambda i: raw(depth_files[i]), len(names))
    if camera.unit_m is None and _is_rotated(sample / np.float32(unit_m)):
        unit_m = camera.rotated_unit_m
        raw, notes = _rotated_back(unit_m), (*notes, ROTATED_NOTE)
    depth_lens = camera.depth.scaled(sample.shape[1], sample.shape[0])
    T_world_camera, registered = matched.poses, raw
    if camera.T_color_depth is not None:
        place = depth_lens, camera.T_color_depth, camera.color.intrinsics
        registered = lambda file: register_depth(raw(file), *place)  # noqa: E731
        T_world_camera, depth_lens = T_world_camera @ invert_pose(camera.T_color_depth), camera.color
    files = FileFrames(color_files, depth_files, [camera.color], [depth_lens], registered)
    resolved = path.resolve()
    return files.recording(
        replace(FACTS, up=APC_UP) if stated else FACTS,
        path,
        name=f"{resolved.parent.name} {resolved.name}" if resolved.name.startswith("seq-") else resolved.name,
        frame_names=names,
        depth_unit_m=unit_m,
        **matched.members(*notes) | {"poses": T_world_camera},
    )


READER = Reader(FACTS, _recognise, _open)

SUN3D = FormatFacts(
    title="SUN3D",
    recognised_by="`image/*.jpg`, `depth/*.png`, `intrinsics.txt`, `extrinsics/*.txt`",
    depth="16-bit PNG, bits rotated by three",
    pose="camera to world: 3x4 for each picture, in the latest file",
)
SUN3D_TOLERANCE_S = 0.05
"""How far depth may be from a picture; the second number in their names is microseconds."""


def _is_sun3d(path: Path) -> bool:
    needed = "image/*.jpg", "depth/*.png", "intrinsics.txt", "extrinsics/*.txt"
    return path.is_dir() and all(next(path.glob(pattern), None) is not None for pattern in needed)


def _open_sun3d(path: Path) -> Recording:
    color, depth = numbered(path / "image", "*.jpg"), numbered(path / "depth", "*.png")
    times = [np.array([number_of(file) for file in files]) * 1e-6 for files in (color, depth)]
    pairs = associate(*times, tolerance_s=SUN3D_TOLERANCE_S)
    file = max((path / "extrinsics").glob("*.txt"), key=lambda file: file.name)
    rows = number_rows(file, 4)
    poses = {i: rows[3 * i : 3 * i + 3] for i in range(len(rows) // 3)}

    def read_pose(block: list[tuple[str, list[str]]]) -> NDArray:
        return np.vstack([*(numbers(*row, count=4) for row in block), (0.0, 0.0, 0.0, 1.0)])

    matched = match_frames(
        path,
        {"picture": dict(enumerate(color)), "depth image of its time": {int(a): depth[b] for a, b in pairs}},
        poses,
        read_pose,
        place=lambda block: block[0][0],
    )
    color_files, depth_of = [color[i] for i in matched.frames], dict(pairs.tolist())
    lens = matrix_lens(str(path), *first_size(color_files), camera_matrix(path / "intrinsics.txt"))
    depth_files = [depth[depth_of[i]] for i in matched.frames]
    return FileFrames(color_files, depth_files, [lens], [lens], _rotated_back(SUN3D.depth_unit_m)).recording(
        SUN3D, path, frame_names=names_of(color_files), **matched.members(ROTATED_NOTE)
    )


SUN3D_READER = Reader(SUN3D, _is_sun3d, _open_sun3d)


@dataclass(frozen=True)
class _Camera:
    """The cameras of a recording."""

    color: Lens
    depth: Lens
    T_color_depth: NDArray | None = None
    """Where depth is not seen through the colour camera's place: takes its points there, [4, 4]."""
    unit_m: float | None = None
    """Metres a step of depth, where the recording says so."""
    rotated_unit_m: float = FACTS.depth_unit_m
    """The same, where depth's bits turn out to be rotated."""
    notes: tuple[str, ...] = ()


def _files(path: Path, kind: str) -> dict[str, Path]:
    """Return {frame: file} of one kind, in the order of the frames' numbers."""
    found = {file.name.partition(".")[0]: file for file in sorted(path.glob(f"frame-*.{kind}.*"))}
    return dict(sorted(found.items(), key=lambda item: (number_of(Path(item[0])), item[0])))


def _titled(file: Path) -> dict[str, NDArray]:
    """Return the matrices of a text by the comment above each; raises InputError when one is none."""
    found: dict[str, list[NDArray]] = {}
    title = ""
    for number, line in enumerate(
        read_bytes(file, MAX_TEXT_BYTES, "a text file").decode("utf-8", "replace").split("\n"), 1
    ):
        if line.startswith("#"):
            title = line.strip("# \t\r")
        elif line.strip():
            found.setdefault(title, []).append(numbers(f"{file}, line {number}", line.split()))
    for name, rows in found.items():
        if len({len(row) for row in rows}) > 1:
            raise InputError(f"{file}: {name}: expected a matrix, found rows of different lengths")
    return {name: np.stack(rows) for name, rows in found.items()}


def _camera(path: Path, width: int, height: int, K: NDArray | None) -> _Camera:
    """Find the cameras: the one stated, or as a file in the folder or above it says, else those of 7-Scenes.

    Raises:
        InputError: No file says it, and the pictures are not as 7-Scenes has them; or a file makes no sense.
    """
    if K is not None:
        if K.shape != (3, 3):
            raise InputError(f"{path / APC_INFO}: {APC_INFO_CAMERA}: expected 3x3 numbers, found {list(K.shape)}")
        lens = matrix_lens(str(path / APC_INFO), width, height, K)
        return _Camera(lens, lens, rotated_unit_m=APC_UNIT_M)
    places = [folder / name for folder in (path, path.resolve().parent) for name in CAMERA_FILES]
    file = next((file for file in places if file.is_file()), None)
    kinect = Lens(pinhole(str(path), *KINECT_DEPTH))
    if file is not None and file.name.endswith("info.txt"):
        return _from_info(file, width, height)
    if file is not None:
        lens = matrix_lens(str(file), width, height, camera_matrix(file))
        if lens != kinect:
            return _Camera(lens, lens, rotated_unit_m=APC_UNIT_M if file.name == APC_CAMERA else FACTS.depth_unit_m)
    elif not (path.resolve().name.startswith("seq-") or _is_raw(path)):
        raise InputError(
            f"{path}: expected a camera in {CAMERA_FILES[0]} (3x3, pixels) or {CAMERA_FILES[1]}, there or in "
            "the folder above, found none; only 7-Scenes' own (seq-01, or depth of 65535 for no reading) go without"
        )
    if (width, height) != KINECT_DEPTH[:2]:
        raise InputError(f"{path}: expected a Kinect's pictures of 640x480 pixels, found {width}x{height}")
    color = Lens(pinhole(str(path), width, height, KINECT_COLOR_FOCAL, KINECT_COLOR_FOCAL, *KINECT_DEPTH[4:]))
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = -KINECT_BASELINE_M
    return _Camera(color, kinect, T_color_depth, notes=(KINECT_NOTE,))


def _is_raw(path: Path) -> bool:
    """Return whether depth is as 7-Scenes has it, 65535 where there is none, in its first picture."""
    depth_m = read_depth(next(iter(_files(path, "depth").values())), 1.0)
    return bool((depth_m == INVALID).any())


def _is_rotated(steps: NDArray) -> bool:
    """Whether the lowest bits of a depth image [H, W], in stored steps, are those that only far depth sets."""
    distinct = np.unique(np.rint(steps[steps > 0]).astype(np.uint16))
    far = distinct & (2**ROTATED_BITS - 1)
    return len(distinct) >= ROTATED_DISTINCT and float(np.mean(far <= 1)) >= ROTATED_SHARE


def _rotated_back(unit_m: float) -> Callable[[Path], NDArray]:
    """Return a reader of 16-bit images whose bits are rotated left: metres, 0 = no reading."""

    def read(path: Path) -> NDArray:
        steps = read_depth(path, 1.0).astype(np.uint16)
        steps[steps == INVALID] = 0
        return (steps >> ROTATED_BITS | steps << (16 - ROTATED_BITS)) * np.float32(unit_m)

    return read


def _from_info(file: Path, width: int, height: int) -> _Camera:
    """Read the cameras of BundleFusion, 12-Scenes and 3RScan: lines of "key = numbers"."""
    values: dict[str, NDArray] = {}
    for _, line in words(file):
        key, _, rest = " ".join(line).partition("=")
        if key.strip().startswith("m_") and key.strip() != "m_sensorName":
            values[key.strip()] = numbers(f"{file}: {key.strip()}", rest.split())
    found = []
    for which, size in (("Color", (width, height)), ("Depth", None)):
        K = values.get(f"m_calibration{which}Intrinsic", np.zeros(0))
        stated = [values.get(f"m_{which.lower()}{side}", np.zeros(0)) for side in ("Width", "Height")]
        if K.size != 16 or any(side.size != 1 or not 0 < side[0] < 1e5 for side in stated):
            raise InputError(f"{file}: m_calibration{which}Intrinsic: expected 16 numbers and the size, found {K.size}")
        lens = matrix_lens(f"{file}: {which.lower()}", int(stated[0][0]), int(stated[1][0]), K.reshape(4, 4))
        found.append(lens.scaled(*size) if size else lens)
    shift = values.get("m_depthShift", np.array([1000.0]))
    if shift.size != 1 or not 0 < shift[0] < 1e6:
        raise InputError(f"{file}: m_depthShift: expected steps a metre, more than 0, found {shift[:1]}")
    return _Camera(found[0], found[1], unit_m=1.0 / float(shift[0]))
