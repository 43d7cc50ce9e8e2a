"""Spreads cases over targets and processes, adds up what came of them, and prints the table of docs/RELIABILITY.md."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from attacks.files import Watched
from attacks.fuzz_cases import Finding, write
from attacks.fuzz_targets import TARGETS

HERE = Path(__file__).parent
ROOT = Path(__file__).parents[2]
PATHS = (ROOT / "apps", ROOT / "tests" / "helpers", ROOT)
"""Where a worker finds the targets and the tests' samples."""
KINDS = ("traceback", "message", "hang", "died")


@dataclass
class Tally:
    """What came of all cases of a target so far."""

    cases: int = 0
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0
    peak_bytes: int = 0
    coverage: int = 0
    """Places in the instrumented code that were reached (guided runs)."""
    findings: list[dict[str, Any]] = field(default_factory=list)

    def add(self, record: dict[str, Any]) -> None:
        """Add what a process found."""
        for name in ("cases", "accepted", "refused", "seconds"):
            setattr(self, name, getattr(self, name) + record[name])
        for name in ("peak_bytes", "coverage"):
            setattr(self, name, max(getattr(self, name), record.get(name, 0)))
        self.findings += record["findings"]


def quotas(total: int, names: Sequence[str]) -> dict[str, int]:
    """Share cases out by the targets' weights."""
    weights = {name: TARGETS[name].weight for name in names}
    return {name: max(1, total * weight // sum(weights.values())) for name, weight in weights.items()}


def fuzz(
    wanted: dict[str, int],
    watched: Watched | None = None,
    *,
    seed: int = 0,
    results: Path | None = None,
    seconds: float = 1e9,
    batch_s: float = 60.0,
) -> dict[str, Tally]:
    """Run cases, target after target, round and round, until every target has its number or time is up.

    Args:
        wanted: number of cases by target.
        watched: files that no case may change.
        seed: of all choices; case n of a target is always the same.
        results: numbers are kept there, and added to when it is run again.
        seconds: stop after so long.
        batch_s: seconds that one process may take.
    """
    tallies = load(results)
    end = time.monotonic() + seconds
    while True:
        left = [n for n, count in wanted.items() if tallies.setdefault(n, Tally()).cases < count]
        if not left:
            return tallies
        for name in left:
            if time.monotonic() > end:
                return tallies
            tally, before = tallies[name], watched.files() if watched else {}
            record = _batch(name, seed, tally.cases, wanted[name] - tally.cases, min(batch_s, end - time.monotonic()))
            record["findings"] += touched(name, watched, before)
            tally.add(record)
            for one in record["findings"]:
                write(str(Finding(**one)))
            if results is not None:
                results.write_text(json.dumps({n: asdict(t) for n, t in tallies.items()}, indent=1))


def touched(name: str, watched: Watched | None, before: Any) -> list[dict[str, Any]]:
    """Return a finding for each file that is not as it was before the cases of a target; -1 stands for their number."""
    changes = watched.changes(before) if watched else []
    return [vars(Finding(name, -1, "file", what, "")) for what in changes]


def table(tallies: dict[str, Tally]) -> str:
    """Return the table in Markdown, the sum last."""
    head = ("target", "cases", "refused", "accepted", "tracebacks", "hangs", "peak memory (MB)", "processor (s)")
    head += ("places reached",) * any(tally.coverage for tally in tallies.values())
    rows = [head, ("---",) * len(head)]
    total = Tally()
    for name in TARGETS:
        tally = tallies.get(name, Tally())
        if tally.cases:
            rows.append(_row(name, tally))
            total.add(asdict(tally) | {"coverage": 0})
    return "\n".join("| " + " | ".join(row[: len(head)]) + " |" for row in [*rows, _row("all", total)])


def faults(tallies: Iterable[Tally]) -> list[dict[str, Any]]:
    """Return the first finding of each fault."""
    first: dict[tuple[str, str], dict[str, Any]] = {}
    for tally in tallies:
        for one in tally.findings:
            first.setdefault((one["kind"], one["where"]), one)
    return list(first.values())


def _row(name: str, tally: Tally) -> tuple[str, ...]:
    kinds = [one["kind"] for one in tally.findings]
    hangs = kinds.count("hang")
    return (name, f"{tally.cases:,}", f"{tally.refused:,}", f"{tally.accepted:,}", str(len(kinds) - hangs), str(hangs),
            f"{tally.peak_bytes / 1e6:.0f}", f"{tally.seconds:.0f}", f"{tally.coverage or ''}")  # fmt: skip


def _batch(name: str, seed: int, first: int, count: int, seconds: float) -> dict[str, Any]:
    """Run cases in a process; when it dies, the case it was at is the finding and the ones before it count."""
    with tempfile.NamedTemporaryFile() as progress:
        progress.write(first.to_bytes(8, "little"))
        progress.flush()
        command = [sys.executable, str(HERE / "fuzz_worker.py"), name, str(seed), str(first), str(count), str(seconds),
                   progress.name]  # fmt: skip
        environment = {
            **os.environ,
            "PYTHONPATH": f"{HERE.parent}{os.pathsep}{ROOT / 'tests' / 'helpers'}{os.pathsep}{ROOT}",
            "OMP_NUM_THREADS": "1",
        }
        done = subprocess.run(command, capture_output=True, env=environment, check=False)
        lines = done.stdout.decode(errors="replace").strip().splitlines()
        if done.returncode == 0 and lines:
            return json.loads(lines[-1])
        at = int.from_bytes(Path(progress.name).read_bytes()[:8], "little")
    said = " ".join(done.stderr.decode(errors="replace").split())[-300:]
    how = signal.Signals(-done.returncode).name if done.returncode < 0 else f"status {done.returncode}"
    finding = Finding(name, at, "died", f"{name} {how}", said)
    return {"cases": at - first + 1, "accepted": 0, "refused": at - first, "seconds": 0.0, "peak_bytes": 0,
            "findings": [vars(finding)]}  # fmt: skip


def load(results: Path | None) -> dict[str, Tally]:
    """Read the numbers of earlier runs."""
    if results is None or not results.is_file():
        return {}
    return {name: Tally(**values) for name, values in json.loads(results.read_text()).items()}
