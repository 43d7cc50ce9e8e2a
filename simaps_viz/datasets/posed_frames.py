"""Reads sequences in the folder format ``posed-frames/1``. Everything that can be checked cheaply is, on opening."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import read_intrinsics, read_poses
from simaps_viz.datasets.gravity import estimate_gravity
from simaps_viz.datasets.images import read_color, read_depth, read_ids
from simaps_viz.datasets.manifest import Manifest, read_manifest
from simaps_viz.datasets.recording import Segments
from simaps_viz.datasets.segment_tables import (
    WorldSegments,
    few,
    read_frame_segments,
    read_world_segments,
)
from simaps_viz.errors import InputError
from simaps_viz.geometry import map_from_world
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

DEPTH_RANGE_M = (0.15, 30.0)
"""The median depth of a sequence lies in here, or its unit is wrong."""

_USUAL_UNITS_M = (0.001, 0.0002, 0.00025, 0.0001, 0.01)
_SAMPLED_FOR_UNIT = 5
_SAMPLED_FOR_GRAVITY = 40


def open_sequence(path: Path, *, whole: bool = True) -> "PosedFrames":
    """Open a sequence and check it; recordings in other formats (docs/FORMATS.md) are recognised by their files.

    Read are the manifest, the calibration, the segment table, the first frame's images and a few depth images; that
    the images of all frames exist is looked up. Without ``up`` or ``floor_height_m`` in the manifest gravity is
    estimated from some forty frames, which takes up to a second.

    Args:
        path: The folder, or a manifest (.json) in it; for other formats their folder or file.
        whole: Every frame has to have its files. False: a build may skip frames, so that only the first frame has to be
            there; of other formats than posed-frames/1 all files still have to.

    Raises:
        InputError: Anything is not as the format wants it; the message names the file, what was expected and found.
    """
    path = Path(path)
    if not (path / "sequence.json").is_file():
        from simaps_viz.datasets.recognise import recognise  # noqa: PLC0415 - the readers build on this module

        reader = recognise(path)
        if reader is not None:
            from simaps_viz.datasets.converted import ConvertedFrames  # noqa: PLC0415 - as above

            return ConvertedFrames(reader.open_recording(path))
    return PosedFrames(read_manifest(path), whole=whole)


def is_sequence(path: Path) -> bool:
    """Determine from names alone whether a path is meant as a sequence: a folder, a manifest or a recording's file."""
    from simaps_viz.datasets.recognise import recognise  # noqa: PLC0415 - the readers build on this module

    return path.is_dir() or path.suffix == ".json" or recognise(path) is not None


class PosedFrames:
    """A checked sequence. Reading keeps no state, so several threads may read at once."""

    # Another kind of recording overrides where a frame's depth and colours come from (`_depth`, `color`, `color_file`),
    # and hands its own masks to `_open_segments`.

    notes: tuple[str, ...] = ()
    """What of the recording was left out, in words."""
    _whole: bool = True
    _segments: Segments | None
    """The precomputed segmentation; None = there is none."""

    def __init__(self, manifest: Manifest, *, whole: bool = True) -> None:
        self._whole = whole
        self.manifest = manifest
        self.name: str = manifest.name
        self.path: Path = manifest.path
        self.simulated: bool = manifest.simulated
        self.frame_names: tuple[str, ...]
        self.poses: NDArray
        """float64 [n, 4, 4], ``T_world_camera``, metres."""
        self.frame_names, self.poses = read_poses(manifest.file(manifest.poses))
        _check_files_exist(manifest, self.frame_names if whole else self.frame_names[:1])
        height, width = read_color(manifest.file(manifest.color, self.frame_names[0])).shape[:2]
        self.intrinsics: Intrinsics = read_intrinsics(manifest.file(manifest.intrinsics), width=width, height=height)
        self._check_depth_unit()
        self._open_segments(_segments_of(manifest, self.frame_names, self.intrinsics))
        self.gravity_estimated: bool = manifest.up is None or manifest.floor_height_m is None
        """Up or the floor was not in the manifest and was found in the depth images."""
        self.T_map_world: NDArray = self._find_map_frame()
        """float64 [4, 4], world to map frame."""

    def _open_segments(self, segments: Segments | None) -> None:
        """Take over the segmentation and check the first frame's."""
        self._segments = segments
        classes = segments.classes if segments else {}
        self.labels: tuple[str, ...] = ("none", *sorted(classes))
        """Class names; index 0 is "none"."""
        self.is_thing: tuple[bool, ...] = (False, *(classes[label] for label in sorted(classes)))
        """Aligned with ``labels``."""
        if segments:
            self.segmentation(0)

    def __len__(self) -> int:
        return len(self.frame_names)

    @property
    def segmentation_source(self) -> str:
        """Who made the precomputed segmentation, in words; "none" when there is none."""
        return self._segments.source if self._segments else "none"

    @property
    def ground_truth(self) -> bool:
        """The precomputed segmentation is the truth."""
        return self._segments is not None and self._segments.ground_truth

    def described(self) -> bytes:
        """Return what says what the images mean (camera, depth unit, segment tables), to see whether it has changed.

        Raises:
            InputError: the segment table cannot be read any more.
        """
        facts = repr((self.intrinsics, self.manifest.depth_unit_m, self.labels, self.is_thing, self.world_segments()))
        files = self.manifest.segmentation
        table = None if files is None else self.manifest.file(files.table)
        try:
            return facts.encode() + (b"" if table is None else table.read_bytes())
        except OSError as error:
            raise InputError(f"{table}: expected a table of segments, found {error.strerror or error}") from error

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame; its colour image only when asked for, as decoding it costs half as much again.

        Raises:
            InputError: An image is damaged, of another size or kind, or there is no frame of that index.
        """
        return Frame(
            index=index,
            name=self._name(index),
            depth_m=self._depth(index),
            T_world_camera=self.poses[index],
            intrinsics=self.intrinsics,
            color=self.color(index) if color else None,
        )

    def color(self, index: int) -> NDArray:
        """Read a frame's colour image, uint8 [H, W, 3], RGB; raises InputError like ``read``."""
        path = self.manifest.file(self.manifest.color, self._name(index))
        rgb = read_color(path)
        _check_size(path, rgb, self.intrinsics)
        return rgb

    def color_file(self, index: int) -> Path | None:
        """Return the file that holds exactly a frame's colour image, if there is one."""
        return self.manifest.file(self.manifest.color, self._name(index))

    def world_segments(self) -> tuple[Segment, ...] | None:
        """Return what the ids mean when they are the same in every frame; None when they are not, or there are none."""
        world = self._segments.world if self._segments else None
        return None if world is None else tuple(world.values())

    def segmentation(self, index: int) -> Segmentation:
        """Read a frame's precomputed segmentation.

        Raises:
            InputError: There is none, its image is damaged or of another size, or it holds an id without an entry.
        """
        self._name(index)
        if self._segments is None:
            raise InputError(f"{self.path}: {self._without_segments()}")
        return self._segments.read(index)

    def _depth(self, index: int) -> NDArray:
        """Read a frame's depth, float32 [H, W], metres along the optical axis, 0 = invalid; H, W are the camera's."""
        path = self.manifest.file(self.manifest.depth, self._name(index))
        depth_m = read_depth(path, self.manifest.depth_unit_m)
        _check_size(path, depth_m, self.intrinsics)
        return depth_m

    def _without_segments(self) -> str:
        return 'expected "segmentation", found none: a network has to segment these frames'

    def _name(self, index: int) -> str:
        if not 0 <= index < len(self):
            raise InputError(f"{self.path}: expected a frame index from 0 to {len(self) - 1}, found {index}")
        return self.frame_names[index]

    def _sample(self, count: int) -> list[int]:
        """Return indices of frames spread evenly over the sequence, the first included."""
        return sorted({int(i) for i in np.linspace(0, len(self) - 1, min(count, len(self)))})

    def _read_sample(self, count: int) -> list[Frame]:
        """Read frames spread evenly over the sequence; leaves out those that cannot be read, where that is allowed."""
        frames = []
        for index in self._sample(count):
            try:
                frames.append(self.read(index))
            except InputError:
                if self._whole or index == 0:
                    raise
        return frames

    def _check_depth_unit(self) -> None:
        depths = [frame.depth_m[frame.depth_m > 0] for frame in self._read_sample(_SAMPLED_FOR_UNIT)]
        valid = np.concatenate(depths)
        if not len(valid):
            pattern = self.path.parent / self.manifest.depth
            raise InputError(f"{pattern}: expected depth readings, found only 0 in {len(depths)} sampled frames")
        median, unit = float(np.median(valid)), self.manifest.depth_unit_m
        low, high = DEPTH_RANGE_M
        if not low <= median <= high:
            better = [u for u in _USUAL_UNITS_M if 2 * low <= median / unit * u <= high / 3]
            hint = f"; depth_unit_m {better[0]:g} would make it {median / unit * better[0]:.2f} m" if better else ""
            raise InputError(
                f"{self.path}: depth_unit_m: expected a median depth of {low:g} to {high:g} m, found {median:.4g} m "
                f"with {unit:g}{hint}"
            )

    def _find_map_frame(self) -> NDArray:
        up, floor_height_m = self.manifest.up, self.manifest.floor_height_m
        if up is not None and floor_height_m is not None:
            return map_from_world(up, floor_height_m)
        frames = self._read_sample(_SAMPLED_FOR_GRAVITY)
        try:
            found_up, found_floor_height_m = estimate_gravity(frames, up=None if up is None else np.array(up))
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from error
        return map_from_world(found_up, found_floor_height_m if floor_height_m is None else floor_height_m)


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


def _segments_of(manifest: Manifest, frames: tuple[str, ...], camera: Intrinsics) -> Segments | None:
    files = manifest.segmentation
    if files is None:
        return None
    path = manifest.file(files.table)
    table = read_world_segments(path) if files.world_wide else read_frame_segments(path, frames)

    def read(index: int) -> Segmentation:
        ids_path = manifest.file(files.ids, frames[index])
        ids = read_ids(ids_path)
        _check_size(ids_path, ids, camera)
        return table.segmentation(frames[index], ids_path, ids)

    world = table.by_id if isinstance(table, WorldSegments) else None
    return Segments(table.classes(), read, files.source, world, files.ground_truth)
