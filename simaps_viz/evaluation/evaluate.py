"""Builds maps by several methods from masks with several kinds of errors, and scores and weighs each."""

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from simaps_viz.datasets.floors import SomeFrames
from simaps_viz.datasets.images import encode_ids
from simaps_viz.datasets.manifest import read_json
from simaps_viz.datasets.sequence import PosedFrames
from simaps_viz.datasets.source import FrameSource, OtherMasks
from simaps_viz.errors import InputError
from simaps_viz.evaluation.quality import Scores, ScoringRules, find_overlaps, scores_of
from simaps_viz.evaluation.truth import Truth, find_truth, settings_of, truth_of
from simaps_viz.events import Progress
from simaps_viz.geometry import transform_points
from simaps_viz.mapping.file import save_map
from simaps_viz.scenes.simulated_errors import LEVELS, KnownInstance, check_level, simulate_errors
from simaps_viz.structures import Segment, Segmentation, SIMap

_FAST_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]


class WithSimulatedErrors(OtherMasks):
    """The frames of a sequence with exact ids, with the mask errors of a simulated network: a `FrameSource`.

    A frame is spoiled when first asked for and kept packed, about as fast to unpack as a file is to read; so builds
    of several methods cost what they would cost with masks on disk. Several threads may read at once.
    """

    def __init__(self, sequence: PosedFrames, level: str, seed: int = 0) -> None:
        """Wrap a sequence.

        Args:
            sequence: its masks are the truth; its scene file gives each object's box.
            level: a key of `scenes.simulated_errors.LEVELS`.
            seed: not negative.

        Raises:
            InputError: there is no such level, the masks are not exact, or the scene file lacks boxes.
        """
        if seed < 0:
            raise InputError(f"seed: expected 0 or more, found {seed}")
        super().__init__(sequence)
        self.level, self.seed, self.color = check_level(level), seed, sequence.color
        self._known = _known_instances(sequence)
        named = {name for errors in (LEVELS[level].by_class or {}).values() for name in errors.names}
        new = tuple(sorted(named.difference(self.labels)))
        self.labels, self.is_thing = (*self.labels, *new), (*self.is_thing, *(True for _ in new))
        self._packed: dict[int, tuple[NDArray, tuple[Segment, ...]]] = {}
        self.name, self.simulated = f"{sequence.name}, {self.segmentation_source}", True

    @property
    def segmentation_source(self) -> str:
        """In words, always "simulated …"."""
        return f"simulated network errors, {self.level}, seed {self.seed}"

    def segmentation(self, index: int) -> Segmentation:
        """Return a frame's spoiled masks; the same every time."""
        if index not in self._packed:
            self._packed[index] = self._spoil(index)
        packed, segments = self._packed[index]
        return Segmentation(np.asarray(cv2.imdecode(packed, cv2.IMREAD_UNCHANGED), dtype=np.int32), segments)

    def prepare(self, progress: Progress | None = None) -> None:
        """Spoil all frames now, on two threads."""
        with ThreadPoolExecutor(max_workers=2) as pool:
            for done, _ in enumerate(pool.map(self.segmentation, range(len(self))), start=1):
                if progress:
                    progress(f"simulating network errors, {self.level}, seed {self.seed}", done, len(self))

    def _spoil(self, index: int) -> tuple[NDArray, tuple[Segment, ...]]:
        exact = self._sequence.segmentation(index)
        name = self.frame_names[index]
        ids, rows = simulate_errors(exact.ids, self._known, level=self.level, seed=self.seed, frame=name)
        things = dict(zip(self.labels, self.is_thing, strict=True))
        segments = tuple(Segment(r["id"], r["label"], float(r["score"]), things[r["label"]]) for r in rows)
        return encode_ids(ids, _FAST_PNG), segments


def _known_instances(sequence: PosedFrames) -> Mapping[int, KnownInstance]:
    segments = sequence.recording.segments
    if not sequence.ground_truth or segments is None or segments.table is None or segments.world is None:
        raise InputError(
            f"{sequence.path}: expected exact world-wide ids, to simulate errors on them, found masks by "
            f'"{sequence.segmentation_source}"'
        )
    path = segments.table
    things = dict(zip(sequence.labels, sequence.is_thing, strict=True))
    known = {}
    for row in read_json(path)["instances"]:
        middle = transform_points(sequence.T_map_world, _middle(path, row))
        known[int(row["id"])] = KnownInstance(row["label"], things[row["label"]], (float(middle[0]), float(middle[1])))
    return known


def _middle(path: Path, row: Mapping[str, Any]) -> NDArray:
    """Return the middle of an object's box, world frame, metres."""
    try:
        low, high = (np.array(row[key], dtype=np.float64).reshape(3) for key in ("aabb_min", "aabb_max"))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: id {row['id']}: expected aabb_min and aabb_max, three numbers each, to tell neighbours by; "
            f"found another shape or none"
        ) from error
    return (low + high) / 2.0


PRECOMPUTED = "precomputed"
ERRORS = (*LEVELS, PRECOMPUTED)
"""What masks a method gets: exact ("none"), spoiled by simulated errors, or those of the manifest."""

NOT_SIMULATED = ("none", PRECOMPUTED)

Build = Callable[[FrameSource, str], SIMap]
"""Builds a map by the method of that name."""

_Config = TypeVar("_Config")
_WARM_UP_FRAMES = 2


@dataclass(frozen=True)
class Footprint:
    """Sizes of the data that a method stores."""

    ram_bytes: int = 0
    disk_bytes: int = 0


Store = Callable[[str, SIMap], Footprint]
"""Returns what a method keeps beside the map itself, such as an embedding for every cell."""


@dataclass(frozen=True, eq=False)
class Run:
    """One map, scored and weighed."""

    method: str
    errors: str
    """One of ``ERRORS``."""
    seed: int
    """Seed of the simulated errors."""
    scores: Scores
    seconds: float
    """Wall-clock time of building, reading included, simulating errors not."""
    footprint: Footprint
    """In memory: label and instance arrays, and the method's store. On disk: the map file, and the store."""


@dataclass(frozen=True, eq=False)
class Report:
    """All runs of one sequence, by errors, then method, then seed, in the order asked for."""

    name: str
    path: Path
    truth_source: str
    simulated: bool
    """The frames themselves are simulated (rendered)."""
    runs: tuple[Run, ...]
    rules: ScoringRules
    maps: Mapping[tuple[str, str], tuple[SIMap, Truth]] = field(default_factory=dict)
    """{(errors, method): the first seed's map and its truth}, for pictures."""

    def of(self, errors: str, method: str) -> tuple[Run, ...]:
        """Return the runs of one row, by seed."""
        return tuple(run for run in self.runs if (run.errors, run.method) == (errors, method))

    @property
    def errors(self) -> tuple[str, ...]:
        """In the order asked for."""
        return tuple(dict.fromkeys(run.errors for run in self.runs))

    @property
    def methods(self) -> tuple[str, ...]:
        """In the order asked for."""
        return tuple(dict.fromkeys(run.method for run in self.runs))


def evaluate(
    sequence: PosedFrames,
    methods: Sequence[str],
    *,
    errors: Sequence[str],
    seeds: Sequence[int] = (0,),
    build: Build,
    truth: Path | None = None,
    rules: ScoringRules | None = None,
    store: Store | None = None,
    progress: Progress | None = None,
) -> Report:
    """Build and score maps by all methods, from all kinds of masks.

    Methods take turns, so that a busy moment of the machine hits them alike; each first maps two frames for nothing,
    so that none pays for compiling.

    Args:
        sequence: exact ids, or masks by a network with the exact ids beside them (see `find_truth`).
        methods: names that ``build`` knows.
        errors: of ``ERRORS``.
        seeds: of the simulated errors; masks that are not simulated are used once.
        build: builds a map by the method of a name.
        truth: manifest with exact ids, if it is not to be looked for.
        rules: what counts.
        store: what methods keep beside the map.
        progress: notified of every step.

    Raises:
        InputError: there is no truth, or no such errors, or something is asked for twice or not at all.
    """
    check_lists(methods, errors, seeds)
    rules, store = rules or ScoringRules(), store or (lambda method, simap: Footprint())
    exact = find_truth(sequence, truth)
    plan = [(e, s) for e in errors for s in (seeds if _is_simulated(e) else seeds[:1])]
    runs: dict[tuple[str, int, str], Run] = {}
    maps: dict[tuple[str, str], tuple[SIMap, Truth]] = {}
    truths = Truths(exact)
    for kind, seed in plan:
        source = masks_source(sequence, exact, kind, seed, progress)
        for method in methods:
            if progress:
                progress("building and scoring maps", len(runs), len(plan) * len(methods))
            if (kind, seed) == plan[0]:
                build(SomeFrames(source, range(min(_WARM_UP_FRAMES, len(source)))), method)
            start = time.perf_counter()
            simap = build(source, method)
            seconds = time.perf_counter() - start
            true = truths.of(simap)
            scores = scores_of(find_overlaps(simap, true, rules), simap)
            footprint = weigh(simap, store(method, simap))
            runs[kind, seed, method] = Run(method, kind, seed, scores, seconds, footprint)
            maps.setdefault((kind, method), (simap, true))
    if progress:
        progress("building and scoring maps", len(runs), len(plan) * len(methods))
    ordered = [runs[e, s, m] for e in errors for m in methods for s in seeds if (e, s, m) in runs]
    return Report(sequence.name, sequence.path, exact.segmentation_source, exact.simulated, tuple(ordered), rules, maps)


def evaluate_variants(
    sequence: PosedFrames,
    variants: Sequence[tuple[str, _Config]],
    *,
    build: Callable[[FrameSource, _Config], SIMap],
    errors: Sequence[str],
    seeds: Sequence[int] = (0,),
    truth: Path | None = None,
    rules: ScoringRules | None = None,
    progress: Progress | None = None,
) -> Report:
    """Do the same with configurations of one method, each under a name of its own; see `evaluate`."""
    configs = dict(variants)
    if len(configs) != len(variants):
        raise InputError(f"variants: expected each name once, found {', '.join(name for name, _ in variants)}")
    return evaluate(
        sequence, tuple(configs), errors=errors, seeds=seeds, truth=truth, rules=rules, progress=progress,
        build=lambda source, name: build(source, configs[name]),
    )  # fmt: skip


def weigh(simap: SIMap, store: Footprint) -> Footprint:
    """Weigh what answers questions about instances: label and instance arrays; the map file; and the store."""
    with tempfile.TemporaryDirectory(prefix="simaps-") as folder:
        path = Path(folder) / "map.npz"
        save_map(simap, path)
        disk = path.stat().st_size
    held = simap.grid.label.nbytes + simap.instance.nbytes
    return replace(store, ram_bytes=store.ram_bytes + held, disk_bytes=store.disk_bytes + disk)


def masks_source(
    sequence: PosedFrames, exact: PosedFrames, errors: str, seed: int, progress: Progress | None
) -> FrameSource:
    """Return the frames with the masks asked for: the sequence's own, exact ones, or ones with simulated errors."""
    if errors == PRECOMPUTED:
        return sequence
    if not _is_simulated(errors):
        return exact
    spoiled = WithSimulatedErrors(exact, errors, seed)
    spoiled.prepare(progress)
    return spoiled


def _is_simulated(errors: str) -> bool:
    return errors not in NOT_SIMULATED


class Truths:
    """Makes the truth once for all maps of one grid, map frame and choice of frames."""

    def __init__(self, exact: PosedFrames) -> None:
        """Take the sequence with exact ids."""
        self._exact = exact
        self._made: dict[tuple, Truth] = {}

    def of(self, simap: SIMap) -> Truth:
        """Return the truth on a map's grid."""
        key = (settings_of(simap), np.asarray(simap.T_map_world).tobytes(), simap.frame_names)
        if key not in self._made:
            self._made[key] = truth_of(simap, self._exact)
        return self._made[key]


def check_lists(methods: Sequence[str], errors: Sequence[str], seeds: Sequence[int]) -> None:
    """Raise InputError unless each list names something, nothing twice, and only errors that there are."""
    for what, values in (("methods", methods), ("errors", errors), ("seeds", seeds)):
        if not values or len(set(values)) != len(values):
            found = ", ".join(map(str, values)) or "none"
            raise InputError(f"{what}: expected at least one, each once, found {found}")
    kinds = (*LEVELS, PRECOMPUTED)  # levels of the caller's own too
    unknown = [e for e in errors if e not in kinds]
    if unknown:
        raise InputError(f"errors: expected some of {', '.join(kinds)}, found {', '.join(unknown)}")
