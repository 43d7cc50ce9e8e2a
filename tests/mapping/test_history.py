"""The history of a map: after every frame exactly what a build of the frames up to it makes."""

import json
import zlib

import numpy as np
import pytest
from build_logs import keep_log
from sequences import write_tiny_sequence

from simaps_viz import build_map, open_sequence, save_map
from simaps_viz.build.pipeline import BuildConfig, facts_of, gather_frames
from simaps_viz.build.to_file import BuildRequest, build_to_file, open_history
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.mapping import history as histories
from simaps_viz.mapping.finalize import map_so_far
from simaps_viz.mapping.history import MapHistory
from simaps_viz.mapping.simap import repartition
from simaps_viz.mapping.steps import MAGIC, pack_step, record

FRAMES = 6


class First:
    """The first frames of a sequence."""

    def __init__(self, sequence, count):
        self._sequence, self._count = sequence, count
        self.frame_names, self.poses = sequence.frame_names[:count], sequence.poses[:count]

    def __getattr__(self, name):
        return getattr(self._sequence, name)

    def __len__(self):
        return self._count


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=FRAMES))


def kept(sequence, folder, method="evidence"):
    build_map(sequence, BuildConfig(method=method), log=folder / "log")
    keep_log(folder / "log", folder / "m.steps")
    return MapHistory.open(folder / "m.steps")


def saved(simap, folder):
    save_map(simap, folder / "one.npz")
    return (folder / "one.npz").read_bytes()


@pytest.mark.parametrize("method", ["evidence", "paper", "components"])
@pytest.mark.parametrize(("memory", "held"), [(0, 64 << 20), (64 << 20, 64 << 20), (0, 0), (64 << 20, 20_000)])
def test_the_map_after_a_frame_is_the_build_of_the_frames_up_to_it(tiny, tmp_path, monkeypatch, method, memory, held):
    monkeypatch.setattr(histories, "KEPT_BYTES", memory)
    monkeypatch.setattr(histories, "HELD_BYTES", held)
    history = kept(tiny, tmp_path, method)
    assert len(history) == FRAMES and history.frame_names == tiny.frame_names
    for frame in (3, 0, FRAMES - 1, 1, 3):
        wanted = build_map(First(tiny, frame + 1), BuildConfig(method=method))  # pyright: ignore
        assert saved(history.map_at(frame), tmp_path) == saved(wanted, tmp_path)
    assert len(history._states) == (FRAMES + 1 if memory else 1)
    assert len(history._steps._held) == {0: 0, 64 << 20: FRAMES}.get(held, len(history._steps._held))
    assert held != 20_000 or 0 < len(history._steps._held) < FRAMES


@pytest.mark.parametrize("method", ["evidence", "paper", "components"])
@pytest.mark.parametrize("held", [0, 64 << 20])
def test_the_look_after_a_frame_has_its_heights_and_classes_in_the_colours_of_the_end(
    tiny, tmp_path, monkeypatch, method, held
):
    monkeypatch.setattr(histories, "HELD_BYTES", held)
    history = kept(tiny, tmp_path, method)
    end = history.map_at(FRAMES - 1)
    for frame in range(FRAMES):
        look, then = history.look_at(frame), history.map_at(frame)
        assert look.spec == end.spec and look.frame_names == then.frame_names
        row = round((then.spec.y0_m - look.spec.y0_m) / look.spec.cell_size_m)
        col = round((then.spec.x0_m - look.spec.x0_m) / look.spec.cell_size_m)
        part = (slice(row, row + then.spec.rows), slice(col, col + then.spec.cols))
        for name in ("label", "height_m", "lowest_m", "observations"):
            ours = getattr(look.grid, name)
            assert np.array_equal(ours[part], getattr(then.grid, name), equal_nan=ours.dtype.kind == "f"), name
        assert look.grid.observations.sum() == then.grid.observations.sum()
        shown = look.instance > 0
        assert (look.instance[shown] == end.instance[shown]).all() and shown[part][then.instance > 0].all()
    assert np.array_equal(look.instance, end.instance) and look.counts() == end.counts()


@pytest.mark.parametrize("method", ["evidence", "components"])
def test_a_history_does_not_need_its_file_but_must_not_be_written_over(tiny, tmp_path, monkeypatch, method):
    looks = [saved(kept(tiny, tmp_path, method).look_at(frame), tmp_path) for frame in range(FRAMES)]
    monkeypatch.setattr(histories, "HELD_BYTES", 0)
    monkeypatch.setattr(histories, "KEPT_BYTES", 0)
    path = tmp_path / "m.steps"
    history, content = MapHistory.open(path), path.read_bytes()
    path.unlink()
    path.write_bytes(b"another one in its place")
    assert [saved(history.look_at(frame), tmp_path) for frame in range(FRAMES)] == looks
    path.write_bytes(content)
    history = MapHistory.open(path)
    path.write_bytes(content[:-20] + bytes(20))  # the same file
    assert len(history.map_at(1).frame_names) == 2
    with pytest.raises(InputError, match=rf"m\.steps: frame {FRAMES - 1} could not be read back, the file was changed"):
        history.map_at(FRAMES - 1)


def test_a_frame_there_is_not_is_refused(tiny, tmp_path):
    history = kept(tiny, tmp_path)
    for ask in (history.map_at, history.look_at):
        for frame in (-1, FRAMES):
            with pytest.raises(InputError, match=f"expected a frame from 0 to {FRAMES - 1}, found {frame}"):
                ask(frame)


def test_only_a_maps_own_history_is_taken(tiny, tmp_path):
    output, config = tmp_path / "m.npz", BuildConfig()
    with stage_progress(quiet=True) as progress:
        simap = build_to_file(tiny, BuildRequest("evidence", config, output, history=True), progress)
    found = open_history(output, simap)
    assert found is not None and found.is_of(repartition(simap, affinity=0.1))
    assert open_history(output, build_map(First(tiny, 3))) is None  # pyright: ignore
    assert open_history(output, build_map(tiny, BuildConfig(method="paper"))) is None
    assert open_history(tmp_path / "other.npz", simap) is None
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.npz", "m.steps"]
    history = (tmp_path / "m.steps").read_bytes()
    (tmp_path / "m.steps").write_bytes(b"foreign")
    assert open_history(output, simap) is None
    (tmp_path / "m.steps").write_bytes(history)
    with stage_progress(quiet=True) as progress:
        build_to_file(tiny, BuildRequest("evidence", config, output), progress)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m.npz"]  # the earlier map's history is gone with it


def test_a_missing_foreign_or_senseless_file_is_named(tiny, tmp_path):
    with pytest.raises(InputError, match=r"nowhere.steps: expected the steps of a build, found No such file"):
        MapHistory.open(tmp_path / "nowhere.steps")
    path = tmp_path / "x.steps"
    facts = {"sequence": {}, "config": {}}
    whole = kept(tiny, tmp_path)
    known = {"sequence": whole.facts.to_json(), "config": whole.config.to_json()}
    first, far = pack_step(whole._steps[0]), whole._steps[0]
    far.seen.readings.rows[0] = 1 << 29
    huge = {**known, "sequence": {**known["sequence"], "T_map_world": [[10**400] * 4] * 4}}
    coarse = {**known["config"]["projection"], "cell_size_m": 10**400}
    slow = {**known, "config": {**known["config"], "projection": coarse}}
    bomb = zlib.compress(bytes(1 << 20)) + b"more"
    for content in (
        b"",
        MAGIC,
        MAGIC + record(0, b"{}"),
        MAGIC + record(0, b"[1]"),
        MAGIC + record(0, json.dumps(facts).encode()),
        MAGIC + record(0, json.dumps(known).encode()),
        MAGIC + record(0, json.dumps(huge).encode()) + record(1, first),
        MAGIC + record(0, json.dumps(slow).encode()) + record(1, first),
        MAGIC + record(0, json.dumps(known).encode()) + record(1, pack_step(far)),
        MAGIC + record(0, json.dumps(known).encode()) + record(2, bomb),
        MAGIC + record(0, json.dumps(known).encode()) + record(1, pack_step(whole._steps[1])),
    ):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"x\.steps: expected the steps of a build, found"):
            MapHistory.open(path)


@pytest.mark.parametrize("method", ["evidence", "paper"])
def test_frames_gathered_in_parts_make_the_map_of_all(tiny, method, tmp_path):
    config = BuildConfig(method=method)
    odd, even = (gather_frames(tiny, config, range(first, FRAMES, 2)) for first in (1, 0))
    odd.merge(even)
    assert saved(map_so_far(odd, facts_of(tiny), config), tmp_path) == saved(build_map(tiny, config), tmp_path)
