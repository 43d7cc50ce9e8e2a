"""What may have changed while a build was stopped, and who else may build the same map: never a map of two things."""

import json
import os
import shutil
import subprocess
import sys
import threading

import numpy as np
import pytest
from build_logs import keep_log
from killed_builds import SMALL_DISK, damage, unfinished
from sequences import frame_name, write_tiny_sequence

from simaps_viz import load_map, open_sequence
from simaps_viz.build import to_file
from simaps_viz.build.build_log import BuildLog, LogBusyError, frames_logged, log_path
from simaps_viz.build.pipeline import BuildConfig, fingerprint
from simaps_viz.build.to_file import BuildRequest, build_to_file
from simaps_viz.cli.main import main
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.mapping.history import MapHistory

FRAMES = 30


@pytest.fixture
def sequence(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return tmp_path / "tiny"


@pytest.fixture
def whole(sequence, tmp_path):
    """The map of a build that nobody stopped."""
    assert main(["build", str(sequence), "-o", str(tmp_path / "whole.npz")]) == 0
    return (tmp_path / "whole.npz").read_bytes()


def camera(sequence):
    path = sequence / "intrinsics.txt"
    K = np.loadtxt(path)
    K[0, 0] *= 1.1
    np.savetxt(path, K)


def table(sequence):
    path = sequence / "segments.json"
    frames = json.loads(path.read_text())
    segment = next(iter(frames[frame_name(7)]))
    segment["score"] = 0.125
    path.write_text(json.dumps(frames))


@pytest.mark.parametrize("change", [camera, table])
def test_a_build_does_not_go_on_with_another_camera_or_other_segments(sequence, change, tmp_path, capsys):
    output = tmp_path / "m.npz"
    unfinished(sequence, output, 20)
    change(sequence)
    capsys.readouterr()
    assert main(["build", str(sequence), "-o", str(output), "--resume"]) == 2
    assert "found another names, poses, cameras and tables" in capsys.readouterr().err
    assert not output.exists() and frames_logged(log_path(output)) == 20


def test_a_build_goes_on_from_another_folder(sequence, tmp_path, monkeypatch, whole, capsys):
    output = tmp_path / "m.npz"
    monkeypatch.chdir(tmp_path)
    unfinished(sequence.relative_to(tmp_path), output, 20)
    monkeypatch.chdir("/")
    assert main(["build", str(sequence), "-o", str(output), "--resume"]) == 0
    assert f"resuming after 20 of {FRAMES}" in capsys.readouterr().err
    assert output.read_bytes() == whole


@pytest.mark.parametrize("strict", [(), ("--strict",)])
def test_a_frame_put_right_since_is_read(sequence, strict, tmp_path, whole):
    output, image = tmp_path / "m.npz", sequence / "depth" / f"{frame_name(5)}.png"
    good = image.read_bytes()
    damage(sequence, 5)
    unfinished(sequence, output, 20)
    image.write_bytes(good)
    assert main(["build", str(sequence), "-o", str(output), "--resume", *strict]) == 0
    assert output.read_bytes() == whole


def test_a_frame_still_damaged_stays_skipped_and_what_follows_is_not_read_again(sequence, tmp_path):
    output = tmp_path / "m.npz"
    damage(sequence, 5)
    unfinished(sequence, output, 20)
    damage(sequence, 11)  # was read before; would be skipped if it was read again
    assert main(["build", str(sequence), "-o", str(output), "--resume"]) == 0
    assert load_map(output).provenance["skipped"] == {"frames": 1, "names": [frame_name(5)]}


def test_nobody_builds_a_map_while_it_is_being_saved(sequence, tmp_path, monkeypatch):
    """The second build would set the first one's log aside, and its frames would become the first one's history."""
    output, saving, go_on = tmp_path / "m.npz", threading.Event(), threading.Event()
    save = to_file.save_map

    def held(simap, path):
        saving.set()
        assert go_on.wait(60)
        save(simap, path)

    monkeypatch.setattr(to_file, "save_map", held)
    opened = open_sequence(sequence)
    request = BuildRequest("evidence", BuildConfig(), output, history=True)

    def first():
        with stage_progress(quiet=True) as progress:
            build_to_file(opened, request, progress)

    one = threading.Thread(target=first)
    one.start()
    assert saving.wait(60)
    with pytest.raises(LogBusyError, match="one build at a time"), stage_progress(quiet=True) as progress:
        build_to_file(opened, request, progress)
    go_on.set()
    one.join()
    assert MapHistory.open(tmp_path / "m.steps").is_of(load_map(output))
    assert sorted(os.listdir(tmp_path)) == ["m.npz", "m.steps", "tiny"]


def test_a_log_removed_by_its_build_is_not_written_by_who_waited_for_it(sequence, tmp_path):
    """Between opening a log and locking it, its build may have ended and removed it."""
    path, facts = tmp_path / "log", fingerprint(open_sequence(sequence), BuildConfig())
    with BuildLog(path, facts):
        late = object.__new__(BuildLog)
        late.path, late.records, late._synced = path, [], 0.0
        late._file = open(path, "r+b", buffering=0)  # noqa: SIM115 - the log closes it
        path.unlink()
    late._lock()
    late._begin(facts, resume=False)
    late.close()
    assert path.is_file() and frames_logged(path) == 0


@pytest.mark.parametrize("history", [False, True])
def test_a_file_of_somebody_else_beside_the_map_stays(sequence, history, tmp_path, capsys):
    notes = tmp_path / "m.steps"
    notes.write_text("notes")
    arguments = ["build", str(sequence), "-o", str(tmp_path / "m.npz"), *(["--history"] if history else [])]
    assert main(arguments) == (2 if history else 0)
    assert notes.read_text() == "notes"
    if history:
        assert f"{notes}: expected the history of an earlier map or nothing" in capsys.readouterr().err


def test_an_earlier_history_goes_with_the_map_it_was_of(sequence, tmp_path):
    output = tmp_path / "m.npz"
    unfinished(sequence, output, FRAMES)
    keep_log(log_path(output), tmp_path / "m.steps")
    assert main(["build", str(sequence), "-o", str(output)]) == 0
    assert sorted(os.listdir(tmp_path)) == ["m.npz", "tiny"]


def test_a_recording_that_does_not_fit_on_the_disk_costs_no_map(sequence, tmp_path, whole):
    pytest.importorskip("rerun")
    record = tmp_path / "m.rrd"
    record.write_bytes(b"an earlier recording")
    command = ["build", str(sequence), "-o", str(tmp_path / "m.npz"), "--record", str(record)]
    done = subprocess.run(
        [sys.executable, "-c", SMALL_DISK.format(bytes=250_000), *command], check=False, capture_output=True, text=True
    )
    assert done.returncode == 2, done.stderr
    assert f"{record}: could not write the recording" in done.stderr and "Traceback" not in done.stderr
    assert (tmp_path / "m.npz").read_bytes() == whole
    assert record.read_bytes() == b"an earlier recording"
    assert sorted(os.listdir(tmp_path)) == ["m.npz", "m.rrd", "tiny", "whole.npz"]


def test_a_recording_without_its_end_does_not_get_its_name(tmp_path, monkeypatch):
    """rerun says nothing when the end of a file cannot be written."""
    from recorded_story import story  # noqa: PLC0415 - rerun is slow to import

    from simaps_viz.recorder import recorder as module  # noqa: PLC0415 - as above

    path = tmp_path / "a.rrd"
    path.write_bytes(b"an earlier recording")
    end = module.RerunRecorder._disconnect

    def cut(recorder):
        end(recorder)
        os.truncate(recorder._partial, os.path.getsize(recorder._partial) - 100)

    monkeypatch.setattr(module.RerunRecorder, "_disconnect", cut)
    with pytest.raises(InputError, match="could not write the recording"), module.RerunRecorder(path) as recorder:
        for event in story():
            recorder.on_event(event)
    assert path.read_bytes() == b"an earlier recording" and os.listdir(tmp_path) == ["a.rrd"]


def test_copies_of_a_sequence_are_the_same_build(sequence, tmp_path, whole, capsys):
    output = tmp_path / "m.npz"
    unfinished(sequence, output, 20)
    shutil.move(sequence, tmp_path / "moved")
    assert main(["build", str(tmp_path / "moved"), "-o", str(output), "--resume"]) == 0
    assert np.array_equal(load_map(output).grid.label, load_map(tmp_path / "whole.npz").grid.label)
