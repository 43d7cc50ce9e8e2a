"""A recording of any format as the sequence that maps are built from: checked, with the map's frame found."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.calibration import check_reach
from simaps_viz.datasets.file_frames import check_size
from simaps_viz.datasets.gravity import find_gravity
from simaps_viz.datasets.recording import Recording, Segments, first_readable
from simaps_viz.errors import InputError
from simaps_viz.geometry import map_from_world, spread
from simaps_viz.io.limits import MAX_FRAMES, check_frame_name
from simaps_viz.structures import Frame, Intrinsics, Segment, Segmentation

DEPTH_RANGE_M = (0.15, 30.0)
"""The median depth of a sequence is in this range, or its unit is wrong."""

_USUAL_UNITS_M = (0.001, 0.0002, 0.00025, 0.0001, 0.01)
_SAMPLED_FOR_UNIT = 5
_SAMPLED_FOR_GRAVITY = 40


class PosedFrames:
    """A checked sequence of posed RGB-D frames, whatever format its recording is in.

    Frames are converted while they are read; nothing is written. Reading keeps no state, so several threads may read
    at once.
    """

    def __init__(self, recording: Recording, *, strict: bool = False) -> None:
        """Check poses, the first colour image and a few depth images, and find up and the floor.

        Args:
            recording: as a reader returns it.
            strict: the first frame and those that are looked at have to be readable, and none may have been left out
                because something of it is missing or damaged. Otherwise so many are as can be.

        Raises:
            InputError: A camera is far from the others, an image is not as the format wants it, or the depth unit
                cannot be right.
        """
        if strict and recording.faults:
            raise InputError(f"{recording.path}: expected all of every frame, found {'; '.join(recording.faults)}")
        self.recording = recording
        self.strict = strict
        self.name: str = recording.name
        self.path: Path = recording.path
        self.simulated: bool = recording.simulated
        same = len(recording.poses) > 1 and bool((recording.poses == recording.poses[0]).all())
        still = f"all {len(recording.poses)} poses are the same: the camera stood still, or none were recorded"
        self.notes: tuple[str, ...] = (*recording.notes, *recording.faults, *[still] * same)
        """What of the recording was left out, and what of up and the floor had to be taken from elsewhere, in words."""
        self.frame_names: tuple[str, ...] = recording.frame_names
        self.poses: NDArray = recording.poses
        """float64 [n, 4, 4], ``T_world_camera``, metres."""
        self.intrinsics: Intrinsics = recording.intrinsics
        self.depth_unit_m: float = recording.depth_unit_m or recording.facts.depth_unit_m
        """Metres that a step of a 16-bit depth image means, as stored or as it would be written."""
        classes = recording.segments.classes if recording.segments else {}
        self.labels: tuple[str, ...] = ("none", *sorted(classes))
        """Class names; index 0 is "none"."""
        self.is_thing: tuple[bool, ...] = (False, *(classes[label] for label in sorted(classes)))
        """Aligned with ``labels``."""
        if len(self.frame_names) > MAX_FRAMES:
            raise InputError(f"{self.path}: expected at most {MAX_FRAMES} frames, found {len(self.frame_names)}")
        for name in self.frame_names:
            check_frame_name(self.path, name)
        check_reach([f"{self.path}: frame {name}" for name in self.frame_names], self.poses)
        first_readable(self.color, len(self), strict=strict)
        self._check_depth_unit()
        if recording.segments:
            first_readable(self.segmentation, len(self), strict=strict)
        self.gravity_estimated: bool = recording.facts.up is None or recording.floor_height_m is None
        """The recording does not state up or the floor's height, so they were found in the depth images."""
        self.T_map_world: NDArray = self._find_map_frame()
        """float64 [4, 4], world to map frame."""

    def __len__(self) -> int:
        return len(self.frame_names)

    @property
    def segmentation_source(self) -> str:
        """Who made the precomputed segmentation, in words; "none" when there is none."""
        return self.recording.segments.source if self.recording.segments else "none"

    @property
    def ground_truth(self) -> bool:
        """The precomputed segmentation is the truth."""
        return self.recording.segments is not None and self.recording.segments.ground_truth

    @property
    def description(self) -> str:
        """What the recording says of itself, in words."""
        described = self.recording.description
        return f"{self.recording.facts.title} recording" if described is None else described

    def described(self) -> bytes:
        """Return what says what the images mean (camera, depth unit, segment tables), to see whether it has changed.

        Raises:
            InputError: the segment table cannot be read any more.
        """
        facts = repr((self.intrinsics, self.depth_unit_m, self.labels, self.is_thing, self.world_segments()))
        table = self.recording.segments.table if self.recording.segments else None
        try:
            return facts.encode() + (b"" if table is None else table.read_bytes())
        except OSError as error:
            raise InputError(f"{table}: expected a table of segments, found {error.strerror or error}") from error

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame; its colour image only when asked for, as decoding it costs half as much again.

        Raises:
            InputError: An image is damaged, of another size or kind, or there is no frame of that index.
        """
        name = self._name(index)
        depth_m = self.recording.depth(index)
        check_size(f"{self.path}: frame {name}: depth", depth_m, self.intrinsics)
        return Frame(
            index=index,
            name=name,
            depth_m=depth_m,
            T_world_camera=self.poses[index],
            intrinsics=self.intrinsics,
            color=self.color(index) if color else None,
        )

    def color(self, index: int) -> NDArray:
        """Read a frame's colour image, uint8 [H, W, 3], RGB; raises InputError like ``read``."""
        name = self._name(index)
        rgb = self.recording.color(index)
        check_size(f"{self.path}: frame {name}: colour", rgb, self.intrinsics)
        return rgb

    def color_file(self, index: int) -> Path | None:
        """Return the file that holds exactly a frame's colour image, if there is one."""
        return self.recording.color_file(index)

    def files(self, index: int) -> tuple[Path, Path]:
        """Return the files that colour and depth of a frame are in; the recording itself when it is one file."""
        return self.recording.stored(index) if self.recording.stored else (self.path, self.path)

    def world_segments(self) -> tuple[Segment, ...] | None:
        """Return what the ids mean when they are the same in every frame; None when they are not, or there are none."""
        world = self.recording.segments.world if self.recording.segments else None
        return None if world is None else tuple(world.values())

    def segmentation(self, index: int) -> Segmentation:
        """Read a frame's precomputed segmentation.

        Raises:
            InputError: There is none, its image is damaged or of another size, or it holds an id without an entry.
        """
        self._name(index)
        return self.segments().read(index)

    def segments(self) -> Segments:
        """Return the segmentation that the recording brings along; raises InputError where it brings none."""
        if self.recording.segments is None:
            raise InputError(
                f"{self.path}: expected a segmentation, found none in this {self.recording.facts.title} recording: a "
                "network has to segment these frames (--segmentation MODEL.onnx)"
            )
        return self.recording.segments

    def _name(self, index: int) -> str:
        if not 0 <= index < len(self):
            raise InputError(f"{self.path}: expected a frame index from 0 to {len(self) - 1}, found {index}")
        return self.frame_names[index]

    def _read_sample(self, count: int) -> list[Frame]:
        """Read frames spread evenly over the sequence; leave out those that cannot be read, where that is allowed.

        Raises:
            InputError: None of them can be read, or one cannot and ``strict``.
        """
        frames, error = [], None
        for index in spread(len(self), count):
            try:
                frames.append(self.read(index))
            except InputError as found:
                if self.strict:
                    raise
                error = error or found
        if error is not None and not frames:
            raise error
        return frames

    def _check_depth_unit(self) -> None:
        depths = [frame.depth_m[frame.depth_m > 0] for frame in self._read_sample(_SAMPLED_FOR_UNIT)]
        valid = np.concatenate(depths)
        if not len(valid):
            raise InputError(
                f"{self.files(0)[1]}: expected depth readings, found only 0 in {len(depths)} sampled frames"
            )
        median, unit = float(np.median(valid)), self.depth_unit_m
        low, high = DEPTH_RANGE_M
        if not low <= median <= high:
            better = [u for u in _USUAL_UNITS_M if 2 * low <= median / unit * u <= high / 3]
            hint = f"; depth_unit_m {better[0]:g} would make it {median / unit * better[0]:.2f} m" if better else ""
            own = self.path.suffix == ".json"  # a manifest, which people write
            raise InputError(
                f"{self.path}: {'depth_unit_m: ' * own}expected a median depth of {low:g} to {high:g} m, found "
                f"{median:.4g} m with {unit:g}{hint * own}"
            )

    def _find_map_frame(self) -> NDArray:
        up, floor_height_m = self.recording.facts.up, self.recording.floor_height_m
        if up is not None and floor_height_m is not None:
            return map_from_world(up, floor_height_m)
        found = find_gravity(
            self._read_sample(_SAMPLED_FOR_GRAVITY), up=None if up is None else np.array(up, dtype=np.float64)
        )
        notes = [found.up_note, found.floor_note if floor_height_m is None else ""]
        self.notes = (*self.notes, *filter(None, notes))
        return map_from_world(found.up, found.floor_height_m if floor_height_m is None else floor_height_m)
