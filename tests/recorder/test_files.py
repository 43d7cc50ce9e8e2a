"""When there is a file, where there cannot be one, and who may listen."""

import subprocess
import sys
from pathlib import Path

import pytest
import rerun.chunk as rc
from recorded_story import rows, story

from simaps_viz.errors import InputError
from simaps_viz.recorder.recorder import RerunRecorder
from simaps_viz.recorder.settings import RecorderSettings


def test_file_appears_when_the_build_is_finished(tmp_path: Path) -> None:
    path = tmp_path / "toy.rrd"
    path.write_bytes(b"an older recording")
    with RerunRecorder(path) as recorder:
        for event in story():
            assert path.read_bytes() == b"an older recording"
            recorder.on_event(event)
        assert [p.name for p in tmp_path.iterdir()] == ["toy.rrd"]
        whole = path.read_bytes()
    assert len(whole) > 10_000 and path.read_bytes() == whole
    verified = subprocess.run(
        [str(Path(sys.executable).parent / "rerun"), "rrd", "verify", str(path)],
        check=False, capture_output=True, text=True, env={"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path)},
    )  # fmt: skip
    assert verified.returncode == 0 and "1 file verified without error" in verified.stdout + verified.stderr


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_no_file_after_an_error(tmp_path: Path, error: type[BaseException]) -> None:
    events = story()
    with pytest.raises(error), RerunRecorder(tmp_path / "toy.rrd") as recorder:
        for _ in range(3):
            recorder.on_event(next(events))
        raise error
    assert list(tmp_path.iterdir()) == []


def test_build_left_in_good_order_is_kept(tmp_path: Path) -> None:
    events = story()
    with RerunRecorder(tmp_path / "toy.rrd") as recorder:
        for _ in range(3):
            recorder.on_event(next(events))
    found = rc.RrdReader(tmp_path / "toy.rrd").stream().collect()
    assert rows(found, "/world/camera")["frame"] == [0, 1]


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "folder.rrd").mkdir()
    (tmp_path / "file").touch()
    for path in (
        tmp_path / "absent" / "a.rrd",
        tmp_path / "file" / "a.rrd",
        tmp_path / "folder.rrd",
        tmp_path / "a.txt",
    ):
        with pytest.raises(InputError, match=str(path)):
            RerunRecorder(path)
    with pytest.raises(InputError, match="neither"):
        RerunRecorder(None)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.rrd"]


def test_live_listens_on_this_machine_only_and_writes_the_file_too(tmp_path: Path) -> None:
    with RerunRecorder(tmp_path / "toy.rrd", live=True) as recorder:
        assert recorder.live_url is not None
        port = int(recorder.live_url.split(":")[2].split("/")[0])
        listening = Path("/proc/net/tcp").read_text().upper() if Path("/proc/net/tcp").exists() else ""
        if listening:
            assert f"0100007F:{port:04X}" in listening and f"00000000:{port:04X}" not in listening
        for event in story():
            recorder.on_event(event)
    assert (tmp_path / "toy.rrd").stat().st_size > 10_000


@pytest.mark.parametrize("wrong", [{"color_every": 0}, {"points": -1}, {"jpeg_quality": 101}, {"map_every": 0}])
def test_settings_are_checked(wrong: dict[str, int]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong))):
        RecorderSettings(**wrong)  # type: ignore[arg-type]
