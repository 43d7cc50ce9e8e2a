"""Measure what the paper measured, on every embedded place: success of commands, instances, memory; and K swept."""

import json
import multiprocessing
import os
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from simaps_viz.baselines import BASELINES
from simaps_viz.build.methods import build, config_of
from simaps_viz.build.pipeline import BuildConfig, facts_of, gather_frames
from simaps_viz.datasets.open import open_sequence
from simaps_viz.datasets.source import FrameSource
from simaps_viz.evaluation.evaluate import Truths, WithSimulatedErrors, masks_source
from simaps_viz.evaluation.navigation import TRUE_MAP, evaluate_navigation
from simaps_viz.evaluation.quality import Scores, score
from simaps_viz.events import Progress
from simaps_viz.mapping.accumulator import MapAccumulator
from simaps_viz.mapping.finalize import apply_method, gathered, map_of
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.scenes.demo import ensure_demo
from simaps_viz.scenes.places import PLACES
from simaps_viz.structures import SIMap

METHODS = ("vlmaps", "vlmaps+components", "paper", "paper-k9", "paper-swept", "components", "evidence")
"""``paper-swept`` is method paper with the K and resolution that are best over all places together."""
WITHOUT_EMBEDDINGS = tuple(method for method in METHODS if method not in BASELINES)
LEVEL, HEAVIER = "light", ("medium", "heavy")
K_PERCENTS = (0.0, 1.0, 2.0, 5.0, 9.0, 15.0, 25.0, 50.0, 80.0)
RESOLUTIONS = (0.05, 0.2, 0.5, 1.0, 2.0, 5.0)
SAMPLES_PER_M2 = 5000
SEATS = ("chair", "couch", "bench", "stool", "ottoman")


@dataclass(frozen=True)
class PaperSettings:
    """How much is measured."""

    places: tuple[str, ...] = tuple(PLACES)
    """Embedded places."""
    seeds: int = 2
    """Of commands, starts and simulated errors."""
    commands: int = 60
    """For each place and seed."""
    most: int = 300
    """Frames of a place, evenly chosen; 0 = all, which takes four times as long."""
    workers: int = max(1, min(os.cpu_count() or 1, len(PLACES)))
    """Processes, each measuring one place."""


@dataclass(frozen=True)
class MapRow:
    """One map, scored."""

    place: str
    level: str
    seed: int
    method: str
    pq: float
    true: int
    found: int
    matched: int
    seats: tuple[int, int, int]
    """True, found and matched instances of ``SEATS``."""
    held_bytes: int
    """Label and instance arrays, and a baseline's embeddings."""


@dataclass(frozen=True)
class DriveRow:
    """All commands of one place and seed on the map of one method."""

    place: str
    seed: int
    method: str
    commands: int
    automatic: float
    strict: float
    collisions: int


@dataclass(frozen=True)
class Results:
    """Everything measured."""

    settings: PaperSettings
    frames: Mapping[str, int]
    maps: tuple[MapRow, ...] = ()
    drives: tuple[DriveRow, ...] = ()
    swept: Mapping[tuple[float, float], float] = field(default_factory=dict)
    """{(resolution, K): PQ of method paper, mean of the places, light errors, first seed}."""
    best: tuple[float, float] = (1.0, 5.0)
    """Resolution and K with the highest of these."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time of each part of the work."""


class OnePass:
    """Builds maps by several methods from one reading of the frames; the baselines read them anew."""

    def __init__(self, variants: Mapping[str, BuildConfig] | None = None) -> None:
        """Take settings of methods that have no name of their own."""
        self._variants = dict(variants or {})
        self._source: FrameSource | None = None
        self._seen: MapAccumulator | None = None

    def __call__(self, source: FrameSource, method: str) -> SIMap:
        """Build a map; the same as `simaps_viz.build.methods.build` makes."""
        if method in BASELINES:
            return build(source, method)
        if self._seen is None or source is not self._source:
            config = BuildConfig(method="paper")  # counts links too, which the other methods leave alone
            self._source, self._seen = source, gather_frames(source, config, range(len(source)), strict=True)
        config = self._variants.get(method) or config_of(method, BuildConfig())
        found = apply_method(gathered(self._seen), config)
        return map_of(found, self._seen.frames, facts_of(source), config)


def measure_places(settings: PaperSettings, progress: Progress) -> Results:
    """Render what is not there yet, sweep K and resolution, then build, score and drive on all maps."""
    began = time.perf_counter()
    seconds, manifests = {}, {}
    for place in settings.places:
        manifests[place] = at_most(ensure_demo(place, level="none", progress=progress), settings.most)
    seconds["rendering"] = time.perf_counter() - began
    began = time.perf_counter()
    sweeps = list(_in_processes(_sweep, [(m,) for m in manifests.values()], settings, "sweeping K", progress))
    swept = {key: sum(sweep[key] for sweep in sweeps) / len(sweeps) for key in sweeps[0]}
    best = max(swept, key=lambda key: (swept[key], key))
    seconds["sweeping K and resolution"] = time.perf_counter() - began
    began = time.perf_counter()
    jobs = [(place, manifest, settings, best) for place, manifest in manifests.items()]
    maps, drives = [], []
    for scored, driven in _in_processes(_measure, jobs, settings, "building and driving", progress):
        maps += scored
        drives += driven
    seconds["building, scoring and driving"] = time.perf_counter() - began
    frames = {place: len(open_sequence(manifest)) for place, manifest in manifests.items()}
    return Results(settings, frames, tuple(maps), tuple(drives), swept, best, seconds)


def at_most(manifest: Path, frames: int) -> Path:
    """Return the manifest of every n-th frame, so that there are no more than so many; written beside the other."""
    poses = (manifest.parent / "poses.txt").read_text(encoding="utf-8").splitlines()
    every = -(-len(poses) // frames) if frames else 1
    if every == 1:
        return manifest
    chosen = manifest.with_name(f"sequence-every-{every}.json")
    (chosen.with_suffix(".txt")).write_text("\n".join(poses[::every]) + "\n", encoding="utf-8")
    named = {**json.loads(manifest.read_text(encoding="utf-8")), "poses": chosen.with_suffix(".txt").name}
    chosen.write_text(json.dumps(named), encoding="utf-8")
    return chosen


def _in_processes(work, jobs: list[tuple], settings: PaperSettings, stage: str, progress: Progress) -> Iterable:
    """Do jobs in processes of their own, as numba's and OpenCV's threads do not survive a fork; results in order."""
    progress(stage, 0, len(jobs))
    with ProcessPoolExecutor(settings.workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(work, *job) for job in jobs]
        for done, future in enumerate(as_completed(futures), start=1):
            future.result()
            progress(stage, done, len(jobs))
        return [future.result() for future in futures]


def _sweep(manifest: Path) -> dict[tuple[float, float], float]:
    """Score method paper for every resolution and K."""
    sequence = open_sequence(manifest)
    simap = OnePass()(masks_source(sequence, sequence, LEVEL, 0, None), "paper")
    truth = Truths(sequence).of(simap)
    swept = {}
    for resolution in RESOLUTIONS:
        parted = recommunity(simap, resolution=resolution, k_percent=0.0)
        for k in K_PERCENTS:
            swept[resolution, k] = score(repartition(parted, k_percent=k), truth).overall.pq or 0.0
    return swept


def _measure(
    place: str, manifest: Path, settings: PaperSettings, best: tuple[float, float]
) -> tuple[list[MapRow], list[DriveRow]]:
    """Measure one place: every map is scored when it is built, and driven on where the errors are light."""
    sequence, rows = open_sequence(manifest), []
    truths = Truths(sequence)
    resolution, k = best
    one_pass = OnePass({"paper-swept": replace(BuildConfig(method="paper"), resolution=resolution, k_percent=k)})

    def build_and_score(source: FrameSource, method: str) -> SIMap:
        simap = one_pass(source, method)
        if isinstance(source, WithSimulatedErrors):
            rows.append(map_row(place, source.level, source.seed, method, simap, score(simap, truths.of(simap))))
        return simap

    report = evaluate_navigation(
        sequence, (TRUE_MAP, *METHODS), build=build_and_score, errors=(LEVEL,), seeds=range(settings.seeds),
        commands=settings.commands, surface_m=surfaces(place),
    )  # fmt: skip
    for level in HEAVIER:
        for seed in range(settings.seeds):
            source = masks_source(sequence, sequence, level, seed, None)
            for method in WITHOUT_EMBEDDINGS:
                build_and_score(source, method)
    drives = []
    for seed in range(settings.seeds):
        for method in report.methods:
            runs = [run for run in report.of(LEVEL, method) if run.seed == seed]
            automatic, strict = (sum(getattr(run.verdict, kind) for run in runs) for kind in ("automatic", "strict"))
            collisions = sum(run.drive.collided for run in runs)
            share = 1.0 / len(runs)
            drives.append(DriveRow(place, seed, method, len(runs), automatic * share, strict * share, collisions))
    return rows, drives


def surfaces(place: str) -> NDArray:
    """Return points about 1.5 cm apart on all surfaces of a place, float64 [n, 3]: what a robot would really touch.

    Judged by depth as it was measured, walls are up to 20 cm thicker wherever one frame of hundreds was wrong.
    """
    triangles = PLACES[place].scene().triangles_m.astype(np.float64)
    low, high = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
    a, b, c = triangles[(low < RobotShape().height_m) & (high > 0.0)].swapaxes(0, 1)
    counts = np.ceil(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2.0 * SAMPLES_PER_M2).astype(int)
    rng = np.random.default_rng(0)
    u, v = rng.random((2, counts.sum(), 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    a, b, c = (np.repeat(corner, counts, axis=0) for corner in (a, b, c))
    return a + u * (b - a) + v * (c - a)


def map_row(place: str, level: str, seed: int, method: str, simap: SIMap, scores: Scores) -> MapRow:
    """Sum up a scored map."""
    seats = [scores.by_class[label] for label in SEATS if label in scores.by_class]
    overall, invented = scores.overall, sum(scores.invented.values())
    held = simap.grid.label.nbytes + simap.instance.nbytes + int(simap.provenance.get("embedding_bytes_held", 0))
    return MapRow(
        place, level, seed, method, overall.pq or 0.0, overall.true, overall.found + invented, overall.matched,
        (sum(s.true for s in seats), sum(s.found for s in seats), sum(s.matched for s in seats)), held,
    )  # fmt: skip
