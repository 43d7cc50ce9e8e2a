"""Builds that are killed, stopped, or meet frames they cannot read: nothing is lost, and what happened is said."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from killed_builds import FRAMES, SMALL_DISK, damage, unfinished
from sequences import frame_name, write_tiny_sequence

from simaps_viz import load_map, open_sequence
from simaps_viz.build.build_log import frames_logged, log_path
from simaps_viz.build.pipeline import BuildConfig, build_map, gather_frames
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.events import FrameSkipped
from simaps_viz.recorder.library import repair_recording

ROOT = Path(__file__).parents[2]


@pytest.fixture
def sequence(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return tmp_path / "tiny"


def test_killed_builds_go_on_and_end_in_the_same_files(sequence):
    command = [sys.executable, str(ROOT / "apps" / "kill_builds.py"), "--sequence", str(sequence), "--every", "1"]
    done = subprocess.run(
        [*command, "--kills", "2", "--seed", "3"], check=False, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "| **all** | **2** | **0** |" in done.stdout


def test_resume_says_where_it_goes_on_and_ends_in_the_same_file(sequence, tmp_path, capsys):
    output, whole = tmp_path / "m.npz", tmp_path / "whole.npz"
    assert main(["build", str(sequence), "-o", str(whole)]) == 0
    unfinished(sequence, output, 41)
    capsys.readouterr()
    assert main(["build", str(sequence), "-o", str(output), "--resume"]) == 0
    assert f"resuming after 41 of {FRAMES} frames" in capsys.readouterr().err
    assert output.read_bytes() == whole.read_bytes()
    assert sorted(os.listdir(tmp_path)) == ["m.npz", "tiny", "whole.npz"]
    assert main(["build", str(sequence), "-o", str(output), "--resume"]) == 0
    assert "no unfinished build to resume" in capsys.readouterr().err


def test_a_resumed_recording_is_whole(sequence, tmp_path, capsys):
    pytest.importorskip("rerun")
    output, record = tmp_path / "m.npz", tmp_path / "m.rrd"
    unfinished(sequence, output, 50)
    assert main(["build", str(sequence), "-o", str(output), "--resume", "--record", str(record)]) == 0
    assert "all are read again, as the recording shows them" in capsys.readouterr().err
    assert repair_recording(record, tmp_path / "same.rrd") == FRAMES
    assert main(["build", str(sequence), "-o", str(tmp_path / "alone.npz")]) == 0
    assert output.read_bytes() == (tmp_path / "alone.npz").read_bytes()


def test_starting_anew_says_that_an_unfinished_build_is_kept_until_it_is_done(sequence, tmp_path, capsys):
    output = tmp_path / "m.npz"
    unfinished(sequence, output, 30)
    assert main(["build", str(sequence), "-o", str(output)]) == 0
    err = capsys.readouterr().err
    assert "an unfinished build of 30 frames was there; starting anew" in err and "--resume continues" in err
    assert sorted(os.listdir(tmp_path)) == ["m.npz", "tiny"]


def test_another_build_to_go_on_with_is_one_line(sequence, tmp_path, capsys):
    output = tmp_path / "m.npz"
    unfinished(sequence, output, 30)
    capsys.readouterr()
    assert main(["build", str(sequence), "-o", str(output), "--resume", "--affinity", "0.5"]) == 2
    message = [line for line in capsys.readouterr().err.splitlines() if line.startswith("simaps: ")]
    assert len(message) == 1 and "affinity (0.6, now 0.5)" in message[0]
    assert frames_logged(log_path(output)) == 30 and not output.exists()


def test_a_full_disk_leaves_the_earlier_map(sequence, tmp_path):
    output = tmp_path / "m.npz"
    output.write_bytes(b"an earlier map")
    command = [sys.executable, "-c", SMALL_DISK.format(bytes=90_000), "build", str(sequence), "-o", str(output)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=600)
    assert done.returncode == 2 and "could not write the build log: File too large" in done.stderr
    assert "Traceback" not in done.stderr and output.read_bytes() == b"an earlier map"
    assert 0 < frames_logged(log_path(output)) < FRAMES
    assert main(["build", str(sequence), "-o", str(output), "--resume"]) == 0
    assert len(load_map(output).frame_names) == FRAMES


def test_frames_that_cannot_be_read_are_skipped_named_and_counted(sequence, tmp_path, capsys):
    opened = open_sequence(sequence)
    damage(sequence, 7, 33)
    (sequence / "ids" / f"{frame_name(20)}.png").unlink()
    told = []

    class Listener:
        wants_color = False

        def on_event(self, event):
            told.append(event)

    simap = build_map(opened, observers=[Listener()])
    names = [frame_name(i) for i in (7, 20, 33)]
    assert [e.name for e in told if isinstance(e, FrameSkipped)] == names
    assert simap.provenance["skipped"] == {"frames": 3, "names": names}
    assert simap.frame_names == opened.frame_names and simap.grid.observations.max() == FRAMES - 3
    assert simap.counts() == {"chair": 2} and not set(simap.views.frame) & {7, 20, 33}
    build_map(opened, log=tmp_path / "log")
    assert build_map(opened, log=tmp_path / "log", resume=True).provenance == simap.provenance
    for log in (None, tmp_path / "log"):
        with pytest.raises(InputError, match=rf"{names[0]}.png: expected a whole image, found a truncated PNG"):
            build_map(opened, strict=True, log=log, resume=True)
    with pytest.raises(InputError, match="truncated PNG"):
        gather_frames(opened, BuildConfig(), range(5, 9), strict=True)


def test_the_command_skips_or_is_strict(sequence, tmp_path, capsys):
    damage(sequence, 7, 14)  # the second is looked at on opening, too
    (sequence / "ids" / f"{frame_name(20)}.png").write_bytes(b"")
    build = ["build", str(sequence), "-o", str(tmp_path / "m.npz")]
    assert main(build) == 0
    err = capsys.readouterr().err.replace("\n", " ")
    assert f"skipped frame {frame_name(7)}: " in err
    assert f"3 of {FRAMES} frames could not be read and were skipped" in err
    assert main([*build, "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["frame"] for line in lines if line["event"] == "skipped"] == [frame_name(i) for i in (7, 14, 20)]
    assert lines[-1]["skipped"] == 3 and lines[-1]["notes"] == []
    assert main([*build, "--strict"]) == 2
    assert f"{frame_name(14)}.png: expected a whole image" in capsys.readouterr().err.replace("\n", "")


@pytest.mark.parametrize(
    ("broken", "words"), [(range(31), "and 30 more of 60 frames"), (range(20), "and 19 more of 60")]
)
def test_too_many_frames_that_cannot_be_read_are_an_error(sequence, broken, words):
    opened = open_sequence(sequence)
    later = [*broken][-1] > 20
    damage(sequence, *([i + 1 for i in broken] if later else broken))
    with pytest.raises(InputError, match=f"truncated PNG.*{words}"):
        build_map(opened)


def test_methods_without_a_log_say_so(sequence, tmp_path, capsys):
    for option in ("--resume", "--history"):
        assert main(["build", str(sequence), "-o", str(tmp_path / "m.npz"), "--method", "vlmaps", option]) == 2
        listed = "evidence, components, paper"  # what `build` takes, not what an evaluation takes besides
        wanted = f"{option}: expected a method that keeps a log ({listed}), found vlmaps"
        assert wanted in " ".join(capsys.readouterr().err.split())


def test_what_a_killed_save_left_of_map_and_history_goes_with_the_next_build(tmp_path):
    sequence = write_tiny_sequence(tmp_path / "tiny")
    left = [tmp_path / name for name in (".m.npz.abcd1234", ".m.npz.A-cd_234", ".m.steps.abcd1234")]
    others = [tmp_path / name for name in (".m.steps.mine", ".m.npz.abc.1234", ".n.steps.abcd1234")]
    for path in (*left, *others):
        path.write_bytes(b"half")
    assert main(["build", str(sequence), "-o", str(tmp_path / "m.npz"), "--history"]) == 0
    assert not any(path.exists() for path in left) and all(path.exists() for path in others)
