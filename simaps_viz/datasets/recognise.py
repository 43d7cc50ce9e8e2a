"""Finds out which format a folder or file is in."""

from pathlib import Path
from types import ModuleType
from typing import Protocol

from simaps_viz.datasets import (
    arkit,
    habitat,
    lidar,
    nerfstudio,
    polycam,
    record3d,
    replica,
    rerun_rrd,
    rosbag,
    scannet,
    scannet_sens,
    seven_scenes,
    tum,
)
from simaps_viz.datasets.recording import FormatFacts, Recording


class Reader(Protocol):
    """What each reader's module offers."""

    FACTS: FormatFacts

    @staticmethod
    def recognise(path: Path) -> bool:
        """Determine from names alone whether a folder or file is in this format."""
        ...

    @staticmethod
    def open_recording(path: Path) -> Recording:
        """Open it; raises InputError for anything that is not as the format wants it."""
        ...


READERS: tuple[ModuleType, ...] = (
    tum, seven_scenes, scannet, scannet_sens, replica, habitat, nerfstudio, arkit, record3d, polycam, rosbag, rerun_rrd,
    lidar,
)  # fmt: skip
"""In the order they are tried."""


def recognise(path: Path) -> ModuleType | None:
    """Return the module of the reader for a folder or file, or None when no reader knows it."""
    return next((reader for reader in READERS if reader.recognise(path)), None)


def format_table() -> str:
    """Return the table of docs/FORMATS.md from the readers' own constants."""
    head = ("format", "recognised by", "depth", "unit (m)", "no reading", "pose", "camera axes", "world's up",
            "segmentation")  # fmt: skip
    rows = [head, ("---",) * len(head)]
    for reader in READERS:
        f: FormatFacts = reader.FACTS
        unit, up = f"{f.depth_unit_m:.8g}", "estimated" if f.up is None else _axis(f.up)
        rows.append((f.title, f.recognised_by, f.depth, unit, f.invalid, f.pose, f.camera_axes, up, f.segmentation))
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _axis(up: tuple[float, float, float]) -> str:
    names = {(0.0, 0.0, 1.0): "+z", (0.0, 1.0, 0.0): "+y", (0.0, -1.0, 0.0): "-y"}
    return names.get(up, str(up))
