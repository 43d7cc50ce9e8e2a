"""Find which camera took the pictures of a folder in TUM's layout, which holds no camera itself."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, numbers, pinhole, read_intrinsics, words
from simaps_viz.datasets.images import image_size
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_TEXT_BYTES, read_bytes

CAMERAS: dict[str, tuple[float, ...]] = {
    "freiburg1": (517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633),
    "freiburg2": (520.9, 521.0, 325.1, 249.7, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172),
    "freiburg3": (535.4, 539.2, 320.1, 247.6),
    "rgbd_bonn": (542.822841, 542.576870, 315.593520, 237.756098, 0.039903, -0.099343, -0.000730, -0.000144, 0.0),
}
"""fx, fy, cx, cy, then k1, k2, p1, p2, k3, as the pages of TUM's and Bonn's datasets give them."""
DEPTH_UNIT_M = 1 / 5000
CALIBRATED_SIZE = (640, 480)


def camera_of(path: Path, color_file: Path, *, by_folder: bool = False) -> tuple[Lens, float, str]:
    """Return the camera of a folder's pictures, the unit of its depth in metres, and who says so.

    Looked at in this order: ``intrinsics.txt`` (3x3), ``calibration.txt`` (fx fy cx cy, as ETH3D writes it), settings
    of ORB-SLAM (``*.yaml``), and the recording that the head of ``rgb.txt`` names, or the folder's name. No camera is
    made up: a wrong one gives a map that looks right.

    Args:
        path: the folder.
        color_file: a picture in it.
        by_folder: the folder's name counts; people call theirs as TUM's, too, so that programs take them.

    Raises:
        InputError: None of them says it, or one is not as it should be.
    """
    width, height = image_size(color_file)
    unit_m = DEPTH_UNIT_M
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
    for text, source in ((_head(path / "rgb.txt"), "rgb.txt"), (path.resolve().name.lower(), "the folder's name")):
        key = next((k for k in CAMERAS if k in text or k.replace("freiburg", "fr") + "_" in text), None)
        if key is None or (source != "rgb.txt" and not by_folder):
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
