"""Open any recording: the registry of readers, and which of them knows a folder or file."""

from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

from simaps_viz.datasets.posed_frames import PosedFramesReader
from simaps_viz.datasets.recording import Reader
from simaps_viz.datasets.sequence import PosedFrames

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


def open_sequence(path: Path, *, whole: bool = True) -> PosedFrames:
    """Open a sequence and check it; its format (docs/FORMATS.md) is recognised by its files.

    Read are the manifest, the calibration, the segment table, the first frame's images and a few depth images; that
    the images of all frames exist is looked up. Where the recording does not state up or the height of the floor,
    gravity is estimated from some forty frames, which takes up to a second.

    Args:
        path: The folder, or a manifest (.json) in it; for other formats than posed-frames/1 their folder or file.
        whole: Every frame has to have its files. False: a build may skip frames, so that only the first frame has to be
            there; of other formats than posed-frames/1 all files still have to.

    Raises:
        InputError: Anything is not as the format wants it; the message names the file, what was expected and found.
    """
    path = Path(path)
    reader = recognise(path)
    if reader is None or isinstance(reader, PosedFramesReader):
        reader = PosedFramesReader(complete=whole)  # its errors describe best what an unknown folder or file lacks
    return PosedFrames(reader.open(path))


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
