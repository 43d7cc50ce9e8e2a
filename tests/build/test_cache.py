"""Maps in the cache: one for each content of a sequence, and a cache that cannot be is told in a line."""

import numpy as np
import pytest
from killed_builds import unfinished
from sequences import write_tiny_sequence

from simaps_viz import load_map, open_sequence
from simaps_viz.app import workbench
from simaps_viz.build.pipeline import BuildConfig, cache_key, map_in_cache
from simaps_viz.cli.main import main
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError

FRAMES = 6


@pytest.fixture
def folder(tmp_path, monkeypatch):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    return tmp_path


def built(folder):
    with stage_progress(quiet=True) as progress:
        return workbench.cached_build(open_sequence(folder / "tiny"), "evidence", BuildConfig(), progress)


def test_a_sequence_that_has_changed_is_mapped_anew(folder):
    first, _ = built(folder)
    again, _ = built(folder)
    assert np.array_equal(first.T_map_camera, again.T_map_camera) and len(first.frame_names) == FRAMES
    poses = folder / "tiny" / "poses.txt"
    poses.write_text("".join(poses.read_text().splitlines(keepends=True)[:4]))
    shorter, record = built(folder)
    assert len(shorter.frame_names) == 4 and len(load_map(record.with_suffix(".npz")).frame_names) == 4


def test_a_build_that_was_stopped_does_not_stand_in_the_way_of_a_changed_sequence(folder):
    opened = open_sequence(folder / "tiny")
    output = map_in_cache(folder / "cache", opened, "evidence", BuildConfig())
    unfinished(folder / "tiny", output, 3)
    poses = folder / "tiny" / "poses.txt"
    lines = poses.read_text().splitlines()
    poses.write_text("\n".join([*lines[:-1], lines[-2].replace(lines[-2].split()[0], lines[-1].split()[0], 1)]) + "\n")
    simap, _ = built(folder)
    assert len(simap.frame_names) == FRAMES and np.array_equal(simap.T_map_camera[-1], simap.T_map_camera[-2])


def test_a_long_name_fits_into_a_file_name(folder):
    opened = open_sequence(folder / "tiny")
    opened.name = "room " * 80
    assert len(map_in_cache(folder / "cache", opened, "evidence", BuildConfig()).name) < 150
    assert cache_key(opened) == cache_key(open_sequence(folder / "tiny"))


@pytest.mark.parametrize("cache", ["afile", "/proc/nothing"])
def test_a_cache_that_cannot_be_is_one_line(folder, cache, monkeypatch, capsys):
    (folder / "afile").touch()
    monkeypatch.setenv("SIMAPS_CACHE", str(folder / cache))
    with pytest.raises(InputError, match="expected a folder for cached files"):
        map_in_cache(folder / cache, open_sequence(folder / "tiny"), "evidence", BuildConfig())
    for command in (["view", str(folder / "tiny"), "--no-browser"], ["demo", "--no-serve"]):
        assert main(command) == 2
        said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("simaps: ")]
        assert len(said) == 1 and "Errno" not in said[0] and str(folder / cache) in said[0]
