"""Read recordings in the folder format ``posed-frames/1``. Everything that can be checked cheaply is, on opening."""

import os
from dataclasses import replace
from pathlib import Path

from numpy.typing import NDArray

from simaps_viz.datasets.calibration import read_intrinsics, read_poses
from simaps_viz.datasets.images import read_color, read_depth, read_ids
from simaps_viz.datasets.manifest import Manifest, SegmentationFiles, read_manifest
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments
from simaps_viz.datasets.segment_tables import WorldSegments, few, read_frame_segments, read_world_segments
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics, Segmentation

FACTS = FormatFacts(
    title="posed-frames/1",
    recognised_by="`sequence.json`, or a manifest of any name (README)",
    depth="16-bit PNG",
    depth_unit_m=0.001,
    invalid="0",
    pose="camera to world: frame name, 4x4",
    camera_axes="OpenCV",
    up=None,
    segmentation="8- or 16-bit PNG of ids, named per frame (`segments`) or for the whole world (`instances`)",
)


class PosedFramesReader(Reader):
    """The reader of posed-frames/1 folders; the only one whose recordings may lack frames."""

    facts = FACTS

    def __init__(self, *, complete: bool = True) -> None:
        self.complete = complete
        """Every frame has to have its files; False: only the first."""

    def recognise(self, path: Path) -> bool:
        """Return whether a path is a manifest of the usual name, or a folder with one."""
        return path.name == "sequence.json" or (path / "sequence.json").is_file()

    def open(self, path: Path) -> Recording:
        """Open a folder or its manifest; raises InputError for anything that is not as the format wants it."""
        manifest = read_manifest(path)
        names, poses = read_poses(manifest.file(manifest.poses))
        _check_files_exist(manifest, names if self.complete else names[:1])
        height, width = read_color(manifest.file(manifest.color, names[0])).shape[:2]
        camera = read_intrinsics(manifest.file(manifest.intrinsics), width=width, height=height)

        def depth(index: int) -> NDArray:
            file = manifest.file(manifest.depth, names[index])
            depth_m = read_depth(file, manifest.depth_unit_m)
            _check_size(file, depth_m, camera)
            return depth_m

        def color_file(index: int) -> Path:
            return manifest.file(manifest.color, names[index])

        def color(index: int) -> NDArray:
            rgb = read_color(color_file(index))
            _check_size(color_file(index), rgb, camera)
            return rgb

        files = manifest.segmentation
        return Recording(
            facts=replace(FACTS, up=manifest.up),
            path=manifest.path,
            name=manifest.name,
            frame_names=names,
            poses=poses,
            intrinsics=camera,
            depth=depth,
            color=color,
            color_file=color_file,
            stored=lambda i: (color_file(i), manifest.file(manifest.depth, names[i])),
            segments=read_segments(manifest.path.parent, files, names, camera) if files else None,
            depth_unit_m=manifest.depth_unit_m,
            simulated=manifest.simulated,
            floor_height_m=manifest.floor_height_m,
            description=manifest.description,
            complete=self.complete,
        )


def read_segments(folder: Path, files: SegmentationFiles, frames: tuple[str, ...], camera: Intrinsics) -> Segments:
    """Read the table of a precomputed segmentation, whose id images have the size of the camera's.

    Raises:
        InputError: The table is not as the format wants it.
    """
    path = folder / files.table
    table = read_world_segments(path) if files.world_wide else read_frame_segments(path, frames)

    def stored(index: int) -> Path:
        return folder / files.ids.replace("{frame}", frames[index])

    def read(index: int) -> Segmentation:
        ids = read_ids(stored(index))
        _check_size(stored(index), ids, camera)
        return table.segmentation(frames[index], stored(index), ids)

    world = table.by_id if isinstance(table, WorldSegments) else None
    return Segments(table.classes(), read, files.source, world, files.ground_truth, path, stored)


def _check_files_exist(manifest: Manifest, frames: tuple[str, ...]) -> None:
    patterns = [manifest.color, manifest.depth] + ([manifest.segmentation.ids] if manifest.segmentation else [])
    for pattern in patterns:
        missing = [frame for frame in frames if not os.path.isfile(manifest.file(pattern, frame))]
        if missing:
            first = manifest.file(pattern, missing[0])
            raise InputError(
                f"{first}: expected a file for each of {len(frames)} frames, found none for {len(missing)}: "
                f"{few(missing)}"
            )


def _check_size(path: Path, image: NDArray, camera: Intrinsics) -> None:
    height, width = image.shape[:2]
    if (width, height) != (camera.width, camera.height):
        wanted = f"{camera.width}x{camera.height}"
        raise InputError(f"{path}: expected {wanted} pixels like the first colour image, found {width}x{height}")
