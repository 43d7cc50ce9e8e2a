"""Read 7-Scenes recordings (Microsoft Research): three files a frame, from a handheld Kinect.

Depth and colour are the raw pictures, not registered to each other. The dataset gives the depth camera that its poses
were made with; colour is brought to it by the focal length that is usual for that sensor, which leaves a few pixels.
"""

from pathlib import Path

import numpy as np

from simaps_viz.datasets.calibration import Lens, matrix4, pinhole, rigid
from simaps_viz.datasets.file_frames import FileFrames, depth_png, numbered
from simaps_viz.datasets.images import image_size
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording

FACTS = FormatFacts(
    title="7-Scenes",
    recognised_by="`frame-*.depth.png`, `.color.png`, `.pose.txt`",
    invalid="0, 65535",
    pose="camera to world: 4x4",
)

INVALID = 65535
DEPTH_CAMERA = (640, 480, 585.0, 320.0, 240.0)
"""Width, height, focal length, principal point (x, y), pixels."""
COLOR_FOCAL = 525.0


class SevenScenesReader(Reader):
    """The reader of 7-Scenes recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        return path.is_dir() and next(path.glob("frame-*.depth.png"), None) is not None

    def open(self, path: Path) -> Recording:
        """Open a recording; raises InputError for anything that is not as the format wants it."""
        depth_files = numbered(path, "frame-*.depth.png")
        names = tuple(file.name.removesuffix(".depth.png") for file in depth_files)
        color_files = [path / f"{name}.color.png" for name in names]
        width, height, focal, cx, cy = DEPTH_CAMERA
        depth_lens = Lens(pinhole(str(path), width, height, focal, focal, cx, cy))
        color_lens = Lens(pinhole(str(path), width, height, COLOR_FOCAL, COLOR_FOCAL, cx, cy))
        actual = image_size(color_files[0])
        color_lens, depth_lens = color_lens.scaled(*actual), depth_lens.scaled(*actual)
        poses = np.stack([rigid(str(file), matrix4(file)) for file in (path / f"{name}.pose.txt" for name in names)])
        read = depth_png(FACTS.depth_unit_m, invalid=INVALID)
        files = FileFrames(color_files, depth_files, [color_lens], [depth_lens], depth_lens.intrinsics, read)
        resolved = path.resolve()
        return files.recording(
            FACTS,
            path,
            name=f"{resolved.parent.name} {resolved.name}" if resolved.name.startswith("seq-") else resolved.name,
            frame_names=names,
            poses=poses,
        )
