"""Whether what a map file holds fits together, so that nothing later meets an index that leads nowhere."""

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simaps_viz.arrays import Rows, check_ends
from simaps_viz.limits import MAX_CELL_INDEX, MAX_CLASSES, MAX_FRAMES
from simaps_viz.mapping.bands import bands
from simaps_viz.mapping.pooling import PoolSettings
from simaps_viz.mapping.simap import JOINING

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
    """Tell whether a number is infinite; NaN is not."""
    ends = [ufunc.reduce(heights, axis=None, initial=np.float32(0)) for ufunc in (np.fmin, np.fmax)]
    return bool(np.isinf(ends).any())


def _check(fine: bool, what: str) -> None:
    if not fine:
        raise ValueError(what)
