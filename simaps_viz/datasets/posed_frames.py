"""Read recordings in the folder format ``posed-frames/1``. Everything that can be checked cheaply is, on opening.

Tables describe the ids in a sequence's id images: for each frame, or once for the whole world.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.colors import classes
from simaps_viz.datasets.association import match_posed_files
from simaps_viz.datasets.calibration import Lens, read_intrinsics
from simaps_viz.datasets.file_frames import FileFrames, check_size, first_size
from simaps_viz.datasets.images import MAX_ID, read_depth, read_ids
from simaps_viz.datasets.manifest import SegmentationFiles, few, read_json, read_manifest, shown
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, Segments
from simaps_viz.errors import InputError
from simaps_viz.structures import Intrinsics, Segment, Segmentation

FACTS = FormatFacts(
    title="posed-frames/1",
    recognised_by="`sequence.json`, or a manifest of any name",
    pose="camera to world: frame name, 4x4",
    segmentation="8- or 16-bit PNG of ids, named per frame (`segments`) or for the whole world (`instances`)",
)


def _recognise(path: Path) -> bool:
    return path.name == "sequence.json" or (path / "sequence.json").is_file()


def _open(path: Path) -> Recording:
    manifest = read_manifest(path)
    patterns = {"colour file": manifest.color, "depth file": manifest.depth}
    if manifest.segmentation:
        patterns["id image"] = manifest.segmentation.ids
    matched, (color, depth, *_) = match_posed_files(
        manifest.file(manifest.poses), {kind: partial(manifest.file, pattern) for kind, pattern in patterns.items()}
    )
    names = tuple(matched.frames)
    width, height = first_size(color)
    camera = read_intrinsics(manifest.file(manifest.intrinsics), width=width, height=height)
    lenses, unit_m, files = [Lens(camera)], manifest.depth_unit_m, manifest.segmentation
    frames = FileFrames(color, depth, lenses, lenses, lambda file: read_depth(file, unit_m))
    return frames.recording(
        replace(FACTS, up=manifest.up),
        manifest.path,
        name=manifest.name,
        frame_names=names,
        segments=read_segments(manifest.path.parent, files, names, camera) if files else None,
        depth_unit_m=unit_m,
        **matched.members(),
        simulated=manifest.simulated,
        floor_height_m=manifest.floor_height_m,
        description=manifest.description,
    )


READER = Reader(FACTS, _recognise, _open)


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


@dataclass(frozen=True)
class FrameSegments:
    """Key ``segments``: every frame has ids of its own."""

    path: Path
    by_frame: Mapping[str, tuple[Segment, ...]]

    def classes(self) -> dict[str, bool]:
        """Return {class name: is it a thing} of every segment."""
        return {s.label: s.is_thing for segments in self.by_frame.values() for s in segments}

    def segmentation(self, frame: str, image: Path, raw: NDArray) -> Segmentation:
        """Join the frame's id image [H, W] with its entries; entries without a pixel are kept.

        Raises:
            InputError: The image holds an id that has no entry.
        """
        segments = self.by_frame[frame]
        _check_known(image, self.path, frame, _present(raw), {s.id for s in segments})
        return Segmentation(raw.astype(np.int32), segments)


@dataclass(frozen=True)
class WorldSegments:
    """Key ``instances``: an id is the same object in every frame."""

    path: Path
    by_id: Mapping[int, Segment]

    def classes(self) -> dict[str, bool]:
        """Return {class name: is it a thing} of every instance of the scene."""
        return {s.label: s.is_thing for s in self.by_id.values()}

    def segmentation(self, frame: str, image: Path, raw: NDArray) -> Segmentation:
        """Join the frame's id image [H, W] with the scene: the segments are the instances in the picture.

        Raises:
            InputError: The image holds an id that the scene does not have.
        """
        present = _present(raw)
        _check_known(image, self.path, frame, present, self.by_id)
        return Segmentation(raw.astype(np.int32), tuple(self.by_id[i] for i in present))


def read_frame_segments(path: Path, frames: Sequence[str]) -> FrameSegments:
    """Read ``{frame: [{id, label, score, isthing, area}]}``.

    Score may be left out (1.0), isthing too (the class name decides); area is not used.
    Frames that the sequence does not have are ignored, so that a part of the poses can be used with the whole table.

    Raises:
        InputError: Another shape, a frame without a list (one that shows nothing has an empty list), an id that is
            no whole number from 1 to 65535 or comes twice in a frame, a bad label or score.
    """
    table = read_json(path)
    if not isinstance(table, dict):
        raise InputError(f"{path}: expected an object {{frame: [segments]}}, found {shown(table)}")
    missing = [frame for frame in frames if frame not in table]
    if missing:
        raise InputError(
            f"{path}: expected an entry for each of {len(frames)} frames, found none for {len(missing)}: {few(missing)}"
        )
    return FrameSegments(path, {frame: _frame_segments(f"{path}: frame {frame}", table[frame]) for frame in frames})


def read_world_segments(path: Path) -> WorldSegments:
    """Read a scene file, ``{"instances": [{id, label, isthing, ...}]}``; without isthing the class name decides.

    Raises:
        InputError: Another shape, bad or repeated ids, bad labels, or a class that is both thing and stuff.
    """
    scene = read_json(path)
    entries = scene.get("instances") if isinstance(scene, dict) else None
    if not isinstance(entries, list) or not entries:
        raise InputError(f'{path}: expected an object with a list "instances", found {shown(scene)}')
    by_id: dict[int, Segment] = {}
    is_thing: dict[str, bool] = {}
    for entry in entries:
        segment = _segment(f"{path}: instances", entry)
        if segment.id in by_id:
            raise InputError(f"{path}: instances: expected each id once, found {segment.id} again")
        if is_thing.setdefault(segment.label, segment.is_thing) != segment.is_thing:
            raise InputError(
                f"{path}: instances: expected {shown(segment.label)} to be thing or stuff, found isthing both ways"
            )
        by_id[segment.id] = segment
    return WorldSegments(path, by_id)


def _frame_segments(where: str, entries: Any) -> tuple[Segment, ...]:
    if not isinstance(entries, list):
        raise InputError(f"{where}: expected a list of segments, found {shown(entries)}")
    segments = tuple(_segment(where, entry) for entry in entries)
    ids = [s.id for s in segments]
    if len(set(ids)) != len(ids):
        twice = next(i for i in ids if ids.count(i) > 1)
        raise InputError(f"{where}: expected each id once, found {twice} again")
    return segments


def _segment(where: str, entry: Any) -> Segment:
    if not isinstance(entry, dict):
        raise InputError(f"{where}: expected objects with id and label, found {shown(entry)}")
    number, label, score = entry.get("id"), entry.get("label"), entry.get("score", 1.0)
    if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= MAX_ID:
        raise InputError(f"{where}: expected id as a whole number from 1 to {MAX_ID}, found {shown(number)}")
    if not isinstance(label, str) or not label.strip() or label == "none":
        raise InputError(f'{where}: id {number}: expected label as a class name (not "none"), found {shown(label)}')
    if not isinstance(score, int | float) or isinstance(score, bool) or not 0 <= score <= 1:
        raise InputError(f"{where}: id {number}: expected score from 0 to 1, found {shown(score)}")
    is_thing = entry.get("isthing", classes.is_thing(label))
    if not isinstance(is_thing, bool):
        raise InputError(f"{where}: id {number}: expected isthing as true or false, found {shown(is_thing)}")
    return Segment(number, label, float(score), is_thing)


def _present(raw: NDArray) -> list[int]:
    """Return the ids in the image, without 0, ascending. A histogram: np.unique would cost as much as decoding."""
    bins = 256 if raw.dtype == np.uint8 else int(raw.max()) + 1
    histogram = cv2.calcHist([raw], [0], None, [bins], [0, bins])
    return [int(i) for i in np.flatnonzero(histogram) if i > 0]


def _check_known(image: Path, table: Path, frame: str, present: Sequence[int], known: Any) -> None:
    unknown = [i for i in present if i not in known]
    if unknown:
        raise InputError(
            f"{image}: frame {frame}: expected only ids that {table.name} lists, found {len(unknown)} "
            f"without an entry: {few(unknown)}"
        )
