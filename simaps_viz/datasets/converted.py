"""Shows a recording in a foreign format as a sequence like any other."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import REACH_M
from simaps_viz.datasets.file_frames import check_size
from simaps_viz.datasets.manifest import Manifest
from simaps_viz.datasets.posed_frames import PosedFrames
from simaps_viz.datasets.recording import Recording
from simaps_viz.errors import InputError
from simaps_viz.io.limits import MAX_FRAMES, check_frame_name


class ConvertedFrames(PosedFrames):
    """A checked sequence that is converted while it is read; nothing is written."""

    def __init__(self, recording: Recording) -> None:
        """Check poses, the first colour image and a few depth images, and find up and the floor.

        Raises:
            InputError: A camera is far from the others, a picture is not as the format wants it, the depth unit
                cannot be right, or there is no floor to be found.
        """
        self.recording = recording
        self.name = recording.name
        self.path = recording.path
        self.simulated = recording.simulated
        self.frame_names = recording.frame_names
        self.poses = recording.poses
        self.notes = recording.notes
        self.intrinsics = recording.intrinsics
        self.manifest = _manifest(recording)
        if len(self.frame_names) > MAX_FRAMES:
            raise InputError(f"{self.path}: expected at most {MAX_FRAMES} frames, found {len(self.frame_names)}")
        for name in self.frame_names:
            check_frame_name(self.path, name)
        self._check_reach()
        self.color(0)
        self._check_depth_unit()
        self._open_segments(recording.segments)
        self.gravity_estimated = recording.facts.up is None
        self.T_map_world = self._find_map_frame()

    def color(self, index: int) -> NDArray:
        """Read a frame's colour image, uint8 [H, W, 3], RGB; raises InputError like ``read``."""
        name = self._name(index)
        rgb = self.recording.color(index)
        check_size(f"{self.path}: frame {name}: colour", rgb, self.intrinsics)
        return rgb

    def color_file(self, index: int) -> Path | None:
        """Return the file that holds exactly a frame's colour image, if there is one."""
        return self.recording.color_file(index)

    def _depth(self, index: int) -> NDArray:
        name, depth_m = self._name(index), self.recording.depth(index)
        check_size(f"{self.path}: frame {name}: depth", depth_m, self.intrinsics)
        return depth_m

    def _without_segments(self) -> str:
        return (
            f"expected a segmentation, found none in this {self.recording.facts.title} recording: a network has to "
            "segment these frames (--segmentation MODEL.onnx)"
        )

    def _check_reach(self) -> None:
        positions = self.poses[:, :3, 3]
        distances = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
        if not distances.max() <= REACH_M:  # NaN is not less
            raise InputError(
                f"{self.path}: frame {self.frame_names[int(distances.argmax())]}: expected a camera within "
                f"{REACH_M:g} m of the others, found one {distances.max():.4g} m away"
            )


@dataclass(frozen=True)
class _RecordingManifest(Manifest):
    """What a posed-frames/1 folder would say of itself; its patterns mean the recording's own files."""

    recording: Recording
    index_of: Mapping[str, int]

    def file(self, pattern: str, frame: str = "") -> Path:
        """Return the file that holds a frame's "color" or "depth", or that the recording is."""
        if self.recording.stored is None or pattern not in ("color", "depth") or not frame:
            return self.path
        color, depth = self.recording.stored(self.index_of[frame])
        return color if pattern == "color" else depth


def _manifest(recording: Recording) -> Manifest:
    return _RecordingManifest(
        path=recording.path,
        name=recording.name,
        color="color",
        depth="depth",
        depth_unit_m=recording.depth_unit_m or recording.facts.depth_unit_m,
        intrinsics="intrinsics",
        poses="poses",
        up=recording.facts.up,
        floor_height_m=recording.floor_height_m,
        segmentation=None,
        simulated=recording.simulated,
        description=f"{recording.facts.title} recording",
        recording=recording,
        index_of={name: index for index, name in enumerate(recording.frame_names)},
    )
