"""The log: what people see, what programs read, and that nothing of it is left behind for the next command."""

import json
import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from sequences import frame_name, write_tiny_sequence

from simaps_viz.cli import main
from simaps_viz.console.logs import LogOptions, logged, logger, take_log_options
from simaps_viz.console.progress import StageClock, stage_progress
from simaps_viz.errors import InputError


class Time:
    now = 100.0

    def __call__(self) -> float:
        return self.now


def test_stages_are_measured_one_after_another():
    time = Time()
    clock = StageClock(time)
    assert clock.seconds() == {}
    for stage, lasts in (("open", 1.0), ("map", 2.0), ("map", 0.5), ("write", 0.25), ("map", 4.0)):
        clock.begin(stage)
        time.now += lasts
    assert clock.seconds() == {"open": 1.0, "map": 6.5, "write": 0.25}
    clock.end()
    time.now += 50
    clock.end()
    assert clock.seconds() == {"open": 1.0, "map": 6.5, "write": 0.25}


COMMAND_LINES = [
    (["build", "x", "--verbose", "-o", "m"], ["build", "x", "-o", "m"], True, None),
    (["--log", "a.jsonl", "info", "m"], ["info", "m"], False, "a.jsonl"),
    (["info", "m", "--log=b"], ["info", "m"], False, "b"),
    (["query", "m", "--", "--verbose", "--log"], ["query", "m", "--", "--verbose", "--log"], False, None),
    ([], [], False, None),
]


@pytest.mark.parametrize(("line", "rest", "verbose", "file"), COMMAND_LINES)
def test_the_logs_options_stand_anywhere(line, rest, verbose, file):
    found, options = take_log_options(line)
    assert found == rest and options.verbose is verbose and (options.file and str(options.file)) == file


@given(st.lists(st.text(max_size=6)))
def test_all_other_words_are_left_as_they_are(words):
    words = [word for word in words if not word.startswith("--")]
    assert take_log_options([*words, "--verbose"])[0] == words


@pytest.mark.parametrize("line", [["--log"], ["--log="], ["--log", "--json"]])
def test_a_log_needs_a_file(line, capsys):
    assert main.main(["info", "m.npz", *line]) == main.BAD_INPUT
    assert "--log: expected a file to append to" in capsys.readouterr().err


def lines(path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()]


@pytest.fixture
def sequence(tmp_path):
    write_tiny_sequence(tmp_path / "tiny")
    return tmp_path / "tiny"


STAGES = ["mapping frames", "finding communities", "finding instances", "joining communities",
          "describing instances", "looking at colours", "writing"]  # fmt: skip


def test_a_build_says_how_long_its_stages_took(sequence, tmp_path, capsys):
    file = tmp_path / "log.jsonl"
    build = ["build", str(sequence), "-o", str(tmp_path / "m.npz")]
    assert main.main([*build, "--verbose", "--log", str(file)]) == 0
    err = capsys.readouterr().err
    for stage in (*STAGES, "together"):
        assert sum(line.startswith(stage) and line.endswith(" s") for line in err.splitlines()) == 1
    logged_lines = lines(file)
    assert logged_lines[0]["event"] == "started" and logged_lines[0]["command"] == "build"
    assert logged_lines[0]["options"]["mapping"]["affinity"] == 0.6
    assert [one["stage"] for one in logged_lines if one["event"] == "stage"] == STAGES
    stages = {one["stage"]: one["seconds"] for one in logged_lines if one["event"] == "stage"}
    (total,) = (one["seconds"] for one in logged_lines if one["event"] == "stages")
    assert total == pytest.approx(sum(stages.values()), abs=1e-3)
    end = logged_lines[-1]
    assert end["event"] == "ended" and end["status"] == 0 and end["seconds"] >= total > 0
    assert all({"time", "level", "logger", "message", "process", "thread"} <= set(one) for one in logged_lines)
    assert all(one["time"].endswith("+00:00") for one in logged_lines)
    assert main.main([*build, "--json"]) == 0
    out, err = capsys.readouterr()
    assert list(json.loads(out.splitlines()[-1])["seconds"]) == STAGES and err == ""


def test_without_verbose_nothing_is_said(sequence, tmp_path, capsys):
    assert main.main(["build", str(sequence), "-o", str(tmp_path / "m.npz")]) == 0
    assert "describing instances" not in capsys.readouterr().err


def test_errors_and_skipped_frames_are_logged_and_said_once(sequence, tmp_path, capsys):
    file = tmp_path / "log.jsonl"
    write_tiny_sequence(sequence, frames=12)
    (sequence / "depth" / f"{frame_name(1)}.png").write_bytes(b"no image")
    arguments = ["build", str(sequence), "-o", str(tmp_path / "m.npz"), "--log", str(file)]
    assert main.main(arguments) == 0
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith(f"skipped frame {frame_name(1)}")]
    assert len(said) == 1
    (skipped,) = (one for one in lines(file) if one["event"] == "skipped")
    assert skipped["frame"] == frame_name(1) and skipped["level"] == "warning" and "people" not in skipped
    assert main.main([*arguments, "--strict"]) == 2
    assert capsys.readouterr().err.count("expected an image, found one that cannot be decoded") == 1
    errors = [one for one in lines(file) if one["event"] == "error"]
    assert len(errors) == 1 and errors[0]["level"] == "error"
    assert lines(file)[-1]["status"] == 2, "and the log of the first build was kept"


def test_a_fault_of_the_program_is_logged_whole(tmp_path, capsys):
    file, error = tmp_path / "log.jsonl", Console(stderr=True)
    with pytest.raises(ZeroDivisionError), logged(LogOptions(file=file), error):
        raise ZeroDivisionError("never mind")
    (fault,) = lines(file)
    assert fault["level"] == "critical" and "test_logs.py" in fault["exception"] and "never mind" in fault["exception"]
    assert capsys.readouterr().err == ""


def test_nothing_is_left_for_the_next_command(tmp_path):
    before = (list(logger.handlers), logger.level, logger.propagate)
    with logged(LogOptions(True, tmp_path / "a"), Console(stderr=True)):
        assert len(logger.handlers) == len(before[0]) + 2
    assert (list(logger.handlers), logger.level, logger.propagate) == before


@pytest.mark.parametrize("where", ["missing/log", ""])
def test_a_log_that_cannot_be_written_is_refused_before_anything(sequence, tmp_path, where, capsys):
    arguments = ["build", str(sequence), "-o", str(tmp_path / "m.npz"), "--log", str(tmp_path / where)]
    assert main.main(arguments) == main.BAD_INPUT
    assert "for --log" in capsys.readouterr().err and not (tmp_path / "m.npz").exists()


def test_warnings_of_the_page_reach_people(capsys):
    with logged(LogOptions(), Console(stderr=True, width=200)):
        child = logging.getLogger("simaps_viz.viewer.server.host")
        child.info("quiet")
        try:
            raise ValueError("odd event")
        except ValueError:
            child.exception("an event could not be handled")
    err = capsys.readouterr().err
    assert err.strip() == "an event could not be handled: ValueError: odd event"


def test_interrupted_stages_are_still_told(tmp_path):
    file = tmp_path / "log"
    with logged(LogOptions(file=file), Console(stderr=True)), pytest.raises(InputError), stage_progress(
        quiet=True
    ) as progress:  # fmt: skip
        progress("reading", 1, 3)
        raise InputError("enough")
    assert [one["stage"] for one in lines(file)] == ["reading"]
