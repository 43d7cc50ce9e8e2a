"""Files are written whole or not at all, several together or none; and with the rights any new file gets."""

import errno
import os
import threading
from pathlib import Path

import pytest

from simaps_viz.errors import CommandError, InputError
from simaps_viz.io import files
from simaps_viz.io.files import beside, left_beside, replacing, write_all, write_whole


@pytest.fixture
def earlier(tmp_path):
    """A file that is there already, alone in its folder."""
    path = tmp_path / "m.npz"
    path.write_bytes(b"earlier")
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture(
    params=[(0o022, 0o644), (0o027, 0o640), (0o077, 0o600), (0o002, 0o664)], ids=lambda pair: f"{pair[0]:o}"
)
def rights(request):
    """What the umask leaves of a new file's rights."""
    umask, mode = request.param
    before = os.umask(umask)
    yield mode
    os.umask(before)


def test_new_files_have_the_rights_the_umask_leaves(tmp_path, rights):
    write_whole(tmp_path / "a", b"1", "a")
    write_whole(tmp_path / "b", b"1", "b", durable=False)
    write_all({tmp_path / "c": b"1"}, "c")
    assert {path.stat().st_mode & 0o777 for path in tmp_path.iterdir()} == {rights}


@pytest.mark.parametrize("durable", [True, False])
def test_what_is_written_takes_the_place_of_the_earlier_only_at_the_end(earlier, durable):
    with replacing(earlier, "the map", durable=durable) as temporary:
        assert temporary.parent == earlier.parent and temporary.name.startswith(".m.npz.")
        temporary.write_bytes(b"new")
        assert earlier.read_bytes() == b"earlier"
    assert contents(earlier.parent) == {"m.npz": b"new"}


@pytest.mark.parametrize("error", [CommandError("refused"), KeyboardInterrupt(), ZeroDivisionError("fault")])
def test_an_error_while_writing_passes_and_leaves_the_earlier(earlier, error):
    with pytest.raises(type(error)) as caught, replacing(earlier, "the map") as temporary:
        temporary.write_bytes(b"half")
        raise error
    assert caught.value is error and contents(earlier.parent) == {"m.npz": b"earlier"}


@pytest.mark.parametrize("call", ["open", "fsync", "replace"])
def test_a_full_disk_is_one_line_and_leaves_the_earlier(earlier, monkeypatch, call):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(files.os, call, full)
    with pytest.raises(InputError) as caught:
        write_whole(earlier, [b"one", b"two"], "the map")
    monkeypatch.undo()
    assert str(caught.value) == f"{earlier}: could not write the map: No space left on device"
    assert contents(earlier.parent) == {"m.npz": b"earlier"}


def test_a_folder_that_is_not_there_and_a_folder_of_the_name(tmp_path):
    with pytest.raises(InputError, match=r"x\.npz: could not write the map: No such file or directory"):
        write_whole(tmp_path / "nowhere" / "x.npz", b"1", "the map")
    (tmp_path / "f").mkdir()
    with pytest.raises(InputError, match="f: could not write the map: Is a directory"):
        write_whole(tmp_path / "f", b"1", "the map")
    assert [path.name for path in tmp_path.iterdir()] == ["f"]


def test_only_what_is_to_last_waits_for_the_disk(tmp_path, monkeypatch):
    synced: list[int] = []
    monkeypatch.setattr(files.os, "fsync", lambda handle: synced.append(os.fstat(handle).st_size))
    write_whole(tmp_path / "a", b"four", "a", durable=False)
    assert synced == []
    write_whole(tmp_path / "a", b"four", "a")
    write_all({tmp_path / "b": b"12345", tmp_path / "c": b"123456"}, "b and c")
    assert synced == [4, 5, 6]


def test_many_at_once_write_the_same_file(tmp_path):
    """Threads do not share a temporary file: one of the contents is there, whole."""
    path, texts = tmp_path / "a", [bytes([65 + i]) * 50_000 for i in range(8)]
    threads = [threading.Thread(target=write_whole, args=(path, text, "a")) for text in texts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [p.name for p in tmp_path.iterdir()] == ["a"] and path.read_bytes() in texts


def test_a_temporary_file_is_gone_unless_it_was_moved(tmp_path):
    with beside(tmp_path / "a") as left, beside(tmp_path / "a") as moved:
        assert left != moved and left.read_bytes() == b""
        os.replace(moved, tmp_path / "a")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("failing", range(1, 4))
def test_several_files_are_written_together_or_not_at_all(tmp_path, monkeypatch, failing):
    paths = [tmp_path / name for name in "abc"]
    paths[1].write_bytes(b"earlier")
    replace, done = os.replace, []

    def fail_once(source, target):
        done.append(target)
        if len(done) == failing:
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", fail_once)
    with pytest.raises(InputError, match="could not write the three: No space left on device"):
        write_all({path: b"new" for path in paths}, "the three")
    assert contents(tmp_path) == {"b": b"earlier"}
    monkeypatch.undo()
    write_all({path: b"new" for path in paths}, "the three")
    assert contents(tmp_path) == dict.fromkeys("abc", b"new")


def test_nothing_takes_its_name_before_all_are_complete(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"earlier")
    sync, done = os.fsync, []

    def full_at_the_second(handle):
        done.append(handle)
        if len(done) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        sync(handle)

    monkeypatch.setattr(files.os, "fsync", full_at_the_second)
    with pytest.raises(InputError, match="b: could not write the two: No space left on device"):
        write_all({tmp_path / "a": b"new", tmp_path / "b": b"new"}, "the two")
    assert contents(tmp_path) == {"a": b"earlier"}


def test_what_the_killed_have_left_is_found_again_and_nothing_else(tmp_path):
    path = tmp_path / "m[1].npz"
    others = (".m[1].npz.building.old", ".m1.npz.abcd1234", ".m[1].npz.abc", "m[1].npz.abcd1234", ".m[1].npz.abcd 234")
    for name in others:
        (tmp_path / name).touch()
    made = []
    for _ in range(40):
        with beside(path) as temporary:
            made.append(temporary)
    for one in made:
        one.touch()
    assert left_beside(path) == sorted(made)
