"""Answers that nobody can read are an error; messages that nobody can read are none."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from sequences import write_tiny_sequence

from simaps_viz.cli.main import main

FULL = Path("/dev/full")
SIMAPS = [sys.executable, "-m", "simaps_viz"]

pytestmark = pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("full")
    write_tiny_sequence(made / "tiny")
    assert main(["build", str(made / "tiny"), "-o", str(made / "m.npz")]) == 0
    return made


@pytest.mark.parametrize("line", ["info m.npz", "--help"])
def test_an_answer_that_cannot_be_written_is_one_line(folder, line):
    with FULL.open("w") as full:
        done = subprocess.run(
            [*SIMAPS, *line.split()], cwd=folder, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert done.stderr == "simaps: stdout: could not write the answer: No space left on device\n"


def test_messages_that_cannot_be_written_do_not_stop_a_build(folder):
    with FULL.open("w") as full:
        done = subprocess.run(
            [*SIMAPS, "build", "tiny", "-o", "quiet.npz", "--json"],
            cwd=folder,
            stderr=full,
            stdout=subprocess.PIPE,
            check=False,
        )
    assert done.returncode == 0 and (folder / "quiet.npz").is_file()
    assert json.loads(done.stdout.splitlines()[-1])["event"] == "done"


def test_a_log_that_cannot_be_written_is_said_once_and_changes_nothing(folder):
    command = [*SIMAPS, "build", "tiny", "-o", "logged.npz", "--log", str(FULL)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and (folder / "logged.npz").is_file()
    assert done.stderr.count("the log ends here, it could not be written: No space left on device") == 1
    assert "Traceback" not in done.stderr and "Logging error" not in done.stderr


def test_a_log_that_cannot_be_opened_is_said_once(folder, capfd):
    assert main(["info", str(folder / "m.npz"), "--log", str(folder / "absent" / "log")]) == 2
    assert capfd.readouterr().err.count("expected a file in a folder that can be written for --log") == 1


def test_words_between_colons_are_no_pictures(folder, capsys):
    assert main(["info", "a:fire:b.npz"]) == 2
    assert "a:fire:b.npz: expected" in capsys.readouterr().err
