"""The command line as other programs meet it: what is printed where, exit status, and nothing half-written."""

import json
import os
import signal
import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from sequences import frame_name, write_manifest, write_tiny_sequence

import simaps_viz
from simaps_viz import load_map
from simaps_viz.app.demo import SHIPPED_MAP
from simaps_viz.cli.main import main
from simaps_viz.drawing.legend import counted, counts_text, not_counted

pytestmark = pytest.mark.slow

SIMAPS = [sys.executable, "-m", "simaps_viz"]


@pytest.fixture
def sequence(tmp_path):
    folder = tmp_path / "tiny"
    write_tiny_sequence(folder)
    return folder


@pytest.fixture
def built(sequence, tmp_path):
    assert main(["build", str(sequence), "-o", str(tmp_path / "tiny.npz")]) == 0
    return tmp_path / "tiny.npz"


def test_build_writes_a_map_and_says_what_is_on_it(sequence, tmp_path, capsys):
    path = tmp_path / "m.npz"
    assert main(["build", str(sequence), "-o", str(path), "--method", "paper", "--k", "7", "--cell-size", "0.1"]) == 0
    out, err = capsys.readouterr()
    assert out == "" and "2 chairs · 2 instances" in err
    simap = load_map(path)
    assert simap.parameters["k_percent"] == 7.0 and simap.spec.cell_size_m == 0.1
    assert simap.provenance["sequence"] == str(sequence / "sequence.json")


def test_build_json_is_a_line_an_event(sequence, tmp_path, capsys):
    assert main(["build", str(sequence), "-o", str(tmp_path / "m.npz"), "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["event"] for line in lines] == ["started", "frame", "frame", "frame", "done"]
    assert lines[2] == {"event": "frame", "frame": frame_name(1), "done": 2, "total": 3}
    assert lines[-1]["counts"] == {"chair": 2} and lines[-1]["map"] == str(tmp_path / "m.npz")


def test_info(built, capsys):
    capsys.readouterr()
    assert main(["info", str(built), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["counts"] == {"chair": 2} and len(facts["instances"]) == 2 and facts["frames"] == 3
    assert main(["info", str(built)]) == 0
    shown = capsys.readouterr().out
    assert shown.count("chair") == 3 and "2 chairs" in shown


def test_info_counts_as_the_page_does(capsys):
    simap = load_map(SHIPPED_MAP)
    assert simap.hidden and simap.doubtful and simap.counts() != counted(simap)
    assert main(["info", str(SHIPPED_MAP)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    said = counts_text(simap, most=len(simap.grid.labels))  # beside the page's map: classes · all, some doubtful
    assert said.split(" · ")[0] in shown and said.split(", ")[-1] in shown
    assert main(["info", str(SHIPPED_MAP), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["counts"] == counted(simap)
    assert {one["id"]: one["not_counted"] for one in facts["instances"] if one["not_counted"]} == not_counted(
        simap, simap.doubtful
    )


def test_query_prints_a_line_a_command_each_from_the_given_pose(built, capsys):
    capsys.readouterr()
    arguments = ["query", str(built), "turn left", "turn right", "go to the piano", "--pose", "0", "-0.45", "0"]
    assert main([*arguments, "--json"]) == 1
    answers = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [a["status"] for a in answers] == ["ok", "ok", "refused"]
    assert [a["final_pose"][2] for a in answers[:2]] == [270.0, 90.0]
    assert answers[2]["reason"] == "There is no piano on this map."
    keys = {"status", "reason", "program", "goals", "path", "final_pose", "path_length_m"}
    assert keys <= set(answers[0])
    assert main([*arguments[:3], *arguments[5:]]) == 0


def damage(folder: Path, what: str) -> tuple[str, str]:
    """Break a tiny sequence; returns the name the message must hold and a word of what was expected."""
    depth = folder / "depth" / f"{frame_name(1)}.png"
    if what == "missing file":
        depth.unlink()
        return f"no depth file ({frame_name(1)})", "expected"
    if what == "truncated PNG":
        depth.write_bytes(depth.read_bytes()[:60])
        return depth.name, "expected a whole image"
    if what == "size mismatch":
        (folder / "intrinsics.txt").write_text("40 0 150\n0 40 11.5\n0 0 1\n")
        return "intrinsics.txt", "expected"
    if what == "NaN pose":
        text = (folder / "poses.txt").read_text().split("\n")
        text[1] = text[1].replace(" 1 ", " nan ", 1)
        (folder / "poses.txt").write_text("\n".join(text))
        return "poses.txt", "expected"
    write_manifest(folder, truth="segments", changes={"dpeth": "x"})
    return "sequence.json", "dpeth"


@pytest.mark.parametrize("what", ["missing file", "truncated PNG", "size mismatch", "NaN pose", "unknown key"])
def test_a_fault_is_one_line_with_status_2_and_nothing_written(sequence, tmp_path, what, capsys):
    name, expected = damage(sequence, what)
    before = sorted(os.listdir(tmp_path))
    record = ["--record", str(tmp_path / "m.rrd")]
    assert main(["build", str(sequence), "-o", str(tmp_path / "m.npz"), *record, "--strict"]) == 2
    err = capsys.readouterr().err
    message = [line for line in err.splitlines() if line.startswith("simaps: ")]
    assert len(message) == 1 and name in message[0] and expected in message[0]
    assert "Traceback" not in err
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.parametrize("output", ["missing/m.npz", "tiny"])
def test_an_unwritable_output_is_refused_before_building(sequence, tmp_path, output, capsys):
    assert main(["build", str(sequence), "-o", str(tmp_path / output)]) == 2
    err = capsys.readouterr().err
    assert "expected" in err and str(tmp_path / output) in err.replace("\n", "") and "mapping frames" not in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["info", "nowhere.npz"], "nowhere.npz: expected a map file"),
        (["build", "nowhere", "-o", "m.npz"], "nowhere"),
        (["view", "nowhere.npz", "--no-browser"], "nowhere.npz: expected a map file"),
    ],
)
def test_what_does_not_exist_is_named(tmp_path, monkeypatch, arguments, words, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert words in capsys.readouterr().err and os.listdir(tmp_path) == []


def test_options_without_sense_are_refused(sequence, tmp_path, capsys):
    build = ["build", str(sequence), "-o", str(tmp_path / "m.npz")]
    for extra, words in ((["--k", "101"], "K: expected"), (["--segmentation", "net.onnx"], "found nothing"),
                         (["--min-cells", "0"], "expected at least 1 cell")):  # fmt: skip
        assert main([*build, *extra]) == 2
        assert words in capsys.readouterr().err
    with pytest.raises(SystemExit) as usage:
        main(["build", str(sequence)])
    assert usage.value.code == 2


def test_ctrl_c_leaves_the_earlier_map_and_nothing_else(tmp_path):
    folder = tmp_path / "long"
    write_tiny_sequence(folder, frames=1000)  # whose events are more than a pipe holds that nobody reads on
    output, record = tmp_path / "m.npz", tmp_path / "m.rrd"
    output.write_bytes(b"an earlier map")
    command = [*SIMAPS, "build", str(folder), "-o", str(output), "--record", str(record), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        frames = (line for line in process.stdout if json.loads(line)["event"] == "frame")
        assert len(list(islice(frames, 100))) == 100
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=600)
    assert process.returncode == 130 and "interrupted" in err and "Traceback" not in err and "--resume" in err
    assert output.read_bytes() == b"an earlier map"
    assert sorted(os.listdir(tmp_path)) == [".m.npz.building", "long", "m.npz"]  # the log, to resume from


def test_rebuilding_gives_the_same_arrays(sequence, built, tmp_path):
    assert main(["build", str(sequence), "-o", str(tmp_path / "again.npz")]) == 0
    with np.load(built) as one, np.load(tmp_path / "again.npz") as two:
        assert set(one.files) == set(two.files)
        for name in one.files:
            assert np.array_equal(one[name], two[name], equal_nan=one[name].dtype.kind == "f"), name


def test_it_says_which_program_it_is(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"simaps {simaps_viz.__version__}\n"


@pytest.mark.parametrize("arguments", [["--help"], ["build", "--help"], ["info", "{built}"]])
def test_a_reader_that_has_gone_is_no_fault(arguments, built):
    """As `simaps --help | head` leaves it: a pipe that nobody reads any more."""
    reading, writing = os.pipe()
    os.close(reading)
    command = [*SIMAPS, *(word.format(built=built) for word in arguments)]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.returncode == 2 and done.stderr == ""
