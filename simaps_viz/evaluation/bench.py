"""How much time building costs, always as a ratio to something measured in the same run."""

import statistics
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from simaps_viz.datasets.posed_frames import PosedFrames
from simaps_viz.datasets.source import read_ahead
from simaps_viz.mapping.mapfile import save_map
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.pipeline import BuildConfig, build_map, empty_accumulator, graphs_so_far
from simaps_viz.structures import SIMap


@dataclass(frozen=True)
class Cost:
    """What a piece of work took, over several runs."""

    wall_s: tuple[float, ...]
    cpu_s: tuple[float, ...]
    """Of all threads of this process."""

    @property
    def wall(self) -> float:
        """Median wall-clock time, seconds."""
        return statistics.median(self.wall_s)

    @property
    def cpu(self) -> float:
        """Median processor time, seconds."""
        return statistics.median(self.cpu_s)


def measure(works: dict[str, Callable[[], object]], *, runs: int) -> dict[str, Cost]:
    """Run each piece of work once to warm up, then all of them in turn, so that a busy moment hits them alike."""
    wall: dict[str, list[float]] = {name: [] for name in works}
    cpu: dict[str, list[float]] = {name: [] for name in works}
    for run in range(runs + 1):
        for name, work in works.items():
            wall_start, cpu_start = time.perf_counter(), time.process_time()
            work()
            if run:
                wall[name].append(time.perf_counter() - wall_start)
                cpu[name].append(time.process_time() - cpu_start)
    return {name: Cost(tuple(wall[name]), tuple(cpu[name])) for name in works}


def decode_only(files: list[Path]) -> None:
    """Decode images and throw them away, on two threads as a build does."""
    with ThreadPoolExecutor(max_workers=2) as pool:
        for image in pool.map(lambda path: cv2.imread(str(path), cv2.IMREAD_UNCHANGED), files):
            if image is None:
                raise OSError("an image that was readable before is not any more")


def image_files(sequence: PosedFrames) -> list[Path]:
    """Give the images a build without observers decodes: depth and segment ids of every frame."""
    manifest, folder = sequence.manifest, sequence.path.parent
    if manifest.segmentation is None:
        return []
    patterns = (manifest.depth, manifest.segmentation.ids)
    return [folder / pattern.replace("{frame}", name) for name in sequence.frame_names for pattern in patterns]


def bench_build(sequence: PosedFrames, *, runs: int = 5) -> Iterator[str]:
    """Compare building with decoding, and time what the K slider asks of the server."""
    files = image_files(sequence)
    config = BuildConfig()

    def read() -> None:
        for _ in read_ahead(sequence, color=False):
            pass

    def gather() -> None:
        accumulator = empty_accumulator(sequence, config)
        T_map_camera = sequence.T_map_world @ sequence.poses
        for frame, segmentation in read_ahead(sequence, color=False):
            accumulator.add_frame(frame, segmentation, T_map_camera[frame.index])
        graphs_so_far(accumulator)

    works = {"decode": lambda: decode_only(files), "read": read, "gather": gather}
    costs = measure({**works, "build": lambda: build_map(sequence, config)}, runs=runs)
    decode = costs["decode"]
    yield f"{sequence.name}: {len(sequence)} frames, {len(files)} images; medians of {runs} runs in turn"
    stages = {"read": "reading and checking", "gather": "reading, projecting, graph", "build": "the whole map"}
    for name, words in stages.items():
        cost = costs[name]
        yield f"  {words:<28} {cost.wall / decode.wall:5.2f} x decoding (wall), {cost.cpu / decode.cpu:5.2f} x (CPU)"
    per_frame = 1000 * costs["build"].wall / len(sequence)
    yield f"  the whole map                {per_frame:5.2f} ms a frame here and now"


def bench_sliders(simap: SIMap, *, paint: Callable[[SIMap], object], scratch: Path) -> Iterator[str]:
    """Time every K and several resolutions on a built map, and weigh its memory and its file.

    Args:
        simap: the map.
        paint: what the page does with a new partition: its picture, encoded.
        scratch: a folder for a map file.
    """
    paint(simap)
    slowest = max(_timed(lambda k=k: paint(repartition(simap, k_percent=k))) for k in np.linspace(0, 100, 101))
    classes = len(simap.graphs)
    yield f"  any K, picture included      {1000 * slowest:5.1f} ms for the slowest of 101 values ({classes} classes)"
    slowest = max(_timed(lambda r=r: recommunity(simap, resolution=r)) for r in (0.2, 0.5, 1.0, 2.0, 5.0))
    yield f"  any resolution               {1000 * slowest:5.1f} ms for the slowest of 5 values"
    per_cell = simap.grid.label.itemsize + simap.instance.itemsize
    yield f"  label + instance             {per_cell} bytes a cell: {per_cell * 1e6 / 2**20:.1f} MiB a million cells"
    path = scratch / "bench.npz"
    save_map(simap, path)
    yield f"  map file                     {path.stat().st_size / 2**20:.2f} MiB, everything included"


def _timed(work: Callable[[], object]) -> float:
    """Best of three, seconds: a neighbour on this machine should not count as our cost."""
    best = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best
