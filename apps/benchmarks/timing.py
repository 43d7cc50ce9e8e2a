"""Clocks of the bench: pieces of work run in turn, their medians compared within one run."""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

Name = TypeVar("Name", str, float)


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


def measure(works: Mapping[Name, Callable[[], object]], *, runs: int, warm: bool = True) -> dict[Name, Cost]:
    """Run all pieces of work in turn, several times, so that a busy moment hits them alike.

    Args:
        works: by name.
        runs: of each that count.
        warm: run each once more before, which does not count.
    """
    wall: dict[Name, list[float]] = {name: [] for name in works}
    cpu: dict[Name, list[float]] = {name: [] for name in works}
    for run in range(-1 if warm else 0, runs):
        for name, work in works.items():
            wall_start, cpu_start = time.perf_counter(), time.process_time()
            work()
            if run >= 0:
                wall[name].append(time.perf_counter() - wall_start)
                cpu[name].append(time.process_time() - cpu_start)
    return {name: Cost(tuple(wall[name]), tuple(cpu[name])) for name in works}


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return how long a piece of work took, seconds, and what it gave."""
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def best_of(work: Callable[[], Any], *, runs: int = 5) -> tuple[float, Any]:
    """Return the median time of several runs, seconds, and what the last gave."""
    done = [timed(work) for _ in range(runs)]
    return statistics.median(seconds for seconds, _ in done), done[-1][1]


def slowest(works: Mapping[float, Callable[[], object]], *, runs: int = 3) -> Cost:
    """Return the largest median of several pieces of work: as ``wall`` of the slowest, as ``cpu`` of the costliest."""
    costs = measure(works, runs=runs, warm=False).values()
    return Cost((max(cost.wall for cost in costs),), (max(cost.cpu for cost in costs),))


def times(ratio: float) -> str:
    """Write a ratio with as many digits as mean something."""
    if ratio >= 100.0:
        return f"{ratio:,.0f} x"
    return f"{ratio:.1f} x" if ratio >= 10.0 else f"{ratio:.2f} x"
