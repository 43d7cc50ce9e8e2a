"""Turn what was measured into findings a newcomer understands: in words and numbers, with the correction that fits.

Up and the floor are compared with what the surfaces themselves say; jumps of depth have to lie where the colour picture
has edges.
"""

from dataclasses import dataclass, field, replace
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.checking.agreement import AGREES, Agreement, Views, find_drift, summarise
from simaps_viz.checking.recording import Convention, Reading, Recording, revisit_pairs, turned_deg
from simaps_viz.checking.search import median_depth_m, score
from simaps_viz.datasets.gravity import Surface, gravity_of, level_share, sample_surface
from simaps_viz.datasets.source import named_times
from simaps_viz.errors import InputError
from simaps_viz.geometry import back_project
from simaps_viz.structures import Frame, Intrinsics

FRAMES = 64
FEWEST = 8
"""Frames with edges; in fewer, chance decides."""
WIDTH = 256
"""Both images are brought to about this width, pixels."""
REACH = 0.08
"""Offsets up to this share of the width are tried."""
NARROW_PX, BROAD_PX, PEAK_PX = 0.8, 4.0, 4
"""Widths (standard deviations) between which a peak lies, and what belongs to it all around, pixels of `WIDTH`."""
JUMP = 0.1
"""Share of the depth that makes an edge."""


@dataclass(frozen=True)
class Offset:
    """Where depth edges fit colour edges best."""

    right: float
    """Share of the image's width by which depth has to move to the right."""
    down: float
    """Share of the image's width by which it has to move down."""
    gain: float
    """Mean colour edge strength under depth edges there, over that without moving."""
    sure: float
    """How many times as high as the second highest peak the highest one is."""


def find_offset(recording: Recording, views: Views) -> Offset | None:
    """Compare edges in a few frames; None when they differ in shape or too few frames have edges."""
    if not np.isclose(recording.depth_size[0] / recording.depth_size[1],
                      recording.color_size[0] / recording.color_size[1], rtol=0.02):  # fmt: skip
        return None
    chosen = np.unique(np.linspace(0, len(views.frames) - 1, FRAMES).astype(int))
    table, used = None, 0
    for view in chosen:
        depth = views.steps[view].astype(np.float32)
        height = round(WIDTH * depth.shape[0] / depth.shape[1])
        size = (WIDTH, height)
        edges = _depth_edges(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST))
        gradient = _color_edges(
            cv2.resize(recording.color(int(views.frames[view])), size, interpolation=cv2.INTER_AREA)
        )
        if edges.sum() < 50:
            continue
        scores, used = _correlate(edges, gradient), used + 1
        table = scores if table is None else table + scores
    if table is None or used < FEWEST or not table.any():
        return None
    strength = cv2.GaussianBlur(table, (0, 0), NARROW_PX)
    # Edges that are the same give a narrow peak; that some parts of the picture have more edges gives broad ones.
    table = strength - cv2.GaussianBlur(table, (0, 0), BROAD_PX)
    reach = table.shape[0] // 2
    row, column = (int(at) for at in np.unravel_index(int(table.argmax()), table.shape))
    rest = table.copy()
    rest[max(row - PEAK_PX, 0) : row + PEAK_PX + 1, max(column - PEAK_PX, 0) : column + PEAK_PX + 1] = 0
    return Offset(
        right=(column - reach) / WIDTH,
        down=(row - reach) / WIDTH,
        gain=float(strength[row, column] / max(float(strength[reach, reach]), 1e-9)),
        sure=float(table[row, column] / max(float(rest.max()), 1e-9)),
    )


def _depth_edges(depth: NDArray) -> NDArray:
    """Mark the nearer side of depth jumps between measured pixels, a few missing ones apart; float32 [h, w]."""
    filled = cv2.dilate(depth, np.ones((3, 3), np.uint8))
    near = np.where(depth > 0, depth, 1e9).astype(np.float32)
    lowest = cv2.erode(near, np.ones((3, 3), np.uint8))
    jump = (depth > 0) & (filled > lowest * (1 + JUMP)) & (depth < lowest * (1 + JUMP / 2))
    return jump.astype(np.float32)


def _color_edges(rgb: NDArray) -> NDArray:
    """Return gradient strength, evened out over the picture, 0-1; float32 [h, w]."""
    gray = cv2.GaussianBlur(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), (0, 0), 1.0).astype(np.float32)
    strength = np.hypot(cv2.Sobel(gray, cv2.CV_32F, 1, 0), cv2.Sobel(gray, cv2.CV_32F, 0, 1))
    return np.minimum(strength / (np.percentile(strength, 95) + 1e-6), 1.0).astype(np.float32)


def _correlate(edges: NDArray, gradient: NDArray) -> NDArray:
    """Mean gradient under the edges moved by every offset, rows down and columns right, float32 [2r+1, 2r+1]."""
    reach = int(REACH * WIDTH)
    inner = edges[reach:-reach, reach:-reach]
    return cv2.matchTemplate(gradient, inner, cv2.TM_CCORR) / max(float(inner.sum()), 1.0)


TILT_DEG = 3.0
"""Up that is off by more is a fault."""
FLOOR_M = 0.08
"""A floor that is off by more is a fault."""
FLOOR_TILT_DEG = 20.0
"""With up further off there is no sense in looking for the floor along it."""
LEVEL_DEG = 2.5
"""Surfaces within this angle of level count as level; less than ``TILT_DEG``, or a tilt would not show."""
ACROSS = 20
"""Normals are taken between points this share (one in so many) of the image's width apart, so that noise is small."""
STEP = 6
"""Normals are taken at every so-manieth pixel."""
HELD = 0.3
"""How much less the cameras may be held along the found up than along the stated one (cosines); see `_held`."""
MORE_LEVEL = 1.3
"""How much more surface has to be level with the found up than with the stated one before that is called wrong."""


@dataclass(frozen=True, eq=False)
class Level:
    """Up and floor as found."""

    up: NDArray
    """float64 [3], unit, world frame."""
    floor_height_m: float
    """Height of the floor along ``up``."""
    tilt_deg: float | None
    """Between the found up and the stated one; None when none is stated."""
    level_stated: float | None
    """Share of surfaces that are level if the stated up is right (0-1)."""
    level_found: float
    held: bool
    """People could hold cameras so with the found up; else it is a wall or a ceiling, and the floor was not seen."""
    floor_error_m: float | None
    """Found height minus the stated one along the stated up; None when none is stated."""

    @property
    def tilted(self) -> bool:
        """The stated up is wrong: far off, and fewer surfaces are level with it."""
        if self.tilt_deg is None or self.level_stated is None:
            return False
        if not self.held:
            return False
        slopes = self.tilt_deg > TILT_DEG or (self.tilt_deg > TILT_DEG / 3 and self._floor_far)
        return slopes and self.level_found > MORE_LEVEL * self.level_stated + 0.005

    @property
    def floor_wrong(self) -> bool:
        """The stated floor height is wrong, with up right."""
        return self.held and not self.tilted and self._floor_far

    def to_json(self) -> dict:
        """Return up and the floor's height as found."""
        return {"up": [round(float(x), 5) for x in self.up], "floor_height_m": round(self.floor_height_m, 4)}

    @property
    def _floor_far(self) -> bool:
        return self.floor_error_m is not None and abs(self.floor_error_m) > FLOOR_M


def find_level(
    views: Views, poses: NDArray, camera: NDArray, unit_m: float, *, up: NDArray | None, floor_height_m: float | None
) -> Level | None:
    """Find up and the floor in the views' depth.

    Args:
        views: Depth images.
        poses: float64 [n, 4, 4], T_world_camera of all frames; NaN = none.
        camera: float64 [4], fx, fy, cx, cy of the whole image, pixels.
        unit_m: Metres a step of depth.
        up: [3] as stated, or None.
        floor_height_m: As stated, or None.

    Returns:
        None when there are not enough surfaces to tell.
    """
    fx, fy, cx, cy = views.camera(camera)
    height, width = views.steps.shape[1:]
    intrinsics = Intrinsics(width, height, fx, fy, cx, cy)
    frames = [
        Frame(int(index), str(index), (steps * np.float32(unit_m)).astype(np.float32), poses[index], intrinsics)
        for index, steps in zip(views.frames, views.steps, strict=True)
        if np.isfinite(poses[index]).all()
    ]
    stated = None if up is None else np.asarray(up, float) / np.linalg.norm(up)
    axes = np.stack([frame.T_world_camera[:3, :3] for frame in frames]).mean(axis=0) if frames else np.eye(3)
    try:
        surface, posed = sample_surface(frames), np.stack([frame.T_world_camera for frame in frames])
        found, floor_m = gravity_of(surface, posed)
    except InputError:
        return None
    normals = _normals(frames)
    tilt = None if stated is None else float(np.rad2deg(np.arccos(np.clip(found @ stated, -1, 1))))
    floor_error_m = None
    if stated is not None and floor_height_m is not None and tilt is not None and tilt < FLOOR_TILT_DEG:
        floor_error_m = _floor_along(surface, posed, stated, floor_height_m)
    return Level(
        up=found,
        floor_height_m=floor_m,
        tilt_deg=tilt,
        level_stated=None if stated is None else level_share(normals, stated, LEVEL_DEG),
        level_found=level_share(normals, found, LEVEL_DEG),
        held=stated is None or _held(axes, found) > _held(axes, stated) - HELD,
        floor_error_m=floor_error_m,
    )


def _held(axes: NDArray, up: NDArray) -> float:
    """Describe how well cameras are held for an up: its cosine with their mean upper, or left or right, side.

    Args:
        axes: float64 [3, 3], mean of the cameras' rotations; columns are x right, y down, z forward.
        up: [3], unit.
    """
    return float(max(-axes[:, 1] @ up, abs(axes[:, 0] @ up)))


def _floor_along(surface: Surface, poses: NDArray, up: NDArray, floor_height_m: float) -> float | None:
    try:
        return gravity_of(surface, poses, up=up)[1] - floor_height_m
    except InputError:
        return None


def _normals(frames: list[Frame]) -> NDArray:
    """Return unit normals towards the camera, world frame, float64 [n, 3], of surfaces that are smooth around."""
    found = []
    for frame in frames:
        k = frame.intrinsics
        points = back_project(frame.depth_m, k.fx, k.fy, k.cx, k.cy)
        away = max(1, k.width // ACROSS)
        corner, right, below = points[:-away, :-away], points[:-away, away:], points[away:, :-away]
        corner, right, below = (each[::STEP, ::STEP] for each in (corner, right, below))
        z = corner[..., 2]
        smooth = (z > 0) & (np.abs(right[..., 2] - z) < 0.15 * z) & (np.abs(below[..., 2] - z) < 0.15 * z)
        normal = np.cross((below - corner)[smooth], (right - corner)[smooth])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
        found.append(normal @ frame.T_world_camera[:3, :3].T)
    return np.concatenate(found)


Severity = Literal["error", "warning", "note"]
"""error: the map would be wrong. warning: it may be. note: something could not be judged."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or could not be judged."""

    kind: str
    severity: Severity
    message: str
    """One sentence for a reader who does not know how this program works."""
    measure: dict[str, Any] = field(default_factory=dict)
    """The numbers behind it; angles in degrees, lengths in metres, shares 0-1."""

    def to_json(self) -> dict[str, Any]:
        """Return it as one flat object."""
        return {"kind": self.kind, "severity": self.severity, "message": self.message, **self.measure}


@dataclass(frozen=True)
class Bar:
    """One hypothesis in the picture of the evidence."""

    label: str
    share: float
    """Agreement of neighbouring frames, 0-1."""
    stated: bool = False
    """It is what the files say."""
    chosen: bool = False
    """It is what the check believes."""


@dataclass(frozen=True)
class Correction:
    """What to change so that frames agree."""

    changes: tuple[str, ...]
    """In words."""
    values: dict[str, Any]
    """The new values by manifest key or file; only what changes."""
    agreement_before: float
    """Share of points of neighbouring frames that agree, as the files are (0-1)."""
    agreement_after: float

    def to_json(self) -> dict[str, Any]:
        """Return it as an object."""
        return {
            "changes": list(self.changes),
            **self.values,
            "agreement_before": round(self.agreement_before, 4),
            "agreement_after": round(self.agreement_after, 4),
        }


STILL_M, STILL_DEG = 0.01, 0.5
"""A camera that moves and turns less between frames shows nothing about its poses."""
FAR_DEG = 60.0
"""Frames that turned more against one another need not see the same."""
FEW = 5
"""Frames named in a message."""
DISAGREE, DOUBTFUL = 0.4, 0.6
"""Shares of agreement below which something is wrong, or may be."""
ODD, SEEN = 0.3, 0.15
"""A pair is odd when less than the first share agrees of what has to, if that is more than the second share of all."""
MISREGISTERED, SURE, STRONGER = 0.014, 1.7, 1.5
"""Offset as a share of the width; how many times as high as other peaks its peak is, and as strong as colour's edges
are without it; each has to be more before depth is called unregistered."""
GAIN = 0.01
"""A smaller gain of agreement, as a share of what both frames see or of all, is none."""
LATE = 0.85
"""Frames; a shift by no more is a matter of time stamps, and by more, one of frames."""
CLOSER = 0.9
"""Share of the median residual that a change has to leave, where it does not gain as much."""
MINOR = 0.06
"""Camera and depth scale that are off by no more (as a share, of the focal length) bend a map less than it is fine."""
DRIFT_GAP = 0.25
"""Share of the sequence between two visits that drift is judged by."""
MAX_NEIGHBOURS = 40
"""Pairs of neighbouring views that places seen again are compared with."""
FEWEST_REVISITS = 6
"""Pairs of views, each in both directions, that drift is judged by."""
_PLAIN = Convention()


def need_depth(recording: Recording, views: Views) -> None:
    """Raise InputError when no frame has any depth."""
    if not views.steps.any():
        where = recording.depth_file(0) or recording.path
        raise InputError(f"{where}: expected depth readings, found only 0 in {len(views.frames)} sampled frames")


def unjudged(recording: Recording, frames: NDArray, stated: Agreement) -> Finding | None:
    """Why poses cannot be judged by comparing frames, if so; ``stated`` is how well frames agree as they are."""
    if not len(frames):
        return Finding("unjudged", "note", "There is only one frame, so poses and camera cannot be compared.")
    a, b = recording.matrices[frames[:, 0]], recording.matrices[frames[:, 1]]
    turned = turned_deg(a, b)
    distance = np.linalg.norm(a[:, :3, 3] - b[:, :3, 3], axis=1)
    if turned.max() > STILL_DEG or distance.max() > STILL_M:
        return None
    if stated.share < DOUBTFUL:
        text = (
            "The poses say that the camera stands still, but the images change: neighbouring frames agree on only "
            f"{stated.percent()} % of what both see."
        )
        return Finding("disagreement", "error", text, {"agreement": round(stated.share, 4)})
    return Finding("unjudged", "note", "The camera does not move, so poses and camera cannot be judged from frames.")


def gains(before: Agreement, after: Agreement, least: float = GAIN) -> bool:
    """Whether frames agree better by as much as is worth saying."""
    return after.share >= before.share + least or after.kept >= before.kept + least


def comes_closer(before: Agreement, after: Agreement) -> bool:
    """Whether the surfaces that frames share come closer together by as much as is worth saying."""
    return after.median < CLOSER * before.median


def minor(recording: Recording, reading: Reading) -> bool:
    """Whether camera and depth scale differ little from the stated ones."""
    return max(map(abs, _off(recording, reading))) <= MINOR


def _off(recording: Recording, reading: Reading) -> tuple[float, ...]:
    """Return by how much camera and depth scale differ, shares of the stated ones; the centre's of the focal length."""
    stated, found = recording.camera, reading.camera_of(recording)
    camera = (*(found[:2] / stated[:2] - 1), *((found[2:] - stated[2:]) / stated[:2]))
    return (*map(float, camera), reading.depth_factor - 1, reading.position_factor - 1)


def of_reading(recording: Recording, views: Views, pairs: NDArray, reading: Reading) -> list[Finding]:
    """Describe every change of a reading, each with the agreement of frames without and with it."""
    after = score(recording, views, pairs, reading)

    def gain(without: Reading) -> tuple[str, dict[str, Any]]:
        before = score(recording, views, pairs, without)
        words = f"raises agreement of neighbouring frames from {before.percent()} % to {after.percent()} %"
        if after.percent() <= before.percent():
            words = "fits a room, though these frames alone do not show it"
            if comes_closer(before, after):
                apart = f"{100 * before.median:.2f} to {100 * after.median:.2f} % of the depth"
                words = f"brings the same surfaces in neighbouring frames from {apart} apart"
        return words, {"agreement_before": round(before.share, 4), "agreement_after": round(after.share, 4)}

    found = []
    for make in (_conventions, _units, _shifts, _intrinsics):
        found += make(recording, reading, gain, views)
    return found


def _conventions(recording: Recording, reading: Reading, gain: Any, views: Views) -> list[Finding]:
    way, found = reading.convention, []
    if way.form != _PLAIN.form:
        words, measure = gain(replace(reading, convention=replace(way, form=_PLAIN.form)))
        looks = "world-to-camera" if way.form == "world-to-camera" else f"mixed ({way.form}, the rest camera-to-world)"
        text = f"Poses look like {looks}; they have to be camera-to-world. Inverting them {words}."
        found.append(Finding("inverted_poses", "error", text, {"form": way.form, **measure}))
    if way.axes != _PLAIN.axes:
        words, measure = gain(replace(reading, convention=replace(way, axes=_PLAIN.axes)))
        text = (
            f"Poses look written {replace(_PLAIN, axes=way.axes).in_words()}, not for x right, y down, z forward. "
            f"Turning the axes {words}."
        )
        found.append(Finding("camera_axes", "error", text, {"axes": [list(row) for row in way.axes], **measure}))
    if way.turned_positions != _PLAIN.turned_positions:
        words, measure = gain(replace(reading, convention=replace(way, turned_positions=_PLAIN.turned_positions)))
        text = f"Positions look written in other axes than rotations. Turning them {words}."
        measure = {"axes": [list(row) for row in way.turned_positions], **measure}
        found.append(Finding("position_axes", "error", text, measure))
    if way.world != _PLAIN.world:
        text = (
            "The world is mirrored: rotations are left-handed, as after swapping or negating one world axis. "
            "Mirrored back, frames agree as before, and left is left again."
        )
        found.append(Finding("mirrored_world", "error", text, {"mirror": [list(row) for row in way.world]}))
    return found


def _units(recording: Recording, reading: Reading, gain: Any, views: Views) -> list[Finding]:
    found = []
    if reading.depth_factor != 1:
        words, measure = gain(replace(reading, depth_factor=1.0))
        unit_m = reading.unit_m(recording)
        text = (
            f"The depth unit looks wrong: {unit_m:.4g} m a step instead of {recording.unit_m:.4g} m (times "
            f"{reading.depth_factor:.4g}) makes the median depth {median_depth_m(views, unit_m):.2f} m and {words}."
        )
        measure = {"stated_m": recording.unit_m, "found_m": unit_m, "factor": reading.depth_factor, **measure}
        found.append(Finding("depth_unit", _severity(reading.depth_factor - 1), text, measure))
    if reading.position_factor != 1:
        words, measure = gain(replace(reading, position_factor=1.0))
        text = (
            f"Camera positions look written in another unit than metres: multiplying them by "
            f"{reading.position_factor:.4g} {words}."
        )
        severity = _severity(reading.position_factor - 1)
        found.append(Finding("position_unit", severity, text, {"factor": reading.position_factor, **measure}))
    return found


def _severity(*off: float) -> Severity:
    return "warning" if max(map(abs, off)) <= MINOR else "error"


def _shifts(recording: Recording, reading: Reading, gain: Any, views: Views) -> list[Finding]:
    found, names = [], recording.names
    if reading.shift_later is not None:
        words, measure = gain(replace(reading, shift=0, shift_later=None))
        at = names[reading.shift_from]
        text = (
            f"From frame {at} on, poses belong to other frames than before, as after a dropped or repeated frame: "
            f"{_shift_words(reading.shift)} before it and {_shift_words(reading.shift_later)} from it on {words}."
        )
        measure = {"frame": at, "index": reading.shift_from, "before": reading.shift, "after": reading.shift_later,
                   **measure}  # fmt: skip
        found.append(Finding("dropped_frame", "error", text, measure))
    elif reading.shift:
        words, measure = gain(replace(reading, shift=0))
        times = named_times(recording.names)
        step_s = None if times is None else float(np.median(np.diff(times)))
        if step_s is not None:
            measure["shift_ms"] = round(1000 * step_s * reading.shift, 1)
        if abs(reading.shift) <= LATE:
            amount = f"{abs(reading.shift):.2f} of the time between frames"
            amount = amount if step_s is None else f"{abs(1000 * step_s * reading.shift):.0f} ms"
            side = "late" if reading.shift > 0 else "early"
            text = f"Poses come {amount} too {side} for their images: interpolating them {words}."
            found.append(Finding("time_offset", "warning", text, {"shift": reading.shift, **measure}))
        else:
            text = f"Poses and images are shifted against one another: taking {_shift_words(reading.shift)} {words}."
            found.append(Finding("frame_shift", "error", text, {"shift": reading.shift, **measure}))
    if reading.left_out:
        listed = [names[i] for i in reading.left_out]
        text = (
            f"{len(listed)} frame{'s repeat' if len(listed) > 1 else ' repeats'} the depth image of the frame before "
            f"though the pose moved on ({', '.join(listed[:FEW])}{', …' if len(listed) > FEW else ''})."
        )
        found.append(Finding("duplicate_frames", "error", text, {"names": listed}))
    return found


def _intrinsics(recording: Recording, reading: Reading, gain: Any, views: Views) -> list[Finding]:
    if reading.camera is None:
        return []
    words, measure = gain(replace(reading, camera=None))
    stated, found = recording.camera, reading.camera
    parts = [
        f"{name} from {was:.1f} to {now:.1f}"
        for name, was, now in zip(("fx", "fy", "cx", "cy"), stated, found, strict=True)
        if abs(now - was) > 0.003 * stated[0]
    ]
    hint = ""
    ratio = stated[:2].mean() / found[:2].mean()
    if max(ratio, 1 / ratio) > 1.3 and np.allclose(stated / found, ratio, rtol=0.05):
        hint = f" It looks made for images {ratio:.3g} times as large."
    text = f"The camera matrix does not fit the depth: changing {', '.join(parts)} pixels {words}.{hint}"
    names = ("fx", "fy", "cx", "cy")
    measure = {
        "stated": dict(zip(names, map(float, np.round(stated, 3)), strict=True)),
        "found": dict(zip(names, map(float, np.round(found, 3)), strict=True)),
        **measure,
    }
    off = _off(recording, Reading(camera=reading.camera))
    return [Finding("intrinsics", _severity(*off), text, measure)]


def of_level(recording: Recording, level: Level | None) -> list[Finding]:
    """Describe a wrong up or floor."""
    if level is None or not level.held:
        text = "Up and the floor could not be checked: too little surface that faces up was seen below the cameras."
        return [Finding("level_unjudged", "note", text)]
    up = [round(float(x), 4) for x in level.up]
    if level.tilted and level.tilt_deg is not None and level.level_stated is not None:
        axis = int(np.argmax(np.abs(level.up)))
        name = f"{'-' if level.up[axis] < 0 else '+'}{'xyz'[axis]}"
        world = f" The world's axes look swapped: up is close to {name}." if level.tilt_deg > 45 else ""
        text = (
            f"Gravity is off axis: surfaces say up is {level.tilt_deg:.1f}° away from the stated one; "
            f"{100 * level.level_found:.0f} % of all surface is level with it, "
            f"{100 * level.level_stated:.0f} % with the stated one.{world}"
        )
        measure = {"tilt_deg": round(level.tilt_deg, 2), "stated": recording.up, "found": up,
                   "floor_height_m": round(level.floor_height_m, 4)}  # fmt: skip
        return [Finding("gravity", "error", text, measure)]
    if level.floor_wrong and level.floor_error_m is not None:
        side = "higher" if level.floor_error_m > 0 else "lower"
        text = f"The floor lies {abs(level.floor_error_m):.2f} m {side} than stated."
        return [Finding("floor_height", "error", text, {"off_m": round(level.floor_error_m, 4)})]
    return []


SPARSE, POINTS = 0.25, 0.02
"""Shares of measured pixels: with fewer, neighbours see few surfaces in common; with still fewer, they are points."""


def of_what_is_left(
    recording: Recording, views: Views, pairs: NDArray, reading: Reading, after: Agreement
) -> list[Finding]:
    """Describe what no correction explains: frames that still disagree, odd ones, drift."""
    residual = reading.residuals(recording, views, pairs)
    a, b = recording.matrices[views.frames[pairs.T]]
    if after.kept < 0.02 and np.median(turned_deg(a, b)) > FAR_DEG:
        text = "Neighbouring frames are too far apart to see the same surfaces, so they cannot be compared."
        return [Finding("unjudged", "warning", text)]
    found = []
    if after.share < DOUBTFUL:
        severity = "error" if after.share < DISAGREE else "warning"
        measured = np.count_nonzero(views.steps) / views.steps.size
        if measured < SPARSE:
            few = f"Only {100 * measured:.1f} % of the pixels have depth, too few to compare frames by"
            points = "; points of a reconstruction make no map" if measured < POINTS else ", as with a LiDAR's depth"
            return [Finding("unjudged", "error" if measured < POINTS else "warning", f"{few}{points}.")]
        text = (
            f"Neighbouring frames agree on only {after.percent()} % of what both see, and no known mistake explains "
            "it. Are poses of these images, is depth registered to colour, is the camera matrix of this camera?"
        )
        return [Finding("disagreement", severity, text, {"agreement": round(after.share, 4)})]
    found += _odd_frames(recording, views, pairs, residual)
    found += _drift(recording, views, pairs, reading, residual)
    return found


def _odd_frames(recording: Recording, views: Views, pairs: NDArray, residual: NDArray) -> list[Finding]:
    """Find pairs that disagree though they see much of the same."""
    sampled = np.maximum((~np.isnan(residual)).sum(axis=1), 1)
    agree = (np.abs(residual) <= AGREES).sum(axis=1)
    through = (residual < -AGREES).sum(axis=1)  # what hides a surface is no contradiction, seeing through it is
    known = agree + through
    bad = pairs[(known > SEEN * sampled) & (agree < ODD * known)]
    if not len(bad):
        return []
    names = sorted({tuple(recording.names[views.frames[i]] for i in sorted(pair)) for pair in bad.tolist()})
    listed = ", ".join(f"{a} and {b}" for a, b in names[:FEW]) + (", …" if len(names) > FEW else "")
    text = f"Most frames agree, but some neighbours do not (poses that jump?): {listed}."
    return [Finding("odd_frames", "warning", text, {"pairs": [list(pair) for pair in names]})]


def _drift(recording: Recording, views: Views, pairs: NDArray, reading: Reading, residual: NDArray) -> list[Finding]:
    """Compare places seen again, the later the better."""
    poses = reading.poses(recording)
    revisits = revisit_pairs(views, poses, round(DRIFT_GAP * len(recording)))
    if len(revisits) < FEWEST_REVISITS:
        revisits = revisit_pairs(views, poses)
    if len(revisits) < FEWEST_REVISITS:
        return []
    few = pairs[:: max(1, len(pairs) // MAX_NEIGHBOURS)]
    drift = find_drift(views, revisits, few, poses, reading.camera_of(recording), reading.unit_m(recording))
    if drift is None:
        return []
    neighbours = summarise(residual).share
    text = (
        f"Poses drift: neighbouring frames agree on {100 * neighbours:.0f} % of what both see, frames of a place "
        f"visited again on {100 * drift.agreement:.0f} %, but on {100 * drift.mended:.0f} % once moved by about "
        f"{drift.off_m:.2f} m. Objects will appear twice. Close the loops in the tracking that made the poses."
    )
    measure = {"agreement": round(neighbours, 4), "agreement_revisits": round(drift.agreement, 4),
               "agreement_moved": round(drift.mended, 4), "off_m": round(drift.off_m, 3)}  # fmt: skip
    return [Finding("drift", "error", text, measure)]


def unregistered(recording: Recording, offset: Offset | None) -> Finding | None:
    """Describe depth that is not registered to colour."""
    if recording.depth_size != recording.color_size:
        sizes = [f"{width}x{height}" for width, height in (recording.depth_size, recording.color_size)]
        text = (
            f"Depth images have {sizes[0]} pixels, colour images {sizes[1]}: depth is not registered to colour. Export "
            "it aligned to the colour camera."
        )
        return Finding("unregistered_depth", "error", text, {"depth": sizes[0], "color": sizes[1]})
    if offset is None or max(abs(offset.right), abs(offset.down)) < MISREGISTERED:
        return None
    if offset.sure < SURE or offset.gain < STRONGER:
        return None
    width = recording.color_size[0]
    sides = ((offset.right * width, "right", "left"), (offset.down * width, "down", "up"))
    moves = " and ".join(f"{abs(px):.0f} pixels {one if px > 0 else other}" for px, one, other in sides if abs(px) >= 1)
    text = (
        f"Depth does not lie on the colour image: moved {moves}, its edges fit those in the colours. Export depth "
        "registered to the colour camera."
    )
    measure = {"right_px": round(offset.right * width, 1), "down_px": round(offset.down * width, 1)}
    return Finding("unregistered_depth", "error", text, {**measure, "sure": round(offset.sure, 2)})


def changes(recording: Recording, reading: Reading) -> tuple[list[str], dict[str, Any]]:
    """Return the changes a reading means, in words and as values."""
    words, values = [], {}
    if not reading.convention.plain:
        words.append(f"poses {reading.convention.in_words()}")
    if reading.position_factor != 1:
        words.append(f"positions times {reading.position_factor:.4g}")
    if reading.shift_later is not None:
        at = recording.names[reading.shift_from]
        words.append(f"from frame {at} on {_shift_words(reading.shift_later)}, before {_shift_words(reading.shift)}")
    elif reading.shift:
        words.append(_shift_words(reading.shift))
    if reading.left_out:
        words.append(f"{len(reading.left_out)} repeated frames left out")
    if words:
        values["poses"] = {"frames": int(reading.posed(len(recording)).sum()), "read_as": "; ".join(words)}
    if reading.depth_factor != 1:
        words.append(f"depth unit {reading.unit_m(recording):.6g} m")
        values["depth_unit_m"] = reading.unit_m(recording)
    if reading.camera is not None:
        fx, fy, cx, cy = (round(float(x), 3) for x in reading.camera)
        words.append(f"fx {fx:.5g}, fy {fy:.5g}, cx {cx:.5g}, cy {cy:.5g}")
        values["intrinsics"] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    return words, values


def plain_words(recording: Recording, reading: Reading) -> str | None:
    """Return a reading in a few words; None for the files' own."""
    words = changes(recording, reading)[0]
    return "; ".join(words) or None


def _shift_words(shift: float) -> str:
    if shift == 0:
        return "each frame's own pose"
    where = "after" if shift > 0 else "before"
    return f"the pose written {abs(shift):.3g} frame{'s' if abs(shift) != 1 else ''} {where}"
