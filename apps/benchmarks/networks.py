"""What everything around a segmentation network adds to the time the network itself takes."""

import shutil
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from benchmarks.masks import agreement, map_agreement
from benchmarks.timing import Cost, measure

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.datasets.floors import SomeFrames
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource, OtherMasks
from simaps_viz.evaluation.evaluate import masks_source
from simaps_viz.evaluation.quality import MIN_CELLS, score
from simaps_viz.evaluation.truth import exact_of, truth_of
from simaps_viz.geometry import turned, turned_pose
from simaps_viz.segmentation.chosen_frames import AUTO, choose_frames, config_for
from simaps_viz.segmentation.protocol import Network
from simaps_viz.segmentation.recognise import NetworkSettings, open_network
from simaps_viz.segmentation.sequences import WithMasks, segment_sequence
from simaps_viz.structures import Frame, Segmentation

REQUIRED = 1.15
"""Segmenting and mapping may take this many times as long as the network alone."""


class Every(SomeFrames):
    """Every n-th frame of a sequence, with all of a `PosedFrames` that segmenting it takes."""

    def __init__(self, sequence: PosedFrames, frames: int) -> None:
        super().__init__(sequence, range(0, len(sequence), max(1, len(sequence) // frames))[:frames])
        self._whole, self.intrinsics = sequence, sequence.intrinsics

    def color_file(self, index: int) -> Path | None:
        """Return the file of a frame's colour image."""
        return self._whole.color_file(self.indices[index])

    def files(self, index: int) -> tuple[Path, Path]:
        """Return the files of a frame's colour and depth."""
        return self._whole.files(self.indices[index])


class Turned(Every):
    """The same frames as a camera would have taken them that was held turned: pictures, cameras and poses."""

    def __init__(self, sequence: PosedFrames, frames: int, turns: int) -> None:
        """Turn every n-th frame by quarter turns counter-clockwise."""
        super().__init__(sequence, frames)
        self._turns = turns
        self.poses = np.stack([turned_pose(pose, turns) for pose in self.poses])
        self.intrinsics = self.intrinsics.turned(turns)

    def color_file(self, index: int) -> Path | None:
        """Return None: no file holds the turned picture."""
        return None

    def read(self, index: int, *, color: bool = False) -> Frame:
        """Read a frame, and turn it."""
        frame = super().read(index, color=color)
        picture = None if frame.color is None else turned(frame.color, self._turns)
        depth_m = turned(frame.depth_m, self._turns)
        return Frame(index, frame.name, depth_m, self.poses[index], self.intrinsics, picture)

    def segmentation(self, index: int) -> Segmentation:
        """Read a frame's own masks, and turn them."""
        return super().segmentation(index).turned(self._turns)


def bench_turned(sequence: PosedFrames, network_file: Path, *, frames: int = 40) -> str:
    """Describe how many things a network finds when the camera was held turned by 90, 180 and 270 degrees.

    Args:
        sequence: posed frames; so many of them, evenly spread, are used.
        network_file: an ONNX file.
        frames: how many.
    """
    network, _ = open_network(network_file)
    words = []
    for turns in range(4):
        some = Turned(sequence, frames, turns)
        with tempfile.TemporaryDirectory() as scratch:
            masks = _segment(some, network, Path(scratch))
            seen = sum(
                masks.is_thing[masks.labels.index(s.label)]
                for i in range(len(some))
                for s in masks.segmentation(i).segments
            )
            words.append(
                f"{90 * turns} degrees: {seen} things in pictures, {len(build_map(masks).instances)} on the map"
            )
    return f"  {sequence.name}, {min(frames, len(sequence))} frames, the camera turned: {'; '.join(words)}"


def bench_network(
    sequence: PosedFrames, network_file: Path, *, frames: int = 40, runs: int = 3, threads: int = 0
) -> Iterator[str]:
    """Compare `session.run` alone with segmenting, keeping and mapping the same frames.

    Args:
        sequence: posed frames; so many of them, evenly spread, are used.
        network_file: an ONNX file.
        frames: how many.
        runs: of each piece of work, in turn, after one to warm up.
        threads: of the network; 0 = one for each core.
    """
    network, device = open_network(network_file, NetworkSettings(threads=threads))
    some = Every(sequence, frames)
    prepared = [network.prepare(some.color(index)) for index in range(len(some))]
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch)
        kept = _segment(some, network, root / "kept")
        costs = measure(
            {
                "run": lambda: [network.infer(tensor) for tensor in prepared],
                "segment": lambda: _segment_anew(some, network, root / "again"),
                "map": lambda: build_map(kept),
            },
            runs=runs,
        )
    run, segment, mapping = (costs[name] for name in ("run", "segment", "map"))
    yield (
        f"{network.name} on {device}, {len(some)} frames of {sequence.name}: session.run alone "
        f"{1000 * run.wall / len(some):.0f} ms a frame, {1000 * run.cpu / len(some):.0f} ms of processor time; "
        f"{runs} runs in turn; required: at most {REQUIRED:.2f} x"
    )
    yield _against(run, (segment,), "decoding, preparing, running, reading its output, floor and walls, keeping")
    yield _against(run, (segment, mapping), f"and mapping ({1000 * mapping.cpu / len(some):.1f} ms of processor time)")


def bench_agreement(sequence: PosedFrames, network_file: Path, *, frames: int = 40) -> str:
    """Describe how a network's masks, and the map of them, agree with the sequence's own.

    Args:
        sequence: posed frames with precomputed masks; so many of them, evenly spread, are used.
        network_file: an ONNX file.
        frames: how many.
    """
    network, _ = open_network(network_file)
    some = Every(sequence, frames)
    with tempfile.TemporaryDirectory() as scratch:
        ours = _segment(some, network, Path(scratch))
        seen = agreement((ours.segmentation(i), some.segmentation(i)) for i in range(len(some)))
        mapped = map_agreement(build_map(ours), build_map(some))
    return f"  against {sequence.segmentation_source}: segments: {seen}; instances of 20 cells and more: {mapped}"


class Chosen(OtherMasks):
    """A sequence whose masks are there for some frames only, as if a network had looked at no others."""

    def __init__(self, sequence: FrameSource, frames: Sequence[int]) -> None:
        super().__init__(sequence)
        self._frames, self.segmentation_source = frozenset(frames), sequence.segmentation_source

    def segmentation(self, index: int) -> Segmentation:
        """Return a frame's masks; of the others, that nobody looked."""
        if index in self._frames:
            return self._sequence.segmentation(index)
        k = self.read(index).intrinsics
        return Segmentation(np.zeros((k.height, k.width), np.int32), (), segmented=False)


def bench_chosen(sequence: PosedFrames, errors: str, seeds: Sequence[int] = (0,)) -> str:
    """Compare a map of all masks with those of the frames that ``--segment-every auto`` and every N choose.

    Args:
        sequence: posed frames; with exact ids, or these beside its masks, panoptic quality is compared, else how many
            chairs there are.
        errors: which masks, see `evaluation.evaluate.ERRORS`.
        seeds: of simulated errors; the mean of all is told.
    """
    exact = exact_of(sequence)
    chosen = choose_frames(sequence, AUTO) or []
    every = str(max(1, round(len(sequence) / len(chosen))))
    kept = {"1": range(len(sequence)), AUTO: chosen, every: choose_frames(sequence, every) or []}
    words = []
    for name, frames in kept.items():
        measured = []
        for seed in seeds:
            masks = sequence if exact is None else masks_source(sequence, exact, errors, seed, None)
            simap = build_map(Chosen(masks, frames), config_for(name, BuildConfig()))
            measured.append(
                sum(i.label == "chair" and i.cells >= MIN_CELLS for i in simap.instances) if exact is None
                else score(simap, truth_of(simap, exact)).overall.pq or 0.0
            )  # fmt: skip
        words.append(f"{name}, {len(frames)}: {statistics.mean(measured):.{0 if exact is None else 3}f}")
    what = "chairs" if exact is None else f"PQ, {len(seeds)} seeds," if len(seeds) > 1 else "PQ"
    return f"  {sequence.name}, masks {errors}: {what} of frames looked at: {'; '.join(words)}"


def _against(run: Cost, costs: Sequence[Cost], words: str) -> str:
    """Compare in each turn, and return the least and the median: a busy machine only ever adds."""
    walls = [sum(turn) / base for base, *turn in zip(run.wall_s, *(c.wall_s for c in costs), strict=True)]
    cpus = [sum(turn) / base for base, *turn in zip(run.cpu_s, *(c.cpu_s for c in costs), strict=True)]
    least = sum(min(c.cpu_s) for c in costs) / min(run.cpu_s)
    return (
        f"  {least:5.2f} x processor time (least of all turns; median {statistics.median(cpus):.2f}), "
        f"{statistics.median(walls):.2f} x wall clock (median)   {words}"
    )


def _segment(sequence: Every, network: Network, root: Path) -> WithMasks:
    return segment_sequence(sequence, network, root)  # pyright: ignore[reportArgumentType] - it has what is used


def _segment_anew(sequence: Every, network: Network, root: Path) -> None:
    shutil.rmtree(root, ignore_errors=True)
    _segment(sequence, network, root)
