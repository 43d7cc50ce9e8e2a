"""How many points a second go onto the map, beside VLMaps' loop over single points; and what a map takes in memory."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.point_loop import vlmaps_point_loop
from benchmarks.timing import measure, times
from numpy.typing import NDArray

from simaps_viz.baselines.vlmaps import EmbeddingStore, PixelEmbeddings, SimulatedLSeg, cell_points, dense_bytes
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.datasets.source import FrameSource
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.finalize import empty_accumulator
from simaps_viz.structures import Frame, Segmentation, SIMap

REQUIRED = 500
"""Ours takes at least this many times as many points a second as the loop."""
Posed = tuple[Frame, Segmentation, NDArray]
"""A frame, its segmentation, T_map_camera."""


def bench_points(sequence: FrameSource, *, frames: int = 20, looped: int = 1, runs: int = 3) -> Iterator[str]:
    """Compare points a second: ours on all pixels, the loop on all pixels of some of the same frames.

    All of them get decoded frames, and the loops embeddings, so that nobody's clock counts decoding or an encoder.

    Args:
        sequence: where the frames come from, spread evenly over it.
        frames: how many frames ours takes, one after the other on one thread.
        looped: how many of them the loop takes; it is slow.
        runs: of each.
    """
    chosen = np.linspace(0, len(sequence) - 1, frames).astype(int).tolist()
    T_map_camera = sequence.T_map_world @ sequence.poses
    posed = [(sequence.read(i), sequence.segmentation(i), T_map_camera[i]) for i in chosen]
    few = posed[min(len(posed) // 2, max(len(posed) - looped, 0)) :][:looped]
    encoder = SimulatedLSeg(sequence.labels)
    embedded = [(frame, encoder.pixels(frame, segmentation), T) for frame, segmentation, T in few]
    settings = ProjectionSettings()
    works: dict[str, Callable[[], object]] = {
        "loop": lambda: vlmaps_point_loop(embedded, settings, stride=1),
        "means": lambda: _compiled_means(embedded, encoder.dimension, settings),
        "evidence": lambda: _project(sequence, BuildConfig(), posed),
        "paper": lambda: _project(sequence, BuildConfig(method="paper"), posed),
    }
    _project(sequence, BuildConfig(method="paper"), few)  # compiles the kernels
    _compiled_means(embedded, encoder.dimension, settings)
    costs = measure(works, runs=runs, warm=False)
    points = {"loop": _points(few, settings), "evidence": _points(posed, settings)}
    points |= {"means": points["loop"], "paper": points["evidence"]}
    rate = {name: points[name] / costs[name].wall for name in works}
    yield f"Points a second, {sequence.name}: every pixel with a depth on the map, one thread; medians of {runs} runs"
    for method in ("evidence", "paper"):
        yield (
            f"  {times(rate[method] / rate['loop']):>8}  ours, {method} (required: {REQUIRED} x): "
            f"{rate[method] / 1e6:.1f} million a second, {points[method]:,} points of {len(posed)} frames"
        )
    yield (
        f"  {times(rate['means'] / rate['loop']):>8}  VLMaps' means of 512 numbers, compiled by us: "
        f"{rate['means'] / 1e6:.2f} million a second"
    )
    yield (
        f"  {times(1.0):>8}  VLMaps' loop over single points, our own re-implementation in Python: "
        f"{rate['loop']:,.0f} a second, {points['loop']:,} points of {len(few)} of these frames"
    )


def _project(sequence: FrameSource, config: BuildConfig, posed: Sequence[Posed]) -> MapAccumulator:
    accumulator = empty_accumulator(sequence, config)
    for number, (frame, segmentation, T_map_camera) in enumerate(posed):
        renumbered = Frame(number, frame.name, frame.depth_m, frame.T_world_camera, frame.intrinsics)
        accumulator.add_frame(renumbered, segmentation, T_map_camera)
    return accumulator


def _compiled_means(
    embedded: Sequence[tuple[Frame, PixelEmbeddings, NDArray]], dimension: int, settings: ProjectionSettings
) -> EmbeddingStore:
    store = EmbeddingStore(dimension)
    for frame, embeddings, T_map_camera in embedded:
        points = cell_points(frame, embeddings, T_map_camera, settings, stride=1, weighting="uniform")
        store.add(points, embeddings.table)
    return store


def _points(posed: Sequence[Posed], settings: ProjectionSettings) -> int:
    """Count the pixels that fall on the map."""
    total = 0
    for frame, _, T_map_camera in posed:
        everywhere = PixelEmbeddings(np.zeros((1, 1), np.float32), np.zeros(frame.depth_m.shape, np.int32))
        total += len(cell_points(frame, everywhere, T_map_camera, settings, stride=1, weighting="uniform").rows)
    return total


def bench_memory(simap: SIMap, *, scratch: Path, side_cells: int = 1000) -> Iterator[str]:
    """Weigh a large map beside VLMaps' and the paper's, and a real one as it is held and as its file is.

    Args:
        simap: a real map.
        scratch: a folder for its file.
        side_cells: rows and columns of the large map.
    """
    cells = side_cells * side_cells
    per_cell = simap.grid.label.itemsize + simap.instance.itemsize
    ours, dense, two_int64 = cells * per_cell, dense_bytes(side_cells, side_cells), cells * 2 * np.dtype("i8").itemsize
    yield f"Memory, {side_cells} x {side_cells} cells, label and instance (MB = 10^6 bytes)"
    yield f"  {times(1.0):>8}  ours: {per_cell} bytes a cell, {ours / 1e6:.1f} MB"
    yield f"  {times(two_int64 / ours):>8}  the paper's: two int64 a cell, {two_int64 / 1e6:.1f} MB"
    yield f"  {times(dense / ours):>8}  VLMaps' dense store: 512 float32 a cell, {dense / 1e6:,.0f} MB"
    path = scratch / "bench.npz"
    save_map(simap, path)
    area = simap.spec.rows * simap.spec.cols
    name, bytes_of_file = simap.provenance.get("name", "a map"), path.stat().st_size
    yield (
        f"  {name}, {simap.method}, {simap.spec.rows} x {simap.spec.cols} cells: file {bytes_of_file / 1e6:.2f} MB "
        f"({bytes_of_file / area:.1f} bytes a cell), everything included"
    )
    yield (
        f"  the same in memory: label and instance {area * per_cell / 1e6:.2f} MB, "
        f"with heights, evidence, views and merge log {held_bytes(simap) / 1e6:.2f} MB"
    )


def held_bytes(thing: Any) -> int:
    """Sum up the bytes of all arrays of a structure and of the structures in it."""
    if isinstance(thing, np.ndarray):
        return thing.nbytes
    if isinstance(thing, (tuple, list)):
        return sum(held_bytes(one) for one in thing)
    if is_dataclass(thing):
        return sum(held_bytes(getattr(thing, field.name)) for field in fields(thing))
    return 0
