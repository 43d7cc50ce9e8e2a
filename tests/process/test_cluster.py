"""Builds by several processes: the map, and the build log, are those of one process, whatever happens to workers."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from build_logs import read_log
from dask import config as dask_config
from deadly_sequences import KillsItsWorker, OpensHeld, OpensRandom, OpensSlow
from distributed import LocalCluster
from hypothesis import given, settings
from hypothesis import strategies as st
from sequences import frame_name, write_tiny_sequence

from simaps_viz import open_sequence, save_map
from simaps_viz.build.build_log import BuildLog, frames_logged, log_path
from simaps_viz.build.pipeline import BuildCancelled, BuildConfig, build_map, facts_of
from simaps_viz.build.workers import Reopen, check_versions, gather_shard, job_of, open_workers, reopening, steps_in
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.events import FrameGathered, FrameSkipped
from simaps_viz.mapping.finalize import empty_accumulator, map_so_far

FRAMES = 70
METHODS = ("evidence", "paper")


@pytest.fixture(scope="module")
def address():
    """A cluster of two processes that all tests share."""
    with open_workers("local:2", OpensRandom(0, 1)) as workers:
        assert workers.count() == 2
        yield str(workers.client.scheduler.address)  # pyright: ignore[reportOptionalMemberAccess]


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tiny")
    write_tiny_sequence(folder, frames=FRAMES)
    return folder


def copied(sequence, folder):
    """Return the sequence as a folder of its own, to be damaged."""
    write_tiny_sequence(folder, frames=FRAMES)
    return folder


def npz(simap, path):
    save_map(simap, path)
    return path.read_bytes()


def one_line(capsys):
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("simaps: ")]
    assert len(lines) == 1
    return lines[0]


def address_of(cluster):
    return cluster.scheduler_address


def greet(server, greeting):
    """Let one in, say this, and listen until they go."""
    with server.accept()[0] as connection, suppress(ConnectionResetError):
        connection.sendall(greeting)
        while connection.recv(100):
            pass


def alive_with(leader):
    """Processes that a process has started and that still run; the dead that nobody has asked for do not count."""
    shown = subprocess.run(["ps", "-o", "stat=", "-s", str(leader)], check=False, capture_output=True, text=True)
    return [line for line in shown.stdout.split() if not line.startswith("Z")]


class Listener:
    wants_color = False

    def __init__(self, then=None):
        self.events, self._then = [], then

    def on_event(self, event):
        self.events.append(event)
        if self._then:
            self._then(event)


# Parts of a build, without any cluster


@st.composite
def sharded(draw):
    """A seed, and random frames dealt out to some shards."""
    frames = draw(st.integers(1, 9))
    owner = draw(st.lists(st.integers(0, 3), min_size=frames, max_size=frames))
    order = draw(st.permutations(sorted(set(owner))))
    return draw(st.integers(0, 50)), [[i for i in range(frames) if owner[i] == who] for who in order]


@settings(max_examples=5, deadline=None)
@given(sharded(), st.sampled_from(METHODS))
def test_any_sharding_in_any_order_makes_the_map_of_one_process(tmp_path_factory, dealt, method):
    (seed, shards), config = dealt, BuildConfig(method=method)
    reopen = OpensRandom(seed, sum(map(len, shards)))
    sequence = reopen()
    folder = tmp_path_factory.mktemp("sharded")
    wanted = npz(build_map(sequence, config, log=folder / "log"), folder / "m.npz")
    job, T_map_camera = job_of(sequence, config, reopen), sequence.T_map_world @ sequence.poses

    parts = [list(steps_in(gather_shard(job, shard, T_map_camera[shard]), shard)) for shard in shards]
    joined = empty_accumulator(sequence, config)
    for step in sorted((step for part in parts for step in part), key=lambda step: step.seen.index):
        joined.replay(step)
    assert npz(map_so_far(joined, facts_of(sequence), config), folder / "a.npz") == wanted

    merged = empty_accumulator(sequence, config)
    for part in parts:
        alone = empty_accumulator(sequence, config)
        for step in part:
            alone.replay(step)
        merged.merge(alone)
    assert npz(map_so_far(merged, facts_of(sequence), config), folder / "b.npz") == wanted

    def gatherer(sequence, config, T_map_camera, indices):
        yield None
        yield from sorted((step for part in parts for step in part), key=lambda step: step.seen.index)

    build_map(sequence, config, log=folder / "log2", gatherer=gatherer)
    assert (folder / "log2").read_bytes() == (folder / "log").read_bytes()


def test_what_was_damaged_on_the_way_is_noticed():
    reopen, indices = OpensRandom(1, 3), range(3)
    job = job_of(reopen(), BuildConfig(), reopen)
    data = gather_shard(job, indices, reopen().poses)
    assert [step.seen.index for step in steps_in(data, indices)] == [0, 1, 2]
    for wrong in (data[:-1], data[:20], b"", data[:50] + bytes([data[50] ^ 1]) + data[51:]):
        with pytest.raises(ValueError, match=r"damaged|fewer"):
            list(steps_in(wrong, indices))
    with pytest.raises(ValueError, match="frame 0 in place of 1"):
        list(steps_in(data, [1]))


def test_a_worker_of_another_version_or_with_other_frames_says_so():
    reopen = OpensRandom(1, 3)
    job = job_of(reopen(), BuildConfig(), reopen)
    with pytest.raises(InputError, match=r"expected simaps-viz 9\.9 as where the build was started, found"):
        gather_shard(replace(job, version="9.9"), [0], np.eye(4)[None])
    with pytest.raises(InputError, match="that is being built, found other frames, poses, cameras or tables"):
        gather_shard(replace(job, reopen=OpensRandom(2, 3)), [0], np.eye(4)[None])


# On a cluster


@pytest.mark.parametrize("method", METHODS)
def test_two_workers_build_the_map_and_the_log_of_one_process(sequence, address, tmp_path, method):
    opened, config, listener = open_sequence(sequence), BuildConfig(method=method), Listener()
    wanted = npz(build_map(opened, config, log=tmp_path / "log"), tmp_path / "m.npz")
    with open_workers(address, reopening(opened, tmp_path)) as workers:
        workers.shard_frames = 4
        simap = build_map(opened, config, [listener], log=tmp_path / "log2", gatherer=workers)
        assert workers.moved.frames == FRAMES and 0 < workers.moved.received < FRAMES * 20_000
    assert npz(simap, tmp_path / "m2.npz") == wanted
    assert (tmp_path / "log2").read_bytes() == (tmp_path / "log").read_bytes()
    gathered = [event for event in listener.events if isinstance(event, FrameGathered)]
    assert [(e.index, e.name) for e in gathered] == [(i, frame_name(i)) for i in range(FRAMES)]


def test_a_worker_that_is_killed_loses_nothing(sequence, address, tmp_path):
    opened, flag = open_sequence(sequence), tmp_path / "killed"
    wanted = npz(build_map(opened), tmp_path / "m.npz")
    with open_workers(address, KillsItsWorker(str(sequence), 37, str(flag))) as workers:
        workers.shard_frames = 4
        simap = build_map(opened, gatherer=workers)
    assert flag.exists() and npz(simap, tmp_path / "m2.npz") == wanted


def test_frames_that_kill_every_worker_are_named(sequence, tmp_path):
    opened, log = open_sequence(sequence), tmp_path / "log"
    deadly = KillsItsWorker(str(sequence), 37)
    with dask_config.set({"distributed.scheduler.allowed-failures": 0}), open_workers("local:1", deadly) as workers:
        workers.shard_frames = 4
        with pytest.raises(InputError, match=r"frames \d+ to \d+: expected workers that can gather them, found"):
            build_map(opened, log=log, gatherer=workers)
    assert frames_logged(log) <= 36 and frames_logged(log) % 4 == 0


def test_unreadable_frames_are_skipped_and_counted_as_by_one_process(sequence, address, tmp_path):
    damaged = copied(sequence, tmp_path / "damaged")
    opened, listener = open_sequence(damaged), Listener()
    (damaged / "depth" / f"{frame_name(20)}.png").write_bytes(b"no picture")
    (damaged / "ids" / f"{frame_name(33)}.png").write_bytes(b"")
    wanted = build_map(opened)
    assert wanted.provenance["skipped"]["frames"] == 2
    with open_workers(address, reopening(opened, tmp_path)) as workers:
        simap = build_map(opened, observers=[listener], gatherer=workers)
        assert npz(simap, tmp_path / "b.npz") == npz(wanted, tmp_path / "a.npz")
        assert [e.index for e in listener.events if isinstance(e, FrameSkipped)] == [20, 33]
        with pytest.raises(InputError, match=f"{frame_name(20)}.png: expected"):
            build_map(opened, strict=True, gatherer=workers)


def test_a_stopped_build_keeps_what_has_arrived_and_goes_on_anywhere(sequence, address, tmp_path):
    opened, log = open_sequence(sequence), tmp_path / "log"
    wanted = npz(build_map(opened), tmp_path / "m.npz")
    cancel = threading.Event()
    listener = Listener(lambda e: cancel.set() if isinstance(e, FrameGathered) and e.index == 21 else None)
    with open_workers(address, reopening(opened, tmp_path)) as workers:
        with pytest.raises(BuildCancelled):
            build_map(opened, observers=[listener], log=log, cancel=cancel, gatherer=workers)
        assert frames_logged(log) == 22
        there = build_map(opened, log=log, resume=True, gatherer=workers)
    with BuildLog(log, read_log(log)[0], resume=True) as steps:
        steps.cut(22)
    here = build_map(opened, log=log, resume=True)
    assert npz(there, tmp_path / "a.npz") == npz(here, tmp_path / "b.npz") == wanted


def test_stopping_does_not_wait_for_a_slow_frame(sequence, address, tmp_path):
    cancel, flag = threading.Event(), tmp_path / "held.read"
    cancel.is_set = flag.with_suffix(".asked").exists  # somebody waits for the frame
    with open_workers(address, OpensHeld(str(sequence), 0, str(flag))) as workers:
        at_last = threading.Timer(60.0, flag.touch)
        at_last.start()
        with pytest.raises(BuildCancelled, match=f"cancelled after 0 of {FRAMES} frames"):
            build_map(open_sequence(sequence), cancel=cancel, gatherer=workers)
        assert not flag.exists()
        at_last.cancel()
        flag.touch()


def test_an_observer_that_wants_pictures_is_refused(sequence):
    listener = Listener()
    listener.wants_color = True
    with pytest.raises(InputError, match="expected no observer that wants colour"):
        build_map(open_sequence(sequence), observers=[listener], gatherer=lambda *a: iter(()))  # pyright: ignore


# What goes wrong with clusters


def test_a_worker_without_the_sequence_is_named(sequence, address, tmp_path):
    opened, gone = open_sequence(sequence), str(tmp_path / "gone")
    nowhere = Reopen(((gone, opened.segmentation_source),), str(tmp_path))
    said = rf"worker tcp://127\.0\.0\.1:\d+: {gone}.*: expected .*found"
    with open_workers(address, nowhere) as workers, pytest.raises(InputError, match=said):
        build_map(opened, gatherer=workers)
    other = Reopen(((str(sequence), "a network"),), str(tmp_path))
    with open_workers(address, other) as workers, pytest.raises(InputError, match="expected the masks of a network"):
        build_map(opened, gatherer=workers)


def test_another_version_is_named(address, monkeypatch):
    monkeypatch.setattr("simaps_viz.build.workers.version", lambda name: "9.9")
    said = r"the scheduler: expected simaps-viz 9\.9 as here, found \d"
    with pytest.raises(InputError, match=said), open_workers(address, OpensRandom(0, 1)):
        pass
    about = {there: {"packages": {"simaps-viz": there}} for there in ("9.9", "9.8", None)}
    for there, message in (("9.8", "found 9.8"), (None, "found none installed")):
        found = {"scheduler": about["9.9"], "workers": {"tcp://a:1": about["9.9"], "tcp://b:2": about[there]}}
        client = SimpleNamespace(get_versions=lambda packages, found=found: found)
        with pytest.raises(InputError, match=rf"worker tcp://b:2: expected simaps-viz 9\.9 as here, {message}"):
            check_versions(client)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("scheduler", "message"),
    [
        ("tcp://127.0.0.1:1", "expected a Dask scheduler there, found none (Connection refused)"),
        ("local:0", "expected 1 to 256 processes, found 0"),
        ("local", "expected local:N (N processes of this machine) or the tcp://HOST:PORT of a Dask scheduler"),
        ("http://127.0.0.1:1", "found neither"),
        ("tcp://127.0.0.1:99999", "found neither"),
    ],
)
def test_a_scheduler_that_is_none_is_one_line(sequence, tmp_path, capsys, scheduler, message):
    output = tmp_path / "m.npz"
    assert main(["build", str(sequence), "-o", str(output), "--scheduler", scheduler]) == 2
    assert message in one_line(capsys) and not output.exists()


def test_a_server_that_is_no_scheduler_is_told_apart(monkeypatch):
    for greeting, message in (
        (b"", "found one that does not answer"),
        (b"SSH-2.0-of-some-kind", "found another server"),
    ):
        monkeypatch.setattr("simaps_viz.build.workers._CONNECT_S", 30.0 if greeting else 0.5)
        with socket.create_server(("127.0.0.1", 0)) as server:
            address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
            with ThreadPoolExecutor(1) as pool:
                asked = pool.submit(greet, server, greeting)
                with pytest.raises(InputError, match=message), open_workers(address, OpensRandom(0, 1)):
                    pass
                asked.result()


def test_a_build_that_all_workers_leave_ends_in_one_line(sequence, tmp_path, monkeypatch):
    for name, seconds in (("PATIENCE_S", 0.5), ("_LOOK_S", 0.1), ("_FETCH_S", 1.0)):
        monkeypatch.setattr(f"simaps_viz.build.workers.{name}", seconds)
    log = tmp_path / "log"
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster,
        open_workers(address_of(cluster), OpensSlow(str(sequence), 0.02)) as workers,
    ):
        workers.shard_frames = 4
        leave = [lambda: cluster.scale(0)]  # pyright: ignore[reportAttributeAccessIssue]
        listener = Listener(lambda event: isinstance(event, FrameGathered) and leave and leave.pop()())
        with pytest.raises(InputError, match=r"expected a worker, found none .*--resume continues from what is done"):
            build_map(open_sequence(sequence), observers=[listener], log=log, gatherer=workers)
    assert 0 < frames_logged(log) < FRAMES


def test_without_the_library_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    said = r"--scheduler: expected the package distributed.*simaps-viz\[cluster\]"
    with pytest.raises(InputError, match=said), open_workers("local:1", OpensRandom(0, 1)):
        pass


@pytest.mark.parametrize("option", [["--record", "m.rrd"], ["--method", "vlmaps"]])
def test_what_needs_the_pictures_here_is_refused(sequence, address, tmp_path, capsys, monkeypatch, option):
    monkeypatch.chdir(tmp_path)
    assert main(["build", str(sequence), "-o", "m.npz", "--scheduler", address, *option]) == 2
    assert "--scheduler: expected method evidence, components or paper without --record" in one_line(capsys)
    assert os.listdir(tmp_path) == []


# The command


def test_the_command_says_the_same_and_writes_the_same_file(sequence, address, tmp_path, capsys):
    here, there = tmp_path / "here.npz", tmp_path / "there.npz"
    lines = []
    for output, more in ((here, []), (there, ["--scheduler", address])):
        assert main(["build", str(sequence), "-o", str(output), "--history", "--json", *more]) == 0
        lines.append([json.loads(line) for line in capsys.readouterr().out.splitlines()])
    assert [{**e, "map": 0, "seconds": 0} for e in lines[0]] == [{**e, "map": 0, "seconds": 0} for e in lines[1]]
    assert here.read_bytes() == there.read_bytes()
    kept = [read_log(path.with_suffix(".steps")) for path in (here, there)]
    assert kept[0] == kept[1] and sorted(os.listdir(tmp_path)) == ["here.npz", "here.steps", "there.npz", "there.steps"]


def test_ctrl_c_ends_all_processes_and_the_build_goes_on(sequence, tmp_path):
    output, whole = tmp_path / "m.npz", tmp_path / "whole.npz"
    held = f"OpensHeld(str(s.path), {FRAMES - 1}, {str(tmp_path / 'never')!r})"  # the build cannot end by itself
    slow = f"from simaps_viz.build import workers as b; b.reopening = lambda s, masks: {held};"
    run = "from simaps_viz.cli.main import main; sys.exit(main())"
    code = f"import sys; from deadly_sequences import OpensHeld; {slow} {run}"
    build = ["build", str(sequence), "-o", str(output)]
    started = subprocess.Popen(
        [sys.executable, "-c", code, *build, "--scheduler", "local:2", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1] / "helpers")},
    )  # fmt: skip
    assert started.stdout is not None
    for line in started.stdout:
        if json.loads(line)["event"] == "frame":
            os.killpg(started.pid, signal.SIGINT)  # as a terminal does: to the workers, too
            break
    _, said = started.communicate(timeout=600)
    assert started.returncode == 130, said
    done = frames_logged(log_path(output))
    hint = "the same command with --resume continues; no file is half-written"
    assert said == f"simaps: interrupted after {done} frames; {hint}\n"
    assert 0 < done < FRAMES
    until = time.monotonic() + 600
    while alive_with(started.pid):
        assert time.monotonic() < until
        time.sleep(0.1)
    assert main([*build, "--resume"]) == main(["build", str(sequence), "-o", str(whole)]) == 0
    assert output.read_bytes() == whole.read_bytes()
