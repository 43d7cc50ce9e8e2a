"""What each frame adds to a recording: the camera (pose, colour, depth, segments, points) and the map as it grows.

Of the map: pictures of the grid, new edges, where the camera went, and counts. Pictures hold small whole numbers that
stand for colours and names, and are north up: row 0 is the northernmost row of cells. On their plane x is east and y is
south (minus north), in metres, so a picture of a grown grid stays where the smaller one was.
"""

import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from simaps_viz.colors.classes import CLUTTER, FLOOR, UNSEEN, WALL, class_color, ground_kinds, instance_color
from simaps_viz.colors.instances import Colored, color_of_instance, colors_like, instance_colors
from simaps_viz.colors.palette import Color
from simaps_viz.events import CommunitiesFound, FrameProjected
from simaps_viz.geometry import transform_points
from simaps_viz.mapping.in_space import VOXEL_M, all_instances, among, has_voxels, voxel_centres, voxel_keys
from simaps_viz.recorder.settings import RecorderSettings
from simaps_viz.structures import Box, Grid, GridSpec, Instance, Intrinsics, MergeLog, Segmentation, SIMap

Entry = tuple[int, str, tuple[int, int, int, int]]
"""Value of a pixel, what it is called, its RGBA colour (0-255)."""

NOTHING: Entry = (0, "", (0, 0, 0, 0))

UNPARTED = 4
GROUND: tuple[Entry, ...] = (
    (UNSEEN, "not seen", (0, 0, 0, 0)),
    (FLOOR, "floor", (128, 132, 140, 40)),
    (CLUTTER, "no name", (140, 146, 158, 150)),
    (WALL, "wall", (110, 116, 128, 255)),
    (UNPARTED, "seen, not told apart yet", (214, 160, 60, 110)),
)
"""Everything under the objects. rerun's own ground, light or dark, shows through."""

CLASS_BASE = 60_000
"""Added to a class index where classes and communities share a picture; communities stay below."""

HEIGHT_STEP_M = 0.02
HEIGHT_TOP_M = 2.0


def north_up(cells: NDArray) -> NDArray:
    """Turn [rows, cols] cells, row 0 at the south, into a picture with row 0 at the north."""
    return np.ascontiguousarray(cells[::-1])


def picture_corner(spec: GridSpec) -> tuple[float, float]:
    """Return where the top left corner of a grid's picture lies on the plane of the pictures, metres."""
    return (spec.x0_m, -(spec.y0_m + spec.rows * spec.cell_size_m))


def on_picture(points_m: NDArray) -> NDArray:
    """Project map-frame points [..., 2 or more] (x, y, ...) on the plane of the pictures, float32 [..., 2]."""
    return (np.asarray(points_m)[..., :2] * (1.0, -1.0)).astype(np.float32)


def ground_picture(grid: Grid) -> NDArray:
    """Draw floor, walls, things without a name and things with one, uint8 [rows, cols], values as in ``GROUND``."""
    picture = ground_kinds(grid).copy()
    picture[np.array(grid.is_thing, dtype=bool)[grid.label]] = UNPARTED
    return north_up(picture)


def class_picture(grid: Grid) -> NDArray:
    """Show classes: index + 1 of the class, 0 = unseen; uint8 [rows, cols], uint16 when there are many classes."""
    dtype = np.uint8 if len(grid.labels) < 255 else np.uint16
    seen = (grid.observations > 0) | ~np.isnan(grid.height_m)
    return north_up(np.where(seen, grid.label + 1, 0).astype(dtype))


def class_entries(labels: Sequence[str]) -> list[Entry]:
    """Name the values of ``class_picture``."""
    entries = [GROUND[UNSEEN], (1, "no name", GROUND[FLOOR][2])]
    return entries + [(i + 1, name, (*class_color(name), 255)) for i, name in enumerate(labels) if i > 0]


def object_picture(ids: NDArray) -> NDArray:
    """Show communities or instances, uint16 [rows, cols], 0 = none. Ids wrap where they would not fit."""
    wrapped = np.where(ids > 0, (ids - 1) % (CLASS_BASE - 1) + 1, 0)
    return north_up(wrapped.astype(np.uint16))


def thing_picture(grid: Grid) -> NDArray:
    """Return countable classes before objects are separated, uint16 [rows, cols]: ``CLASS_BASE`` + index, 0 = none."""
    thing = np.array(grid.is_thing, dtype=bool)[grid.label]
    return north_up(np.where(thing, CLASS_BASE + grid.label.astype(np.int32), 0).astype(np.uint16))


def object_entries(grid: Grid, ids: NDArray, colors: NDArray | None = None) -> list[Entry]:
    """Name the values of ``object_picture`` and ``thing_picture``.

    Args:
        grid: the map.
        ids: int32 [rows, cols], communities or instances, 0 = none.
        colors: uint8 [n, 3], at the place of the id; None takes those that ids alone give.
    """
    present, first = np.unique(ids, return_index=True)
    entries = [NOTHING]
    for value, at in zip(present.tolist(), first.tolist(), strict=True):
        if 0 < value < CLASS_BASE:
            name = grid.labels[int(grid.label.reshape(-1)[at])]
            entries.append((value, f"{name} (id {value})", (*_color(value, colors), 255)))
    things = [(i, name) for i, name in enumerate(grid.labels) if grid.is_thing[i]]
    return entries + [(CLASS_BASE + i, name, (*class_color(name), 255)) for i, name in things]


def recolored(entries: Sequence[Entry], colors: NDArray) -> list[Entry]:
    """Return ``object_entries`` with other colours, uint8 [n, 3], indexed by id."""
    return [
        (value, name, (*_color(value, colors), 255)) if 0 < value < CLASS_BASE else (value, name, color)
        for value, name, color in entries
    ]


def _color(value: int, colors: NDArray | None) -> Color:
    if colors is None or value >= len(colors):
        return instance_color(value)
    red, green, blue = colors[value].tolist()
    return red, green, blue


def height_picture(grid: Grid) -> NDArray:
    """Show heights, uint8 [rows, cols]: 1 + height / ``HEIGHT_STEP_M``, 0 = unseen."""
    steps = np.clip(np.nan_to_num(grid.height_m), 0.0, HEIGHT_TOP_M) / HEIGHT_STEP_M
    return north_up(np.where(np.isnan(grid.height_m), 0, 1 + np.rint(steps)).astype(np.uint8))


def height_entries() -> list[Entry]:
    """Name the values of ``height_picture``, in the colours of viridis."""
    steps = round(HEIGHT_TOP_M / HEIGHT_STEP_M) + 1
    ramp = np.linspace(0, 255, steps).astype(np.uint8)[None]
    colors = cv2.cvtColor(cv2.applyColorMap(ramp, cv2.COLORMAP_VIRIDIS), cv2.COLOR_BGR2RGB)[0].tolist()
    names = [f"{i * HEIGHT_STEP_M:.2f} m" for i in range(steps)]
    return [GROUND[UNSEEN], *((i + 1, names[i], (*colors[i], 255)) for i in range(steps))]


def merge_order(applied: NDArray) -> NDArray:
    """Put the applied steps of a merge log before the others; each part keeps its order. Int64 [steps]."""
    return np.concatenate([np.flatnonzero(applied), np.flatnonzero(~applied)])


def shown_steps(steps: int, applied: int, most: int) -> NDArray:
    """Choose which of the counts 0 .. ``steps`` of merges done get a picture.

    0 and ``applied`` are always among them, and ``steps`` if ``most`` is above 2. The applied ones are taken
    first; what is left over is spread evenly.

    Returns:
        int64 [at most max(most, 2)], ascending.
    """
    chosen = {0, applied}
    for low, high in ((0, applied), (applied, steps)):
        room = max(most, 2) - len(chosen)
        if room > 0 and high > low:
            count = min(room + (high in chosen), high - low)
            chosen |= set(np.rint(np.linspace(high, low, count, endpoint=False)).astype(int).tolist())
    return np.array(sorted(chosen), dtype=np.int64)


class Merging:
    """Follows a merge log step by step. A group is called by the smallest of its communities."""

    def __init__(self, log: MergeLog, order: NDArray, communities: int) -> None:
        self.log, self.order = log, order
        self.name_of = np.arange(communities + 1, dtype=np.int32)
        """int32 [communities + 1]: the present id of each community."""

    def step(self, position: int) -> tuple[int, int]:
        """Apply the step at a position of the order; return the ids of its two groups, source first."""
        at = self.order[position]
        source, target = (int(self.name_of[c[at]]) for c in (self.log.source, self.log.target))
        self.name_of[np.isin(self.name_of, (source, target))] = min(source, target)
        return source, target


def log_entries(stream: rr.RecordingStream, path: str, entries: Iterable[Entry]) -> None:
    """Log, for all times, the meaning of the pixel values of an entity's pictures."""
    stream.log(path, annotations(entries), static=True)


def annotations(entries: Iterable[Entry]) -> rr.AnnotationContext:
    """Turn entries into rerun's names and colours."""
    return rr.AnnotationContext([rr.AnnotationInfo(id=i, label=name, color=color) for i, name, color in entries])


def log_map_picture(
    stream: rr.RecordingStream, path: str, picture: NDArray, spec: GridSpec, *, draw_order: float
) -> None:
    """Lay a picture of the grid on the plane of the pictures, where its cells are."""
    s = spec.cell_size_m
    stream.log(
        path,
        rr.SegmentationImage(picture, opacity=1.0, draw_order=draw_order),
        rr.Transform3D(translation=(*picture_corner(spec), 0.0), scale=(s, s, 1.0)),
    )


def markdown(text: str) -> rr.TextDocument:
    """Return a document of a text in Markdown."""
    return rr.TextDocument(text, media_type="text/markdown")


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Write a table whose first column is text and whose others are numbers."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


NEAR_M, FAR_M = 0.1, 6.0
BELOW_FLOOR_M = 0.3
DEPTH_UNITS_PER_M = 1000.0
IMAGE_PLANE_M = 0.5
"""How far in front of the camera its picture hangs in the 3-D view."""
FRUSTUM_COLOR = (22, 110, 235)


class CameraLog:
    """Logs one frame after another to ``/world/camera`` and ``/world/points``."""

    def __init__(self, stream: rr.RecordingStream, settings: RecorderSettings) -> None:
        self._stream, self._settings = stream, settings
        self._pinholes: dict[str, tuple[Intrinsics, int]] = {}

    def log(self, event: FrameProjected) -> None:
        """Log the parts of a frame that the settings select; the timeline is set already."""
        frame, keep = event.frame, self._settings
        T = event.T_map_camera
        self._stream.log("/world/camera", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
        if frame.color is not None and frame.index % keep.color_every == 0:
            self._pinhole("color", frame.intrinsics, keep.color_divide)
            jpeg = encode_jpeg(frame.color, keep.color_divide, keep.jpeg_quality)
            self._stream.log("/world/camera/color", rr.EncodedImage(contents=jpeg, media_type="image/jpeg"))
        if frame.index % keep.depth_every == 0:
            self._pinhole("depth", frame.intrinsics, keep.depth_divide)
            self._stream.log(
                "/world/camera/depth",
                rr.DepthImage(
                    depth_picture(frame.depth_m, keep.depth_divide),
                    meter=DEPTH_UNITS_PER_M,
                    colormap="turbo",
                    depth_range=(0.0, FAR_M * DEPTH_UNITS_PER_M),
                ),
            )
        self._pinhole("segmentation", frame.intrinsics, keep.segmentation_divide)
        self._stream.log(
            "/world/camera/segmentation",
            rr.SegmentationImage(segment_picture(event.segmentation, keep.segmentation_divide), opacity=1.0),
            annotations(segment_entries(event.segmentation)),
        )
        points, colors = cloud(event, most=keep.points, cut_height_m=keep.cut_height_m)
        self._stream.log("/world/points", rr.Points3D(points, colors=colors, radii=0.02))

    def _pinhole(self, name: str, intrinsics: Intrinsics, divide: int) -> None:
        """Describe how a picture was taken, from now on; each has a size, so a camera model, of its own."""
        if self._pinholes.get(name) == (intrinsics, divide):
            return
        self._pinholes[name] = (intrinsics, divide)
        matrix = intrinsics.matrix()
        matrix[:2] /= divide
        pinhole = rr.Pinhole(
            image_from_camera=matrix,
            width=-(-intrinsics.width // divide),
            height=-(-intrinsics.height // divide),
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=IMAGE_PLANE_M,
            color=FRUSTUM_COLOR,
        )
        self._stream.log(f"/world/camera/{name}", pinhole)


def encode_jpeg(color: NDArray, divide: int, quality: int) -> bytes:
    """Shrink and compress a picture, uint8 [H, W, 3] RGB."""
    if divide > 1:
        size = (-(-color.shape[1] // divide), -(-color.shape[0] // divide))
        color = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", color[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()


def depth_picture(depth_m: NDArray, divide: int) -> NDArray:
    """Thin a depth image out, uint16 [H / divide, W / divide], millimetres, 0 = invalid."""
    kept = np.nan_to_num(depth_m[::divide, ::divide], posinf=0.0, neginf=0.0)
    return np.rint(np.clip(kept * DEPTH_UNITS_PER_M, 0, 65535)).astype(np.uint16)


def segment_picture(segmentation: Segmentation, divide: int) -> NDArray:
    """Thin the segment ids out, uint8 or uint16 [H / divide, W / divide]."""
    kept = segmentation.ids[::divide, ::divide]
    return np.ascontiguousarray(kept.astype(np.uint8 if kept.max(initial=0) < 256 else np.uint16))


def segment_entries(segmentation: Segmentation) -> list[Entry]:
    """Name the segments of one frame; things get the colour of their id, so that neighbours differ, stuff its own."""
    entries: list[Entry] = [(0, "nothing", (30, 32, 36, 255))]
    for segment in segmentation.segments:
        color = instance_color(segment.id) if segment.is_thing else class_color(segment.label)
        entries.append((segment.id, f"{segment.label} {segment.score:.2f}", (*color, 255)))
    return entries


def cloud(event: FrameProjected, *, most: int, cut_height_m: float) -> tuple[NDArray, NDArray]:
    """Back-project an even sample of a frame's pixels, those that can be on the map.

    Args:
        event: the frame.
        most: greatest number of points.
        cut_height_m: points above are dropped.

    Returns:
        float32 [n, 3], map frame, metres, and uint8 [n, 3], RGB: the picture's colours, or those of the classes when
        the picture was not decoded.
    """
    points, v, u = sampled(event, most=most, cut_height_m=cut_height_m)
    return points, _colors(event, v, u)


def sampled(event: FrameProjected, *, most: int, cut_height_m: float) -> tuple[NDArray, NDArray, NDArray]:
    """Return the points of `cloud`, float32 [n, 3], and the row and column of the pixel of each, int [n]."""
    frame, k = event.frame, event.frame.intrinsics
    if most == 0:
        return np.zeros((0, 3), np.float32), np.zeros(0, int), np.zeros(0, int)
    step = max(1, int(np.ceil(np.sqrt(frame.depth_m.size / most))))
    v, u = (axis.reshape(-1) for axis in np.mgrid[step // 2 : k.height : step, step // 2 : k.width : step])
    z = frame.depth_m[v, u].astype(np.float64)
    valid = (z >= NEAR_M) & (z <= FAR_M)
    v, u, z = v[valid], u[valid], z[valid]
    in_camera = np.stack([(u - k.cx) / k.fx * z, (v - k.cy) / k.fy * z, z], axis=-1)
    points = transform_points(event.T_map_camera, in_camera)
    kept = np.flatnonzero((points[:, 2] <= cut_height_m) & (points[:, 2] >= -BELOW_FLOOR_M))[:most]
    return points[kept].astype(np.float32), v[kept], u[kept]


def _colors(event: FrameProjected, v: NDArray, u: NDArray) -> NDArray:
    if event.frame.color is not None:
        return event.frame.color[v, u]
    colors = np.zeros((len(v), 3), np.uint8)
    ids = event.segmentation.ids[v, u]
    for segment in event.segmentation.segments:
        colors[ids == segment.id] = class_color(segment.label)
    return colors


@dataclass(frozen=True, eq=False)
class _Shown:
    """The picture shown after a frame; its ids are packed, as a long build shows many."""

    frame: int
    spec: GridSpec
    packed: bytes
    entries: list[Entry]

    def ids(self) -> NDArray:
        return np.frombuffer(zlib.decompress(self.packed), np.int32).reshape(self.spec.shape)


class ObjectColors:
    """Stores the objects and their colours each time they are found during a build."""

    def __init__(self) -> None:
        self._last: Colored | None = None
        self._shown: list[_Shown] = []

    def find(self, frame: int, grid: Grid, ids: NDArray, colors: NDArray | None = None) -> list[Entry]:
        """Colour the objects found after a frame as those that were found before them.

        Args:
            frame: its index.
            grid: the map then.
            ids: int32 [rows, cols], 0 = none.
            colors: uint8 [n, 3], where they are known.
        """
        if colors is None:
            colors = colors_like(grid.spec, ids, self._last)
        entries = object_entries(grid, ids, colors)
        self._last = Colored(grid.spec, ids, colors)
        packed = zlib.compress(np.ascontiguousarray(ids, np.int32).tobytes(), level=1)
        self._shown.append(_Shown(frame, grid.spec, packed, entries))
        return entries

    def as_finished(self, simap: SIMap) -> Iterator[tuple[int, list[Entry]]]:
        """Return (frame, colours) for the frames whose objects had other colours than on the finished map."""
        finished = Colored(simap.spec, simap.instance, instance_colors(simap))
        for one in self._shown:
            entries = recolored(one.entries, colors_like(one.spec, one.ids(), finished))
            if entries != one.entries:
                yield one.frame, entries
        self._shown = []


SURFACE = "/world/surface"
COARSE = 2
"""Voxels of the recorded surface are so many times as wide as the map's; each is there from its first frame on."""
SURFACE_PIXELS = 20_000
"""Greatest number of pixels of a frame that are looked at for it."""
CAMERA_COLOR = (22, 110, 235)
TRAIL_POINTS = 200
"""The camera's trajectory is thinned out to this many points."""
WEDGE_M = 0.6
"""Length of the two lines that show where the camera looks."""
MAX_LABELS = 20
"""More names than that would hide each other; they show when the pointer rests on an object."""
BOTTOM, MIDDLE = -10.0, -5.0
"""Draw orders: the ground lies under the objects, lines and labels (0 and more) above both."""
COUNTS = {
    "/counts/cells/seen": "seen cells",
    "/counts/cells/named": "named cells",
    "/counts/edges": "edges",
    "/counts/few/classes": "classes",
    "/counts/few/communities": "communities",
}


class MapLog:
    """Logs the map to ``/map`` and the counts to ``/counts``."""

    def __init__(self, stream: rr.RecordingStream, settings: RecorderSettings) -> None:
        self._stream, self._settings = stream, settings
        self._classes: tuple[str, ...] | None = None
        self._edges = 0
        self._trail: list[NDArray] = []
        self._on_the_way = ObjectColors()
        self._colors: NDArray | None = None
        self._voxels = np.zeros(0, np.int64)

    def log_start(self) -> None:
        """Log the static data: the meaning of pixel values and the names of the curves."""
        log_entries(self._stream, "/map/ground", GROUND)
        log_entries(self._stream, "/map/heights", height_entries())
        for path, name in COUNTS.items():
            self._stream.log(path, rr.SeriesLines(names=name), static=True)

    def log_frame(self, event: FrameProjected, *, last: bool) -> Grid | None:
        """Log the changes of one frame to the map; the timeline is set already. Return the map if it was kept."""
        self._edges += len(event.new_edges)
        self._stream.log("/counts/edges", rr.Scalars(float(self._edges)))
        self._log_camera(event.T_map_camera)
        if event.frame.index % self._settings.map_every and not last:
            return None
        grid = event.snapshot()
        self.log_grid(grid)
        self._log_edges(grid, event.new_edges, event.new_edge_labels)
        self._log_surface(event, grid.labels)
        self._stream.log("/counts/cells/seen", rr.Scalars(float((grid.observations > 0).sum())))
        self._stream.log("/counts/cells/named", rr.Scalars(float((grid.label > 0).sum())))
        self._stream.log("/counts/few/classes", rr.Scalars(float(len(np.unique(grid.label[grid.label > 0])))))
        return grid

    def log_grid(self, grid: Grid) -> None:
        """Log ground, classes and heights at the present time."""
        if grid.labels != self._classes:
            self._classes = grid.labels
            for path in ("/map/classes", SURFACE):
                log_entries(self._stream, path, class_entries(grid.labels))
        log_map_picture(self._stream, "/map/ground", ground_picture(grid), grid.spec, draw_order=BOTTOM)
        log_map_picture(self._stream, "/map/classes", class_picture(grid), grid.spec, draw_order=BOTTOM)
        log_map_picture(self._stream, "/map/heights", height_picture(grid), grid.spec, draw_order=BOTTOM)

    def log_things(self, grid: Grid) -> None:
        """Log the countable classes, before objects are separated."""
        self._name_objects(object_entries(grid, np.zeros_like(grid.label)))
        self._log_object_picture(grid, thing_picture(grid))

    def wear_colors_of(self, simap: SIMap) -> None:
        """Color every object as on the finished map's page, from now on and on all frames before."""
        self._colors = instance_colors(simap)
        for frame, entries in self._on_the_way.as_finished(simap):
            self._stream.reset_time()
            self._stream.set_time("frame", sequence=frame)
            self._name_objects(entries)

    def log_objects(self, grid: Grid, ids: NDArray, colors: NDArray | None = None) -> None:
        """Log communities or instances, int32 [rows, cols], each in a colour of its own, by default the map's."""
        self._name_objects(object_entries(grid, ids, self._colors if colors is None else colors))
        self._log_object_picture(grid, object_picture(ids))

    def log_object_ids(self, grid: Grid, ids: NDArray) -> None:
        """Log new ids of the same cells, of which names and colours are known on this timeline."""
        picture = object_picture(ids)
        log_map_picture(self._stream, "/map/objects", picture, grid.spec, draw_order=MIDDLE)
        values = picture[::-1]
        self._stream.log("/world/cells", rr.Points3D.from_fields(class_ids=values[values > 0]))

    def _name_objects(self, entries: list[Entry]) -> None:
        names = annotations(entries)
        self._stream.log("/map/objects", names)
        self._stream.log("/world/cells", names)

    def _log_object_picture(self, grid: Grid, picture: NDArray) -> None:
        """Log objects on the map, and their cells as points at their heights in the room."""
        log_map_picture(self._stream, "/map/objects", picture, grid.spec, draw_order=MIDDLE)
        values = picture[::-1]  # south up again, like the grid
        rows, cols = np.nonzero(values)
        tops = np.nan_to_num(grid.height_m[rows, cols])[:, None]
        points = np.concatenate([grid.spec.centres_of(rows, cols), tops], axis=1)
        self._stream.log(
            "/world/cells",
            rr.Points3D(points, class_ids=values[rows, cols], radii=grid.spec.cell_size_m / 2, show_labels=False),
        )

    def log_communities(self, event: CommunitiesFound, colors: NDArray | None = None) -> int:
        """Log the present objects, or the communities themselves, and return their number.

        Each keeps the colour of the object that it was before, unless ``colors``, uint8 [n, 3], are given.
        """
        ids = event.community if event.instance is None else event.instance
        self._name_objects(self._on_the_way.find(event.frame_index, event.grid, ids, colors))
        self._log_object_picture(event.grid, object_picture(ids))
        count = int(np.count_nonzero(np.unique(event.community)))
        self._stream.log("/counts/few/communities", rr.Scalars(float(count)))
        return count

    def log_instances(self, simap: SIMap) -> None:
        """Log the finished objects, on the map and as boxes in the room, with their names."""
        self.log_objects(simap.grid, simap.instance)
        if not simap.instances:
            return
        names = [one.name for one in simap.instances]
        colors = instance_colors(simap)[[instance.id for instance in simap.instances]]
        corners = np.array([instance.aabb_m for instance in simap.instances])
        low, high = on_picture(corners[:, 0]), on_picture(corners[:, 1])
        self._stream.log(
            "/map/names",
            rr.Boxes2D(centers=(low + high) / 2, half_sizes=np.abs(high - low) / 2, colors=colors, labels=names,
                       radii=0.01, draw_order=20.0, show_labels=False),
        )  # fmt: skip
        if has_voxels(simap):
            self._log_boxes(simap)
            return
        self._stream.log(
            "/world/objects",
            rr.Boxes3D(mins=corners[:, 0], sizes=corners[:, 1] - corners[:, 0], colors=colors, labels=names,
                       radii=0.01, show_labels=len(names) <= MAX_LABELS),
        )  # fmt: skip

    def _log_boxes(self, simap: SIMap) -> None:
        """Log the turned boxes of the objects, in the order of the map's instances, then of those no cell shows."""
        ones = all_instances(simap)
        boxes = [one.box or _upright(one) for one in ones]
        half_turns = np.array([box.yaw_rad for box in boxes]) / 2.0
        nothing = np.zeros(len(boxes))
        self._stream.log(
            "/world/objects",
            rr.Boxes3D(
                centers=[box.center_m for box in boxes],
                sizes=[box.size_m for box in boxes],
                quaternions=np.stack([nothing, nothing, np.sin(half_turns), np.cos(half_turns)], axis=1),
                colors=[color_of_instance(simap, one.id) for one in ones],
                labels=[one.name for one in all_instances(simap)],
                radii=0.01,
                show_labels=len(ones) <= MAX_LABELS,
            ),
        )

    def _log_edges(self, grid: Grid, edges: NDArray, labels: NDArray) -> None:
        """Draw an even sample of the edges a frame added, in the colours of their classes."""
        if len(edges) > self._settings.edges:
            kept = np.linspace(0, len(edges), self._settings.edges, endpoint=False).astype(int)
            edges, labels = edges[kept], labels[kept]
        ends = grid.spec.centres_of(edges.reshape(-1, 2, 2)[..., 0], edges.reshape(-1, 2, 2)[..., 1])
        palette = np.array([class_color(name) for name in grid.labels], np.uint8)
        self._stream.log(
            "/map/edges",
            rr.LineStrips2D(on_picture(ends), colors=palette[labels], radii=0.012, draw_order=10.0),
        )

    def _log_surface(self, event: FrameProjected, labels: Sequence[str]) -> None:
        """Log the voxels that no frame logged before has shown, in the classes that this one shows there."""
        points, v, u = sampled(event, most=SURFACE_PIXELS, cut_height_m=self._settings.cut_height_m)
        keys, first = np.unique(voxel_keys(points / COARSE, (0.0, 0.0)), return_index=True)
        new = ~among(keys, self._voxels)
        self._voxels = np.sort(np.concatenate([self._voxels, keys[new]]))
        of_segment = np.zeros(max((s.id for s in event.segmentation.segments), default=0) + 1, np.uint16)
        for segment in event.segmentation.segments:
            of_segment[segment.id] = labels.index(segment.label)
        ids = event.segmentation.ids[v, u][first[new]]
        self._stream.log(
            SURFACE,
            rr.Points3D(
                COARSE * voxel_centres(keys[new], (0.0, 0.0)), class_ids=of_segment[ids] + 1,
                radii=COARSE * VOXEL_M / 2, show_labels=False,
            ),
        )  # fmt: skip

    def _log_camera(self, T_map_camera: NDArray) -> None:
        """Draw the camera's trajectory and its viewing direction."""
        at = T_map_camera[:3, 3]
        self._trail.append(on_picture(at))
        thinned = [*self._trail[:: max(1, len(self._trail) // TRAIL_POINTS)], self._trail[-1]]
        looks = [T_map_camera[:3, :3] @ (side, 0.0, 1.0) for side in (-0.5, 0.5)]
        flat = [look[:2] / max(float(np.linalg.norm(look[:2])), 1e-9) for look in looks]
        left, right = (on_picture(at[:2] + WEDGE_M * direction) for direction in flat)
        self._stream.log(
            "/map/camera",
            rr.LineStrips2D(
                [np.array(thinned), np.array([left, self._trail[-1], right, left])],
                colors=[(*CAMERA_COLOR, 110), CAMERA_COLOR],
                radii=[0.015, 0.025],
                draw_order=15.0,
            ),
        )


def _upright(instance: Instance) -> Box:
    """Return the box along the axes of an instance that has no voxel."""
    low, high = (np.array(corner) for corner in instance.aabb_m)
    x, y, z = ((low + high) / 2.0).tolist()
    length, width, height = (high - low).tolist()
    return Box((x, y, z), (length, width, height), 0.0)
