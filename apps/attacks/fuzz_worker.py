"""Runs some cases of one target in a process of its own, so that a crash or a huge allocation ends only this one."""

import faulthandler
import json
import os
import resource
import sys
import tempfile
import time
import warnings
from pathlib import Path

from attacks.fuzz_cases import Finding, choices, limit_time, try_case
from attacks.fuzz_targets import TARGETS

ROOM = 3 << 30
"""Bytes of memory that the cases may ask for on top of what the program itself takes."""
STUCK_S = 300.0
"""A case that is stuck in a library for so long ends the process."""


def main(name: str, seed: int, first: int, count: int, seconds: float, progress: str) -> None:
    """Run cases until there are enough of them or time is up; prints what came of them as JSON."""
    warnings.simplefilter("ignore")
    target = TARGETS[name]
    scratch = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    done = {"cases": 0, "accepted": 0, "refused": 0}
    findings: list[Finding] = []
    with tempfile.TemporaryDirectory(dir=scratch) as folder, Path(progress).open("r+b", buffering=0) as at:
        case = target.prepare(Path(folder))
        _limit_memory()
        limit_time()
        began, used = time.monotonic(), time.process_time()
        for number in range(first, first + count):
            at.seek(0)
            at.write(number.to_bytes(8, "little"))
            faulthandler.dump_traceback_later(STUCK_S, exit=True)
            found = try_case(target, case, number, choices(name, seed, number))
            done["cases"] += 1
            if isinstance(found, Finding):
                findings.append(found)
            else:
                done[found] += 1
            if time.monotonic() - began > seconds:
                break
        faulthandler.cancel_dump_traceback_later()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    record = {
        **done,
        "seconds": time.process_time() - used,
        "peak_bytes": peak,
        "findings": [vars(f) for f in findings],
    }
    sys.stdout.write("\n" + json.dumps(record) + "\n")
    sys.stdout.flush()
    os._exit(0)  # servers and readers of some targets keep threads


def _limit_memory() -> None:
    """Make a huge allocation fail instead of filling the machine."""
    status = Path("/proc/self/statm")
    if status.is_file():
        size = int(status.read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, size + ROOM))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    wanted, numbers = sys.argv[1], [int(word) for word in sys.argv[2:5]]
    main(wanted, numbers[0], numbers[1], numbers[2], float(sys.argv[5]), sys.argv[6])
