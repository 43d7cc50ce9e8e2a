"""Checks of the machine: ports, memory, clock."""

import os
import socket
import time
from datetime import UTC, datetime
from pathlib import Path

from simaps_viz.installation.finding import Finding

LITTLE_MEMORY_GB = 2.0
A_DAY_S = 86_400.0


def check_port(port: int) -> Finding:
    """Check whether the page's port on 127.0.0.1 is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or str(error)
            return Finding("port", "warn", f"127.0.0.1:{port} cannot be used ({why})",
                           "the page takes the next free one; --port chooses another")  # fmt: skip
    return Finding("port", "ok", f"127.0.0.1:{port} is free")


def check_memory(meminfo: Path = Path("/proc/meminfo")) -> Finding:
    """Check how much memory is left."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        lines = dict(line.split(":", 1) for line in meminfo.read_text().splitlines() if ":" in line)
        free_gb = int(lines["MemAvailable"].split()[0]) / 1e6
    except (OSError, KeyError, ValueError):
        return Finding("memory", "ok", f"unknown; {cores} cores")
    found = f"{free_gb:.1f} GB free, {cores} cores"
    if free_gb < LITTLE_MEMORY_GB:
        return Finding("memory", "warn", found, "close other programs: the demo with its page takes some 1.5 GB")
    return Finding("memory", "ok", found)


def check_clock(now_s: float | None = None) -> Finding:
    """Check that the clock is not behind the program's own files, and not years ahead of them."""
    now_s = time.time() if now_s is None else now_s
    newest_s = max(path.stat().st_mtime for path in Path(__file__).parent.glob("*.py"))
    said = datetime.fromtimestamp(now_s, tz=UTC).isoformat(timespec="seconds") if 0 <= now_s < 2e11 else str(now_s)
    if now_s < newest_s - A_DAY_S:
        return Finding("clock", "warn", f"{said} is before this program was installed",
                       "set it: certificates, logs and the newest recording go by it")  # fmt: skip
    return Finding("clock", "ok", said)
