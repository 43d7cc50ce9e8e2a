"""Command lines as somebody new to it types them: what is wrong is said in one line, before any work is done."""

import json
import os
import re

import pytest
from sequences import write_tiny_sequence
from toy_maps import toy_map

from simaps_viz import save_map
from simaps_viz.cli import COMMANDS
from simaps_viz.cli.main import main, parse


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with a map, a sequence, a text under several names, and nothing else; the current one."""
    monkeypatch.chdir(tmp_path)
    save_map(toy_map(), tmp_path / "toy.npz")
    write_tiny_sequence(tmp_path / "tiny")
    for name in ("text.rrd", "text.json", "empty.npz"):
        (tmp_path / name).write_text("hello" if name != "empty.npz" else "")
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_every_help_has_an_example_that_the_command_line_understands(command, capsys):
    with pytest.raises(SystemExit) as helped:
        main([command, "--help"])
    assert helped.value.code == 0
    example = re.search(rf"Example: (.*; )?simaps ({command} .*?)(\n\n|; simaps)", capsys.readouterr().out, re.DOTALL)
    assert example, f"no example in simaps {command} --help"
    words = re.findall(r'"[^"]*"|\S+', example[2])
    parsed = parse([word.strip('"') for word in words])
    assert type(parsed).__name__.lower() == command.replace("-", "")


def test_commands_are_all_there():
    assert {"build", "describe", "export-network", "live", "doctor"} <= set(COMMANDS) and len(COMMANDS) == 19


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("demo --port 99999", "--port: expected 0 to 65535, found 99999"),
        ("view toy.npz --no-browser --port -1", "--port: expected 0 to 65535, found -1"),
        ("judge runs.jsonl demo --port 70000", "--port: expected"),
        ("doctor --no-browser --port 70000", "--port: expected"),
        ("view nowhere --no-browser", "nowhere: expected a map file (.npz), a sequence or a recorded build (.rrd)"),
        ("view nowhere --segmentation net.onnx", "nowhere: expected a map file (.npz), a sequence or a recorded build"),
        ("view toy.npz --segmentation net.onnx", "toy.npz: expected a sequence with --segmentation, found a map"),
        ("view nowhere.rrd --no-browser", "nowhere.rrd: expected a map file (.npz), a sequence or a recorded build"),
        ("view toy.npz --no-browser --recording text.rrd", "text.rrd: expected a finished rerun recording"),
        ("view toy.npz --no-browser --recording toy.npz", "toy.npz: expected a finished rerun recording"),
        ("build nowhere -o m.npz", "nowhere: expected a recording of a format that is read, or a manifest, found"),
        ("check nowhere.json", "nowhere.json: expected a recording of a format that is read, or a manifest, found"),
        ("check toy.npz", "toy.npz: expected a recording of a format that is read, or a manifest, found a map, which"),
        ("build tiny -o m.npz --max-depth -1", "largest depth: expected more than 0.1 m, the smallest, found -1 m"),
        ("build tiny -o m.npz --cut-height -2", "cut height: expected a height over the floor, metres, found -2 m"),
        ("build tiny -o m.txt", "m.txt: expected a map's name that ends in .npz (a building's in .json), found .txt"),
        ("build tiny -o m", "m: expected a map's name that ends in .npz (a building's in .json), found no ending"),
        ("build tiny -o tiny/sequence.json", "tiny/sequence.json: expected the building file of an earlier build"),
        ("mend toy.npz -o m.txt", "m.txt: expected a map's name that ends in .npz, found .txt"),
        ("evaluate tiny --methods evidence,foo", "method: expected one of evidence, components"),
        ("evaluate tiny --seeds 0", "at least one method and one seed, found 5 methods and 0 seeds"),
        ("evaluate tiny --record m.png", "m.png: expected a recording's name that ends in .rrd"),
        ("evaluate tiny --judge runs.jsonl", "--judge: expected --task navigation, found --task instances"),
        ("evaluate tiny --task navigation --picture m.png", "--picture: expected --task instances, found"),
        ("evaluate tiny --task ablation --counts chair=2", "--counts: expected --task instances, found"),
        ("segment tiny nowhere.onnx -o m.txt", "m.txt: expected a manifest's name (.json) to write masks for"),
        ("segment tiny nowhere.onnx -o tiny/sequence.json", "expected another name than the sequence's own manifest"),
        ("judge nowhere.jsonl demo", "nowhere.jsonl: expected a session file, found No such file or directory"),
    ],
)
def test_a_wrong_line_is_answered_in_one_before_any_work(folder, line, words, capsys, monkeypatch):
    monkeypatch.setattr("simaps_viz.app.workbench.serve", lambda *_, **__: pytest.fail("served"))
    before = sorted(os.listdir(folder)), (folder / "tiny" / "sequence.json").read_bytes()
    assert main(line.split()) == 2
    err = capsys.readouterr().err
    said = [one for one in err.splitlines() if one.startswith("simaps: ")]
    assert len(said) == 1 and words in said[0] and "Errno" not in err
    assert not any(word in err for word in ("mapping frames", "simulating network errors", "Traceback"))
    assert (sorted(os.listdir(folder)), (folder / "tiny" / "sequence.json").read_bytes()) == before


def test_a_shared_command_that_fails_says_why(folder, capsys):
    line = ["share", "toy.npz", "-o", "toy.html", "--command", "go to the chair", "--pose", "900", "0", "0"]
    assert main(line) == 1
    err = capsys.readouterr().err
    assert "toy.html: " in err and '"go to the chair" failed: The robot cannot start at (900.00, 0.00)' in err
    assert main([*line, "--json"]) == 1
    assert "cannot start" in json.loads(capsys.readouterr().out)["outcome"]


def test_convert_says_how_many_frames_it_wrote(folder, capsys):
    assert main(["convert", "tiny", "-o", "half", "--every", "2"]) == 0
    written = len(os.listdir(folder / "half" / "depth"))
    assert f"half/sequence.json: {written} frames, segmentation " in capsys.readouterr().err and written > 1
