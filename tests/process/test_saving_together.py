"""Programs that save one map at the same time, and what killed ones have left: only that is taken away."""

from pathlib import Path

import pytest
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.build import to_file
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import BuildRequest, RecordingFault, build_to_file
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.mapping.file import load_map, save_map


@pytest.fixture
def sequence(tmp_path):
    write_tiny_sequence(tmp_path / "tiny")
    return open_sequence(tmp_path / "tiny")


def built(sequence, output: Path, **others):
    with stage_progress(quiet=True) as progress:
        return build_to_file(sequence, BuildRequest("evidence", BuildConfig(), output, **others), progress)


def test_what_another_program_is_saving_stays_and_what_a_killed_one_left_goes(sequence, tmp_path, monkeypatch):
    output = tmp_path / "m.npz"
    left, saving = tmp_path / ".m.npz.aaaaaaaa", tmp_path / ".m.npz.bbbbbbbb"
    left.write_bytes(b"half a map")

    def save_as_others_do(simap, path):
        saving.write_bytes(b"the map of another program, nearly")
        save_map(simap, path)

    monkeypatch.setattr(to_file, "save_map", save_as_others_do)
    built(sequence, output)
    assert saving.read_bytes() == b"the map of another program, nearly" and not left.exists()
    saving.unlink()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.npz", "tiny"]


def test_a_map_whose_recording_is_lost_is_saved_and_given(sequence, tmp_path, monkeypatch):
    def cut_short(path):
        raise InputError("it has no end")

    monkeypatch.setattr("simaps_viz.recorder.recorder.read_facts", cut_short)
    with pytest.raises(RecordingFault, match=r"m\.rrd: could not write the recording: it has no end") as lost:
        built(sequence, tmp_path / "m.npz", record=tmp_path / "m.rrd")
    assert lost.value.simap.counts() == load_map(tmp_path / "m.npz").counts() == {"chair": 2}
