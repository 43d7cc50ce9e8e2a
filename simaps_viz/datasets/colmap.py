"""Read COLMAP reconstructions with depth images of a sensor, or COLMAP's own depth maps, beside the pictures.

COLMAP's world has any scale. The points it found are in a sensor's depth images, too: how much farther away these have
them is the scale, by which poses become metres. COLMAP's own depth maps have its world's unit, and so no scale.
"""

import os
import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import Lens, from_quaternion, numbers, pinhole
from simaps_viz.datasets.file_frames import FileFrames, clean_depth, depth_npy, depth_png, names_of
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.manifest import few
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, complete, left_out
from simaps_viz.errors import InputError
from simaps_viz.geometry import invert_pose, spread, transform_points
from simaps_viz.io.limits import MAX_ARRAY_BYTES, MAX_CLOUD_BYTES, MAX_FRAMES, check_picture, read_bytes

FACTS = FormatFacts(
    title="COLMAP with depth",
    recognised_by="`sparse/0/` or `sparse/` (`images`, `cameras`; `.bin` or `.txt`), `images/`, "
    "`depth/` or `stereo/depth_maps/`",
    depth="16-bit PNG or `.npy` (metres), or COLMAP's depth maps (its unit)",
    pose="world to camera: quaternion w x y z, position; scaled to metres by the points in a sensor's depth",
)
_MODELS = {
    0: ("SIMPLE_PINHOLE", "fxy"), 1: ("PINHOLE", "fgxy"), 2: ("SIMPLE_RADIAL", "fxyk"), 3: ("RADIAL", "fxykk"),
    4: ("OPENCV", "fgxykkkk"), 5: ("OPENCV_FISHEYE", "fgxykkkk"), 6: ("FULL_OPENCV", "fgxykkkkkkkk"),
    8: ("SIMPLE_RADIAL_FISHEYE", "fxyk"), 9: ("RADIAL_FISHEYE", "fxykk"),
}  # fmt: skip
"""{number: (name, parameters)}: focal lengths f (both) or f and g, principal point x and y, distortion k."""
PIXEL_CENTRE = 0.5
"""Where COLMAP has the centre of the first pixel."""
DEPTHS = ("depth", "depths", "depth_maps", "stereo/depth_maps")
_OWN = ".bin"
"""How the names of COLMAP's own depth maps end."""
_ENDS = (".png", ".npy", f".geometric{_OWN}", f".photometric{_OWN}")
"""Of depth images, the better ones first: geometric ones agree between pictures."""
_OWN_HEAD = re.compile(rb"([1-9]\d{0,5})&([1-9]\d{0,5})&1&")
"""Width, height and channels, before little-endian float32 row by row."""
_SAMPLED, _FEWEST, _AGREED = 40, 50, 0.15
"""Pictures the scale is estimated in, points it needs, and how far its quartiles may be from the median."""
_NO_SCALE = (
    "depth is COLMAP's own, in the reconstruction's unit: 1 is taken as 1 m, so sizes are metres only where it was "
    "georegistered or scaled"
)
METRIC = 0.02
"""A scale this near to 1 is the depth's own error, not another unit."""


@dataclass(frozen=True, eq=False)
class _Picture:
    """One registered picture."""

    name: str
    camera: int
    T_camera_world: NDArray
    pixels: NDArray
    """float64 [n, 2], where points were found."""
    points: NDArray
    """int64 [n], their ids; -1 = none."""


def _recognise(path: Path) -> bool:
    return _model(path) is not None and _depths(path) is not None


def _open(path: Path) -> Recording:
    model, depths = _model(path), _depths(path)
    assert model is not None and depths is not None
    with complete(model, FACTS.title):
        cameras, pictures, points = _read(model)
    folder = path / "images" if (path / "images").is_dir() else path
    kept = [
        (picture, color, depth)
        for picture in pictures
        if (color := folder / picture.name).is_file() and (depth := _depth_file(depths, picture.name)) is not None
    ]
    if not kept:
        names = few([picture.name for picture in pictures])
        there = few(sorted(file.name for file in depths.iterdir()))
        expected = f"{depths}: expected depth named as the reconstruction's {len(pictures)} pictures ({names})"
        raise InputError(f"{expected}, found {there or 'none'}")
    kept = [item for item in kept if item[2].suffix != _OWN] or kept  # one unit for all: a sensor's, if there is one
    kept.sort(key=lambda item: item[0].name)
    color_files, depth_files = [color for _, color, _ in kept], [depth for _, _, depth in kept]
    missing = next((p for p, _, _ in kept if p.camera not in cameras), None)
    if missing is not None:
        raise InputError(f"{model}: expected camera {missing.camera} of {missing.name}, found none of that number")
    lenses = [cameras[p.camera].scaled(*image_size(color)) for p, color, _ in kept]
    scale, note = _scale(path, [p for p, _, _ in kept], depth_files, lenses, points)
    poses = np.stack([invert_pose(p.T_camera_world) for p, _, _ in kept])
    poses[:, :3, 3] *= scale
    files = FileFrames.of_one_view(color_files, depth_files, lenses, _read_depth)
    return files.recording(
        FACTS,
        path,
        frame_names=names_of([Path(p.name) for p, _, _ in kept]),
        poses=poses,
        notes=(
            *_parts(path, model),
            note,
            *left_out(len(pictures) - len(kept), len(pictures), "pictures have no depth or are missing"),
            *_rough(depth_files),
        ),
    )


READER = Reader(FACTS, _recognise, _open)


def _model(path: Path) -> Path | None:
    """Return the folder of the reconstruction; of several, which do not know of one another, the largest."""
    for folders in (_numbered(path / "sparse"), [path / "sparse"], _numbered(path / "colmap" / "sparse")):
        found = [file for f in folders for end in ("bin", "txt") if (file := f / f"images.{end}").is_file()]
        if found:
            return max(found, key=os.path.getsize).parent
    return None


def _numbered(sparse: Path) -> list[Path]:
    return sorted((f for f in sparse.glob("*") if f.name.isdecimal()), key=lambda f: int(f.name))


def _rough(depth_files: list[Path]) -> tuple[str, ...]:
    """Return the note that some depth maps are COLMAP's first guess, which no other picture had to agree with."""
    rough = sum(file.name.endswith(_ENDS[-1]) for file in depth_files)
    note = f"{rough} of {len(depth_files)} frames have only a photometric depth map, which is rough"
    return (note,) if rough else ()


def _parts(path: Path, model: Path) -> tuple[str, ...]:
    """Return the note that pictures fell into several reconstructions, of which one is read."""
    count = sum(any(f.glob("images.*")) for f in _numbered(model.parent))
    read = model.relative_to(path).as_posix()
    note = f"of {count} reconstructions, which share no frame of reference, the largest is read: {read}"
    return (note,) if count > 1 else ()


def _depths(path: Path) -> Path | None:
    return next((path / name for name in DEPTHS if (path / name).is_dir()), None)


def _depth_file(folder: Path, name: str) -> Path | None:
    """Return the depth image of a picture: of its name but for the suffix, or with another one behind it."""
    plain = Path(name)
    stems = (folder / plain.with_suffix(""), folder / plain.stem, folder / plain)
    files = (stem.parent / f"{stem.name}{end}" for stem in stems for end in _ENDS)
    return next((file for file in files if file.is_file()), None)


def _read_depth(path: Path) -> NDArray:
    if path.suffix == _OWN:
        return _read_own(path)
    return depth_npy()(path) if path.suffix == ".npy" else depth_png(FACTS.depth_unit_m)(path)


def _read_own(path: Path) -> NDArray:
    """Read a depth map that COLMAP made; raises InputError when it is something else or cut short."""
    data = read_bytes(path, MAX_ARRAY_BYTES, "a depth map of COLMAP")
    head = _OWN_HEAD.match(data)
    if head is None:
        raise InputError(f"{path}: expected a depth map of COLMAP (width&height&1&...), found {data[:24]!r}")
    width, height = int(head[1]), int(head[2])
    check_picture(path, width, height)
    expected, found = 4 * width * height, len(data) - head.end()
    if found != expected:
        raise InputError(f"{path}: expected {width}x{height} numbers in {expected} bytes, found {found} bytes")
    return clean_depth(np.frombuffer(data, "<f4", offset=head.end()).reshape(height, width))


def _scale(
    path: Path, pictures: list[_Picture], depth_files: list[Path], lenses: list[Lens], points: dict[int, NDArray]
) -> tuple[float, str]:
    """Return how many metres COLMAP's unit is, and a note on how that is known.

    Raises:
        InputError: Depth and points do not agree on one.
    """
    if depth_files[0].suffix == _OWN:
        return 1.0, _NO_SCALE
    ratios = []
    for i in spread(len(pictures), _SAMPLED):
        picture = pictures[i]
        seen = [j for j, number in enumerate(picture.points.tolist()) if number in points]
        if not seen:
            continue
        depth_m = _read_depth(depth_files[i])
        height, width = depth_m.shape
        k = lenses[i].intrinsics
        z = transform_points(picture.T_camera_world, np.stack([points[int(picture.points[j])] for j in seen]))[:, 2]
        u, v = (picture.pixels[seen] * (width / k.width, height / k.height)).T.astype(np.int64)
        inside = (u >= 0) & (v >= 0) & (u < width) & (v < height) & (z > 0)
        measured = depth_m[v[inside], u[inside]]
        ratios.append((measured / z[inside])[measured > 0])
    found = np.concatenate(ratios) if ratios else np.zeros(0)
    if not points:
        return 1.0, "the reconstruction has no points to compare with depth: its poses are taken as metres"
    if len(found) < _FEWEST:
        raise InputError(f"{path}: expected {_FEWEST} points or more with depth, for the scale, found {len(found)}")
    low, scale, high = (float(x) for x in np.percentile(found, (25, 50, 75)))
    if not scale * (1 - _AGREED) <= low <= high <= scale * (1 + _AGREED):
        raise InputError(
            f"{path}: expected one scale between points and depth, found {low:.3g} to {high:.3g} m for half of the "
            f"{len(found)} points; does depth belong to these pictures, in millimetres?"
        )
    if abs(scale - 1) < METRIC:
        return 1.0, f"poses are metres: depth and {len(found)} points agree"
    return scale, f"COLMAP's unit is {scale:.4g} m, by the depth of {len(found)} points"


def _read(model: Path) -> tuple[dict[int, Lens], list[_Picture], dict[int, NDArray]]:
    """Read cameras, pictures and points of a folder, in binary or text."""
    if (model / "images.bin").is_file():
        read = _Binary(model / "cameras.bin"), _Binary(model / "images.bin"), model / "points3D.bin"
        points = _points_binary(_Binary(read[2])) if read[2].is_file() else {}
        return _cameras_binary(read[0]), _pictures_binary(read[1]), points
    points = _points_text(model / "points3D.txt") if (model / "points3D.txt").is_file() else {}
    return _cameras_text(model / "cameras.txt"), _pictures_text(model / "images.txt"), points


def _lens(where: str, model: int, width: int, height: int, values: NDArray) -> Lens:
    name, kinds = _MODELS.get(model, ("", ""))
    if not name or len(values) != len(kinds):
        known = ", ".join(name for name, _ in _MODELS.values())
        raise InputError(f"{where}: expected one of {known}, found model {model} of {len(values)} numbers")
    by_kind = {kind: [float(v) for v, k in zip(values, kinds, strict=True) if k == kind] for kind in "fgxyk"}
    (fx,), (cx,), (cy,) = by_kind["f"], by_kind["x"], by_kind["y"]
    fy = by_kind["g"][0] if by_kind["g"] else fx
    camera = pinhole(where, width, height, fx, fy, cx - PIXEL_CENTRE, cy - PIXEL_CENTRE)
    distortion = tuple(by_kind["k"])
    return Lens(camera, distortion if any(distortion) else (), fisheye=name.endswith("FISHEYE"))


class _Binary:
    """A binary file, read forwards."""

    def __init__(self, path: Path) -> None:
        self.path, self._at = path, 0
        self._data = read_bytes(path, MAX_CLOUD_BYTES, "a COLMAP model")

    def take(self, form: str) -> tuple:
        """Return the numbers of the next bytes; struct.error, which `complete` turns, where there are fewer."""
        form = f"<{form}"
        found = struct.unpack_from(form, self._data, self._at)
        self._at += struct.calcsize(form)
        return found

    def array(self, dtype: np.dtype, count: int) -> NDArray:
        """Return the next rows; raises ValueError where there are fewer."""
        found = np.frombuffer(self._data, dtype, count, self._at)
        self._at += dtype.itemsize * count
        return found

    def text(self) -> str:
        """Return the characters up to the next zero byte."""
        end = self._data.index(b"\0", self._at)
        found, self._at = self._data[self._at : end], end + 1
        return found.decode("utf-8", errors="replace")

    def many(self, most: int) -> int:
        """Return how many things follow; raises InputError for more than a file of its size can hold."""
        (count,) = self.take("Q")
        if count > min(most, len(self._data)):
            raise InputError(f"{self.path}: expected a COLMAP model, found {count} entries in {len(self._data)} bytes")
        return count


def _cameras_binary(file: _Binary) -> dict[int, Lens]:
    cameras = {}
    for _ in range(file.many(MAX_FRAMES)):
        number, model, width, height = file.take("iiQQ")
        values = np.array(file.take(f"{len(_MODELS.get(model, ('', ''))[1])}d"))
        cameras[number] = _lens(f"{file.path}: camera {number}", model, width, height, values)
    return cameras


_SEEN = np.dtype([("pixel", "<f8", 2), ("point", "<i8")])


def _pictures_binary(file: _Binary) -> list[_Picture]:
    pictures = []
    for _ in range(file.many(MAX_FRAMES)):
        _, w, x, y, z, *position, camera = file.take("i7di")
        name = file.text()
        seen = file.array(_SEEN, file.many(1 << 40))
        T = from_quaternion(f"{file.path}: {name}", position, (x, y, z, w))
        pictures.append(_Picture(name, camera, T, seen["pixel"], seen["point"]))
    return pictures


def _points_binary(file: _Binary) -> dict[int, NDArray]:
    points = {}
    for _ in range(file.many(1 << 40)):
        number, *xyz, _, _, _, _, track = file.take("Q3d3BdQ")
        points[number] = np.array(xyz)
        file.array(np.dtype("<i8"), track)
    return points


def _lines(path: Path) -> list[tuple[str, list[str]]]:
    """Return (where, words) of the lines that are no comments, empty ones too."""
    text = read_bytes(path, MAX_CLOUD_BYTES, "a COLMAP model").decode("utf-8", errors="replace")
    numbered = enumerate(re.split("\r\n|\r|\n", text), start=1)
    return [(f"{path}, line {i}", line.split()) for i, line in numbered if not line.startswith("#")]


def _cameras_text(path: Path) -> dict[int, Lens]:
    named = {name: number for number, (name, _) in _MODELS.items()}
    cameras = {}
    for where, (number, model, *rest) in (line for line in _lines(path) if line[1]):
        width, height, *values = numbers(where, rest, finite=True)
        cameras[int(number)] = _lens(where, named.get(model, -1), int(width), int(height), np.array(values))
    return cameras


def _pictures_text(path: Path) -> list[_Picture]:
    pictures, lines = [], _lines(path)
    at = 0
    while at < len(lines):
        where, found = lines[at]
        at += 1
        if not found:
            continue
        w, x, y, z, *position = numbers(where, found[1:8], finite=True)
        seen = numbers(where, lines[at][1] if at < len(lines) else []).reshape(-1, 3)  # the next line, empty or not
        at += 1
        T = from_quaternion(where, position, (x, y, z, w))
        pictures.append(_Picture(" ".join(found[9:]), int(found[8]), T, seen[:, :2], seen[:, 2].astype(np.int64)))
    return pictures


def _points_text(path: Path) -> dict[int, NDArray]:
    lines = [(where, found) for where, found in _lines(path) if found]
    return {int(found[0]): numbers(where, found[1:4], finite=True) for where, found in lines}
