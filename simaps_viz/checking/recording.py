"""Open a sequence without judging it, so that what is wrong with it can be found out.

Of posed-frames/1, `simaps_viz.datasets` refuses a mirrored pose, an impossible camera matrix or a depth unit that makes
rooms of millimetres. Here only what cannot be worked with at all is refused: files that are missing, damaged or no
numbers. Recordings of other formats are taken as their readers return them. The conventions in which people write poses
are here too, with what each takes to become ``T_world_camera``, and which frames and pairs of frames a check looks at.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import permutations, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import Views, relative_poses, residuals
from simaps_viz.datasets.association import interpolate_poses, match_posed_files
from simaps_viz.datasets.calibration import camera_matrix
from simaps_viz.datasets.file_frames import MAX_STEP, check_size
from simaps_viz.datasets.images import read_color, read_depth
from simaps_viz.datasets.manifest import Manifest, read_manifest
from simaps_viz.datasets.open import reader_of
from simaps_viz.datasets.posed_frames import READER as POSED_FRAMES
from simaps_viz.datasets.recording import Recording as SourceRecording
from simaps_viz.datasets.recording import first_readable
from simaps_viz.errors import InputError
from simaps_viz.events import Progress

FORMS = ("camera-to-world", "world-to-camera", "rotation world-to-camera", "position world-to-camera")
"""What of a pose file is written the other way round: nothing, all, only the rotation, only the position."""

Turn = tuple[tuple[int, ...], ...]
"""A signed permutation: three rows of three, each with one entry of ±1."""

PLAIN: Turn = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
OPENGL: Turn = ((1, 0, 0), (0, -1, 0), (0, 0, -1))
ROS: Turn = ((0, 0, 1), (-1, 0, 0), (0, -1, 0))

_NAMED_AXES: dict[Turn, str] = {
    PLAIN: "x right, y down, z forward",
    OPENGL: "OpenGL camera axes (x right, y up, z backward)",
    ROS: "ROS body axes (x forward, y left, z up)",
    ((0, 1, 0), (0, 0, 1), (1, 0, 0)): "axes x down, y forward, z right",
    ((1, 0, 0), (0, 0, 1), (0, -1, 0)): "axes x right, y forward, z up",
    ((-1, 0, 0), (0, -1, 0), (0, 0, 1)): "a camera upside down (x left, y up, z forward)",
    ((0, -1, 0), (1, 0, 0), (0, 0, 1)): "a camera on its side",
    ((0, 1, 0), (-1, 0, 0), (0, 0, 1)): "a camera on its other side",
    ((1, 0, 0), (0, -1, 0), (0, 0, 1)): "a camera with y flipped (x right, y up, z forward: left-handed)",
    ((1, 0, 0), (0, 1, 0), (0, 0, -1)): "a camera with z flipped (left-handed)",
    ((-1, 0, 0), (0, 1, 0), (0, 0, 1)): "a camera with x flipped (left-handed)",
}
"""By the matrix that takes OpenCV camera points to the named axes' numbers."""


@dataclass(frozen=True)
class Convention:
    """One way of writing poses."""

    form: str = FORMS[0]
    axes: Turn = PLAIN
    """A: takes a point's OpenCV camera coordinates to those the poses were written for; a signed permutation."""
    world: Turn = PLAIN
    """W: takes a point's world coordinates as written to those wanted; mirrors a mirrored world back."""
    turned_positions: Turn = PLAIN
    """Q: takes positions as written to the axes of the rotations."""

    @property
    def plain(self) -> bool:
        """Nothing has to be done."""
        return self == Convention()

    @property
    def changes(self) -> int:
        """Number of unusual assumptions it makes; the simplest convention that fits is chosen."""
        plain = Convention()
        named = self.axes in _NAMED_AXES
        return (
            (self.form != plain.form) * (1 if self.form == FORMS[1] else 2)
            + (self.axes != plain.axes) * (1 if named else 2)
            + (self.world != plain.world)
            + (self.turned_positions != plain.turned_positions) * 2
        )

    def apply(self, matrices: NDArray) -> NDArray:
        """Turn poses [n, 4, 4] as written into T_world_camera."""
        rotation = matrices[:, :3, :3]
        position = matrices[:, :3, 3] @ np.array(self.turned_positions, float).T
        back = -np.einsum("nji,nj->ni", rotation, position)
        if self.form in (FORMS[1], FORMS[2]):
            rotation = rotation.transpose(0, 2, 1)
        if self.form in (FORMS[1], FORMS[3]):
            position = back if self.form == FORMS[1] else -np.einsum("nij,nj->ni", rotation, position)
        world = np.array(self.world, float)
        out = np.tile(np.eye(4), (len(matrices), 1, 1))
        out[:, :3, :3] = world @ rotation @ np.array(self.axes, float)
        out[:, :3, 3] = position @ world.T
        return out

    def in_words(self) -> str:
        """Describe what the poses look like."""
        plain = Convention()
        parts = [self.form] if self.form != plain.form else []
        if self.axes != plain.axes:
            parts.append(f"for {_NAMED_AXES.get(self.axes, f'other camera axes {list(map(list, self.axes))}')}")
        if self.turned_positions != plain.turned_positions:
            parts.append("with positions in other axes than rotations")
        if self.world != plain.world:
            parts.append("of a mirrored world")
        return ", ".join(parts) or "camera-to-world with OpenCV axes"


@cache
def signed_permutations(determinant: int) -> tuple[Turn, ...]:
    """Return the 24 matrices of zeros and ±1 with that determinant, the identity first where it is among them."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1, -1), repeat=3):
            matrix = np.zeros((3, 3), int)
            matrix[range(3), order] = signs
            if round(float(np.linalg.det(matrix))) == determinant:
                found.append(tuple(tuple(int(x) for x in row) for row in matrix))
    return tuple(found)


MIRRORS: tuple[Turn, ...] = tuple(
    tuple(tuple(row) for row in matrix)
    for matrix in (
        ((1, 0, 0), (0, 0, 1), (0, 1, 0)), ((0, 1, 0), (1, 0, 0), (0, 0, 1)), ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
        ((1, 0, 0), (0, 1, 0), (0, 0, -1)), ((1, 0, 0), (0, -1, 0), (0, 0, 1)), ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    )
)  # fmt: skip
"""Swapping two world axes, or turning one round; the frames agree alike after each."""


def conventions(*, mirrored: bool) -> list[Convention]:
    """Return the ways worth trying, for poses whose rotations are proper or mirrored, the simplest first."""
    proper, improper = signed_permutations(1), signed_permutations(-1)
    if mirrored:
        found = [Convention(form, axes) for form in FORMS for axes in improper]
        found += [Convention(form, axes, MIRRORS[0]) for form in FORMS for axes in proper]
    else:
        found = [Convention(form, axes) for form in FORMS for axes in proper]
        turns = (*proper[1:], *improper)
        found += [Convention(turned_positions=turn) for turn in turns if turn != Convention().axes]
    return sorted(found, key=lambda convention: convention.changes)


ORTHONORMAL = 1e-2
"""How far R Rᵀ may be off the identity, as on opening a sequence."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A sequence as its files have it, right or wrong."""

    path: Path
    """The manifest, or the recording's folder or file."""
    name: str
    names: tuple[str, ...]
    """Names of the frames, in order."""
    matrices: NDArray
    """float64 [n, 4, 4], what the files say; rotations are orthonormal but may be mirrored."""
    camera: NDArray
    """float64 [4], what the files say: fx, fy, cx, cy, pixels of the colour image."""
    color_size: tuple[int, int]
    """Width and height, pixels."""
    depth_size: tuple[int, int]
    """Width and height, pixels."""
    unit_m: float
    """Metres a step of depth, as the files say."""
    depth_steps: Callable[[int], NDArray]
    """Reads a frame's depth image, uint16 [H, W], 0 = invalid; raises InputError when it is missing, damaged, or of
    another size than the first."""
    color: Callable[[int], NDArray]
    """Reads a frame's colour image, uint8 [H, W, 3], RGB; raises InputError when it cannot be read."""
    up: tuple[float, float, float] | None = None
    """World frame, any length; None = not stated."""
    floor_height_m: float | None = None
    """Height of the floor along ``up``; None = not stated."""
    depth_file: Callable[[int], Path | None] = lambda _: None
    """The file with a frame's depth image and nothing else, if there is one."""
    source: SourceRecording | None = None
    """What its reader returned; None for posed-frames/1, whose files are read as they are."""
    notes: tuple[str, ...] = ()
    """What was left out, in words."""

    def __len__(self) -> int:
        return len(self.names)


FEWEST_STEPS = 500
"""That far away is the median of a recording's depth at least, so that nothing is lost by rounding."""


def open_recording(path: Path) -> Recording:
    """Open a sequence of any format; of posed-frames/1 the numbers are taken as they are, without judging them.

    Raises:
        InputError: Something cannot be read, or has not the numbers it needs to have.
    """
    path = Path(path)
    reader = reader_of(path)
    if reader is POSED_FRAMES:
        return _posed_frames(read_manifest(path))
    return as_recording(reader.open(path))


def as_recording(source: SourceRecording) -> Recording:
    """Return what a reader has opened, as the check wants it; depth in metres becomes steps of a millimetre or less."""
    k = source.intrinsics
    stated_m = source.depth_unit_m or source.facts.depth_unit_m
    depth_m = first_readable(source.depth, len(source.frame_names))
    median_m = float(np.median(depth_m[depth_m > 0])) if (depth_m > 0).any() else 1.0
    unit_m = min(stated_m, 0.001, median_m / FEWEST_STEPS)  # of a wrong unit the steps are too coarse, too
    size = (k.width, k.height)

    def depth_steps(index: int) -> NDArray:
        depth_m = source.depth(index)
        check_size(f"{source.path}: frame {source.frame_names[index]}: depth", depth_m, k)
        steps = np.rint(depth_m.astype(np.float64) / unit_m)
        steps[~(steps <= MAX_STEP)] = 0
        return steps.astype(np.uint16)

    def depth_file(index: int) -> Path | None:
        files = source.stored(index) if source.stored else None
        return files[1] if files else None

    return Recording(
        path=source.path, name=source.name, names=source.frame_names, matrices=source.poses,
        camera=np.array([k.fx, k.fy, k.cx, k.cy]), color_size=size, depth_size=size, unit_m=unit_m,
        depth_steps=depth_steps, color=source.color, up=source.facts.up, floor_height_m=source.floor_height_m,
        depth_file=depth_file, source=source, notes=(*source.notes, *source.faults),
    )  # fmt: skip


def _posed_frames(manifest: Manifest) -> Recording:
    """Read the pose and intrinsics files and the size of the first images."""
    files = {
        "colour file": partial(manifest.file, manifest.color),
        "depth file": partial(manifest.file, manifest.depth),
    }
    matched, _ = match_posed_files(manifest.file(manifest.poses), files, checked=_orthonormal)
    names = tuple(matched.frames)
    camera = _read_camera(manifest.file(manifest.intrinsics))

    def color(index: int) -> NDArray:
        return read_color(manifest.file(manifest.color, names[index]))

    def depth_file(index: int) -> Path:
        return manifest.file(manifest.depth, names[index])

    color_size, depth_size = ((image.shape[1], image.shape[0]) for image in (color(0), read_depth(depth_file(0), 1.0)))

    def depth_steps(index: int) -> NDArray:
        steps = read_depth(depth_file(index), 1.0).astype(np.uint16)
        found = (steps.shape[1], steps.shape[0])
        if found != depth_size:
            sizes = [f"{width}x{height}" for width, height in (depth_size, found)]
            raise InputError(
                f"{depth_file(index)}: expected {sizes[0]} pixels like the first depth image, found {sizes[1]}"
            )
        return steps

    return Recording(
        path=manifest.path, name=manifest.name, names=names, matrices=matched.poses, camera=camera,
        color_size=color_size, depth_size=depth_size, unit_m=manifest.depth_unit_m, depth_steps=depth_steps,
        color=color, up=manifest.up, floor_height_m=manifest.floor_height_m, depth_file=depth_file,
        notes=(*matched.notes, *matched.faults),
    )  # fmt: skip


def _orthonormal(where: str, matrix: NDArray) -> NDArray:
    """Return a pose as it is written, which may be mirrored or inverted; raises InputError for one that is damaged."""
    if np.allclose(matrix[:, 3], (0, 0, 0, 1), atol=1e-6) and not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
        raise InputError(f"{where}: expected 0 0 0 1 as the last row, found the matrix written column by column")
    rotation = matrix[:3, :3]
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > ORTHONORMAL:
        raise InputError(f"{where}: expected an orthonormal rotation, found none")
    return matrix


def _read_camera(path: Path) -> NDArray:
    K = camera_matrix(path)
    fx, fy = K[0, 0], K[1, 1]
    if fx <= 0 or fy <= 0:
        raise InputError(f"{path}: expected focal lengths fx, fy over 0, found {fx:g} and {fy:g}")
    return np.array([fx, fy, K[0, 2], K[1, 2]])


@dataclass(frozen=True, eq=False)
class Reading:
    """A hypothesis about a sequence; the default one takes the files at their word."""

    convention: Convention = field(default_factory=Convention)
    depth_factor: float = 1.0
    """On the depth unit."""
    position_factor: float = 1.0
    """On the written positions."""
    shift: float = 0
    """Frame i has the pose written for frame i + shift, interpolated where that is no whole number ..."""
    shift_later: int | None = None
    """... or, from ``shift_from`` on, that written for frame i + shift_later."""
    shift_from: int = 0
    left_out: tuple[int, ...] = ()
    """Frames to leave out."""
    camera: NDArray | None = None
    """float64 [4], fx, fy, cx, cy in place of those stated."""

    def shifts(self, count: int) -> NDArray:
        """Return for each frame how far away its pose is written, float64 [n]."""
        shifts = np.full(count, self.shift, np.float64)
        if self.shift_later is not None:
            shifts[self.shift_from :] = self.shift_later
        return shifts

    def posed(self, count: int) -> NDArray:
        """Return which frames have a pose, bool [n]: a shift leaves some at an end without."""
        row = np.arange(count) + self.shifts(count)
        posed = (row >= 0) & (row <= count - 1)
        posed[list(self.left_out)] = False
        return posed

    def poses(self, recording: Recording) -> NDArray:
        """Return T_world_camera, float64 [n, 4, 4]; NaN for frames that have none."""
        count = len(recording)
        row = np.clip(np.arange(count) + self.shifts(count), 0, count - 1)
        poses = self.convention.apply(recording.matrices)
        if (row % 1).any() and (np.linalg.det(poses[:, :3, :3]) > 0).all():
            poses, _ = interpolate_poses(np.arange(count, dtype=float), poses, row, max_gap_s=2.0)
        else:
            poses = poses[np.rint(row).astype(np.int64)]
        poses[:, :3, 3] *= self.position_factor
        poses[~self.posed(count)] = np.nan
        return poses

    def posed_pairs(self, recording: Recording, views: Views, pairs: NDArray) -> NDArray:
        """Return the pairs of views, int64 [p, 2], whose frames both have a pose, bool [p]."""
        return np.asarray(self.posed(len(recording))[views.frames[pairs]].all(axis=1))

    def residuals(self, recording: Recording, views: Views, pairs: NDArray, every: int = 1) -> NDArray:
        """Compare pairs of views, int64 [p, 2], under this hypothesis: see `agreement.residuals`."""
        T_target_source = relative_poses(self.poses(recording), views.frames, pairs)
        return residuals(views, pairs, T_target_source, self.camera_of(recording), self.unit_m(recording), every)

    def camera_of(self, recording: Recording) -> NDArray:
        """Return fx, fy, cx, cy, float64 [4]."""
        return recording.camera if self.camera is None else self.camera

    def unit_m(self, recording: Recording) -> float:
        """Return metres a step of depth."""
        return recording.unit_m * self.depth_factor


BASES = 40
"""Places in the sequence where frames are compared."""
TURN_DEG = (8.0, 40.0)
"""A partner is the first frame that has turned by more than the first, as long as it has by less than the second."""
GAP = 6
"""Partners are no further apart than this many frames."""
SAMPLES = 800
"""Points a frame, at most."""
WIDEST = 640
"""Pixels; wider depth images are thinned out by whole steps."""
REVISIT_GAP = 15
"""Frames between two visits of a place, at least."""
REVISIT_TURN_DEG = 45.0
REVISIT_DISTANCE_M = 1.5


def neighbour_pairs(matrices: NDArray) -> NDArray:
    """Pair frames with later ones that have turned a little, so that mistakes show but most is still in view.

    Angles between rotations are the same whichever way poses are written, so this needs no right poses.

    Returns:
        int64 [p, 2], frame indices (earlier, later); empty for a single frame.
    """
    count = len(matrices)
    found = []
    for base in sorted({int(i) for i in np.linspace(0, max(count - 2, 0), BASES)} if count > 1 else ()):
        last = min(base + GAP, count - 1)
        turns = turned_deg(matrices[base], matrices[base + 1 : last + 1]).tolist()
        gap = next((g for g, turn in enumerate(turns, 1) if turn > TURN_DEG[0]), len(turns))
        while gap > 1 and turns[gap - 1] > TURN_DEG[1]:
            gap -= 1
        found.append((base, base + gap))
    return np.array(found, np.int64).reshape(-1, 2)


def load_views(recording: Recording, frames: NDArray, progress: Progress) -> Views:
    """Read the depth of some frames; raises InputError when an image cannot be read."""
    stride = max(1, -(-recording.depth_size[0] // WIDEST))
    steps, pixels = [], []
    for done, frame in enumerate(frames):
        progress("reading depth", done, len(frames))
        image = np.ascontiguousarray(recording.depth_steps(int(frame))[::stride, ::stride])
        steps.append(image)
        pixels.append(_sample(image))
    progress("reading depth", len(frames), len(frames))
    return Views(np.asarray(frames), np.stack(steps), stride, np.stack(pixels))


def in_views(views: Views, pairs: NDArray) -> NDArray:
    """Turn pairs of frame indices into pairs of view indices, each in both directions, int64 [2 p, 2]."""
    there = np.searchsorted(views.frames, pairs)
    return np.concatenate([there, there[:, ::-1]])


def revisit_pairs(views: Views, poses: NDArray, gap: int = REVISIT_GAP) -> NDArray:
    """Pair views of one place that are ``gap`` frames apart or more, each in both directions, int64 [p, 2]."""
    frames = views.frames
    rotation, position = poses[frames, :3, :3], poses[frames, :3, 3]
    cosine = rotation[:, :, 2] @ rotation[:, :, 2].T
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    apart = np.abs(frames[:, None] - frames[None]) >= max(gap, REVISIT_GAP)
    good = apart & (cosine > np.cos(np.deg2rad(REVISIT_TURN_DEG))) & (distance < REVISIT_DISTANCE_M)
    cost = np.where(good, distance + 2 * np.arccos(np.clip(cosine, -1, 1)), np.inf)
    best = cost.argmin(axis=1)
    chosen = {tuple(sorted((a, int(b)))) for a, b in enumerate(best) if np.isfinite(cost[a, b])}
    pairs = np.array(sorted(chosen), np.int64).reshape(-1, 2)
    return np.concatenate([pairs, pairs[:, ::-1]])


def turned_deg(a: NDArray, b: NDArray) -> NDArray:
    """Return the angle between the rotations of poses [..., 4, 4], degrees [...]."""
    cosine = (np.einsum("...ij,...ij->...", a[..., :3, :3], b[..., :3, :3]) - 1) / 2
    return np.rad2deg(np.arccos(np.clip(cosine, -1, 1)))


def _sample(steps: NDArray) -> NDArray:
    """Pick measured pixels whose right and lower neighbours are of the same surface, evenly over the image."""
    pixels = np.full((SAMPLES, 2), -1, np.int32)
    depth = steps.astype(np.float32)
    corner = depth[:-1, :-1]
    near = 0.03 * corner + 1  # a step of rounding is no edge
    smooth = (corner > 0) & (np.abs(depth[:-1, 1:] - corner) <= near) & (np.abs(depth[1:, :-1] - corner) <= near)
    v, u = np.nonzero(smooth)
    if len(u):
        chosen = np.unique(np.linspace(0, len(u) - 1, min(SAMPLES, len(u))).astype(np.int64))
        pixels[: len(chosen)] = np.stack([u[chosen], v[chosen]], axis=1)
    return pixels
