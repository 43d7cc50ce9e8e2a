"""The pipe before a recording's file: all that is put in is written, and who puts it in never waits for the disk."""

import os
import tempfile
from pathlib import Path

import pytest
import rerun.chunk as rc
from recorded_story import rows, story

from simaps_viz.errors import InputError
from simaps_viz.recorder.recorder import FilePipe, RerunRecorder

CONTENT = os.urandom(5_000_000)


@pytest.fixture(autouse=True)
def pipes(tmp_path, monkeypatch):
    """Where the pipes are made."""
    folder = tmp_path / "pipes"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def put_in(pipe: FilePipe, content: bytes) -> None:
    with pipe.entrance.open("wb") as entrance:
        pipe.opened()
        entrance.write(content)


def test_what_is_put_in_is_in_the_file_and_the_pipe_is_gone(tmp_path, pipes) -> None:
    pipe = FilePipe(tmp_path / "a.rrd")
    assert pipe.entrance.is_fifo() and pipe.entrance.stat().st_mode & 0o077 == 0
    put_in(pipe, CONTENT)
    assert list(pipes.iterdir()) == []
    pipe.finish()
    assert (tmp_path / "a.rrd").read_bytes() == CONTENT


def test_a_full_disk_is_told_at_the_end_and_nobody_waits() -> None:
    pipe = FilePipe(Path("/dev/full"))
    put_in(pipe, CONTENT)  # far more than a pipe holds
    with pytest.raises(OSError, match="No space left"):
        pipe.finish()


@pytest.mark.parametrize("missing", ["pipes", "a place for them"])
def test_without_pipes_the_file_is_written_as_it_is(tmp_path, pipes, monkeypatch, missing) -> None:
    if missing == "pipes":
        monkeypatch.delattr(os, "mkfifo")
    else:
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    pipe = FilePipe(tmp_path / "a.rrd")
    assert pipe.entrance == tmp_path / "a.rrd"
    put_in(pipe, CONTENT)
    pipe.finish()
    assert (tmp_path / "a.rrd").read_bytes() == CONTENT

    with RerunRecorder(tmp_path / "toy.rrd") as recorder:
        for event in story():
            recorder.on_event(event)
    found = rc.RrdReader(tmp_path / "toy.rrd").stream().collect()
    assert len(rows(found, "/world/camera")["frame"]) > 1


def test_a_file_system_without_pipes_leaves_nothing_behind(tmp_path, pipes, monkeypatch) -> None:
    def refuse(path: Path, mode: int) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "mkfifo", refuse)
    pipe = FilePipe(tmp_path / "a.rrd")
    pipe.finish()
    assert pipe.entrance == tmp_path / "a.rrd"
    assert list(pipes.iterdir()) == []


def test_a_file_that_cannot_be_made_is_a_line(tmp_path) -> None:
    with pytest.raises(OSError, match="No such file"):
        FilePipe(tmp_path / "absent" / "a.rrd")
    with pytest.raises(InputError, match=r"absent/a\.rrd: expected a place where a recording can be written"):
        RerunRecorder(tmp_path / "absent" / "a.rrd")
