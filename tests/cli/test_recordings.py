"""Recorded builds at hand: what they say of themselves, and that nothing outside the library is ever touched."""

import json
import os
import subprocess
import sys
import urllib.request
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
import rerun.chunk as rc
from sequences import write_tiny_sequence
from toy_maps import toy_map

from simaps_viz import open_sequence
from simaps_viz.build.methods import build
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.cli import BAD_INPUT
from simaps_viz.cli.main import main
from simaps_viz.cli.recordings import Recordings, find_recording, is_recorded_build, open_alone
from simaps_viz.errors import InputError
from simaps_viz.mapping.file import save_map
from simaps_viz.recorder.facts import RecordingFacts, read_facts
from simaps_viz.recorder.importer import NOT_MINE, is_map
from simaps_viz.recorder.library import RecordingLibrary, recording_folders
from simaps_viz.recorder.recorder import RerunRecorder

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """The recorded build of the tiny sequence."""
    folder = tmp_path_factory.mktemp("recorded")
    manifest = write_tiny_sequence(folder / "tiny", manifest={"simulated": True})
    with RerunRecorder(folder / "tiny.rrd") as recorder:
        build(open_sequence(manifest), "evidence", BuildConfig(affinity=0.7), [recorder])
    return folder / "tiny.rrd"


@pytest.fixture
def library(tmp_path, recorded) -> RecordingLibrary:
    """Two folders; the second has a foreign recording of a name that the first has too."""
    own, shipped = tmp_path / "own", tmp_path / "shipped"
    own.mkdir()
    shipped.mkdir()
    (own / "tiny.rrd").write_bytes(recorded.read_bytes())
    foreign(shipped / "tiny.rrd")
    foreign(shipped / "other.rrd")
    return RecordingLibrary([own, shipped])


def foreign(path: Path) -> None:
    stream = rr.RecordingStream("somebody")
    stream.set_sinks(rr.FileSink(str(path)))
    stream.log("/text", rr.TextLog("hello"))
    stream.flush()
    stream.disconnect()


def test_a_recording_says_what_it_is(recorded):
    facts = read_facts(recorded)
    assert facts == RecordingFacts(
        title="tiny", application="simaps", frames=3, simulated=True, segmentation="drawn by the test",
        method="evidence", parameters="affinity 0.7, resolution 1", instances=2, version=facts.version,
    )  # fmt: skip
    assert facts.version


def test_of_a_recording_of_others_little_is_known(tmp_path):
    foreign(tmp_path / "a.rrd")
    assert read_facts(tmp_path / "a.rrd") == RecordingFacts(application="somebody")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_an_unfinished_recording_is_refused_and_still_listed(tmp_path, recorded, share):
    data = recorded.read_bytes()
    (tmp_path / "cut.rrd").write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError, match="expected a finished rerun recording, found"):
        read_facts(tmp_path / "cut.rrd")
    (entry,) = RecordingLibrary([tmp_path]).entries()
    assert entry.fault and entry.facts == RecordingFacts() and entry.size_bytes == int(len(data) * share)


def test_listing_takes_recordings_alone_the_newest_first(library, recorded):
    own = library.folders[0]
    (own / "notes.txt").write_text("")
    (own / ".hidden.rrd").write_bytes(b"")
    (own / "folder.rrd").mkdir()
    (own / "link.rrd").symlink_to(recorded)
    os.utime(own / "tiny.rrd", (2e9, 2e9))
    found = library.entries()
    assert found[0].path.relative_to(own.parent).as_posix() == "own/tiny.rrd"
    assert sorted(e.path.relative_to(own.parent).as_posix() for e in found) == [
        "own/tiny.rrd", "shipped/other.rrd", "shipped/tiny.rrd",
    ]  # fmt: skip
    assert found[0].to_json()["method"] == "evidence" and json.dumps(found[0].to_json())
    assert RecordingLibrary([own / "missing"]).entries() == []


def test_the_users_own_goes_first(library):
    assert library.find("tiny").path == library.folders[0] / "tiny.rrd"
    assert library.find("other.rrd").path == library.folders[1] / "other.rrd"
    with pytest.raises(InputError, match="did you mean 'other'"):
        library.find("othr")


def test_rename_and_delete(library):
    assert library.rename("tiny", " My café 2 ").path == library.folders[0] / "My café 2.rrd"
    assert library.find("tiny").path.parent == library.folders[1]
    assert library.delete("other") == library.folders[0] / ".trash" / "other.rrd"
    assert sorted(e.name for e in library.entries()) == ["My café 2", "tiny"]


def test_what_was_deleted_comes_back(library, recorded):
    own, trash = library.folders[0], library.trash
    assert library.delete("tiny") == trash / "tiny.rrd" and not (own / "tiny.rrd").exists()
    library.add(recorded)
    assert library.delete("tiny") == trash / "tiny (2).rrd"
    assert sorted(e.name for e in library.deleted()) == ["tiny", "tiny (2)"]
    assert library.restore("tiny").path == own / "tiny.rrd"
    assert (own / "tiny.rrd").read_bytes() == recorded.read_bytes()
    library.restore("tiny (2)")
    library.delete("tiny")
    library.add(recorded)
    with pytest.raises(InputError, match="a name that is free"):
        library.restore("tiny")
    for name in ("other", "../tiny", ""):
        with pytest.raises(InputError, match="expected one of the trash, found none"):
            library.restore(name)
    assert library.empty_trash() == [trash / "tiny.rrd"] and library.deleted() == []
    assert sorted(e.name for e in library.entries()) == ["other", "tiny", "tiny", "tiny (2)"]


def test_what_ships_or_lies_under_version_control_stays(tmp_path, recorded, monkeypatch):
    shipped = RecordingLibrary([tmp_path / "none", Path(__file__).parents[2] / "recordings"])
    tracked = tmp_path / "checkout" / "data"
    tracked.mkdir(parents=True)
    (tmp_path / "checkout" / ".git").mkdir()
    (tracked / "mine.rrd").write_bytes(recorded.read_bytes())
    for library, name, why in (
        (shipped, "cafe-evidence", "ships with SI Maps"),
        (RecordingLibrary([tracked]), "mine", "lies under version control"),
    ):
        path = library.find(name).path
        before = path.read_bytes()
        for do in (lambda: library.delete(name), lambda: library.rename(name, "other")):  # noqa: B023 - run at once
            with pytest.raises(InputError, match=why):
                do()
        assert path.read_bytes() == before and library.deleted() == []
    # A home folder under version control does not make everything below it so.
    monkeypatch.setenv("HOME", str(tmp_path / "checkout"))
    assert RecordingLibrary([tracked]).delete("mine") == tracked / ".trash" / "mine.rrd"


def test_a_name_that_is_taken_is_kept(library, recorded):
    own = library.folders[0]
    (own / "second.rrd").write_bytes(recorded.read_bytes()[:10])
    with pytest.raises(InputError, match="a name that is free"):
        library.rename("tiny", "second")
    with pytest.raises(InputError, match="a name that is free"):
        library.add(recorded)
    assert (own / "second.rrd").stat().st_size == 10 and (own / "tiny.rrd").is_file()
    assert [p.name for p in own.iterdir() if p.name.startswith(".")] == []


NAMES = ["", "  ", ".", "..", "../tiny", "a/b", "/etc/passwd", "..\\x", ".hidden", "a\nb", "x" * 200, "a:b", "\0"]


@pytest.mark.parametrize("name", NAMES)
def test_no_name_leads_outside(library, recorded, tmp_path, name):
    before = sorted(p for p in tmp_path.rglob("*"))
    for do in (lambda: library.rename("tiny", name), lambda: library.add(recorded, name or " ")):
        with pytest.raises(InputError, match="expected a file name without"):
            do()
    for do in (lambda: library.find(name), lambda: library.delete(name)):
        with pytest.raises(InputError, match="found none"):
            do()
    assert sorted(p for p in tmp_path.rglob("*")) == before and recorded.is_file()


def test_what_is_added_is_a_whole_copy(tmp_path, recorded):
    library = RecordingLibrary([tmp_path / "new" / "folder"])
    entry = library.add(recorded, "mine")
    assert entry.path == tmp_path / "new" / "folder" / "mine.rrd"
    assert entry.path.read_bytes() == recorded.read_bytes()
    (tmp_path / "bad.rrd").write_bytes(b"nothing")
    for file, what in ((tmp_path / "bad.rrd", "finished rerun recording"), (tmp_path / "no.rrd", "no such file")):
        with pytest.raises(InputError, match=what):
            library.add(file)
    assert [e.name for e in library.entries()] == ["mine"]


def test_the_folder_can_be_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv("SIMAPS_RECORDINGS", str(tmp_path))
    assert recording_folders()[0] == tmp_path
    assert recording_folders()[1:] == [Path(__file__).parents[2] / "recordings"]
    monkeypatch.delenv("SIMAPS_RECORDINGS")
    assert recording_folders()[0].name == "recordings" and "simaps" in str(recording_folders()[0])


def test_the_command(monkeypatch, tmp_path, recorded, capsys):
    monkeypatch.setenv("SIMAPS_RECORDINGS", str(tmp_path / "own"))
    Recordings("add", (str(recorded), "first"), json=True).run()
    assert json.loads(capsys.readouterr().out)["event"] == "added"
    Recordings(json=True).run()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"name": "first", "frames": 3, "method": "evidence", "simulated": True}.items() <= lines[0].items()
    Recordings().run()
    out = capsys.readouterr().out
    assert "first" in out and "tiny (simulated)" in out and "evidence" in out
    Recordings("rename", ("first", "second")).run()
    assert find_recording(Path("second.rrd")) == tmp_path / "own" / "second.rrd"
    with pytest.raises(InputError, match="expected --yes to delete"):
        Recordings("delete", ("second",)).run()
    assert (tmp_path / "own" / "second.rrd").is_file()
    Recordings("delete", ("second",), yes=True).run()
    assert not (tmp_path / "own" / "second.rrd").exists()
    capsys.readouterr()
    Recordings("trash", json=True).run()
    assert json.loads(capsys.readouterr().out)["name"] == "second"
    Recordings("restore", ("second",)).run()
    assert (tmp_path / "own" / "second.rrd").read_bytes() == recorded.read_bytes()
    Recordings("delete", ("second",), yes=True).run()
    with pytest.raises(InputError, match="expected --yes to delete 1 for good, found none; nothing was deleted"):
        Recordings("empty-trash").run()
    assert (tmp_path / "own" / ".trash" / "second.rrd").is_file()
    Recordings("empty-trash", yes=True).run()
    assert not any((tmp_path / "own" / ".trash").iterdir())
    for wrong in (Recordings("delete"), Recordings("list", ("x",)), Recordings("rename", ("x",))):
        with pytest.raises(InputError, match=r"recordings: expected .*, found \d names"):
            wrong.run()
    with pytest.raises(InputError, match="no such file"):
        find_recording(Path("folder/second.rrd"))


def test_a_recording_alone_is_a_page(recorded):
    host = open_alone(recorded)
    try:
        page = urllib.request.urlopen(host.url).read().decode()
        assert "tiny (simulated). A recorded build alone, without its map" in page
        address = "/recordings/tiny.rrd"
        base = f"http://127.0.0.1:{host.port}"
        assert address in page and urllib.request.urlopen(base + address).read() == recorded.read_bytes()
    finally:
        host.close()


def test_what_view_takes_for_a_recorded_build(monkeypatch, tmp_path, recorded, capsys):
    """Recordings of others may be sequences; those are mapped."""
    foreign(tmp_path / "theirs.rrd")
    monkeypatch.setenv("SIMAPS_RECORDINGS", str(tmp_path / "own"))
    RecordingLibrary().add(recorded, "mine")
    paths = (recorded, Path("mine.rrd"), tmp_path / "theirs.rrd", Path("no.rrd"), Path("a/mine.rrd"), tmp_path)
    assert [is_recorded_build(path) for path in paths] == [True, True, False, False, False, False]
    shown = []
    monkeypatch.setattr("simaps_viz.cli.recordings.view_alone", lambda path, **options: shown.append((path, options)))
    assert main(["view", str(recorded), "--no-browser", "--port", "8123"]) == 0
    (path, options), *others = shown
    assert (path, options["port"], options["browser"], others) == (recorded, 8123, False, [])
    assert options["access"].host == "127.0.0.1" and options["access"].read_only
    assert main(["view", str(tmp_path / "theirs.rrd"), "--no-browser"]) == BAD_INPUT
    assert "theirs.rrd" in capsys.readouterr().err.replace("\n", "") and len(shown) == 1


def test_an_unfinished_recording_is_not_shown_alone(tmp_path, recorded):
    (tmp_path / "cut.rrd").write_bytes(recorded.read_bytes()[:500])
    with pytest.raises(InputError, match="finished"):
        open_alone(tmp_path / "cut.rrd")


IMPORTER = "from simaps_viz.recorder.importer import main; import sys; sys.exit(main())"


def import_file(*arguments: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run([sys.executable, "-c", IMPORTER, *arguments], capture_output=True, check=False, timeout=600)


@pytest.fixture(scope="module")
def map_file(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("map") / "toy.npz"
    save_map(toy_map(), path)
    return path


def columns(path: Path) -> dict[str, dict[str, list]]:
    found: dict[str, dict[str, list]] = {}
    for chunk in rc.RrdReader(path).stream():
        found.setdefault(chunk.entity_path, {}).update(chunk.to_record_batch().to_pydict())
    return found


def test_rerun_gets_the_map_as_a_recording(map_file, tmp_path):
    done = import_file(str(map_file), "--recording-id", "rec-1", "--application-id", "here", "--unheard-of", "7")
    assert done.returncode == 0, done.stderr
    (tmp_path / "out.rrd").write_bytes(done.stdout)
    (entry,) = (e for e in rc.RrdReader(tmp_path / "out.rrd").recordings() if e.kind == "recording")
    assert (entry.application_id, entry.recording_id) == ("here", "rec-1")
    data, simap = columns(tmp_path / "out.rrd"), toy_map()
    (names,) = data["/world/objects"]["Boxes3D:labels"]
    assert sorted(names) == sorted(f"{one.label} {one.id}" for one in simap.instances)
    (sizes,), (centres,) = data["/world/objects"]["Boxes3D:half_sizes"], data["/world/objects"]["Boxes3D:centers"]
    for i, one in enumerate(simap.instances):
        low, high = np.array(one.aabb_m)
        np.testing.assert_allclose(centres[i], (low + high) / 2, atol=1e-6)
        np.testing.assert_allclose(sizes[i], (high - low) / 2, atol=1e-6)
    (points,) = data["/world/surface"]["Points3D:positions"]
    seen = ~np.isnan(simap.grid.height_m) & (simap.instance == 0)
    assert len(points) == seen.sum() and np.isclose(max(z for _, _, z in points), 2.0)
    assert {"/map/objects", "/map/classes", "/map/ground", "/map/heights", "/map/names", "/about"} <= set(data)
    facts = read_facts(tmp_path / "out.rrd")
    assert (facts.method, facts.instances, facts.frames) == ("paper", 7, 5)


def test_into_a_window_that_is_open(map_file, tmp_path):
    """What is dropped on a recording joins it, under the prefix, and leaves its layout and name alone."""
    done = import_file(str(map_file), "--opened-application-id", "scan", "--recording-id", "r2",
                       "--entity-path-prefix", "maps/toy")  # fmt: skip
    (tmp_path / "out.rrd").write_bytes(done.stdout)
    entries = rc.RrdReader(tmp_path / "out.rrd").recordings()
    assert [e.application_id for e in entries] == ["scan"] and read_facts(tmp_path / "out.rrd").title is None
    data = columns(tmp_path / "out.rrd")
    assert "/maps/toy/map/objects" in data
    assert all(path.startswith(("/maps/toy/", "/__properties")) for path in data)


def test_files_of_others_are_turned_away(tmp_path, recorded, map_file):
    np.savez(tmp_path / "arrays.npz", a=np.zeros(3))
    (tmp_path / "broken.npz").write_bytes(map_file.read_bytes()[:100])
    for path in (tmp_path / "arrays.npz", tmp_path / "broken.npz", recorded, tmp_path, tmp_path / "missing.npz"):
        assert not is_map(path)
    done = import_file(str(tmp_path / "arrays.npz"), "--recording-id", "x")
    assert (done.returncode, done.stdout, done.stderr) == (NOT_MINE, b"", b"")


def test_a_damaged_map_is_one_line(tmp_path, map_file):
    """Its table of contents is whole, what it holds is not."""
    data = bytearray(map_file.read_bytes())
    data[len(data) // 3 : len(data) // 3 + 400] = bytes(400)
    (tmp_path / "bad.npz").write_bytes(bytes(data))
    done = import_file(str(tmp_path / "bad.npz"))
    assert done.returncode == 1 and done.stdout == b""
    assert done.stderr.startswith(b"rerun-importer-simaps: ") and done.stderr.count(b"\n") == 1


def program(path: Path, code: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!{sys.executable}\n{code}\n")
    path.chmod(0o755)
    return path


def open_with_rerun(map_file: Path, folder: Path, out: Path) -> str:
    """`rerun map.npz` with the programs of a folder on the PATH; --save writes what the viewer would show."""
    rerun = Path(sys.executable).with_name("rerun")
    environment = os.environ | {"PATH": f"{folder}:/usr/bin:/bin", "HOME": str(out.parent)}
    command = [str(rerun), str(map_file), "--save", str(out), "--bind", "127.0.0.1", "--port", "0"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stderr


def test_rerun_itself_opens_a_map(map_file, tmp_path):
    program(tmp_path / "bin" / "rerun-importer-simaps", IMPORTER)
    said = open_with_rerun(map_file, tmp_path / "bin", tmp_path / "out.rrd")
    assert "deprecated" not in said
    assert "/world/objects" in columns(tmp_path / "out.rrd")
