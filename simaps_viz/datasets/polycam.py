"""Read raw exports of Polycam ("keyframes"): a picture, a depth image and a camera file for each."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import match_frames
from simaps_viz.datasets.calibration import OPENCV_FROM_OPENGL, Lens, pinhole
from simaps_viz.datasets.file_frames import FileFrames, by_stem, depth_png, json_number, numbered
from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, first_readable, left_out
from simaps_viz.errors import InputError

FACTS = FormatFacts(
    title="Polycam",
    recognised_by="`keyframes/images/*.jpg`, `keyframes/depth/*.png`, `keyframes/cameras/*.json`, or `corrected_...`",
    pose="camera to world: t_00 ... t_23, three rows",
    camera_axes="OpenGL",
    up=(0.0, 1.0, 0.0),
)


class PolycamReader(Reader):
    """The reader of Polycam recordings."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a folder is in this format, from names alone."""
        return (_folder(path) / "depth").is_dir() and (_folder(path) / "cameras").is_dir()

    def open(self, path: Path) -> Recording:
        """Open an export; raises InputError for anything that is not as the format wants it.

        Where Polycam has optimised the poses, those (``corrected_cameras``) and their pictures are taken.
        """
        folder = _folder(path)
        corrected = "corrected_" if (folder / "corrected_cameras").is_dir() else ""
        images, cameras = folder / f"{corrected}images", folder / f"{corrected}cameras"
        camera_files = numbered(cameras, "*.json")
        if not camera_files:
            raise InputError(f"{cameras}: expected *.json, found none")
        depth = by_stem(numbered(folder / "depth", "*.png"))
        with_depth = {file.stem: file for file in camera_files if file.stem in depth}
        color = {stem: file for stem, file in by_stem(numbered(images, "*.jpg")).items() if stem in with_depth}
        if not with_depth:
            raise InputError(f"{folder / 'depth'}: expected *.png named as the cameras, found none; was LiDAR mode on?")
        cameras_of: dict[str, Lens] = {}

        def read_camera(file: Path) -> NDArray:
            content = read_json(file)
            cameras_of[file.stem] = _lens(str(file), content)
            return _pose(str(file), content)

        matched = match_frames(folder, {"picture": color}, with_depth, read_camera)
        lenses = [cameras_of[stem] for stem in matched.frames]
        depth_files, color_files = [depth[stem] for stem in matched.frames], [color[stem] for stem in matched.frames]
        read = depth_png(FACTS.depth_unit_m)
        height, width = first_readable(lambda i: read(depth_files[i]), len(depth_files)).shape
        depth_lenses = [lens.scaled(width, height) for lens in lenses]
        files = FileFrames(color_files, depth_files, lenses, depth_lenses, read)
        return files.recording(
            FACTS,
            path,
            name=folder.resolve().parent.name,
            poses=matched.poses,
            notes=(
                *left_out(len(camera_files) - len(with_depth), len(camera_files), "pictures have no depth"),
                *matched.notes,
            ),
            faults=matched.faults,
        )


def _folder(path: Path) -> Path:
    return path / "keyframes" if (path / "keyframes").is_dir() else path


def _lens(where: str, content: object) -> Lens:
    fx, fy, cx, cy, width, height = (
        json_number(where, content, key) for key in ("fx", "fy", "cx", "cy", "width", "height")
    )
    return Lens(pinhole(where, int(width), int(height), fx, fy, cx, cy))


def _pose(where: str, content: object) -> NDArray:
    T = np.eye(4)
    for row in range(3):
        for column in range(4):
            T[row, column] = json_number(where, content, f"t_{row}{column}")
    return T @ OPENCV_FROM_OPENGL
