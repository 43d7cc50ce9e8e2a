"""How a build that is watched ends when something beside the map is wrong: the map is there, and the page has it."""

import threading

from fake_page import fake_page
from live_sequences import at_once, held_sequence, settings
from toy_maps import toy_map

from simaps_viz.app import live
from simaps_viz.app.live import STARTS_AGAIN, STOPPED, Audience, LiveBuild, live_workbench
from simaps_viz.build.pipeline import BuildCancelled, BuildConfig
from simaps_viz.build.to_file import BuildRequest, RecordingFault
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.mapping.file import load_map, save_map
from simaps_viz.mapping.mending import open_mending

FRAMES = 6


def watched(held, how):
    """Build with a page open; returns the state at the end, the page's map and its panels."""
    with (
        stage_progress(quiet=True) as progress,
        live_workbench(held, how, progress) as (bench, build),
        fake_page(bench) as page,
    ):
        build.start()
        assert build.wait(60.0)
        assert bench.wait_idle(60.0)
        return build.state(), page.session.simap, page.session.panels.titles


def test_edits_of_an_earlier_build_cost_no_map(tmp_path):
    output = tmp_path / "m.npz"
    save_map(toy_map(), output)
    mending = open_mending(output)
    mending.do(mending.simap(), "delete", 9, who="Ann")
    state, shown, panels = watched(held_sequence(tmp_path / "tiny", FRAMES, held_from=FRAMES), settings(output))
    assert state.status == "done" and state.error == ""
    assert "Saved as" in state.notice and "found edits of another build" in state.notice and "--adopt" in state.notice
    assert len(shown.frame_names) == len(load_map(output).frame_names) == FRAMES
    assert "Compare" in panels and "Mend" not in panels


def test_a_recording_that_is_lost_costs_no_map(tmp_path, monkeypatch):
    build_plainly = live.build_to_file

    def loses_recording(*arguments, **named):
        raise RecordingFault(
            InputError("m.rrd: could not write the recording: full"), build_plainly(*arguments, **named)
        )

    monkeypatch.setattr(live, "build_to_file", loses_recording)
    held = held_sequence(tmp_path / "tiny", FRAMES, held_from=FRAMES)
    state, shown, _ = watched(held, settings(tmp_path / "m.npz"))
    assert state.status == "done" and "could not write the recording: full" in state.notice
    assert len(shown.frame_names) == FRAMES


def test_a_method_without_a_log_begins_anew_and_says_so(tmp_path, monkeypatch):
    at_once(monkeypatch)
    held = held_sequence(tmp_path / "tiny", 12, held_from=6)
    how = BuildRequest("vlmaps", BuildConfig(), tmp_path / "m.npz")
    with stage_progress(quiet=True) as progress, live_workbench(held, how, progress) as (_, build):
        build.start()
        build.stop()
        held.let_go()
        assert build.wait(60.0) and (build.state().status, build.state().notice) == ("stopped", STARTS_AGAIN)
        build.go_on()
        assert build.wait(60.0) and build.state().status == "done", build.state().error
    assert len(load_map(tmp_path / "m.npz").frame_names) == 12


def test_a_build_that_has_just_ended_is_not_stopping():
    """The thread of a build clears up for a while after it has said how it ended."""
    clearing, ended = threading.Event(), threading.Event()

    class SlowToGo:
        map_so_far = None

        def __del__(self):
            ended.set()
            clearing.wait(60.0)

    def run(observers, cancel, resume):
        if not resume:
            observers[0]._latest = SlowToGo()  # freed when the thread has told
            raise BuildCancelled("stopped")
        return toy_map()

    build = LiveBuild(run, 9, Audience(show=lambda m: None, watches=lambda: False, done=lambda m: "Saved."))
    build.start()
    assert ended.wait(60.0) and build.state().notice == STOPPED
    build.stop()
    assert build.state().status == "stopped"
    threading.Timer(0.2, clearing.set).start()
    build.go_on()
    assert build.wait(60.0) and build.state().status == "done"
