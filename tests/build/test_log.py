"""The build log: every step comes back exactly, and whatever happens to the file, a build ends in the same map."""

import errno
import os
import shutil
import struct
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from build_logs import keep_log, read_log
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_frames import IS_THING, LABELS, random_frames
from sequences import write_tiny_sequence
from stopped_builds import Stop, same, saved

from simaps_viz import open_sequence
from simaps_viz.build import build_log
from simaps_viz.build.build_log import BuildLog, LogBusyError, frames_logged, set_aside_name
from simaps_viz.build.pipeline import BuildCancelled, BuildConfig, build_map
from simaps_viz.errors import InputError
from simaps_viz.mapping.accumulator import MapAccumulator, ProjectionSettings
from simaps_viz.mapping.steps import compress, decompress, pack_step, unpack_step

FRAMES = 5
METHODS = ("evidence", "paper", "components")


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return open_sequence(write_tiny_sequence(tmp_path_factory.mktemp("tiny"), frames=FRAMES))


def accumulator(**options):
    return MapAccumulator(LABELS, IS_THING, ProjectionSettings(), **options)


def stepped(seed, frames=6):
    whole, steps = accumulator(steps=True), []
    for part in random_frames(seed, frames=frames):
        whole.add_frame(*part)
        assert whole.step is not None
        steps.append(whole.step)
    return whole, steps


@pytest.mark.parametrize("seed", range(4))
def test_a_step_comes_back_exactly_and_replays_the_frame(seed):
    whole, steps = stepped(seed)
    again = accumulator(steps=True)
    for step in steps:
        packed = pack_step(step)
        assert decompress(compress(packed), most=len(packed)) == packed
        back = unpack_step(packed)
        assert pack_step(back) == packed
        again.replay(back)
    same(again, whole)
    for at in (0, 1, 17, len(packed) - 1):
        with pytest.raises((ValueError, KeyError, struct.error, TypeError)):
            unpack_step(packed[:at])


def test_after_replaying_frames_are_added_as_if_never_interrupted():
    parts = random_frames(7, frames=8)
    whole, steps = stepped(7, frames=8)
    for cut in range(len(parts) + 1):
        again = accumulator(steps=True)
        for step in steps[:cut]:
            again.replay(step)
        for part, step in zip(parts[cut:], steps[cut:], strict=True):
            again.add_frame(*part)
            assert again.step is not None and pack_step(again.step) == pack_step(step)
        same(again, whole)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 5), owners=st.lists(st.integers(0, 3), min_size=6, max_size=6), order=st.permutations(range(4))
)
def test_parts_merged_in_any_grouping_and_order_are_one_pass(seed, owners, order):
    parts = random_frames(seed % 3)[:1] * 2 + random_frames(seed, frames=4)  # equal frames: ties everywhere
    parts = [(replace(f, index=i), s, T) for i, (f, s, T) in enumerate(parts)]
    whole, shards = accumulator(), [accumulator() for _ in order]
    for part, owner in zip(parts, owners, strict=True):
        whole.add_frame(*part)
        shards[owner].add_frame(*part)
    shards = [shards[i] for i in order]
    left, right = shards[0], shards[2]
    left.merge(shards[1])
    right.merge(shards[3])
    right.merge(left)
    same(right, whole)


def test_parts_of_different_builds_or_with_a_frame_in_common_do_not_merge():
    one, two = accumulator(), accumulator()
    for part in random_frames(1, frames=2):
        one.add_frame(*part)
        two.add_frame(*part)
    with pytest.raises(InputError, match="found frame 0 in both"):
        one.merge(two)
    with pytest.raises(InputError, match="differ in reach_cells"):
        one.merge(accumulator(reach_cells=-1))


@pytest.mark.parametrize("method", METHODS)
def test_a_build_with_a_log_is_the_build_without(tiny, method, tmp_path):
    config = BuildConfig(method=method)
    wanted = saved(build_map(tiny, config), tmp_path)
    assert saved(build_map(tiny, config, log=tmp_path / "log"), tmp_path) == wanted
    assert frames_logged(tmp_path / "log") == FRAMES
    assert saved(build_map(tiny, config, log=tmp_path / "log", resume=True), tmp_path) == wanted


@pytest.mark.parametrize("method", ["evidence", "paper"])
def test_whatever_is_cut_off_or_changed_the_log_ends_before_it_and_the_map_is_the_same(method, tmp_path):
    tiny, path = open_sequence(write_tiny_sequence(tmp_path / "two", frames=2)), tmp_path / "log"
    config = BuildConfig(method=method, projection=ProjectionSettings(cell_size_m=0.2))
    wanted = saved(build_map(tiny, config, log=path), tmp_path)
    whole = path.read_bytes()
    ends = [0, *(offset + length for offset, length, _ in records(path))]

    def check(data, end):
        path.write_bytes(data)
        assert frames_logged(path) == max(sum(e <= end for e in ends) - 1, 0), end

    for cut in range(len(whole)):
        check(whole[:cut], cut)
    for at in range(0, len(whole), 7):
        check(whole[:at] + bytes([whole[at] ^ 0x40]) + whole[at + 1 :], at)
    for cut in np.linspace(0, len(whole), 12).astype(int).tolist():
        path.write_bytes(whole[:cut] + b"torn"[: cut % 5])
        assert saved(build_map(tiny, config, log=path, resume=True), tmp_path) == wanted
        assert path.read_bytes() == whole


def records(path):
    with build_log.FileIO(path) as file:
        return build_log.scan(file).records


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(data=st.data())
def test_a_log_of_any_bytes_is_read_or_ends_early(tiny, tmp_path, data):
    path = tmp_path / "any"
    if not (tmp_path / "log").exists():
        build_map(tiny, log=tmp_path / "log")
    content = bytearray((tmp_path / "log").read_bytes())
    for _ in range(data.draw(st.integers(1, 5))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 9))] = data.draw(st.binary(max_size=9))
    path.write_bytes(content)
    assert 0 <= frames_logged(path) <= FRAMES


def test_another_sequence_or_other_settings_are_refused_by_name(tiny, tmp_path):
    build_map(tiny, log=tmp_path / "log")
    for config, words in (
        (BuildConfig(method="paper"), r"method \(evidence, now paper\)"),
        (BuildConfig(projection=ProjectionSettings(cell_size_m=0.1)), r"cell_size_m \(0.05, now 0.1\)"),
    ):
        with pytest.raises(InputError, match=words):
            build_map(tiny, config, log=tmp_path / "log", resume=True)
    other = open_sequence(write_tiny_sequence(tmp_path / "other", frames=FRAMES + 1))
    with pytest.raises(InputError, match=r"found another frames \(5, now 6\)"):
        build_map(other, log=tmp_path / "log", resume=True)
    assert frames_logged(tmp_path / "log") == FRAMES


def test_starting_anew_sets_the_unfinished_log_aside_and_resume_takes_the_farther_one(tiny, tmp_path):
    path = tmp_path / "log"
    wanted = saved(build_map(tiny, log=path), tmp_path)
    stop = Stop(after=2)
    with pytest.raises(KeyboardInterrupt):
        build_map(tiny, observers=[stop], log=path)
    assert frames_logged(path) == 1 and frames_logged(set_aside_name(path)) == FRAMES
    told = Stop()
    assert saved(build_map(tiny, observers=[told], log=path, resume=True), tmp_path) == wanted
    assert told.frames == [] and frames_logged(path) == FRAMES


def test_the_farther_log_is_kept_however_often_one_starts_anew(tiny, tmp_path):
    path = tmp_path / "log"
    build_map(tiny, log=path)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            build_map(tiny, observers=[Stop(after=2)], log=path)
        assert frames_logged(path) == 1 and frames_logged(set_aside_name(path)) == FRAMES


@pytest.mark.skipif(sys.platform == "win32", reason="no locks there")
@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSPC])
def test_a_folder_without_locks_is_used_without_and_other_faults_are_told(tiny, tmp_path, monkeypatch, number):
    def refuse(file, how):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", refuse)
    if number == errno.ENOLCK:
        build_map(tiny, log=tmp_path / "log")
        assert frames_logged(tmp_path / "log") == FRAMES
        return
    with pytest.raises(InputError, match="could not write the build log: No space left on device") as told:
        build_map(tiny, log=tmp_path / "log")
    assert not isinstance(told.value, LogBusyError)


def test_a_cancelled_build_goes_on_where_it_was(tiny, tmp_path):
    wanted, cancel = saved(build_map(tiny), tmp_path), threading.Event()
    with pytest.raises(BuildCancelled, match=f"cancelled after 3 of {FRAMES} frames"):
        build_map(tiny, observers=[Stop(after=3, cancel=cancel)], log=tmp_path / "log", cancel=cancel)
    told = Stop()
    assert saved(build_map(tiny, observers=[told], log=tmp_path / "log", resume=True), tmp_path) == wanted
    assert told.frames == [3, 4]


def test_who_wants_colour_sees_all_frames_again_and_the_log_stays(tiny, tmp_path):
    build_map(tiny, log=tmp_path / "log")
    with BuildLog(tmp_path / "log", read_log(tmp_path / "log")[0], resume=True) as log:
        log.cut(2)
    kept = (tmp_path / "log").read_bytes()
    told = Stop()
    told.wants_color = True
    wanted = saved(build_map(tiny), tmp_path)
    assert saved(build_map(tiny, observers=[told], log=tmp_path / "log", resume=True), tmp_path) == wanted
    assert told.frames == list(range(FRAMES)) and (tmp_path / "log").read_bytes().startswith(kept)


def test_one_build_at_a_time_writes_a_log(tiny, tmp_path):
    with BuildLog(tmp_path / "log", {}), pytest.raises(LogBusyError, match="found another one writing it"):
        build_map(tiny, log=tmp_path / "log")


@pytest.mark.parametrize("fault", ["full", "half"])
def test_a_full_disk_is_one_error_and_the_log_goes_on_later(tiny, tmp_path, monkeypatch, fault):
    wanted, room = saved(build_map(tiny), tmp_path), [14_000]

    class Small(build_log.FileIO):
        def write(self, data):
            if room[0] <= 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            part = data[: room[0]] if fault == "half" else data
            room[0] -= len(part)
            return super().write(part)

    monkeypatch.setattr(build_log, "FileIO", Small)
    with pytest.raises(InputError, match="could not write the build log: No space left on device"):
        build_map(tiny, log=tmp_path / "log")
    monkeypatch.undo()
    assert 0 < frames_logged(tmp_path / "log") < FRAMES
    assert saved(build_map(tiny, log=tmp_path / "log", resume=True), tmp_path) == wanted


def test_a_history_holds_the_same_steps_in_less_room(tiny, tmp_path):
    build_map(tiny, log=tmp_path / "log")
    shutil.copy(tmp_path / "log", tmp_path / "copy")
    keep_log(tmp_path / "log", tmp_path / "m.steps")
    facts, plain = read_log(tmp_path / "copy")
    kept, compressed = read_log(tmp_path / "m.steps")
    assert not (tmp_path / "log").exists() and facts == kept
    assert [pack_step(build_log.decode_step(r)) for r in compressed] == [content for _, content in plain]
    assert (tmp_path / "m.steps").stat().st_size < (tmp_path / "copy").stat().st_size
