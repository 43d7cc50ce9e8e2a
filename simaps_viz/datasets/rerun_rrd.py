"""Read rerun recordings (``.rrd``): a DepthImage, a picture and a Pinhole below entities that Transform3D moves.

Every entity is in a frame: one that its CoordinateFrame names, as rerun's ROS example and its MCAP importer do, or else
one of its own, which is in that of the entity above it. Transform3D and Pinhole say where one frame is in another.

The file is read through once for times, poses and cameras. Pictures are read again when they are wanted, forwards, with
a few chunks kept, so memory does not grow with the recording.
"""

import atexit
import subprocess
import sys
import threading
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.association import nearest
from simaps_viz.datasets.calibration import Lens, from_quaternion, matrix_lens, rigid, see_through
from simaps_viz.datasets.file_frames import clean_depth
from simaps_viz.datasets.images import decode_color
from simaps_viz.datasets.recording import FormatFacts, Reader, Recording, complete, left_out
from simaps_viz.datasets.ros_messages import sixteen_bits, unpack_depth
from simaps_viz.errors import InputError

_ROOM = 8 << 30
"""Bytes of address space that the other process may take."""
_PROGRAM = f"""
import resource, sys, warnings
warnings.simplefilter("ignore")
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
hard = resource.getrlimit(resource.RLIMIT_AS)[1]
room = {_ROOM} if hard == resource.RLIM_INFINITY else min({_ROOM}, hard)
resource.setrlimit(resource.RLIMIT_AS, (room, hard))
import rerun.chunk as rc
for line in sys.stdin:
    try:
        for chunk in rc.RrdReader(line[:-1]).stream():
            chunk.to_record_batch()
    except Exception:
        pass  # whoever reads it next says what is wrong
    print("read", flush=True)
"""


class _Trial:
    """The other process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None

    def survives(self, path: Path) -> bool:
        """Have it read a file; False when that ended it."""
        with self._lock:
            process = self._running()
            assert process.stdin is not None and process.stdout is not None
            try:
                process.stdin.write(f"{path.absolute()}\n")
                process.stdin.flush()
                survived = process.stdout.readline() == "read\n"
            except (OSError, UnicodeEncodeError):
                survived = False
            if not survived:
                self.close()
            return survived

    def close(self) -> None:
        """End it."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            for pipe in (process.stdin, process.stdout):
                with suppress(OSError):
                    pipe.close()  # pyright: ignore[reportOptionalMemberAccess]
            process.wait()

    def _running(self) -> subprocess.Popen[str]:
        if self._process is not None and self._process.poll() is not None:
            self.close()
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL, text=True, encoding="utf-8",
            )  # fmt: skip
        return self._process


_trial = _Trial()
atexit.register(_trial.close)


def check_readable(path: Path) -> None:
    """Raise InputError for a recording that ends the process which reads it; costs a second once, then a reading."""
    if "\n" in str(path) or not _trial.survives(path):
        raise InputError(f"{path}: expected a rerun recording, found one so damaged that rerun cannot read it")


FACTS = FormatFacts(
    title="rerun",
    recognised_by="`*.rrd`",
    depth="DepthImage: 16-bit or 32-bit float; EncodedDepthImage: PNG, RVL",
    invalid="0, NaN",
    pose="Transform3D of the picture's frame (its entity, or a named one) and those above it",
)

CHUNKS_KEPT = 6
UP = 1
"""In ViewCoordinates; 2 is down."""
_AXES = {1: (0, -1, 0), 2: (0, 1, 0), 3: (1, 0, 0), 4: (-1, 0, 0), 5: (0, 0, 1), 6: (0, 0, -1)}
"""Directions of ViewCoordinates (up, down, right, left, forward, back) in a camera's axes."""
RDF = [3, 2, 5]
"""Right, down, forward: the camera axes of a Pinhole that names none."""
_IMPLICIT = "tf#"
"""Before an entity's path: the name of its own frame."""
_U8, _U16, _F32 = 6, 8, 34
"""Numbers of ChannelDatatype."""
_DEPTHS, _COLORS = ("DepthImage", "EncodedDepthImage"), ("Image", "EncodedImage")
_RVL = "application/rvl"
_LOGGED = ("message_publish_time", "message_log_time", "log_tick", "log_time")
"""Timelines of when something was recorded, not taken; the best first."""


def _recognise(path: Path) -> bool:
    return path.suffix == ".rrd" and path.is_file()


def _open_path(path: Path) -> Recording:
    """Open a recording.

    Raises:
        InputError: It is damaged, or lacks depth, pictures, a camera or poses that belong together.
    """
    check_readable(path)
    _check_finished(path)
    with complete(path, FACTS.title):
        return _open(path)


READER = Reader(FACTS, _recognise, _open_path)


def _open(path: Path) -> Recording:
    found = _Contents(path)
    depth = _the_one(path, "DepthImage with times below a Pinhole", found.pictures,
                     lambda p: p.kind in _DEPTHS and found.has_pinhole(p.entity))  # fmt: skip
    color = _the_one(path, "colour Image or EncodedImage below a Pinhole", found.pictures,
                     lambda p: p.kind in _COLORS and found.has_pinhole(p.entity),
                     lambda p: found.shared(p.entity, depth.entity))  # fmt: skip
    timeline = _timeline(path, depth, color, found)
    times, color_times = depth.times[timeline], color.times[timeline]
    depth_order, color_order = (np.argsort(t, kind="stable") for t in (times, color_times))
    partner = color_order[nearest(color_times[color_order], times[depth_order])]
    apart = np.abs(color_times[partner] - times[depth_order])
    close = apart <= (np.median(np.diff(times[depth_order])) / 2 if len(times) > 1 else 0)
    poses, known = found.poses(depth.entity, timeline, times[depth_order])
    kept = np.flatnonzero(close & known)
    if not len(kept):
        raise InputError(f"{path}: expected depth, picture and pose of one time on {timeline!r}, found none together")
    depth_lens, color_lens = found.lens(depth.entity), found.lens(color.entity)
    target = depth_lens.intrinsics
    depth_rows, color_rows = depth_order[kept], partner[kept]

    def read_depth(i: int) -> NDArray:
        with complete(path, FACTS.title):
            return see_through(_depth_m(path, depth.read(int(depth_rows[i]))), depth_lens, target, exact=True)

    def read_color(i: int) -> NDArray:
        with complete(path, FACTS.title):
            rgb = _rgb(path, color.read(int(color_rows[i])))
        return see_through(rgb, color_lens.scaled(rgb.shape[1], rgb.shape[0]), target, exact=False)

    logged = f"pictures and poses share no time but {timeline}, when they were recorded: poses may be late"
    return Recording(
        facts=replace(FACTS, up=found.up),
        path=path,
        name=path.resolve().stem,
        frame_names=tuple(str(int(t)) for t in times[depth_order][kept]),
        poses=poses[kept],
        intrinsics=target,
        depth=read_depth,
        color=read_color,
        depth_unit_m=1 / depth.meter if depth.meter and depth.meter >= 100 else None,
        notes=(
            *((logged,) if timeline in _LOGGED else ()),
            *left_out(len(times) - len(kept), len(times), "depth images have no picture or pose of their time"),
        ),
    )


def _check_finished(path: Path) -> None:
    """Raise InputError unless the file is a recording that has its end: rerun itself only warns."""
    import rerun.chunk as rc  # noqa: PLC0415 - rerun is slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            rc.RrdReader(path)
    except (ValueError, RuntimeError, OSError) as error:
        raise InputError(f"{path}: expected a rerun recording, found {' '.join(str(error).split())[:200]}") from error
    except Warning as warning:
        raise InputError(
            f"{path}: expected a finished rerun recording, found one without its end: cut short, or of an older rerun "
            "(try rerun rrd migrate)"
        ) from warning


def _chunks(path: Path, entity: str | None = None) -> Iterator[Any]:
    """Return the chunks of a recording, or of one entity of it, in order."""
    import rerun.chunk as rc  # noqa: PLC0415 - rerun is slow to import

    try:
        stream = rc.RrdReader(path).stream()
        yield from stream.filter(content=entity) if entity else stream
    except (ValueError, RuntimeError, OSError) as error:
        raise InputError(f"{path}: expected a rerun recording, found {' '.join(str(error).split())[:200]}") from error


@dataclass(eq=False)
class _Pictures:
    """The pictures of an entity; rows are counted over all of its chunks."""

    path: Path
    entity: str
    kind: str
    times: dict[str, NDArray] = field(default_factory=dict)
    """Timeline to int64 [n]."""
    chunks: list[str] = field(default_factory=list)
    """Ids of its chunks."""
    starts: list[int] = field(default_factory=list)
    """Row at which each of them starts."""
    meter: float | None = None
    _kept: OrderedDict[str, Any] = field(default_factory=OrderedDict)
    _lock: Any = field(default_factory=threading.Lock)
    _cursor: Iterator[tuple[str, Any]] = field(default_factory=lambda: iter(()))

    def read(self, row: int) -> dict[str, Any]:
        """Return the values of a row by component."""
        number = int(np.searchsorted(self.starts, row, side="right")) - 1
        with self._lock:
            wanted = self.chunks[number]
            if wanted not in self._kept and not self._advance_to(wanted):
                self._cursor = _batches(self.path, self.entity, self.kind)
                if not self._advance_to(wanted):
                    raise InputError(f"{self.path}: {self.entity}: expected it as it was opened, found it changed")
            batch = self._kept[wanted]
        at = row - self.starts[number]
        names = [name for name in batch.schema.names if name.startswith(f"{self.kind}:")]
        values = {name.partition(":")[2]: batch.column(name)[at].values for name in names}
        return values | ({"meter": [self.meter]} if self.meter is not None and not values.get("meter") else {})

    def _advance_to(self, wanted: str) -> bool:
        for found, batch in self._cursor:
            self._kept[found] = batch
            while len(self._kept) > CHUNKS_KEPT:
                self._kept.popitem(last=False)
            if found == wanted:
                return True
        return False


def _column(kind: str) -> str:
    """Return the column that holds a kind's pictures."""
    return f"{kind}:{'blob' if kind.startswith('Encoded') else 'buffer'}"


def _batches(path: Path, entity: str, kind: str) -> Iterator[tuple[str, Any]]:
    """Return chunk ids and the tables that hold pictures of that kind."""
    column = _column(kind)
    for chunk in _chunks(path, entity):
        if not chunk.is_static and chunk.entity_path == entity:
            batch = chunk.to_record_batch()
            if column in batch.schema.names:
                yield str(chunk.id), batch.filter(batch.column(column).is_valid())


class _Contents:
    """What one reading of a recording finds: cameras, transforms, up and where pictures are."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.up: tuple[float, float, float] | None = None
        self.pictures: dict[tuple[str, str], _Pictures] = {}
        self._frames: dict[str, str] = {}
        """Of entities that are not in their own."""
        self._parents: dict[str, str] = {}
        """Of frames that something is said of."""
        self._pinholes: dict[str, dict[str, dict[str, Any]]] = {}
        """Of frames, by entity: camera_info topics of one frame may be of several sizes."""
        self._static: dict[str, dict[str, Any]] = {}
        self._moving: dict[str, dict[str, tuple[list[int], list[dict[str, Any]]]]] = {}
        for chunk in _chunks(path):
            batch = chunk.to_record_batch()
            kinds = {name.partition(":")[0] for name in batch.schema.names if ":" in name}
            for kind in kinds & {*_DEPTHS, *_COLORS}:
                self._add_pictures(chunk, batch, kind)
            if "CoordinateFrame" in kinds:
                self._frames.setdefault(chunk.entity_path, str(_row(batch, "CoordinateFrame", 0)["frame"][0]))
            if "Pinhole" in kinds:
                values = _row(batch, "Pinhole", 0)
                self._pinholes.setdefault(self._link(chunk.entity_path, values), {}).setdefault(
                    chunk.entity_path, values
                )
            if "ViewCoordinates" in kinds and chunk.is_static:
                self._add_up(_row(batch, "ViewCoordinates", 0))
            if "Transform3D" in kinds:
                self._add_transforms(chunk, batch)

    def _add_pictures(self, chunk: Any, batch: Any, kind: str) -> None:
        column = _column(kind)
        if kind == "DepthImage" and f"{kind}:meter" in batch.schema.names:
            values = [v for v in batch.column(f"{kind}:meter").to_pylist() if v]
            if values:
                self._pictures(chunk.entity_path, kind).meter = float(values[0][0])
        if chunk.is_static or column not in batch.schema.names:
            return
        pictures, batch = self._pictures(chunk.entity_path, kind), batch.filter(batch.column(column).is_valid())
        pictures.chunks.append(str(chunk.id))
        pictures.starts.append(sum(len(t) for t in list(pictures.times.values())[:1]))
        for name in chunk.timeline_names:
            times = batch.column(name).cast("int64").to_numpy()
            pictures.times[name] = np.concatenate([pictures.times.get(name, np.zeros(0, np.int64)), times])

    def _pictures(self, entity: str, kind: str) -> _Pictures:
        return self.pictures.setdefault((entity, kind), _Pictures(self.path, entity, kind))

    def _add_up(self, values: dict[str, Any]) -> None:
        directions = [int(d) for d in np.ravel(values["xyz"][0])]
        for axis, direction in enumerate(directions):
            if self.up is None and direction in (UP, UP + 1):
                sign = 1.0 if direction == UP else -1.0
                up = [0.0, 0.0, 0.0]
                up[axis] = sign
                self.up = (up[0], up[1], up[2])

    def _add_transforms(self, chunk: Any, batch: Any) -> None:
        rows = [_row(batch, "Transform3D", i) for i in range(batch.num_rows)]
        frames = [self._link(chunk.entity_path, values) for values in rows]
        if chunk.is_static:
            self._static.update(zip(frames, rows, strict=True))
            return
        for name in chunk.timeline_names:
            for frame, time, values in zip(frames, batch.column(name).cast("int64").to_pylist(), rows, strict=True):
                times, known = self._moving.setdefault(frame, {}).setdefault(name, ([], []))
                times.append(time)
                known.append(values)

    def _link(self, entity: str, values: dict[str, Any]) -> str:
        """Return the frame that a Transform3D or Pinhole is of, and note the one it is in, which it keeps."""
        child, parent = (str(values[f"{n}_frame"][0]) if values.get(f"{n}_frame") else "" for n in ("child", "parent"))
        frame = child or _IMPLICIT + entity
        self._parents.setdefault(frame, parent or _above(_IMPLICIT + entity) or (_IMPLICIT + "/" if child else ""))
        return frame

    def chain(self, entity: str) -> list[str]:
        """Return the frames from an entity's up to the world's, both included.

        Raises:
            InputError: The frames go round in a circle.
        """
        found = [self._frames.get(entity, _IMPLICIT + entity)]
        while above := self._parents.get(found[-1], _above(found[-1])):
            if above in found:
                raise InputError(f"{self.path}: expected frames as a tree, found a circle at frame {above!r}")
            found.append(above)
        return found

    def shared(self, entity: str, other: str) -> tuple[int, int]:
        """Return how many frames two entities have in common, and how many entities above them."""
        one, two = self.chain(entity), self.chain(other)
        return len({*one} & {*two}), len({*_upwards(entity)} & {*_upwards(other)})

    def has_pinhole(self, entity: str) -> bool:
        """Return whether an entity's frame, or one above it, has a Pinhole."""
        return any(name in self._pinholes for name in self.chain(entity))

    def _pinhole(self, entity: str) -> tuple[str, dict[str, Any]]:
        """Return the Pinhole of an entity's frame, or the nearest one above it, and the name for it in errors."""
        for name in self.chain(entity):
            if name in self._pinholes:
                found = self._pinholes[name]
                best = max(found, key=lambda one: (len({*_upwards(one)} & {*_upwards(entity)}), one))
                return f"{self.path}: {best}: Pinhole", found[best]
        raise InputError(f"{self.path}: {entity}: expected a Pinhole there or above, found none")

    def lens(self, entity: str) -> Lens:
        """Return the camera of an entity."""
        where, values = self._pinhole(entity)
        if not values.get("resolution"):
            raise InputError(f"{where}: expected a resolution, found none")
        K = np.array(values["image_from_camera"][0], dtype=np.float64).reshape(3, 3).T
        width, height = (int(x) for x in values["resolution"][0])
        return matrix_lens(where, width, height, K)

    def _axes(self, entity: str) -> NDArray:
        """Return the rotation [4, 4] from OpenCV's camera axes to those that an entity's Pinhole names."""
        where, values = self._pinhole(entity)
        named = [int(x) for x in np.ravel(values["camera_xyz"][0])] if values.get("camera_xyz") else RDF
        R = np.array([_AXES.get(axis, (0, 0, 0)) for axis in named], dtype=np.float64)
        if R.shape != (3, 3) or np.linalg.det(R) != 1:
            raise InputError(f"{where}: expected right-handed camera axes, as RDF (3, 2, 5) or RUB, found {named}")
        return np.block([[R, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])

    def timelines(self, entity: str) -> list[str]:
        """Return the timelines over which the frames of an entity move, once for each frame."""
        return [timeline for name in self.chain(entity) for timeline in self._moving.get(name, {})]

    def poses(self, entity: str, timeline: str, times: NDArray) -> tuple[NDArray, NDArray]:
        """Return T_world_camera [n, 4, 4], of the latest transforms as rerun shows it, and where they are known."""
        T, known = np.repeat(self._axes(entity)[None], len(times), axis=0), np.ones(len(times), dtype=bool)
        moves, chain = False, self.chain(entity)
        for name in chain:
            if timeline in self._moving.get(name, {}):
                own, found = self._moving[name][timeline]
                poses = np.stack([_transform(f"{self.path}: {name}", values) for values in found])
                order = np.argsort(own, kind="stable")
                latest = np.searchsorted(np.array(own)[order], times, side="right") - 1
                T = poses[order[np.maximum(latest, 0)]] @ T
                known, moves = known & (latest >= 0), True
            elif name in self._moving and name not in self._static:
                others = ", ".join(self._moving[name])
                raise InputError(
                    f"{self.path}: {name}: expected a Transform3D over {timeline!r}, found it over {others}"
                )
            elif name in self._static:
                T = _transform(f"{self.path}: {name}", self._static[name]) @ T
        if not moves:
            raise InputError(
                f"{self.path}: {entity}: expected a Transform3D over {timeline!r} there or above, found none "
                f"among {', '.join(chain)}"
            )
        return T, known


def _row(batch: Any, kind: str, at: int) -> dict[str, Any]:
    """Return the values of an archetype's components in a row."""
    names = [name for name in batch.schema.names if name.startswith(f"{kind}:")]
    return {name.partition(":")[2]: batch.column(name)[at].as_py() for name in names}


def _transform(where: str, values: dict[str, Any]) -> NDArray:
    """Return T_parent_entity [4, 4] of one Transform3D; scales other than 1 are refused by ``rigid``."""
    T = np.eye(4)
    if values.get("quaternion"):
        T = from_quaternion(where, (0, 0, 0), values["quaternion"][0])
    if values.get("mat3x3"):
        T[:3, :3] = np.array(values["mat3x3"][0], dtype=np.float64).reshape(3, 3).T
    if values.get("rotation_axis_angle"):
        spin = values["rotation_axis_angle"][0]
        axis = np.array(spin["axis"], dtype=np.float64)
        T[:3, :3] = cv2.Rodrigues(axis / max(float(np.linalg.norm(axis)), 1e-12) * spin["angle"])[0]
    if values.get("scale"):
        T[:3, :3] *= np.array(values["scale"][0], dtype=np.float64)
    if values.get("translation"):
        T[:3, 3] = values["translation"][0]
    T = rigid(where, T)
    return np.linalg.inv(T) if values.get("relation") and values["relation"][0] == 2 else T


def _above(frame: str) -> str:
    """Return the frame of the entity above that whose own frame this is; "" for the world's and named ones."""
    if not frame.startswith(_IMPLICIT) or frame == _IMPLICIT + "/":
        return ""
    return frame.rpartition("/")[0] if frame.count("/") > 1 else _IMPLICIT + "/"


def _upwards(entity: str) -> list[str]:
    parts = entity.strip("/").split("/")
    return ["/" + "/".join(parts[:n]) for n in range(len(parts), -1, -1)]


def _the_one(
    path: Path,
    what: str,
    pictures: dict[Any, _Pictures],
    wanted: Callable[[_Pictures], bool],
    nearness: Callable[[_Pictures], Any] = lambda _: 0,
) -> _Pictures:
    """Choose among the entities the nearest one, then the first by name."""
    found = sorted((p for p in pictures.values() if wanted(p) and p.starts), key=lambda p: p.entity)
    if not found:
        others = ", ".join(sorted({entity for entity, _ in pictures}))
        raise InputError(f"{path}: expected a {what}, found {others or 'no picture'}")
    return max(found, key=nearness)


def _timeline(path: Path, depth: _Pictures, color: _Pictures, found: _Contents) -> str:
    """Choose the timeline over which most of the depth's frames move, rather one of when pictures were taken."""
    shared = [name for name in depth.times if name in color.times]
    if not shared:
        raise InputError(f"{path}: expected a timeline of {depth.entity} and {color.entity}, found none they share")
    moving = found.timelines(depth.entity)
    return min(shared, key=lambda n: (-moving.count(n), _LOGGED.index(n) + 1 if n in _LOGGED else 0, n))


def _format(values: dict[str, Any]) -> dict[str, Any]:
    return values["format"][0].as_py() if hasattr(values["format"][0], "as_py") else values["format"][0]


def _bytes(value: Any) -> NDArray:
    return np.asarray(value[0].values.to_numpy(), dtype=np.uint8)


def _depth_m(path: Path, values: dict[str, Any]) -> NDArray:
    meter = values.get("meter")
    first = meter[0] if meter is not None and len(meter) else None
    per_metre = float(first.as_py() if hasattr(first, "as_py") else first) if first is not None else None
    if "blob" in values:
        return _encoded_depth_m(f"{path}: EncodedDepthImage", values, per_metre)
    kind = _format(values)
    dtype = {_U8: "<u1", _U16: "<u2", _F32: "<f4"}.get(int(kind["channel_datatype"] or 0))
    if dtype is None:
        raise InputError(f"{path}: expected depth of 16 bits or 32-bit floats, found type {kind['channel_datatype']}")
    pixels = _bytes(values["buffer"]).view(dtype).reshape(kind["height"], kind["width"])
    unit = per_metre if per_metre is not None else (1.0 if dtype == "<f4" else 1000.0)
    return clean_depth(pixels * np.float32(1.0 / unit))


def _encoded_depth_m(where: str, values: dict[str, Any], per_metre: float | None) -> NDArray:
    """Return depth, float32 [H, W], metres, of a PNG of 16 bits or of RVL as ROS packs it.

    rerun's own example has ``meter=0.001`` for millimetres, where 1000 is meant; no depth has steps of over a metre.
    """
    data = _bytes(values["blob"]).tobytes()
    media = values.get("media_type")
    stated = str(media[0]) if media is not None and len(media) else ""
    if stated == _RVL:
        steps, metres = unpack_depth(where, data, rvl=True)
        if metres is not None:
            return metres
    else:
        steps = sixteen_bits(where, data)
    unit = 1000.0 if per_metre is None else per_metre
    return clean_depth(steps * np.float32(unit if 0 < unit < 1 else 1.0 / unit))


def _rgb(path: Path, values: dict[str, Any]) -> NDArray:
    if "blob" in values:
        return decode_color(f"{path}: EncodedImage", _bytes(values["blob"]).tobytes())
    kind, data = _format(values), _bytes(values["buffer"])
    channels = data.size // (kind["width"] * kind["height"])
    if kind["pixel_format"] or channels not in (3, 4) or int(kind["channel_datatype"] or _U8) != _U8:
        raise InputError(f"{path}: expected pictures of 8-bit RGB or RGBA, found another pixel format")
    rgb = data.reshape(kind["height"], kind["width"], channels)[..., :3]
    return np.ascontiguousarray(rgb[..., ::-1] if kind["color_model"] in (4, 5) else rgb)
