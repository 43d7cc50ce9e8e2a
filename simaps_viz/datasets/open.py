"""Open any recording: the registry of readers, and which of them knows a folder or file."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path

from simaps_viz.datasets.posed_frames import PosedFramesReader
from simaps_viz.datasets.recording import Reader
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.unknown import unknown_folder
from simaps_viz.errors import InputError

READERS: list[str | Reader] = [
    PosedFramesReader(),
    "simaps_viz.datasets.tum:TumReader",
    "simaps_viz.datasets.slam_folder:SlamFolderReader",
    "simaps_viz.datasets.seven_scenes:SevenScenesReader",
    "simaps_viz.datasets.redwood:RedwoodReader",
    "simaps_viz.datasets.scannet:ScanNetReader",
    "simaps_viz.datasets.scannet:SensReader",
    "simaps_viz.datasets.replica:ReplicaReader",
    "simaps_viz.datasets.habitat:HabitatReader",
    "simaps_viz.datasets.nerfstudio:NerfstudioReader",
    "simaps_viz.datasets.arkit:ArkitReader",
    "simaps_viz.datasets.colmap:ColmapReader",
    "simaps_viz.datasets.record3d:Record3DReader",
    "simaps_viz.datasets.polycam:PolycamReader",
    "simaps_viz.datasets.rosbag:RosbagReader",
    "simaps_viz.datasets.stray_scanner:StrayScannerReader",
    "simaps_viz.datasets.rtabmap:RtabmapReader",
    "simaps_viz.datasets.rerun_rrd:RerunReader",
    "simaps_viz.datasets.lidar:LidarReader",
]
"""Readers in the order they are tried: objects, or "module:class", which is imported when its turn comes."""


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
    reader = recognise(path)
    if reader is None and path.is_dir():
        raise unknown_folder(path, tuple(readers()))
    return reader or PosedFramesReader()  # a manifest of any name, or its error says best what is there


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
    module, _, name = entry.partition(":")
    return getattr(import_module(module), name)()
