"""The map file, ``simap/1``: one .npz without pickles, written whole or not at all."""

import json
import os
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.arrays import Check, PackedArray, Rows, read_npz, write_rows
from simaps_viz.errors import InputError
from simaps_viz.files import write_whole
from simaps_viz.limits import MAX_ARRAY_BYTES, MAX_FRAMES, MAX_JSON_BYTES, check_cells
from simaps_viz.mapping.map_contents import check_arrays, check_instances, check_metadata
from simaps_viz.mapping.stored_graphs import EDGES, edge_parts, stored_graphs
from simaps_viz.mapping.stored_layers import LAYERS, StoredGrid, StoredMap
from simaps_viz.structures import GridSpec, Instance, MergeLog, SIMap, Views

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
PACKED = (*LAYERS, *EDGES)
"""Those that stay packed until somebody asks for them."""


def check_writable(path: Path) -> None:
    """Raise InputError, naming the path, unless a map file can be written there; leaves nothing behind."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: expected a file name for the map, found a folder")
    try:
        # as long as the longest name that a build gives to files of this map
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".building", dir=path.parent)
    except OSError as error:
        raise InputError(f"{path}: expected a place that can be written, found: {error.strerror or error}") from error
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
    """Write what `numpy.savez_compressed` writes, byte for byte, one array after the other and edges in parts."""
    arrays, edges = _arrays(simap), sum(len(graph.edges) for graph in simap.graphs)
    with zipfile.ZipFile(file, "w", compression=zipfile.ZIP_DEFLATED) as archive:
        for name in ("metadata", *_ARRAYS):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                if name == "metadata":
                    np.lib.format.write_array(member, np.array(json.dumps(_metadata(simap))), allow_pickle=False)
                elif name in EDGES:
                    write_rows(member, np.dtype(_ARRAYS[name][0]), edges, edge_parts(simap.graphs, name))
                else:
                    array = np.asarray(arrays[name], dtype=_ARRAYS[name][0])
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
    """Give all arrays but those of the edges."""
    grid, views, log = simap.grid, simap.views, simap.merges
    return {
        "label": grid.label, "instance": simap.instance, "height": grid.height_m, "lowest": grid.lowest_m,
        "observations": grid.observations, "community": simap.community, "T_map_camera": simap.T_map_camera,
        "merge_label": log.label, "merge_source": log.source, "merge_target": log.target, "merge_score": log.score,
        "graph_label": [g.label for g in simap.graphs], "graph_edges": [len(g.edges) for g in simap.graphs],
        "view_community": views.community, "view_frame": views.frame, "view_segment": views.segment,
        "view_cells": views.cells, "view_score": views.score,
    }  # fmt: skip


def load_map(path: Path) -> SIMap:
    """Read a map file.

    Raises:
        InputError: it is missing, damaged, or not a ``simap/1`` file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a map file ({FORMAT}), found {'a folder' if path.is_dir() else 'nothing'}")
    checks = {name: _check_of(path, name) for name in ("metadata", *_ARRAYS)}
    return map_in(path, *read_npz(path, checks, what=f"{FORMAT} file", packed=PACKED))


def map_in(path: Path, data: Mapping[str, NDArray], packed: Mapping[str, PackedArray] | None = None) -> SIMap:
    """Make the map of a file's arrays; raises InputError, naming the file, when they do not fit together.

    Args:
        path: of the file.
        data: its arrays.
        packed: those of `PACKED` that are not in ``data``.
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
    """Give what an array of that name is checked for before it is read."""

    def check(shape: tuple[int, ...], dtype: np.dtype) -> None:
        wanted, axes = _ARRAYS.get(name, (np.str_, 0))
        if len(shape) != axes or (dtype.kind != "U" if name == "metadata" else dtype != wanted):
            kind = f"{np.dtype(wanted).name} with {axes} axes"
            raise InputError(f"{path}: {name}: expected {kind}, found {dtype} {list(shape)}")
        if axes == 2:
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
    grid = StoredGrid.of(
        {"height_m": packed["height"], "lowest_m": packed["lowest"], "observations": packed["observations"]},
        spec=GridSpec(rows, cols, float(meta["cell_size_m"]), float(x0), float(y0)),
        labels=tuple(meta["labels"]),
        is_thing=tuple(meta["is_thing"]),
        label=data["label"],
    )
    return StoredMap.of(
        {"community": packed["community"]},
        grid=grid,
        instance=data["instance"],
        instances=tuple(_instance(entry) for entry in meta["instances"]),
        T_map_world=np.array(meta["T_map_world"], dtype=np.float64).reshape(4, 4),
        method=str(meta["method"]),
        parameters=meta["parameters"],
        provenance=meta["provenance"],
        merges=MergeLog(data["merge_label"], data["merge_source"], data["merge_target"], data["merge_score"]),
        graphs=stored_graphs(
            grid, data["graph_label"], data["graph_edges"], packed, evidence=meta["method"] == "evidence"
        ),
        views=Views(
            data["view_community"], data["view_frame"], data["view_segment"], data["view_cells"], data["view_score"]
        ),
        frame_names=tuple(meta["frame_names"]),
        T_map_camera=data["T_map_camera"].reshape(-1, 4, 4),
    )


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
