"""What building a map costs, beside decoding the same images on the same two threads."""

import statistics
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import cv2
from benchmarks.timing import Cost, measure

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.build.seen_colors import with_colors
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource, read_ahead
from simaps_viz.events import Event
from simaps_viz.mapping import accumulator, finalize
from simaps_viz.mapping.evidence import EVIDENCE
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.methods import method_of
from simaps_viz.structures import CellGraph

METHODS: tuple[str, ...] = ("evidence", "paper")
REQUIRED = 2.0
"""A map may cost this many times as much as decoding its images."""


SPACE_MS, SPACE_BYTES = 2.0, 1.5
"""Milliseconds that all heights may add to a frame of 640 x 480, and how many times as large the file may be."""
_NO_STEP = 1 << 20
"""Above all pixels: columns that begin there are empty."""


class Watcher:
    """Asks for colour and looks at nothing: what a build costs as soon as somebody watches it."""

    wants_color = True

    def on_event(self, event: Event) -> None:
        """Take an event and leave it."""


def image_files(sequence: PosedFrames, *, color: bool = False) -> list[Path]:
    """Return the images a build decodes: depth and segment ids of every frame, and colour when somebody watches."""
    segments = sequence.recording.segments
    if segments is None or segments.stored is None:
        return []
    files = []
    for index in range(len(sequence)):
        color_file, depth_file = sequence.files(index)
        files += [depth_file, segments.stored(index)] + ([color_file] if color else [])
    return files


def decode_only(files: list[Path]) -> None:
    """Decode images and throw them away, on two threads as a build does.

    Raises:
        OSError: an image cannot be decoded.
    """
    with ThreadPoolExecutor(max_workers=2) as pool:
        for image in pool.map(lambda path: cv2.imread(str(path), cv2.IMREAD_UNCHANGED), files):
            if image is None:
                raise OSError("an image that was readable before is not any more")


def read_only(sequence: FrameSource) -> None:
    """Read and check depth and segments of every frame, and throw them away."""
    for _ in read_ahead(sequence, color=False):
        pass


def gather(sequence: FrameSource, config: BuildConfig) -> tuple[CellGraph, ...]:
    """Do everything a build does up to, but without, looking for communities; give the graphs they are found in."""
    accumulator = finalize.empty_accumulator(sequence, config)
    T_map_camera = sequence.T_map_world @ sequence.poses
    for frame, segmentation in read_ahead(sequence, color=False):
        accumulator.add_frame(frame, segmentation, T_map_camera[frame.index])
    method, seen = method_of(config.method), finalize.gathered(accumulator)
    grid, _ = method.label_cells(seen.grid, seen.readings, config)
    return method.graphs(grid, seen, config)


@contextmanager
def _tops_only() -> Iterator[None]:
    """Let method evidence look at the top of each cell only, in frames and at the end."""
    with patch.object(EVIDENCE, "layered", new=False), patch.object(accumulator, "first_step", lambda _: _NO_STEP):
        yield


def _build_file(sequence: FrameSource, path: Path) -> None:
    """Do all that `simaps build` does."""
    log = path.with_suffix(".log")
    log.unlink(missing_ok=True)
    save_map(with_colors(build_map(sequence, log=log), sequence), path)


def bench_surface(sequence: PosedFrames, *, runs: int = 5) -> Iterator[str]:
    """Compare building, colouring and saving a map of all heights with one of the top of each cell."""
    with tempfile.TemporaryDirectory() as folder:
        space, tops = Path(folder) / "space.npz", Path(folder) / "tops.npz"
        works: dict[str, Callable[[], object]] = {
            "space": lambda: _build_file(sequence, space),
            "tops": _tops_only()(lambda: _build_file(sequence, tops)),
        }
        costs = measure(works, runs=runs)
        times_larger = space.stat().st_size / tops.stat().st_size
    more = [1000 * (a - b) / len(sequence) for a, b in zip(costs["space"].cpu_s, costs["tops"].cpu_s, strict=True)]
    yield (
        f"  evidence, all heights instead of tops of cells: {statistics.median(more):.2f} ms of processor time more "
        f"a frame, with colours and saving; required: {SPACE_MS:g} ms at 640 x 480"
    )
    yield f"  its map file: {times_larger:.2f} x as large; required: {SPACE_BYTES:g} x"


def bench_build(sequence: PosedFrames, *, runs: int = 5) -> Iterator[str]:
    """Compare building with decoding, stage by stage, for both methods."""
    plain, colored = image_files(sequence), image_files(sequence, color=True)
    works: dict[str, Callable[[], object]] = {
        "decode": lambda: decode_only(plain),
        "read": lambda: read_only(sequence),
        "decode, colour too": lambda: decode_only(colored),
    }
    for method in METHODS:
        config = BuildConfig(method=method)
        works[f"gather, {method}"] = lambda config=config: gather(sequence, config)
        works[f"build, {method}"] = lambda config=config: build_map(sequence, config)
    works["build, watched"] = lambda: build_map(sequence, observers=[Watcher()])
    decode_only(colored)  # from now on the files are in memory
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        works["build, logged"] = lambda: (log.unlink(missing_ok=True), build_map(sequence, log=log))
        costs = measure(works, runs=runs, warm=False)
        log_mb = log.stat().st_size / 1e6
    decode, frames = costs["decode"], len(sequence)
    yield f"{sequence.name}: {frames} frames; medians of {runs} runs in turn; required: at most {REQUIRED:g} x"
    yield f"  decoding depth and ids, 1.00 x = {1000 * decode.wall / frames:.2f} ms a frame on two threads"
    yield _against(decode, costs["read"], "reading and checking them")
    for method in METHODS:
        stage = "reading, projecting, votes, evidence" if method == "evidence" else "reading, projecting, cell graphs"
        yield _against(decode, costs[f"gather, {method}"], f"{method}: {stage}")
        build = costs[f"build, {method}"]
        yield f"{_against(decode, build, f'{method}: the whole map')}, {1000 * build.wall / frames:.2f} ms a frame"
    watched = "evidence, watched (all three images decoded)"
    yield f"{_against(costs['decode, colour too'], costs['build, watched'], watched)}, against all three decoded"
    logged = f"evidence with its build log ({log_mb:.1f} MB)"
    yield f"{_against(costs['build, evidence'], costs['build, logged'], logged)}, against without; required: 1.05 x"


def _against(decode: Cost, cost: Cost, words: str) -> str:
    return f"  {cost.wall / decode.wall:5.2f} x wall {cost.cpu / decode.cpu:5.2f} x CPU   {words}"
