"""What a person sees on a real terminal: bars that move while the work goes on, and messages above them."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from sequences import frame_name, write_tiny_sequence

pty = pytest.importorskip("pty", reason="no terminals to make here")

BARS = """
import sys
import time
from pathlib import Path
from simaps_viz.console.progress import stage_progress
from simaps_viz.console.terminal import console
with stage_progress() as progress:
    for done in range(5):
        progress("mapping frames", done, 5)
        while not Path(sys.argv[1], str(done)).exists():
            time.sleep(0.01)
        if done == 2:
            console.print("a message of some length")
    progress("mapping frames", 5, 5)
"""
BOUNDED = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
resource.setrlimit(resource.RLIMIT_CPU, (600, 600))
os.execv(sys.argv[1], sys.argv[1:])
"""
"""A program that writes to itself would take all there is."""
SIMAPS = [sys.executable, "-m", "simaps_viz"]


def plain(seen: bytes) -> str:
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", seen.decode(errors="replace"))


def on_terminal(command: list[str], folder: Path, watch: Callable[[str], None] = lambda seen: None) -> tuple[int, str]:
    """Run a command on a terminal of its own; returns its status and all that appeared there, in order.

    ``watch`` is called with all that has appeared so far, whenever there is more.
    """
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    bounded = [sys.executable, "-c", BOUNDED, *command]
    process = subprocess.Popen(bounded, cwd=folder, env=environment, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    seen = b""
    while True:
        try:
            part = os.read(ours, 1 << 16)
        except OSError:  # the terminal's other end is closed
            break
        seen += part
        watch(plain(seen))
        assert len(seen) < 1 << 20, "the terminal is flooded"
    os.close(ours)
    return process.wait(), plain(seen)


def test_bars_move_and_a_message_is_written_once_above_them(tmp_path):
    def watch(seen):
        for done in re.findall(r"(\d)/5", seen):
            (tmp_path / done).touch()  # the work goes on once its bar is drawn, and would stand still without

    status, seen = on_terminal([sys.executable, "-c", BARS, str(tmp_path)], tmp_path, watch)
    assert status == 0
    assert seen.count("a message of some length") == 1
    before, after = seen.split("a message of some length")
    assert {"0/5", "1/5", "2/5"} <= set(re.findall(r"\d/5", before))
    assert {"3/5", "4/5", "5/5"} <= set(re.findall(r"\d/5", after)) and "0/5" not in after


def test_a_build_shows_its_frames_and_says_what_it_skipped(tmp_path):
    write_tiny_sequence(tmp_path / "tiny")
    (tmp_path / "tiny" / "depth" / f"{frame_name(1)}.png").write_bytes(b"no picture")
    status, seen = on_terminal([*SIMAPS, "build", "tiny", "-o", "m.npz"], tmp_path)
    assert status == 0 and (tmp_path / "m.npz").is_file()
    assert seen.count(f"skipped frame {frame_name(1)}") == 1
    assert "mapping frames" in seen and "3/3" in seen and "2 chairs" in seen
