"""A whole building, streamed: what its frames cost at the beginning and at the end, and what memory they take.

The building is simulated (`scenes.building`): exact depth and masks, furniture of known number.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from benchmarks.large_building import SimulatedBuilding

from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.evaluation.quality import ScoringRules
from simaps_viz.events import BuildFinished, Event, FrameProjected
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.structures import SIMap

MARKS = (0.1, 0.5, 1.0)
"""Shares of the frames after which memory is looked at."""


@dataclass
class Gauge:
    """Watches a build's time and memory."""

    frames: int
    started_s: float = field(default_factory=time.perf_counter)
    rss_mb: dict[float, float] = field(default_factory=dict)
    """Memory of the program by share of the frames."""
    ms_a_frame: dict[float, float] = field(default_factory=dict)
    """Of the tenth of the frames that ends at that share; processor time."""
    gathered_s: float = 0.0
    """From the start to the last frame."""
    gathered_peak_mb: float = 0.0
    finished_s: float = 0.0
    """From the last frame to the map."""
    finished_cpu_s: float = 0.0
    wants_color = False

    def __post_init__(self) -> None:
        self._tenth_s = time.process_time()
        reset_peak()

    def on_event(self, event: Event) -> None:
        """Look at the clock after every tenth of the frames, and at the end of each stage."""
        now = time.perf_counter()
        if isinstance(event, FrameProjected):
            self._after(event.frame.index + 1, now)
        elif isinstance(event, BuildFinished):
            self.finished_s = now - self.started_s - self.gathered_s
            self.finished_cpu_s = time.process_time() - self._tenth_s

    def _after(self, done: int, now: float) -> None:
        tenth = self.frames // 10 or 1
        if done % tenth == 0:
            share = round(done / self.frames, 2)
            self.rss_mb[share] = memory_mb("VmRSS")
            cpu = time.process_time()
            self.ms_a_frame[share] = 1000.0 * (cpu - self._tenth_s) / tenth
            self._tenth_s = cpu
        if done == self.frames:
            self.gathered_s, self.gathered_peak_mb = now - self.started_s, memory_mb("VmHWM")
            reset_peak()


@dataclass(frozen=True)
class Found:
    """How many objects of the building the map has."""

    true: int
    """That a camera saw at least `ScoringRules.min_true_cells` cells of."""
    found: int
    """Of at least `ScoringRules.min_found_cells` cells."""
    right: int
    """Of the same class and with more than half of either's cells in common."""
    quality: float
    """Panoptic quality: mean IoU of the right ones, times right / (right + (missed + invented) / 2)."""


def bench_building(building: SimulatedBuilding, *, scratch: Path) -> Iterator[str]:
    """Build, save, open and score the map of a simulated building."""
    frames = len(building)
    build_map(SimulatedBuilding(10.0, 40))  # compiles
    yield f"{building.name}: {frames} frames, {building.rooms**2} rooms, method evidence, with its build log"
    log, output = scratch / "log", scratch / "map.npz"
    gauge = Gauge(frames)
    at_first = memory_mb("VmRSS")
    simap = build_map(building, BuildConfig(), [gauge], log=log)
    peak = memory_mb("VmHWM")
    seen = int(np.count_nonzero(simap.grid.observations))
    area = seen * simap.spec.cell_size_m**2
    yield f"  area seen {area:,.0f} m2 ({seen:,} cells) of a grid of {simap.spec.cols} x {simap.spec.rows} cells"
    yield "  memory before, and after 10, 50 and 100 % of the frames: " + ", ".join(
        f"{mb:,.0f} MB" for mb in (at_first, *(gauge.rss_mb.get(share, float("nan")) for share in MARKS))
    )
    yield f"  peak while frames came {gauge.gathered_peak_mb:,.0f} MB, in the final stage {peak:,.0f} MB"
    per = list(gauge.ms_a_frame.values())
    yield (
        f"  frames took {gauge.gathered_s:,.0f} s; processor time {per[0]:.2f} ms each in the first tenth, "
        f"{per[-1]:.2f} ms in the last, rendering included; slowest tenth {max(per):.2f} ms"
    )
    yield f"  the final stage took {gauge.finished_s:,.1f} s, {gauge.finished_cpu_s:,.1f} s of processor time"
    yield f"  log {log.stat().st_size / 1e6:,.0f} MB, {log.stat().st_size / 1e3 / frames:.1f} kB a frame"
    found = score(building, simap)
    yield (
        f"  objects: {found.found:,} found, {found.true:,} true, {found.right:,} of them right, "
        f"panoptic quality {found.quality:.3f}"
    )
    start = time.perf_counter()
    save_map(simap, output)
    saved_s = time.perf_counter() - start
    del simap
    reset_peak()
    start = time.perf_counter()
    load_map(output)
    yield (
        f"  map file {output.stat().st_size / 1e6:,.1f} MB, written in {saved_s:,.1f} s, opened in "
        f"{time.perf_counter() - start:,.1f} s with a peak of {memory_mb('VmHWM'):,.0f} MB"
    )


def score(building: SimulatedBuilding, simap: SIMap, rules: ScoringRules | None = None) -> Found:
    """Compare the instances of a map with the furniture, room by room, on the cells that were seen."""
    rules, spec = rules or ScoringRules(), simap.spec
    kind = {instance.id: instance.label for instance in simap.instances}
    found_cells = np.bincount(simap.instance.reshape(-1))
    true_cells: list[int] = []
    matches: list[tuple[float, int]] = []  # IoU, found
    for row in range(building.rooms):
        for col in range(building.rooms):
            objects, names, (x, y) = building.truth_of(row, col, spec.cell_size_m)
            top, left = round((y - spec.y0_m) / spec.cell_size_m), round((x - spec.x0_m) / spec.cell_size_m)
            low, high = max(top, 0), min(top + len(objects), spec.rows)
            west, east = max(left, 0), min(left + len(objects), spec.cols)
            if low >= high or west >= east:
                continue
            part = np.s_[low:high, west:east]
            objects = objects[low - top : high - top, west - left : east - left]
            true = np.where(simap.grid.observations[part] > 0, objects, 0)
            cells = np.bincount(true.reshape(-1), minlength=len(names) + 1)
            key = true.astype(np.int64) << 32 | simap.instance[part]
            pairs, shared = np.unique(key[(true > 0) & (simap.instance[part] > 0)], return_counts=True)
            true_cells += [n for n in cells[1:].tolist() if n >= rules.min_true_cells]
            for pair, both in zip(pairs.tolist(), shared.tolist(), strict=True):
                number, instance = pair >> 32, pair & 0xFFFFFFFF
                iou = both / (cells[number] + found_cells[instance] - both)
                if iou > 0.5 and cells[number] >= rules.min_true_cells and kind[instance] == names[number - 1]:
                    matches.append((float(iou), instance))
    found = int((found_cells[1:] >= rules.min_found_cells).sum())
    right, true = len(matches), len(true_cells)
    quality = 2.0 * sum(iou for iou, _ in matches) / max(true + found, 1)
    return Found(true, found, right, quality)


def memory_mb(what: str) -> float:
    """Return this program's memory now (``VmRSS``) or its peak (``VmHWM``), MB; NaN where the system does not tell."""
    try:
        text = Path("/proc/self/status").read_text()
    except OSError:
        return float("nan")
    kilobytes = (int(line.split()[1]) for line in text.splitlines() if line.startswith(f"{what}:"))
    return next(kilobytes, float("nan")) / 1024


def reset_peak() -> None:
    """Start the peak anew, where the system can."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return
