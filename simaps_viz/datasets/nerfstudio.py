"""Read nerfstudio folders: ``transforms.json`` with a depth image for every picture; also as instant-ngp has it.

instant-ngp calls depth ``depth_path`` and its unit ``integer_depth_scale``, leaves out suffixes of pictures, and may
give a camera by ``camera_angle_x`` alone. NeRFCapture writes that.
"""

from collections.abc import Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL.TiffImagePlugin import TiffImageFile

from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import OPENCV_FROM_OPENGL, Lens, pinhole
from simaps_viz.datasets.file_frames import (
    FileFrames,
    clean_depth,
    depth_npy,
    depth_png,
    json_number,
    names_of,
    number_of,
    present,
)
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.manifest import read_json, shown
from simaps_viz.datasets.record3d import read_exr
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, first_readable, left_out
from simaps_viz.datasets.sequence import DEPTH_RANGE_M
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_IMAGE_BYTES, check_picture, read_bytes

FACTS = FormatFacts(
    title="nerfstudio, instant-ngp",
    recognised_by="`transforms.json` with `depth_file_path` (instant-ngp: `depth_path`)",
    depth="16-bit PNG, `.npy`, TIFF or EXR",
    pose="camera to world: 4x4",
    camera_axes="OpenGL",
)

PIXEL_CENTRE = 0.5
"""Where nerfstudio has the centre of the first pixel."""
UNITS = ("depth_unit_scale_factor", "integer_depth_scale", "depth_integer_scale")
"""Keys of the depth images' unit, metres: nerfstudio's, instant-ngp's, and the one NeRFCapture writes for it."""
PICTURES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG")
FLOATS = (".npy", ".exr", ".tif", ".tiff")
FISHEYE = "OPENCV_FISHEYE"
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")


def _recognise(path: Path) -> bool:
    return _file(path).is_file()


def _open(path: Path) -> Recording:
    """Open a folder or its transforms.json; raises InputError for anything that is not as the format wants it.

    Poses may be off by any turn, as they come from a reconstruction, so up is estimated. They have to be in metres.
    """
    file = _file(path)
    content = read_json(file)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise InputError(f'{file}: expected an object with a list "frames", found {shown(content)}')
    model = str(content.get("camera_model", "OPENCV")).upper()
    fisheye = model == FISHEYE or content.get("is_fisheye") is True
    k4 = json_number(str(file), {"k4": 0.0} | content, "k4")
    if (model not in (*PINHOLES, FISHEYE)) or (k4 and not fisheye):
        known = ", ".join((*PINHOLES, FISHEYE))
        raise InputError(f"{file}: camera_model: expected one of {known}, pinholes without k4, found {shown(model)}")
    frames = [_merged(file, i, content, frame) for i, frame in enumerate(frames)]
    stated = len(frames)
    frames = sorted((f for f in frames if f["depth_file_path"] is not None), key=lambda f: _in_time(f["file_path"]))
    if not frames:
        raise InputError(f"{file}: expected depth_file_path in its frames, found none in {stated}; a map needs depth")
    poses = {frame["file_path"]: frame for frame in frames}
    images = {kind: present({name: file.parent / frame[key] for name, frame in poses.items()})
              for kind, key in (("picture", "file_path"), ("depth image", "depth_file_path"))}  # fmt: skip
    matched = match_frames(
        file, images, poses, lambda frame: _pose(_place(file, frame), frame), place=partial(_place, file)
    )
    color_files, depth_files = matched.of_each(*images.values())
    with_depth, frames = len(frames), [poses[name] for name in matched.frames]
    unit_m, note = _unit(file, content, depth_files)
    lenses = [_lens(_place(file, frame), frame, color_files[i], fisheye=fisheye) for i, frame in enumerate(frames)]
    files = FileFrames.of_one_view(color_files, depth_files, lenses, lambda p: _read_depth(p, unit_m))
    return files.recording(
        FACTS,
        path,
        name=file.resolve().parent.name,
        frame_names=names_of([Path(frame["file_path"]) for frame in frames]),
        depth_unit_m=unit_m if depth_files[0].suffix != ".npy" and unit_m < 1.0 else None,
        **matched.members(first=(*note, *left_out(stated - with_depth, stated, "frames have no depth"))),
    )


READER = Reader(FACTS, _recognise, _open)


def _file(path: Path) -> Path:
    return path if path.name.startswith("transforms") and path.suffix == ".json" else path / "transforms.json"


def _in_time(picture: str) -> tuple[str, float, str]:
    """Return what pictures are sorted by: those of NeRFCapture have numbers of one to three digits."""
    path = Path(picture)
    return str(path.parent), number_of(path), path.name


def _merged(file: Path, index: int, content: dict[str, Any], frame: Any) -> dict[str, Any]:
    """Return a frame with the keys that all frames share, under nerfstudio's names."""
    if not isinstance(frame, dict):
        raise InputError(f"{file}: frames: expected objects, found {shown(frame)}")
    picture: Any = frame.get("file_path")
    depth = frame.get("depth_file_path", frame.get("depth_path"))
    for key, value in (("file_path", picture), ("depth_file_path", "" if depth is None else depth)):
        if not isinstance(value, str):
            raise InputError(f"{file}: frame {index}: expected {key}, found {shown(value)}")
    if not Path(picture).suffix:
        picture = next((picture + end for end in PICTURES if (file.parent / (picture + end)).is_file()), picture)
    shared = {key: value for key, value in content.items() if key != "frames"}
    return shared | frame | {"file_path": picture, "depth_file_path": depth}


def _place(file: Path, frame: dict[str, Any]) -> str:
    return f"{file}: frame {frame['file_path']}"


def _lens(where: str, frame: dict[str, Any], color_file: Path, *, fisheye: bool) -> Lens:
    stated = "w" in frame and "h" in frame
    width, height = (int(json_number(where, frame, key)) for key in "wh") if stated else image_size(color_file)
    known = {"cx": width / 2, "cy": height / 2} | frame
    if "fl_x" not in known and "camera_angle_x" in known:
        half = json_number(where, known, "camera_angle_x") / 2
        known["fl_x"] = width / 2 / np.tan(half) if 0 < half < np.pi / 2 else 0.0
    numbers = [json_number(where, {"fl_y": known.get("fl_x")} | known, key) for key in ("fl_x", "fl_y", "cx", "cy")]
    fx, fy, cx, cy = numbers
    camera = pinhole(where, width, height, fx, fy, cx - PIXEL_CENTRE, cy - PIXEL_CENTRE)
    keys = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    distortion = tuple(json_number(where, dict.fromkeys(keys, 0.0) | frame, key) for key in keys)
    return Lens(camera, distortion if any(distortion) else (), fisheye=fisheye)


def _pose(where: str, frame: dict[str, Any]) -> NDArray:
    try:
        matrix = np.array(frame.get("transform_matrix"), dtype=np.float64)
    except (TypeError, ValueError) as error:
        found = shown(frame.get("transform_matrix"))
        raise InputError(f"{where}: transform_matrix: expected 4x4 numbers, found {found}") from error
    if matrix.shape != (4, 4):
        raise InputError(
            f"{where}: transform_matrix: expected 4x4 numbers, found {shown(frame.get('transform_matrix'))}"
        )
    return matrix @ OPENCV_FROM_OPENGL


def _unit(file: Path, content: dict[str, Any], depth_files: Sequence[Path]) -> tuple[float, tuple[str, ...]]:
    """Return the metres that a stored 1 means, and a note where that is told by the numbers.

    nerfstudio itself is told by a flag. Floats may be metres, which read as millimetres would lie on the lens.
    """
    stated = next((key for key in UNITS if content.get(key) is not None), None)
    if stated is not None:
        return json_number(str(file), content, stated), ()
    if depth_files[0].suffix.lower() in FLOATS:
        depth = first_readable(lambda i: _read_depth(depth_files[i], 1.0), len(depth_files))
        median = float(np.median(depth[depth > 0])) if (depth > 0).any() else 0.0
        nearest_m, farthest_m = DEPTH_RANGE_M
        if nearest_m < median < farthest_m and median * FACTS.depth_unit_m < nearest_m:
            return 1.0, (
                f"depth is taken as metres: {file.name} states no {UNITS[0]}, and as millimetres what "
                f"{depth_files[0].name} shows would be {median:.2g} mm away",
            )
    return FACTS.depth_unit_m, ()


def _read_depth(path: Path, unit_m: float) -> NDArray:
    if path.suffix == ".npy":
        return depth_npy(unit_m)(path)
    if path.suffix.lower() in (".tif", ".tiff"):
        return clean_depth(_read_tiff(path) * np.float32(unit_m))
    if path.suffix.lower() == ".exr":
        return clean_depth(read_exr(path) * np.float32(unit_m))
    return depth_png(unit_m)(path)


def _read_tiff(path: Path) -> NDArray:
    """Read the only channel of a TIFF image of 16 bits or floats; raises InputError when it is damaged or another."""
    data = read_bytes(path, MAX_IMAGE_BYTES, "an image")
    try:
        with TiffImageFile(BytesIO(data)) as header:
            size = header.size
        check_picture(path, *size)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except InputError:
        raise
    except Exception as error:  # Pillow may raise anything on damaged headers
        raise InputError(f"{path}: expected a TIFF image, found one that cannot be decoded") from error
    if image is None:
        raise InputError(f"{path}: expected a TIFF image, found one that cannot be decoded")
    if image.ndim != 2 or image.dtype not in (np.uint16, np.float32, np.float64):
        found = f"{image.dtype} {list(image.shape)}"
        raise InputError(f"{path}: expected depth of 16 bits or floats in one channel, found {found}")
    return image.astype(np.float32)
