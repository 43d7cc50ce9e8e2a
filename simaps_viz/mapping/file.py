"""The map file, ``simap/1``: one .npz without pickles, written whole or not at all."""

import json
import math
import os
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simaps_viz.errors import InputError
from simaps_viz.io.arrays import Check, PackedArray, Rows, check_ends, read_npz, write_rows
from simaps_viz.io.files import write_whole
from simaps_viz.io.limits import MAX_ARRAY_BYTES, MAX_CELL_INDEX, MAX_CLASSES, MAX_FRAMES, MAX_JSON_BYTES, check_cells
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.row_blocks import bands
from simaps_viz.mapping.simap import JOINING
from simaps_viz.mapping.stored_layers import EDGES, LAYERS, StoredGrid, StoredMap, edge_parts, stored_graphs
from simaps_viz.structures import GridSpec, Instance, MergeLog, SIMap, Views

_CELL_SIZE_M = (1e-4, 100.0)
_LONGEST_NAME = 1000
_PARAMETERS = {
    "k_percent": (0.0, 100.0), "affinity": (0.0, 1.0), "resolution": (1e-9, 1e9), "seed": (0, (1 << 32) - 1),
    "min_cells": (0, 1 << 31), "cut_height_m": (-1e6, 1e6),
}  # fmt: skip
"""Those that are computed with again, and their ranges."""
_SPARE_IDS = 1_000_000
"""Ids count up from the number of communities, which are fewer than cells, with every edit."""


def check_metadata(meta: Mapping[str, Any]) -> None:
    """Raise ValueError, KeyError or TypeError for metadata that cannot be a map's."""
    labels, is_thing, frames = meta["labels"], meta["is_thing"], meta["frame_names"]
    _check(_are(labels, str) and labels[:1] == ["none"] and len(set(labels)) == len(labels), "labels")
    _check(len(labels) <= MAX_CLASSES, "more classes than a map has")
    _check(_are(is_thing, bool) and len(is_thing) == len(labels), "is_thing")
    _check(_are(frames, str) and len(frames) <= MAX_FRAMES, "frame names")
    names = [*labels, *frames, meta["method"]]
    _check(all(isinstance(n, str) and len(n) <= _LONGEST_NAME and n.isprintable() for n in names), "names")
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
    """Check what is read of the parameters; what else there is may be anything."""
    for name, (low, high) in _PARAMETERS.items():
        value = parameters.get(name, low)
        _check(_is_number(value) and low <= value <= high, f"parameter {name}")
    _check(all(type(parameters.get(name, 0)) is int for name in ("seed", "min_cells")), "parameters")
    _check(JOINING.get(method, "seed") in {*parameters, "seed"}, "parameters")
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
        data: the arrays.
        rows: those that may be packed; what is in those of the edges is checked with the graphs.
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
    """Raise ValueError for a layer with numbers it cannot have; give the highest community."""
    highest = 0
    for band in bands(shape):
        _check(_within(rows["observations"][band], 0, None), "observations")
        _check(not _infinite(rows["height"][band]) and not _infinite(rows["lowest"][band]), "heights that are infinite")
        community = rows["community"][band]
        highest = max(highest, int(community.max(initial=0)))
        _check(_within(community, 0, math.prod(shape) + _SPARE_IDS), "community out of range")
    check_ends(rows[name] for name in ("observations", "height", "lowest", "community"))
    return highest


def _check_merges(source: NDArray, target: NDArray, highest: int) -> None:
    """Raise ValueError unless a community that was merged into another one is never met again."""
    step = np.arange(len(source))
    gone = np.full(highest + 1, len(source))
    gone[source] = step
    _check(bool((gone[source] == step).all() and (gone[target] > step).all()), "a merge of what is no more")


def check_instances(meta: Mapping[str, Any], instance: NDArray, label: NDArray) -> None:
    """Raise ValueError, KeyError or TypeError unless every instance on the grid is told, once, with finite numbers.

    Its cells are of its class.
    """
    ids = [entry["id"] for entry in meta["instances"]]
    _check(_are(ids, int) and all(0 < i < 1 << 31 for i in ids) and len(set(ids)) == len(ids), "instance ids")
    seen = np.zeros(int(instance.max(initial=0)) + 1, dtype=np.bool_)
    for band in bands(instance.shape):
        seen[instance[band]] = True
    here = np.flatnonzero(seen).tolist()
    _check(set(here) - {0} == set(ids), "instances that are not those on the grid")
    class_of = np.full(len(seen), -1, dtype=np.int32)
    for entry in meta["instances"]:
        _check(entry["label"] in meta["labels"], "an instance of an unknown class")
        class_of[entry["id"]] = meta["labels"].index(entry["label"])
        numbers = [*entry["centroid_m"], *entry["aabb_m"][0], *entry["aabb_m"][1], entry["score"]]
        _check(len(numbers) == 10 and bool(np.isfinite(np.array(numbers, dtype=np.float64)).all()), "an instance")
    for band in bands(instance.shape):
        named = instance[band] > 0
        same = class_of[instance[band][named]] == label[band][named]
        _check(bool(same.all()), "an instance with cells of another class")


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
    """Return what an array of that name is checked for before it is read."""

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
