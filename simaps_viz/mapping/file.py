"""The map file, ``simap/1``: one .npz without pickles, written completely or not at all.

Everything in a file is checked when it is opened. Its largest arrays (`PACKED`) then stay packed in memory and are
unpacked when somebody asks for one: few uses of a map need all of its layers, and those of a building of 500 m x 500 m
take 0.4 GB each.
"""

import json
import math
import os
import tempfile
import threading
import zipfile
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from functools import cached_property
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.appearance import Appearance
from simaps_viz.errors import InputError
from simaps_viz.io.arrays import Check, PackedArray, Rows, check_ends, read_npz, write_rows
from simaps_viz.io.files import write_whole
from simaps_viz.io.limits import MAX_ARRAY_BYTES, MAX_CELL_INDEX, MAX_CLASSES, MAX_FRAMES, MAX_JSON_BYTES, check_cells
from simaps_viz.mapping.methods import method_of
from simaps_viz.mapping.partition import row_blocks
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.surface import Surface
from simaps_viz.structures import CellGraph, Grid, GridSpec, Instance, MergeLog, SIMap, Views

FORMAT = "simap/1"

_ARRAYS: dict[str, tuple[type, int]] = {
    "label": (np.int16, 2), "instance": (np.int32, 2), "height": (np.float32, 2), "lowest": (np.float32, 2),
    "observations": (np.int32, 2), "community": (np.int32, 2), "T_map_camera": (np.float64, 3),
    "merge_label": (np.int16, 1), "merge_source": (np.int32, 1), "merge_target": (np.int32, 1),
    "merge_score": (np.float32, 1), "graph_label": (np.int16, 1), "graph_edges": (np.int64, 1),
    "edge_first": (np.int32, 1), "edge_step": (np.int32, 1), "edge_count": (np.int32, 1),
    "edge_different": (np.int32, 1),
    "view_community": (np.int32, 1), "view_frame": (np.int32, 1), "view_segment": (np.int32, 1),
    "view_cells": (np.int32, 1), "view_score": (np.float32, 1),
}  # fmt: skip
"""Every array of the file: dtype and number of axes."""
_SEEN: dict[str, tuple[type, int]] = {
    "seen_cell": (np.int32, 1), "seen_patch": (np.int32, 1), "seen_rgb": (np.uint8, 2), "seen_pixels": (np.int32, 1),
    "embedding_of": (np.int32, 1), "embedding": (np.float16, 2), "embedding_weight": (np.float32, 1),
    "embedding_words": (np.float16, 2), "embedding_model": (np.str_, 0),
}  # fmt: skip
"""The arrays of `Appearance`, all of them or none; ``seen_cell`` counts from cell to cell."""
_ROOMS: dict[str, tuple[type, int]] = {"rooms": (np.int32, 2), "room_names": (np.str_, 0)}
"""`SIMap.room`, and `SIMap.room_names` as JSON; maps of earlier versions have neither."""
_SURFACE: dict[str, tuple[type, int]] = {
    "surface_cell": (np.int32, 1), "surface_low": (np.int8, 1), "surface_more": (np.int8, 1),
    "surface_owner": (np.int32, 1), "surface_color": (np.int8, 2), "hidden": (np.str_, 0),
}  # fmt: skip
"""The arrays of `Surface`, ``surface_cell`` from cell to cell, ``surface_more`` = high - low, and `SIMap.hidden` as
JSON: all of them or none, but ``surface_color`` only where the pictures have colour."""
LAYERS = ("height", "lowest", "observations", "community")
"""The arrays with a number for each cell that few uses of a map need."""
EDGES = ("edge_first", "edge_step", "edge_count", "edge_different")
"""The arrays with an entry for each edge, class by class: flat cell, how many cells further the other end is, and
`CellGraph.counts` and `CellGraph.different`."""
RUNS = ("surface_cell", "surface_low", "surface_more", "surface_owner", "surface_color")
"""The arrays of `Surface`."""
PACKED = (*LAYERS, *EDGES, *RUNS)
"""The arrays that stay packed until somebody asks for them."""
_EDGES_AT_ONCE = 1 << 20
_QUICK_LEVEL = 5
"""Of zlib, for the surface and colours: its usual 6 takes twice the time there for files hardly smaller."""
_CELL_SIZE_M = (1e-4, 100.0)
_MAX_NAME = 1000
_PARAMETERS = {
    "k_percent": (0.0, 100.0), "affinity": (0.0, 1.0), "resolution": (1e-9, 1e9), "seed": (0, (1 << 32) - 1),
    "min_cells": (0, 1 << 31), "cut_height_m": (-1e6, 1e6),
}  # fmt: skip
"""The parameters that are computed with again, and their ranges."""
_SPARE_IDS = 1_000_000
"""Communities are fewer than cells, but every edit adds ids above theirs."""


def check_writable(path: Path) -> None:
    """Raise InputError, naming the path, unless a map file can be written there; leaves nothing behind."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: expected a file name for the map, found a folder")
    try:
        # as long as the longest name that a build gives to a file beside this map
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".building", dir=path.parent)
    except OSError as error:
        raise InputError(f"{path}: expected a folder that can be written, found: {error.strerror or error}") from error
    os.close(handle)
    os.unlink(name)


def save_map(simap: SIMap, path: Path) -> None:
    """Write a map file, replacing an earlier one only once the new one is complete on disk.

    Raises:
        InputError: the file cannot be written; an earlier file is left as it was.
    """
    path = Path(path)
    check_writable(path)
    write_whole(path, lambda file: _write(simap, file), "the map")


def _write(simap: SIMap, file: IO[bytes]) -> None:
    """Write what `numpy.savez_compressed` does, array by array and edges in parts, to save memory."""
    arrays, edges = _arrays(simap), sum(len(graph.edges) for graph in simap.graphs)
    with zipfile.ZipFile(file, "w", compression=zipfile.ZIP_DEFLATED) as archive:
        for name in ("metadata", *_ARRAYS):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                if name == "metadata":
                    np.lib.format.write_array(member, np.array(json.dumps(_metadata(simap))), allow_pickle=False)
                elif name in EDGES:
                    write_rows(member, np.dtype(_ARRAYS[name][0]), edges, _edge_parts(simap.graphs, name))
                else:
                    array = np.asarray(arrays[name], dtype=_ARRAYS[name][0])
                    np.lib.format.write_array(member, array, allow_pickle=False)
        archive.compresslevel = _QUICK_LEVEL
        for name, array in {**_seen_arrays(simap), **_room_arrays(simap), **_surface_arrays(simap)}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def _metadata(simap: SIMap) -> dict[str, Any]:
    spec = simap.spec
    return {
        "format": FORMAT,
        "cell_size_m": spec.cell_size_m,
        "origin_m": [spec.x0_m, spec.y0_m],
        "T_map_world": np.asarray(simap.T_map_world).tolist(),
        "labels": list(simap.grid.labels),
        "is_thing": list(simap.grid.is_thing),
        "method": simap.method,
        "parameters": dict(simap.parameters),
        "instances": [asdict(instance) for instance in simap.instances],
        "provenance": dict(simap.provenance),
        "frame_names": list(simap.frame_names),
    }


def _arrays(simap: SIMap) -> dict[str, ArrayLike]:
    """Return all arrays but those of the edges."""
    grid, views, log = simap.grid, simap.views, simap.merges
    return {
        "label": grid.label, "instance": simap.instance, "height": grid.height_m, "lowest": grid.lowest_m,
        "observations": grid.observations, "community": simap.community, "T_map_camera": simap.T_map_camera,
        "merge_label": log.label, "merge_source": log.source, "merge_target": log.target, "merge_score": log.score,
        "graph_label": [g.label for g in simap.graphs], "graph_edges": [len(g.edges) for g in simap.graphs],
        "view_community": views.community, "view_frame": views.frame, "view_segment": views.segment,
        "view_cells": views.cells, "view_score": views.score,
    }  # fmt: skip


def _seen_arrays(simap: SIMap) -> dict[str, NDArray]:
    """Return the arrays of a map's appearance; none where it has none, or that of another grid."""
    look = simap.appearance
    if look is None or look.spec != simap.spec:
        return {}
    found = (
        np.diff(look.cell, prepend=0), look.patch, look.rgb, look.pixels, look.vector, look.vectors, look.weight,
        look.word_vectors, np.array(json.dumps(dict(look.model))),
    )  # fmt: skip
    return {
        name: array.astype(dtype, copy=False) for (name, (dtype, _)), array in zip(_SEEN.items(), found, strict=True)
    }


def _room_arrays(simap: SIMap) -> dict[str, NDArray]:
    """Return the rooms that a map has; none where they are found when asked for."""
    if simap.room is None:
        return {}
    names = {str(room): name for room, name in sorted(simap.room_names.items())}
    return {"rooms": simap.room, "room_names": np.array(json.dumps(names))}


def _surface_arrays(simap: SIMap) -> dict[str, NDArray]:
    """Return the arrays of a map's surface; none where it has none, or that of another grid."""
    surface = simap.surface
    if surface is None or surface.spec != simap.spec:
        return {}
    found = {
        "surface_cell": np.diff(surface.cell, prepend=np.int32(0)), "surface_low": surface.low,
        "surface_more": surface.high - surface.low, "surface_owner": surface.owner,
        "hidden": np.array(json.dumps([asdict(one) for one in simap.hidden])),
    }  # fmt: skip
    return found | {"surface_color": surface.color} if surface.color.size else found


def load_map(path: Path) -> SIMap:
    """Read a map file.

    Raises:
        InputError: it is missing, damaged, or not a ``simap/1`` file.
    """
    path = Path(path)
    if not path.is_file():
        found = "a folder; simaps build makes a map of a recording" if path.is_dir() else "nothing"
        raise InputError(f"{path}: expected a map file ({FORMAT}), found {found}")
    checks = {name: _check_of(path, name) for name in ("metadata", *_ARRAYS, *_SEEN, *_ROOMS, *_SURFACE)}
    return map_in(path, *read_npz(path, checks, what=f"map file ({FORMAT})", packed=PACKED))


def map_in(path: Path, data: Mapping[str, NDArray], packed: Mapping[str, PackedArray] | None = None) -> SIMap:
    """Return the map in a file's arrays.

    Args:
        path: the file, for messages.
        data: its arrays.
        packed: the arrays of `PACKED` that are not in ``data``.

    Raises:
        InputError: they are not of this format, or do not fit together.
    """
    meta = _read_metadata(path, data)
    rows = {name: found for part in (data, packed or {}) for name, found in part.items() if name in PACKED}
    _check_arrays(path, data, rows)
    try:
        check_metadata(meta)
        check_arrays(meta, data, rows)
        check_instances(meta, data["instance"], data["label"])
        return _rebuild(meta, data, rows)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError, AttributeError, InputError) as error:
        if isinstance(error, InputError) and str(error).startswith(str(path)):
            raise
        why = " ".join(repr(error).split())[:200]
        raise InputError(f"{path}: expected consistent {FORMAT} contents, found otherwise ({why})") from error


def _check_of(path: Path, name: str) -> Check:
    """Return the check of an array's shape and dtype before the array is read."""

    def check(shape: tuple[int, ...], dtype: np.dtype) -> None:
        wanted, axes = {**_ARRAYS, **_SEEN, **_ROOMS, **_SURFACE}.get(name, (np.str_, 0))
        if len(shape) != axes or (dtype.kind != "U" if wanted is np.str_ else dtype != wanted):
            kind = f"{np.dtype(wanted).name} with {axes} axes"
            raise InputError(f"{path}: {name}: expected {kind}, found {dtype} {list(shape)}")
        if axes == 2 and name not in {**_SEEN, **_SURFACE}:
            check_cells(path, *shape)
        if (axes == 3 and shape[0] > MAX_FRAMES) or (axes == 0 and dtype.itemsize > 4 * MAX_JSON_BYTES):
            raise InputError(f"{path}: {name}: expected less than {MAX_ARRAY_BYTES} bytes, found {dtype} {list(shape)}")

    return check


def _read_metadata(path: Path, data: Mapping[str, NDArray]) -> dict[str, Any]:
    try:
        meta = json.loads(str(data["metadata"]))
        found = meta["format"]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON metadata of format {FORMAT}, found none") from error
    if found != FORMAT:
        raise InputError(f"{path}: expected format {FORMAT}, found {repr(found)[:60]}")
    return meta


def _check_arrays(path: Path, data: Mapping[str, NDArray], rows: Mapping[str, Rows]) -> None:
    shape = data["label"].shape if "label" in data else ()
    for name, (dtype, axes) in _ARRAYS.items():
        array = (rows if name in PACKED else data).get(name)
        wanted = f"{np.dtype(dtype).name} with {axes} axes"
        if array is None:
            raise InputError(f"{path}: expected an array {name} ({wanted}), found none")
        if array.dtype != dtype or array.ndim != axes:
            raise InputError(f"{path}: {name}: expected {wanted}, found {array.dtype} {list(array.shape)}")
        if axes == 2 and array.shape != shape:
            raise InputError(f"{path}: {name}: expected shape {list(shape)} as label, found {list(array.shape)}")


def _rebuild(meta: Mapping[str, Any], data: Mapping[str, NDArray], packed: Mapping[str, Rows]) -> SIMap:
    rows, cols = data["label"].shape
    x0, y0 = meta["origin_m"]
    grid = _LazyGrid.of(
        {
            "height_m": lambda _: packed["height"][:],
            "lowest_m": lambda _: packed["lowest"][:],
            "observations": lambda _: packed["observations"][:],
        },
        spec=GridSpec(rows, cols, float(meta["cell_size_m"]), float(x0), float(y0)),
        labels=tuple(meta["labels"]),
        is_thing=tuple(meta["is_thing"]),
        label=data["label"],
    )
    return _LazyMap.of(
        {"community": lambda _: packed["community"][:], "surface": lambda _: _surface(grid.spec, packed)},
        grid=grid,
        instance=data["instance"],
        instances=tuple(_instance(entry) for entry in meta["instances"]),
        T_map_world=np.array(meta["T_map_world"], dtype=np.float64).reshape(4, 4),
        method=str(meta["method"]),
        parameters=meta["parameters"],
        provenance=meta["provenance"],
        merges=MergeLog(data["merge_label"], data["merge_source"], data["merge_target"], data["merge_score"]),
        graphs=_graphs(
            grid, data["graph_label"], data["graph_edges"], packed, evidence=method_of(meta["method"]).weighs_evidence
        ),
        views=Views(
            data["view_community"], data["view_frame"], data["view_segment"], data["view_cells"], data["view_score"]
        ),
        frame_names=tuple(meta["frame_names"]),
        T_map_camera=data["T_map_camera"].reshape(-1, 4, 4),
        appearance=_appearance(grid.spec, data),
        **_rooms(data),
        hidden=_hidden(grid, data, packed, {int(entry["id"]) for entry in meta["instances"]}),
    )


def _rooms(data: Mapping[str, NDArray]) -> dict[str, Any]:
    """Return the rooms of a map file; raises ValueError or TypeError for what no rooms can be."""
    if "rooms" not in data:
        return {"room": None, "room_names": {}}
    room, names = data["rooms"], json.loads(str(data.get("room_names", "{}")))
    _check(room.shape == data["label"].shape and _within(room, 0, room.size), "rooms")
    _check(isinstance(names, dict) and len(names) <= room.size and all(key.isdigit() for key in names), "room names")
    fine = (isinstance(name, str) and 0 < len(name) <= _MAX_NAME and name.isprintable() for name in names.values())
    _check(all(fine), "room names")
    return {"room": room, "room_names": {int(key): name for key, name in names.items()}}


def _surface(spec: GridSpec, rows: Mapping[str, Rows]) -> Surface | None:
    """Return the surface of a map file; None for a map without."""
    if RUNS[0] not in rows:
        return None
    cell = np.cumsum(rows["surface_cell"][:], dtype=np.int32)
    low, more, owner = (rows[name][:] for name in RUNS[1:4])
    color = rows.get("surface_color", np.zeros((3, 0), np.int8))
    return Surface(spec, cell, low, low + more, owner, color[:])


def _hidden(
    grid: Grid, data: Mapping[str, NDArray], rows: Mapping[str, Rows], ids: Collection[int]
) -> tuple[Instance, ...]:
    """Return the hidden objects of a map file, whose surface is checked; a map without a surface has none.

    Args:
        grid: the map's.
        data: the arrays that are not packed.
        rows: the packed ones.
        ids: of the instances on the grid.

    Raises:
        KeyError, TypeError, ValueError: some of the arrays are missing, or they do not fit together.
    """
    if not any(name in part for name in _SURFACE for part in (data, rows)):
        return ()
    entries = json.loads(str(data["hidden"]))
    _check(isinstance(entries, list) and all(isinstance(one, dict) for one in entries), "hidden")
    known = [one["id"] for one in entries]
    _check(_are(known, int) and len({*known, *ids}) == len(known) + len(ids), "ids of hidden instances")
    for one in entries:
        _check(0 < one["id"] < 1 << 31 and one["label"] in grid.labels, "hidden")
        _check_numbers(one)
    step, low, more, owner = (rows[name] for name in RUNS[:4])
    _check(len(step) == len(low) == len(more) == len(owner), "surface arrays of different lengths")
    last = voxels = 0
    for block in _blocks(slice(0, len(step))):
        steps, size = step[block], more[block].astype(np.int64) + 1
        _check(_within(steps, 0, None) and _within(size, 1, None) and _within(size + low[block], -127, 128), "surface")
        _check(_within(owner[block], -len(grid.labels), grid.label.size + _SPARE_IDS), "surface_owner out of range")
        last, voxels = last + int(steps.sum(dtype=np.int64)), voxels + int(size.sum())
    _check(last < grid.label.size and voxels <= 256 * grid.label.size, "surface_cell out of range")
    color = rows.get("surface_color")
    _check(color is None or color.shape == (3, voxels), "surface_color")
    for row in range(0 if color is None else 3):
        color[row : row + 1]  # pyright: ignore[reportOptionalSubscript] # unpacked, so that damage is found
    check_ends(rows[name] for name in RUNS if name in rows)
    return tuple(_instance(one) for one in entries)


def _appearance(spec: GridSpec, data: Mapping[str, NDArray]) -> Appearance | None:
    """Return what a map's objects look like; None for a map without.

    Raises:
        KeyError, ValueError, InputError: some of its arrays are missing, or they do not fit together.
    """
    if not any(name in data for name in _SEEN):
        return None
    step, patch, rgb, pixels, vector, vectors, weight, word_vectors, model = (data[name] for name in _SEEN)
    if not (_within(step[:1], 0, None) and _within(step[1:], 1, None)):
        raise ValueError("seen_cell that does not ascend")
    cell = np.cumsum(step, dtype=np.int64)
    _check(_within(cell[-1:], 0, spec.rows * spec.cols - 1), "seen_cell out of range")
    _check(_within(patch, 0, len(rgb) - 1) and _within(pixels, 0, None), "seen_patch or seen_pixels out of range")
    _check(_within(vector, -1, len(vectors) - 1), "embedding_of out of range")
    finite = all(np.isfinite(part).all() for part in (vectors, word_vectors, weight))
    _check(bool(finite and (weight >= 0.0).all()), "embedding with numbers that are none")
    about = json.loads(str(model))
    words = about.get("words", [])
    _check(_are(words, str) and all(len(word) <= _MAX_NAME for word in words), "embedding_model")
    scaled = _is_number(about.get("scale")) and 0.0 < about["scale"] < 1e6
    _check(not len(vectors) or bool(words and scaled), "embedding_model")
    return Appearance(spec, cell.astype(np.int32), patch, rgb, pixels, vector, vectors, weight, word_vectors, about)


class _Lazy:
    """Makes a frozen dataclass of which some fields are computed when first asked for, then kept.

    Threads may share it: all get the same array. Copies and pickles are complete.
    """

    @classmethod
    def of(cls, compute: Mapping[str, Callable[[Any], Any]], **known: Any) -> Self:
        """Return an instance with some fields; ``compute`` makes each of the others from the instance.

        Nothing is checked: `__init__`, and with it `__post_init__`, is for `dataclasses.replace` alone.
        """
        made = cls.__new__(cls)
        vars(made).update(known, _compute=compute, _lock=threading.RLock())
        return made

    def __getattr__(self, name: str) -> Any:  # called only for what is not there yet
        known = vars(self)
        if name not in known.get("_compute", ()):
            raise AttributeError(f"{type(self).__name__} has no {name}")
        with known["_lock"]:
            if name not in known:
                known[name] = known["_compute"][name](self)
        return known[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), tuple(getattr(self, one.name) for one in fields(self))  # pyright: ignore[reportArgumentType]


class _LazyGrid(_Lazy, Grid):
    """A grid whose layers are unpacked when first asked for."""


class _LazyMap(_Lazy, SIMap):
    """A map whose communities and surface are unpacked when first asked for."""

    # The field has a default, which would hide it from `__getattr__`.
    surface = cached_property(lambda self: self.__getattr__("surface"))  # pyright: ignore[reportAssignmentType]

    @classmethod
    def of(cls, compute: Mapping[str, Callable[[Any], Any]], **known: Any) -> Self:
        """Return a map with some fields, its instances bound to it."""
        made = super().of(compute, **known)
        made._bind_instances()
        return made


class _LazyGraph(_Lazy, CellGraph):
    """A graph whose cells and edges are found when first asked for."""


def _graphs(
    grid: Grid, graph_label: NDArray, graph_edges: NDArray, rows: Mapping[str, Rows], *, evidence: bool
) -> tuple[CellGraph, ...]:
    """Return the graphs of a map file, whose edges are checked now.

    Raises:
        ValueError: an edge leaves the cells of its class or leads backwards, or a count is negative.
        InputError: a packed array is damaged.
    """
    ends = np.cumsum(graph_edges).tolist()
    spans = [slice(stop - edges, stop) for stop, edges in zip(ends, graph_edges.tolist(), strict=True)]
    labels = graph_label.tolist()
    for label, span in zip(labels, spans, strict=True):
        for block in _blocks(span):
            _check_edges(grid.label.reshape(-1), label, *(rows[name][block] for name in EDGES))
    check_ends(rows[name] for name in EDGES)
    return tuple(_graph(grid, label, span, rows, evidence=evidence) for label, span in zip(labels, spans, strict=True))


def _graph(grid: Grid, label: int, span: slice, rows: Mapping[str, Rows], *, evidence: bool) -> CellGraph:
    """Return the graph of a class; ``span`` is where its edges are in ``rows``."""

    def edges(graph: CellGraph) -> NDArray:
        found = np.zeros((span.stop - span.start, 2), dtype=np.int32)
        for block in _blocks(span):
            first = rows["edge_first"][block]
            here = found[block.start - span.start : block.stop - span.start]
            here[:, 0] = np.searchsorted(graph.cells, first)
            here[:, 1] = np.searchsorted(graph.cells, first + rows["edge_step"][block])
        return found

    return _LazyGraph.of(
        {
            "cells": lambda _: np.flatnonzero(grid.label.reshape(-1) == label),
            "seen": lambda graph: None if evidence else grid.observations.reshape(-1)[graph.cells],
            "edges": edges,
            "counts": lambda _: rows["edge_count"][span],
            "different": lambda _: rows["edge_different"][span],
        },
        label=label,
    )


def _edge_parts(graphs: Sequence[CellGraph], name: str) -> Iterator[NDArray]:
    """Yield one of `EDGES` of some graphs, part by part."""
    for graph in graphs:
        for block in _blocks(slice(0, len(graph.edges))):
            first, second = graph.edges[block].T
            if name == "edge_first":
                yield graph.cells[first]
            elif name == "edge_step":
                yield graph.cells[second] - graph.cells[first]  # small numbers pack well
            else:
                yield (graph.counts if name == "edge_count" else graph.different)[block]


def _instance(entry: Mapping[str, Any]) -> Instance:
    low, high = (tuple(float(v) for v in corner) for corner in entry["aabb_m"])
    return Instance(
        id=int(entry["id"]),
        label=str(entry["label"]),
        cells=int(entry["cells"]),
        centroid_m=tuple(float(v) for v in entry["centroid_m"]),  # pyright: ignore[reportArgumentType]
        aabb_m=(low, high),  # pyright: ignore[reportArgumentType]
        frames=int(entry["frames"]),
        score=float(entry["score"]),
    )


def check_metadata(meta: Mapping[str, Any]) -> None:
    """Raise ValueError, KeyError or TypeError for metadata that cannot be a map's."""
    labels, is_thing, frames = meta["labels"], meta["is_thing"], meta["frame_names"]
    _check(_are(labels, str) and labels[:1] == ["none"] and len(set(labels)) == len(labels), "labels")
    _check(len(labels) <= MAX_CLASSES, "more classes than a map has")
    _check(_are(is_thing, bool) and len(is_thing) == len(labels), "is_thing")
    _check(_are(frames, str) and len(frames) <= MAX_FRAMES, "frame names")
    names = [*labels, *frames, meta["method"]]
    _check(all(isinstance(n, str) and len(n) <= _MAX_NAME and n.isprintable() for n in names), "names")
    _check(isinstance(meta["parameters"], dict) and isinstance(meta["provenance"], dict), "parameters, provenance")
    _check_parameters(meta["method"], meta["parameters"])
    _check_provenance(meta["provenance"])
    low, high = _CELL_SIZE_M
    size, origin = meta["cell_size_m"], np.array(meta["origin_m"], dtype=np.float64)
    _check(isinstance(size, int | float) and low <= size <= high, "cell_size_m")
    _check(origin.shape == (2,) and bool((np.abs(origin) < MAX_CELL_INDEX * size).all()), "origin_m")
    T = np.array(meta["T_map_world"], dtype=np.float64)
    _check(T.shape == (4, 4) and bool(np.isfinite(T).all()), "T_map_world")


def _check_parameters(method: str, parameters: Mapping[str, Any]) -> None:
    """Check the parameters that are computed with; others may have any value."""
    for name, (low, high) in _PARAMETERS.items():
        value = parameters.get(name, low)
        _check(_is_number(value) and low <= value <= high, f"parameter {name}")
    _check(all(type(parameters.get(name, 0)) is int for name in ("seed", "min_cells")), "parameters")
    slider = method_of(method).slider
    _check(slider is None or slider.parameter in parameters, "parameters")
    pooling = parameters.get("pooling", {})
    _check(isinstance(pooling, dict) and set(pooling) <= {f.name for f in fields(PoolSettings)}, "parameter pooling")
    _check(all(_is_number(value) and 0 <= value <= 1e6 for value in pooling.values()), "parameter pooling")


def _check_provenance(provenance: Mapping[str, Any]) -> None:
    words = [provenance.get(name) for name in ("sequence", "segmentation", "name")]
    _check(all(word is None or (isinstance(word, str) and word.isprintable()) for word in words), "provenance")
    edits, skipped = provenance.get("edits", []), provenance.get("skipped", {})
    _check(isinstance(edits, list) and all(isinstance(one, dict) for one in edits), "provenance: edits")
    _check(all(_are(one.get("instances", []), int) for one in edits), "provenance: edits")
    _check(isinstance(skipped, dict) and type(skipped.get("frames", 0)) is int, "provenance: skipped")


def check_arrays(meta: Mapping[str, Any], data: Mapping[str, NDArray], rows: Mapping[str, Rows]) -> None:
    """Raise ValueError for arrays that do not fit the metadata and each other.

    Args:
        meta: the metadata.
        data: the arrays that are not in `PACKED`.
        rows: those in `PACKED`; the values of `EDGES` are checked later, class by class (`_graphs`).
    """
    frames, classes = len(meta["frame_names"]), len(meta["labels"])
    cameras = data["T_map_camera"]
    _check(cameras.shape == (frames, 4, 4) and bool(np.isfinite(cameras).all()), "T_map_camera")
    _check(_within(data["label"], 0, classes - 1), "label out of range")
    _check(_within(data["instance"], 0, data["instance"].size + _SPARE_IDS), "instance out of range")
    highest = _check_layers(rows, data["label"].shape)
    for name in ("merge_source", "merge_target", "view_community"):
        _check(_within(data[name], 1, highest), f"{name} out of range")
    _check(_within(data["merge_label"], 0, classes - 1), "merge_label out of range")
    _check_merges(data["merge_source"], data["merge_target"], highest)
    _check(_within(data["view_frame"], 0, frames - 1), "view_frame out of range")
    _check(_within(data["view_cells"], 0, None) and _within(data["view_segment"], 0, None), "views")
    for kind, arrays in (("merge_", data), ("view_", data), ("edge_", rows)):
        sizes = {len(array) for name, array in arrays.items() if name.startswith(kind)}
        _check(len(sizes) == 1, f"{kind} arrays of different lengths")
    _check(bool(np.isfinite(data["merge_score"]).all() and np.isfinite(data["view_score"]).all()), "scores")
    edges = data["graph_edges"]
    _check(_within(edges, 0, len(rows["edge_first"])) and int(edges.sum()) == len(rows["edge_first"]), "graph_edges")
    _check(_within(data["graph_label"], 0, classes - 1), "graph_label out of range")
    _check(len(set(data["graph_label"].tolist())) == len(data["graph_label"]), "a class with two graphs")


def _check_layers(rows: Mapping[str, Rows], shape: tuple[int, ...]) -> int:
    """Return the highest community; raise ValueError for a layer with numbers that it cannot have."""
    highest = 0
    for block in row_blocks(shape):
        _check(_within(rows["observations"][block], 0, None), "observations")
        _check(
            not _infinite(rows["height"][block]) and not _infinite(rows["lowest"][block]), "heights that are infinite"
        )
        community = rows["community"][block]
        highest = max(highest, int(community.max(initial=0)))
        _check(_within(community, 0, math.prod(shape) + _SPARE_IDS), "community out of range")
    check_ends(rows[name] for name in ("observations", "height", "lowest", "community"))
    return highest


def _check_merges(source: NDArray, target: NDArray, highest: int) -> None:
    """Raise ValueError where a community that was merged into another one takes part in a later merge."""
    step = np.arange(len(source))
    gone = np.full(highest + 1, len(source))
    gone[source] = step
    once = (gone[source] == step).all() and (gone[target] > step).all()
    _check(bool(once), "a merge of a community that was merged before")


def check_instances(meta: Mapping[str, Any], instance: NDArray, label: NDArray) -> None:
    """Check instances against the grid.

    Each instance on the grid must be described once, with finite numbers, and its cells must be of its class.

    Raises:
        ValueError, KeyError, TypeError: this is not so.
    """
    ids = [entry["id"] for entry in meta["instances"]]
    _check(_are(ids, int) and all(0 < i < 1 << 31 for i in ids) and len(set(ids)) == len(ids), "instance ids")
    seen = np.zeros(int(instance.max(initial=0)) + 1, dtype=np.bool_)
    for block in row_blocks(instance.shape):
        seen[instance[block]] = True
    here = np.flatnonzero(seen).tolist()
    _check(set(here) - {0} == set(ids), "instances that are not those on the grid")
    class_of = np.full(len(seen), -1, dtype=np.int32)
    for entry in meta["instances"]:
        _check(entry["label"] in meta["labels"], "an instance of an unknown class")
        class_of[entry["id"]] = meta["labels"].index(entry["label"])
        _check_numbers(entry)
    for block in row_blocks(instance.shape):
        named = instance[block] > 0
        same = class_of[instance[block][named]] == label[block][named]
        _check(bool(same.all()), "an instance with cells of another class")


def _check_numbers(entry: Mapping[str, Any]) -> None:
    numbers = [*entry["centroid_m"], *entry["aabb_m"][0], *entry["aabb_m"][1], entry["score"]]
    _check(len(numbers) == 10 and bool(np.isfinite(np.array(numbers, dtype=np.float64)).all()), "an instance")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are(values: Any, kind: type) -> bool:
    return isinstance(values, list) and all(type(value) is kind for value in values)


def _within(values: NDArray, low: int, high: int | None) -> bool:
    if not values.size:
        return True
    return low <= int(values.min()) and (high is None or int(values.max()) <= high)


def _infinite(heights: NDArray) -> bool:
    """Return whether a number is infinite; NaN is not."""
    ends = [ufunc.reduce(heights, axis=None, initial=np.float32(0)) for ufunc in (np.fmin, np.fmax)]
    return bool(np.isinf(ends).any())


def _check(fine: bool, what: str) -> None:
    if not fine:
        raise ValueError(what)


def _check_edges(
    of_cell: NDArray, label: int, first: NDArray, step: NDArray, counts: NDArray, different: NDArray
) -> None:
    second = first.astype(np.int64) + step
    if int(step.min()) <= 0:
        raise ValueError(f"edges of class {label} that lead backwards")
    inside = int(first.min()) >= 0 and int(second.max()) < len(of_cell)
    if not inside or (of_cell[first] != label).any() or (of_cell[second] != label).any():
        raise ValueError(f"edges of class {label} leave its cells")
    if int(counts.min()) < 0 or int(different.min()) < 0:
        raise ValueError("edge counts")


def _blocks(span: slice) -> list[slice]:
    return [slice(at, min(at + _EDGES_AT_ONCE, span.stop)) for at in range(span.start, span.stop, _EDGES_AT_ONCE)]
