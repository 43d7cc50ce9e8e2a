"""Finished maps for rerun, without their builds: one with its objects in the room, or several side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from simaps_viz.colors.classes import class_color
from simaps_viz.io.files import check_output, replacing
from simaps_viz.mapping.in_space import VOXEL_M, has_voxels
from simaps_viz.recorder.facts import finished_facts, send_facts
from simaps_viz.recorder.map_log import MapLog, markdown_table, north_up, object_picture
from simaps_viz.recorder.recorder import extent_of, map_views
from simaps_viz.recorder.settings import SMALL
from simaps_viz.structures import SIMap


class _Under:
    """A stream that puts all its entities below a prefix."""

    def __init__(self, stream: rr.RecordingStream, prefix: str) -> None:
        self._stream, self._prefix = stream, "/" + prefix.strip("/") if prefix.strip("/") else ""

    def log(self, path: str, *entities: Any, static: bool = False) -> None:
        self._stream.log(self._prefix + path, *entities, static=static)


def log_whole_map(stream: rr.RecordingStream, simap: SIMap, *, prefix: str = "") -> None:
    """Log a map: ``/map`` its pictures and names, ``/world`` its objects and surfaces, ``/about`` in words.

    Args:
        stream: where to.
        simap: the map.
        prefix: entity path that all of it is put under.
    """
    under: Any = _Under(stream, prefix)
    send_facts(stream, finished_facts(simap))
    stream.set_time("frame", sequence=max(len(simap.frame_names) - 1, 0))
    under.log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    under.log("/about", rr.TextDocument(_about(simap), media_type="text/markdown"), static=True)
    maps = MapLog(under, SMALL)
    maps.log_start()
    maps.log_grid(simap.grid)
    maps.log_instances(simap)
    _log_surface(under, simap)
    _log_way(under, simap)


def whole_map_blueprint(simap: SIMap) -> rrb.Blueprint:
    """Lay the map out: from above on the left, the room and words on the right."""
    shown = {"Objects": ("/map/ground", "/map/objects", "/map/names"), "Classes": ("/map/classes",),
             "Heights": ("/map/heights",)}  # fmt: skip
    return rrb.Blueprint(
        rrb.Horizontal(
            map_views(extent_of(simap.spec), shown),
            rrb.Vertical(
                rrb.Spatial3DView(origin="/world", name="3-D"),
                rrb.TextDocumentView(origin="/about", name="About"),
                row_shares=[0.7, 0.3],
            ),
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="hidden"),
        auto_views=False,
    )


def _log_surface(under: Any, simap: SIMap) -> None:
    """Log the surface as it looked; of a map without voxels the tops of cells that no object covers, by class."""
    grid = simap.grid
    if has_voxels(simap):
        points = simap.points()
        under.log("/world/surface", rr.Points3D(points.positions, colors=points.colors, radii=VOXEL_M / 2))
        return
    rows, cols = np.nonzero(~np.isnan(grid.height_m) & (simap.instance == 0))
    points = np.concatenate([grid.spec.centres_of(rows, cols), grid.height_m[rows, cols][:, None]], axis=1)
    palette = np.array([class_color(name) if i else (170, 175, 185) for i, name in enumerate(grid.labels)], np.uint8)
    under.log(
        "/world/surface", rr.Points3D(points, colors=palette[grid.label[rows, cols]], radii=grid.spec.cell_size_m / 3)
    )


def _log_way(under: Any, simap: SIMap) -> None:
    if len(simap.T_map_camera) > 1:
        way = simap.T_map_camera[:, :3, 3]
        under.log("/world/camera_way", rr.LineStrips3D([way], colors=(22, 110, 235), radii=0.01))


def _about(simap: SIMap) -> str:
    simulated = "\n\n**Simulated**: not of a real place, or not segmented by a network." * bool(
        simap.provenance.get("simulated")
    )
    counts = markdown_table(("class", "instances"), list(simap.counts().items()))
    return (
        f"# {simap.provenance.get('name', 'A map')}\n\nA Semantic Instance Map: {len(simap.instances)} instances,"
        f" method {simap.method}, {len(simap.frame_names)} frames, cells of {simap.spec.cell_size_m:g} m. North is up."
        f"{simulated}\n\n{counts}\n"
    )


Picture = tuple[str, NDArray, NDArray]
"""Title; colours uint8 [rows, cols, 3] with row 0 at the south; instance ids int32 [rows, cols]."""


def record_comparison(name: str, pictures: Sequence[Picture], path: Path) -> None:
    """Write a recording with one view for each picture; pointing at a cell shows its instance.

    Args:
        name: of the recording.
        pictures: all of the same shape.
        path: the .rrd; replaced only once the new one is complete.

    Raises:
        InputError: it cannot be written there.
    """
    path = Path(path)
    check_output(path)
    stream = rr.RecordingStream("simaps_comparison")
    with replacing(path, "the recording") as partial:
        stream.set_sinks(rr.FileSink(str(partial)))
        stream.send_recording_name(name)
        views = []
        for number, (title, colors, instance) in enumerate(pictures):
            origin = f"/{number:02d}"
            stream.log(f"{origin}/map", rr.Image(north_up(colors)), static=True)
            ids = rr.SegmentationImage(object_picture(instance), opacity=0.0)
            stream.log(f"{origin}/instance", ids, static=True)
            views.append(rrb.Spatial2DView(origin=origin, name=title))
        columns = max(1, round(len(views) ** 0.5))
        stream.send_blueprint(rrb.Blueprint(rrb.Grid(*views, grid_columns=columns), collapse_panels=True))
        stream.flush()
        stream.disconnect()
