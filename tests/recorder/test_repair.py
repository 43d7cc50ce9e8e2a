"""The recording a killed build leaves is mended: it opens, verifies, and shows the frames that were whole."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from sequences import write_tiny_sequence

from simaps_viz.errors import InputError
from simaps_viz.recorder import library
from simaps_viz.recorder.library import repair_recording, unfinished_recordings

pytestmark = pytest.mark.slow

KILLED = """
import os, signal, sys
from pathlib import Path
from simaps_viz import build_map, open_sequence
from simaps_viz.recorder.recorder import RerunRecorder

class Kill:
    wants_color, events = False, 0
    def on_event(self, event):
        self.events += 1
        if self.events in (10, 20):
            recorder.flush()  # rerun does so every so often; twice here, so that a torn end costs only the last frames
        if self.events == 30:
            os.kill(os.getpid(), signal.SIGKILL)

with RerunRecorder(Path(sys.argv[2])) as recorder:
    build_map(open_sequence(Path(sys.argv[1])), observers=[recorder, Kill()])
"""


def verified(path):
    command = [str(Path(sys.executable).parent / "rerun"), "rrd", "verify", str(path)]
    home = {"HOME": str(path.parent), "XDG_CONFIG_HOME": str(path.parent)}
    return subprocess.run(command, check=False, capture_output=True, env=home).returncode == 0


def test_a_full_disk_is_not_blamed_on_the_recording(tmp_path, monkeypatch):
    record = tmp_path / "m.rrd"
    record.write_bytes(b"a recording")
    said = "Error: couldn't encode messages: Failed to write: No space left on device (os error 28)"  # rerun 0.41
    failed = subprocess.CompletedProcess([], 1, "", said)
    monkeypatch.setattr(library.subprocess, "run", lambda *_, **__: failed)
    with pytest.raises(InputError, match=f"^{record}: could not write the recording: No space left on device$"):
        repair_recording(record, record)
    assert record.read_bytes() == b"a recording" and os.listdir(tmp_path) == ["m.rrd"]


def test_a_killed_builds_recording_is_mended(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=40)
    record = tmp_path / "m.rrd"
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "tiny"), str(record)], check=False)
    (left,) = unfinished_recordings(record)
    assert not record.exists() and not verified(left)
    frames = repair_recording(left, record)
    assert 0 < frames <= 29 and verified(record)
    assert record.stat().st_mode == left.stat().st_mode  # the rights any new file gets, as without the kill
    torn = tmp_path / "torn.rrd"
    torn.write_bytes(left.read_bytes()[:-7])
    assert repair_recording(torn, torn) <= frames and verified(torn)
    for junk in (b"", left.read_bytes()[:100]):
        torn.write_bytes(junk)
        with pytest.raises(InputError, match="found no whole frame in it"):
            repair_recording(torn, record)
    assert verified(record) and [name for name in os.listdir(tmp_path) if name.startswith(".m.")] == [left.name]
    with pytest.raises(InputError, match="found nothing"):
        repair_recording(tmp_path / "nowhere.rrd", record)
