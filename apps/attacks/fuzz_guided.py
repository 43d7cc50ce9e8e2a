"""Lets coverage choose: libFuzzer, by way of atheris, makes the choices that otherwise come from random numbers."""

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import warnings
from dataclasses import asdict
from pathlib import Path
from random import Random
from typing import Any

from attacks.files import Watched

ROOT = Path(__file__).parents[2]
PATHS = (ROOT / "apps", ROOT / "tests" / "helpers", ROOT)
SEEDS, SEED_BYTES, LONGEST = 40, 200, 4096


class Fed(Random):
    """Random numbers that are bytes somebody gives; zeros when they run out."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0
        super().__init__(0)

    def getrandbits(self, k: int) -> int:
        """Take as many bytes as are needed."""
        size = (k + 7) // 8
        piece = self._data[self._at : self._at + size]
        self._at += size
        return int.from_bytes(piece, "little") & ((1 << k) - 1)

    def random(self) -> float:
        """Take two bytes."""
        return self.getrandbits(16) / 65536


def guide(
    wanted: dict[str, int],
    watched: Watched | None = None,
    *,
    seed: int = 0,
    results: Path | None = None,
    seconds: float = 1e9,
) -> dict[str, Any]:
    """Run cases, target after target; like `fuzz_runner.fuzz`, but each takes its time in one go."""
    from attacks.fuzz_runner import Tally, load, touched  # noqa: PLC0415 - as below

    tallies = load(results)
    for name, count in wanted.items():
        tally = tallies.setdefault(name, Tally())
        if tally.cases < count:
            before = watched.files() if watched else {}
            record = _run(name, seed + tally.cases, count - tally.cases, seconds / len(wanted))
            record["findings"] += touched(name, watched, before)
            tally.add(record)
        if results is not None:
            results.write_text(json.dumps({n: asdict(t) for n, t in tallies.items()}, indent=1))
    return tallies


def _run(name: str, seed: int, count: int, seconds: float) -> dict[str, Any]:
    from attacks.fuzz_cases import Finding  # noqa: PLC0415 - the instrumented process must not have loaded it before

    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, name, str(seed), str(count), str(min(seconds, 1e6)), folder]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, PATHS)), "OMP_NUM_THREADS": "1"}
        done = subprocess.run(command, capture_output=True, env=environment, check=False)
        said = done.stderr.decode(errors="replace")
        told = Path(folder) / "told.json"
        if not told.is_file():
            raise RuntimeError(f"{name}: the guided run ended at once: {said[-2000:]}")
        record = json.loads(told.read_text())
        if done.returncode != 0:
            record["findings"].append(vars(Finding(name, record["cases"], "died", name, said[-300:])))
    covered = re.findall(r"cov: (\d+)", said)
    return {**record, "coverage": int(covered[-1]) if covered else 0}


def compiled() -> list[str]:
    """Name the modules that numba compiles, which cannot be instrumented."""
    sources = (ROOT / "simaps_viz").rglob("*.py")
    found = [path for path in sources if "njit" in path.read_text(encoding="utf-8")]
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in found]


def main(name: str, seed: int, count: int, seconds: float, folder: Path) -> None:
    """Fuzz one target in this process, which libFuzzer ends."""
    import atheris  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - only where it is asked for

    with atheris.instrument_imports(include=["simaps_viz"], exclude=compiled()):  # pyright: ignore[reportAttributeAccessIssue]
        from attacks.fuzz_cases import Finding, limit_time, try_case  # noqa: PLC0415 - instrumented as it is imported
        from attacks.fuzz_targets import TARGETS  # noqa: PLC0415 - as above
    warnings.simplefilter("ignore")
    work, corpus = folder / "work", folder / "corpus"
    work.mkdir()
    corpus.mkdir()
    source = Random(seed)
    for number in range(SEEDS):
        (corpus / str(number)).write_bytes(source.randbytes(SEED_BYTES))
    target = TARGETS[name]
    case = target.prepare(work)
    limit_time()
    done: dict[str, Any] = {"cases": 0, "accepted": 0, "refused": 0, "seconds": 0.0, "peak_bytes": 0, "findings": []}

    def tell() -> None:
        usage = resource.getrusage(resource.RUSAGE_SELF)
        done["seconds"], done["peak_bytes"] = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
        (folder / "told.json").write_text(json.dumps(done))

    def one(data: bytes) -> None:
        found = try_case(target, case, done["cases"], Fed(data))
        done["cases"] += 1
        if isinstance(found, Finding):
            done["findings"].append(vars(found) | {"detail": f"{found.detail} (bytes {data[:400].hex()})"})
        else:
            done[found] += 1
        if done["cases"] % 500 == 0 or done["cases"] == count:
            tell()

    tell()
    options = (f"-runs={count}", f"-max_total_time={int(seconds)}", f"-seed={seed + 1}", f"-max_len={LONGEST}",
               "-rss_limit_mb=6000", "-timeout=120", f"-artifact_prefix={folder}/")  # fmt: skip
    atheris.Setup([__file__, *options, str(corpus)], one)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]), Path(sys.argv[5]))
