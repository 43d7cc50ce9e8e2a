"""Read recordings in the folder format ``posed-frames/1``. Everything that can be checked cheaply is, on opening."""

from dataclasses import replace
from functools import partial
from pathlib import Path

from simaps_viz.datasets.association import match_posed_files
from simaps_viz.datasets.calibration import Lens, read_intrinsics
from simaps_viz.datasets.file_frames import FileFrames, check_size
from simaps_viz.datasets.images import image_size, read_depth, read_ids
from simaps_viz.datasets.manifest import SegmentationFiles, read_manifest
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments, first_readable
from simaps_viz.datasets.segment_tables import WorldSegments, read_frame_segments, read_world_segments
from simaps_viz.structures import Intrinsics, Segmentation

FACTS = FormatFacts(
    title="posed-frames/1",
    recognised_by="`sequence.json`, or a manifest of any name (README)",
    pose="camera to world: frame name, 4x4",
    segmentation="8- or 16-bit PNG of ids, named per frame (`segments`) or for the whole world (`instances`)",
)


class PosedFramesReader(Reader):
    """The reader of posed-frames/1 folders."""

    facts = FACTS

    def recognise(self, path: Path) -> bool:
        """Return whether a path is a manifest of the usual name, or a folder with one."""
        return path.name == "sequence.json" or (path / "sequence.json").is_file()

    def open(self, path: Path) -> Recording:
        """Open a folder or its manifest; raises InputError for anything that is not as the format wants it."""
        manifest = read_manifest(path)
        patterns = {"colour file": manifest.color, "depth file": manifest.depth}
        if manifest.segmentation:
            patterns["id image"] = manifest.segmentation.ids
        matched, (color, depth, *_) = match_posed_files(
            manifest.file(manifest.poses), {kind: partial(manifest.file, pattern) for kind, pattern in patterns.items()}
        )
        names = tuple(matched.frames)
        width, height = first_readable(lambda i: image_size(color[i]), len(color))
        camera = read_intrinsics(manifest.file(manifest.intrinsics), width=width, height=height)
        lenses, unit_m, files = [Lens(camera)], manifest.depth_unit_m, manifest.segmentation
        frames = FileFrames(color, depth, lenses, lenses, camera, lambda file: read_depth(file, unit_m))
        return frames.recording(
            replace(FACTS, up=manifest.up),
            manifest.path,
            name=manifest.name,
            frame_names=names,
            poses=matched.poses,
            segments=read_segments(manifest.path.parent, files, names, camera) if files else None,
            depth_unit_m=unit_m,
            notes=matched.notes,
            faults=matched.faults,
            simulated=manifest.simulated,
            floor_height_m=manifest.floor_height_m,
            description=manifest.description,
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
        check_size(stored(index), ids, camera)
        return table.segmentation(frames[index], stored(index), ids)

    world = table.by_id if isinstance(table, WorldSegments) else None
    return Segments(table.classes(), read, files.source, world, files.ground_truth, path, stored)
