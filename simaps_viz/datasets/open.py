"""Open any recording: the registry of readers, which knows a folder or file, and the error where none does."""

import json
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

from simaps_viz.datasets.manifest import FORMAT
from simaps_viz.datasets.posed_frames import READER as POSED_FRAMES
from simaps_viz.datasets.recording import FormatFacts, Reader
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.errors import InputError
from simaps_viz.io.limits import LFS_POINTER, is_lfs_pointer

READERS: list[str | Reader] = [
    POSED_FRAMES,
    "simaps_viz.datasets.tum:TUM_READER",
    "simaps_viz.datasets.tum:SLAM_READER",
    "simaps_viz.datasets.seven_scenes:READER",
    "simaps_viz.datasets.seven_scenes:SUN3D_READER",
    "simaps_viz.datasets.redwood:READER",
    "simaps_viz.datasets.scannet:SCANNET_READER",
    "simaps_viz.datasets.scannet:SENS_READER",
    "simaps_viz.datasets.rendered:REPLICA_READER",
    "simaps_viz.datasets.rendered:HABITAT_READER",
    "simaps_viz.datasets.nerfstudio:READER",
    "simaps_viz.datasets.phones:ARKIT_READER",
    "simaps_viz.datasets.colmap:READER",
    "simaps_viz.datasets.record3d:READER",
    "simaps_viz.datasets.phones:POLYCAM_READER",
    "simaps_viz.datasets.rosbag:READER",
    "simaps_viz.datasets.phones:STRAY_READER",
    "simaps_viz.datasets.rtabmap:READER",
    "simaps_viz.datasets.rerun_rrd:READER",
    "simaps_viz.datasets.lidar:READER",
    "simaps_viz.datasets.kitti360:READER",
]
"""Readers in the order they are tried: objects, or "module:name", which is imported when its turn comes."""


def open_sequence(
    path: Path, *, strict: bool = False, up: Sequence[float] | None = None, floor_height_m: float | None = None
) -> PosedFrames:
    """Open a sequence and check it; its format (docs/FORMATS.md) is recognised by its files.

    Read are the manifest, the calibration, the segment table, the first frame's images and a few depth images; that
    the images of all frames exist is looked up. A frame that lacks something is left out; `PosedFrames.notes` say how
    many and which. Where the recording does not state up or the height of the floor,
    gravity is estimated from some forty frames, which takes up to a second; the notes say where it came from when no
    floor is in view.

    Args:
        path: The folder, or a manifest (.json) in it; for other formats than posed-frames/1 their folder or file.
        strict: A frame that lacks something, or a damaged first one, is an error.
        up: The world's up direction [3], any length, in place of the recording's; the floor is looked for anew.
        floor_height_m: Height of the floor along up, in place of the recording's.

    Raises:
        InputError: Anything is not as the format wants it; the message names the file, what was expected and found.
    """
    path = Path(path)
    recording = reader_of(path).open(path)
    if up is not None:
        x, y, z = map(float, up)
        if not 1e-6 < math.hypot(x, y, z) < 1e6:
            raise InputError(f"up: expected a direction of three finite numbers, found {x:g}, {y:g}, {z:g}")
        recording = replace(recording, facts=replace(recording.facts, up=(x, y, z)), floor_height_m=None)
    if floor_height_m is not None:
        if not math.isfinite(floor_height_m):
            raise InputError(f"floor height: expected metres, found {floor_height_m:g}")
        recording = replace(recording, floor_height_m=floor_height_m)
    return PosedFrames(recording, strict=strict)


def reader_of(path: Path) -> Reader:
    """Return the reader of a folder or file.

    Raises:
        InputError: It is of no format that is read; what was looked for is in the error's notes.
    """
    if is_lfs_pointer(path):
        raise InputError(f"{path}: expected a recording, found {LFS_POINTER}")
    reader = recognise(path)
    if reader is None and path.is_dir():
        raise unknown_folder(path, tuple(readers()))
    if reader is None and any(path.name in files for files in CONVERTIBLE) and (known := _convertible(path.parent)):
        raise InputError(f"{path}: expected a recording of a format that is read, found that its folder is {known}")
    return reader or POSED_FRAMES  # a manifest of any name, or its error says best what is there


def is_sequence(path: Path) -> bool:
    """Return whether a path is meant as a sequence, from names alone: a folder, a manifest or a recording's file."""
    return path.is_dir() or path.suffix == ".json" or recognise(path) is not None


def recognise(path: Path) -> Reader | None:
    """Return the reader that knows a folder or file, or None."""
    return next((reader for reader in readers() if reader.recognise(path)), None)


def readers() -> Iterator[Reader]:
    """Yield the registered readers in the order they are tried; a module is imported when it is reached."""
    for entry in READERS:
        yield _load(entry) if isinstance(entry, str) else entry


def format_table() -> str:
    """Return the table of docs/FORMATS.md, made of the readers' facts."""
    head = ("format", "recognised by", "depth", "unit (m)", "no reading", "pose", "camera axes", "world's up",
            "segmentation")  # fmt: skip
    axes = {(0.0, 0.0, 1.0): "+z", (0.0, 1.0, 0.0): "+y", (0.0, -1.0, 0.0): "-y", None: "estimated"}
    rows = [head, ("---",) * len(head)]
    for f in (reader.facts for reader in readers()):
        unit, up = f"{f.depth_unit_m:.8g}", axes.get(f.up, str(f.up))
        rows.append((f.title, f.recognised_by, f.depth, unit, f.invalid, f.pose, f.camera_axes, up, f.segmentation))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


@cache
def _load(entry: str) -> Reader:
    return resolve_name(entry)


MAX_LISTED = 8
"""Names of a folder that a message shows."""
MAX_NEAREST = 3
"""Formats that an unknown folder is told to be near to, where it has as much of each."""
MAX_SEARCHED = 20_000
"""Files of a folder whose names are looked at."""
MAX_DEPTH, MAX_FOLDERS = 4, 200
"""Levels of folders, and folders in all, that a recording is looked for in."""
CONVERTIBLE = {
    ("data.jsonl", "calibration.json"): "a recording of Spectacular AI: what `sai-cli process INPUT OUTPUT` makes of it"
    " (nerfstudio's transforms.json, with depth) is read",
    ("train.json", "val.json", "images/depth_*.png"): "an export of Spectacular AI for Taichi: what `sai-cli process"
    " INPUT OUTPUT` makes without `--format taichi` (nerfstudio's transforms.json, with depth) is read",
}
"""{files: what a folder that has them is, and what makes one of it that is read}."""
NO_PICTURE = re.compile(r"(?<![a-z])conf|mask|label|semantic|instance|normal|thumb|(?:^|/)\._")
"""In the names of what else is stored as pictures."""
_IMAGES = (".png", ".pgm", ".jpg", ".jpeg")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?=\D*$)")
"""The last number in a file's name, which may be a time."""


def unknown_folder(path: Path, readers: Sequence[Reader]) -> InputError:
    """Return the error for a folder of no known format; its notes list the formats and a manifest for the folder."""
    names = [f"{p.name}/" if p.is_dir() else p.name for p in _inside(path)]
    shown = ", ".join(names[:MAX_LISTED]) + ", ..." * (len(names) > MAX_LISTED) if names else "an empty folder"
    error = InputError(f"{path}: expected a recording of a format that is read, found {shown}{_nearest(path, readers)}")
    error.add_note("Formats that are read, and the files they are recognised by (docs/FORMATS.md):")
    for reader in readers:
        error.add_note(f"  {reader.facts.title}: {reader.facts.recognised_by.replace('`', '')}")
    error.add_note("Frames of any other kind can be read with this file, sequence.json, beside them:")
    error.add_note(manifest_for(path))
    error.add_note("poses.txt: a frame's name and 16 numbers a line, camera to world, row by row; intrinsics.txt: 3x3.")
    return error


def manifest_for(path: Path) -> str:
    """Return a manifest (JSON) for the pictures in a folder, as far as their names tell."""
    files = (file for _, file in zip(range(MAX_SEARCHED), path.rglob("*"), strict=False))
    pictures = [file.relative_to(path) for file in files if file.suffix.lower() in _IMAGES]
    pictures = [picture for picture in pictures if not NO_PICTURE.search(picture.as_posix().lower())]
    is_depth = ["depth" in picture.as_posix().lower() for picture in pictures]
    depth = _pattern([p for p, d in zip(pictures, is_depth, strict=True) if d and p.suffix.lower() in _IMAGES[:2]])
    color = _pattern([p for p, d in zip(pictures, is_depth, strict=True) if not d])
    if color is None or depth is None:
        color, depth = Path("color/{frame}.jpg"), Path("depth/{frame}.png")
    elif color.stem == depth.stem:  # then a frame's name is all of its pictures'
        color, depth = color.with_stem("{frame}"), depth.with_stem("{frame}")
    patterns = color.as_posix(), depth.as_posix()
    keys = {
        "format": FORMAT, "color": patterns[0], "depth": patterns[1], "depth_unit_m": 0.001,
        "intrinsics": "intrinsics.txt", "poses": "poses.txt", "up": [0, 0, 1],
    }  # fmt: skip
    lines = (f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in keys.items())
    return "{\n" + ",\n".join(lines) + "\n}"


def _pattern(pictures: Sequence[Path]) -> Path | None:
    """Return what most pictures are called, with {frame} for the last number in a name; None without pictures."""
    names = Counter(picture.with_stem(_NUMBER.sub("{frame}", picture.stem)) for picture in pictures)
    if not names:
        return None
    name = max(names, key=lambda name: (names[name], any(word in name.stem for word in ("color", "rgb"))))
    return name if names[name] > 1 and "{frame}" in name.stem else name.with_stem("{frame}")


def _nearest(path: Path, readers: Sequence[Reader]) -> str:
    """Return which folder inside is a recording, what makes one of it, or the nearest formats and what lacks."""
    inside = [folder for folder in _folders(path) if any(reader.recognise(folder) for reader in readers)]
    if inside:
        more = f" (so are {len(inside) - 1} other folders)" if len(inside) > 1 else ""
        return f"; {inside[0]} is one{more}"
    if known := _convertible(path):
        return f"; it is {known}"
    best, nearest = 0.0, dict[str, str]()
    for reader in readers:
        for needed in ways(reader.facts):
            lacking = [any_of[0] for any_of in needed if not any(next(path.glob(p.rstrip("/")), None) for p in any_of)]
            share = 1 - len(lacking) / len(needed)
            if not lacking or share < best or not share:
                continue
            if share > best:
                best, nearest = share, {}
            nearest.setdefault(reader.facts.title, ", ".join(lacking))
    known = [f"{title}, which also has {files}" for title, files in nearest.items()]
    return f"; nearest is {', or '.join(known[:MAX_NEAREST])}" if known else ""


def _convertible(folder: Path) -> str | None:
    """Return what a folder is that another program makes a recording of, and which program; None for others."""
    for files, known in CONVERTIBLE.items():
        if all(next(folder.glob(file), None) for file in files):
            return known
    return None


def ways(facts: FormatFacts) -> list[list[list[str]]]:
    """Return what the files of a format are called, from what it is recognised by.

    Returns:
        For each way in which it is written, the files it needs; for each of these, the patterns any of which will do.
    """
    plain = re.sub(r"\([^)]*\)", "", facts.recognised_by)
    parts = [[re.findall(r"`([^`]+)`", part) for part in way.split(",")] for way in plain.split(";")]
    return [needed for way in parts if (needed := [any_of for any_of in way if any_of])]


def _folders(path: Path) -> list[Path]:
    """Return the folders in a folder, down to `MAX_DEPTH` of them, the upper ones first."""
    found, level = [], [path]
    for _ in range(MAX_DEPTH):
        level = [folder for above in level for folder in _inside(above) if folder.is_dir()]
        level = level[: MAX_FOLDERS - len(found)]
        found += level
    return found


def _inside(folder: Path) -> list[Path]:
    """Return what is in a folder, by name; nothing where it cannot be looked into."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []
