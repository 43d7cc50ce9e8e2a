"""What many workers gain, what moves between them, and what saturates first; figures of one run on one machine."""

import pickle
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.timing import best_of, measure, timed, times

from simaps_viz.build.pipeline import BuildConfig, facts_of, gather_frames
from simaps_viz.build.workers import SHARD_FRAMES, gather_shard, job_of, open_workers, reopening, steps_in
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import JoinedFrames
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.finalize import empty_accumulator, map_so_far
from simaps_viz.mapping.steps import pack_step

GIGABIT = 117e6
"""Bytes of content a second over a network of 1 Gbit/s."""
CAMPUS_FRAMES = 5_000_000
"""Fifty buildings of 100,000 frames each."""


@dataclass(frozen=True)
class Run:
    """One build by some workers, without finding its instances at the end."""

    workers: int
    frames: int
    seconds: float
    client_s: float
    """Of it spent here, on fetching, unpacking and putting on the grid; the rest is waiting."""
    cpu_s: float
    """Processor time of this process, with Dask's client and scheduler."""
    received: int
    """Bytes."""
    same: bool
    """The map is that of one process, byte for byte."""


def bench_cluster(
    sequence: PosedFrames, scratch: Path, *, workers: Sequence[int] = (1, 2, 4), copies: int = 4
) -> Iterator[str]:
    """Build with more and more workers.

    Args:
        sequence: what to build from.
        scratch: folder for maps.
        workers: how many; the first is what the others are compared with.
        copies: the sequence is read so many times over, so that starting up does not count.
    """
    frames, config = JoinedFrames([sequence] * copies), BuildConfig()
    gather_frames(sequence, config, range(len(sequence)))  # compiles, and reads the files into memory
    alone_s, accumulator = timed(lambda: gather_frames(frames, config, range(len(frames))))
    save_map(map_so_far(accumulator, facts_of(frames), config), scratch / "alone.npz")
    wanted = (scratch / "alone.npz").read_bytes()
    yield f"Workers, {sequence.name}: {copies} x {len(sequence)} frames, method {config.method}, on this machine"
    yield f"  {'':>8}  one process, two threads that read and one that maps: {len(frames) / alone_s:.0f} frames/s"
    runs = [_run(frames, config, n, scratch, wanted) for n in workers]
    for run in runs:
        yield (
            f"  {times(runs[0].seconds / run.seconds):>8}  workers: {run.workers}, {run.frames / run.seconds:.0f} "
            f"frames/s, {times(alone_s / run.seconds)} one process; {100 * run.client_s / run.seconds:.0f} % of the "
            f"time is work of the one who merges; map {'the same' if run.same else 'NOT THE SAME'}"
        )
    yield from _moved(sequence, config, runs[0])
    yield from _on_paper(sequence, config, runs[0])


def _run(frames: JoinedFrames, config: BuildConfig, count: int, scratch: Path, wanted: bytes) -> Run:
    T_map_camera, indices = frames.T_map_world @ frames.poses, range(len(frames))
    with open_workers(f"local:{count}", reopening(frames, scratch)) as workers:
        for _ in workers(frames, config, T_map_camera, indices[: 4 * SHARD_FRAMES * count]):
            pass  # every worker has opened the sequence and loaded its kernels
        before = workers.moved.fetched_s + workers.moved.unpacked_s
        received, replayed_s = workers.moved.received, 0.0
        accumulator, start, cpu_start = empty_accumulator(frames, config), time.perf_counter(), time.process_time()
        for step in workers(frames, config, T_map_camera, indices):
            if step is not None:
                replayed_s -= time.perf_counter()
                accumulator.replay(step)
                replayed_s += time.perf_counter()
        seconds, cpu_s = time.perf_counter() - start, time.process_time() - cpu_start
        client_s = workers.moved.fetched_s + workers.moved.unpacked_s - before + replayed_s
        received = workers.moved.received - received
    output = scratch / f"{count}.npz"
    save_map(map_so_far(accumulator, facts_of(frames), config), output)
    return Run(count, len(frames), seconds, client_s, cpu_s, received, output.read_bytes() == wanted)


def _moved(sequence: PosedFrames, config: BuildConfig, run: Run) -> Iterator[str]:
    """Describe what a frame costs to move and merge, as steps and as a part of the map."""
    indices = range(min(SHARD_FRAMES, len(sequence)))
    n, T_map_camera = len(indices), sequence.T_map_world @ sequence.poses
    job = job_of(sequence, config, reopening(sequence, Path()))
    data = gather_shard(job, indices, T_map_camera[indices])
    gather_s = _gathering_s(sequence, config)
    unpack_s, steps = best_of(lambda: list(steps_in(data, indices)))
    whole = gather_frames(sequence, config, range(n, len(sequence)))
    part = gather_frames(sequence, config, indices)
    replay_s = best_of(lambda: _replayed(empty_accumulator(sequence, config), steps))[0]
    merge_s = min(timed(partial(whole.copy().merge, part))[0] for _ in range(5))
    task = len(pickle.dumps((job, indices, T_map_camera[indices])))
    partly = len(pickle.dumps((part.tiles, list(part.frames), part.links)))
    yield (
        f"  {times(partly / len(data)):>8}  bytes a frame as part of a map, over those as steps: "
        f"{partly / n / 1e3:.0f} and {len(data) / n / 1e3:.1f} kB in shards of {n}; all frames: "
        f"{run.received / run.frames / 1e3:.1f} kB, {task / n:.0f} bytes of task go out"
    )
    yield (
        f"  {times(gather_s / (unpack_s + replay_s)):>8}  gathering a frame, over joining it: "
        f"{1e3 * gather_s / n:.2f} ms of processor time; unpacked in {1e3 * unpack_s / n:.3f} and put on the grid in "
        f"{1e3 * replay_s / n:.3f} ms, or merged as part of a map in {1e3 * merge_s / n:.3f} ms"
    )
    plain = np.mean([len(pack_step(step)) for step in steps])
    yield f"  {'':>8}  in the build log, and on disk beyond 128 MB of memory: {plain / 1e3:.0f} kB a frame"


def _replayed(accumulator, steps) -> None:
    for step in steps:
        accumulator.replay(step)


def _gathering_s(sequence: PosedFrames, config: BuildConfig) -> float:
    """Return the processor time a worker takes for a shard, seconds."""
    indices, job = range(min(SHARD_FRAMES, len(sequence))), job_of(sequence, config, reopening(sequence, Path()))
    poses = (sequence.T_map_world @ sequence.poses)[indices]
    return measure({"gather": lambda: gather_shard(job, indices, poses)}, runs=5)["gather"].cpu


def _on_paper(sequence: PosedFrames, config: BuildConfig, run: Run) -> Iterator[str]:
    """Carry the figures on to a campus; the first run is by one worker."""
    worker = min(SHARD_FRAMES, len(sequence)) / _gathering_s(sequence, config)
    client = run.frames / run.cpu_s
    read = np.mean([_read_bytes(sequence, index) for index in range(len(sequence))])
    moved = run.received / run.frames
    limits = {
        "the one who merges": client,
        "1 Gbit/s to the files": GIGABIT / read,
        "1 Gbit/s to the scheduler, through which each step goes twice": GIGABIT / moved / 2,
    }
    yield (
        f"Processor time a frame: {1e3 / worker:.2f} ms of a worker, {1e3 / client:.2f} ms of the one who merges, with "
        "Dask's client and scheduler"
    )
    yield f"On paper, a campus of {CAMPUS_FRAMES:,} frames in {CAMPUS_FRAMES // 100_000} buildings, a map each:"
    for what, rate in sorted(limits.items(), key=lambda limit: limit[1]):
        hours = CAMPUS_FRAMES / rate / 3600
        yield f"  {rate / worker:6.1f} workers  saturate {what}: {rate:,.0f} frames/s, {hours:.1f} h"
    yield (
        f"  {read / 1e3:.0f} kB of files are read for a frame and {moved / 1e3:.1f} kB come back; "
        f"{CAMPUS_FRAMES * moved / 1e9:.0f} GB in all; a building of 100,000 frames keeps "
        f"{100_000 * moved / 1e9:.1f} GB of steps, packed"
    )


def _read_bytes(sequence: PosedFrames, index: int) -> int:
    segments = sequence.recording.segments
    ids = [segments.stored(index)] if segments and segments.stored else []
    return sum(file.stat().st_size for file in (sequence.files(index)[1], *ids))
