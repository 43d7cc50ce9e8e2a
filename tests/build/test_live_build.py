"""A build that is watched: it shows what it has, stops, goes on, and ends in the file a plain build writes."""

import numpy as np
import pytest
from fake_page import fake_page
from live_sequences import at_once, held_sequence, settings
from waiting import until

from simaps_viz.app.live import Audience, LiveBuild, live_workbench, waiting_map
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import BuildRequest, build_to_file
from simaps_viz.console.progress import stage_progress
from simaps_viz.errors import InputError
from simaps_viz.recorder.web_viewer import CONTENT_SECURITY_POLICY
from simaps_viz.viewer.panels.build import BuildPanel
from simaps_viz.viewer.panels.live import HEADS, WAITING, LiveState, duration, head_html, text_html

ALWAYS = ("Map", "Instance", "Command", "Build")


def plain(sequence, output):
    with stage_progress(quiet=True) as progress:
        build_to_file(sequence, BuildRequest("evidence", BuildConfig(), output, history=True), progress)
    return output.read_bytes()


def test_stopped_and_gone_on_with_it_ends_in_the_same_bytes_and_panels_come(tmp_path, monkeypatch):
    at_once(monkeypatch)
    held = held_sequence(tmp_path / "tiny", 40, held_from=20)
    output = tmp_path / "m.npz"
    with stage_progress(quiet=True) as progress, live_workbench(held, settings(output), progress) as (bench, build):
        with fake_page(bench) as page:
            session = page.session
            assert session.panels.titles == ("Progress", *ALWAYS)
            assert not (session.simap.grid.observations > 0).any() and build.state().status == "starting"
            build.start()
            until(lambda: session.simap.frame_names and build.state().done >= 8)
            assert session.wait_idle() and len(session.simap.frame_names) < 40
            assert (session.simap.grid.observations > 0).any()
            build.stop()
            held.let_go()
            assert build.wait(60.0) and build.state().status == "stopped"
            assert not output.exists() and build.state().done < 40
            build.go_on()
            assert build.wait(60.0)
            assert build.state().status == "done" and "m.npz" in build.state().notice
            assert bench.wait_idle()
            titles = session.panels.titles
            assert set(titles) == {"Progress", *ALWAYS, "Errors", "Compare", "Masks", "Mend", "Share"}
            assert len(session.simap.frame_names) == 40 and not session.services.building
            session.show_frame(2)
            assert session.wait_idle()
            assert "seen" in session.panels[BuildPanel]._then.content
        with fake_page(bench) as late:
            assert sorted(late.session.panels.titles) == sorted(titles)
    assert output.read_bytes() == plain(held.whole, tmp_path / "plain.npz")


def test_a_build_that_fails_says_so_and_can_be_tried_again():
    turns = []

    def run(observers, cancel, resume):
        turns.append(resume)
        if len(turns) == 1:
            raise InputError("depth/000007.png: expected a picture, found none")
        raise ZeroDivisionError("a fault")

    build = LiveBuild(run, 9, Audience(show=lambda m: None, watches=lambda: True, done=lambda m: ""))
    build.start()
    assert build.wait(60.0) and build.state().status == "failed"
    assert build.state().error == "depth/000007.png: expected a picture, found none"
    build.go_on()
    assert build.wait(60.0) and turns == [False, True]
    assert build.state().error == "Unexpected error (ZeroDivisionError): a fault"


def test_nobody_looks_so_no_map_is_made(tmp_path):
    held = held_sequence(tmp_path / "tiny", 12, held_from=99)
    shown = []

    def run(observers, cancel, resume):
        with stage_progress(quiet=True) as progress:
            request = BuildRequest("evidence", BuildConfig(), tmp_path / "m.npz")
            return build_to_file(held.whole, request, progress, observers=tuple(observers), cancel=cancel)

    build = LiveBuild(run, 12, Audience(show=shown.append, watches=lambda: False, done=lambda m: "there"))
    build.start()
    assert build.wait(60.0) and shown == [] and build.state().notice == "there" and build.state().done == 12


class Stream:
    def __init__(self):
        self.shown = []

    def on_event(self, event):
        pass

    def show(self, event, simap):
        self.shown.append((event.frame.index, simap))


@pytest.mark.parametrize("show", [True, False])
def test_a_stopped_build_shows_the_map_of_all_its_frames(tmp_path, monkeypatch, show):
    monkeypatch.setattr("simaps_viz.app.live.FIRST_S", 1e9)  # so that nothing is shown but what stopping shows
    held = held_sequence(tmp_path / "tiny", 40, held_from=20)
    maps, stream, sketched = [], Stream(), []

    def run(observers, cancel, resume):
        with stage_progress(quiet=True) as progress:
            request = BuildRequest("evidence", BuildConfig(), tmp_path / "m.npz", history=True)
            return build_to_file(held, request, progress, observers=tuple(observers), cancel=cancel)

    def sketch(event):
        sketched.append(event.frame.index)
        return b"png"

    build = LiveBuild(run, 40, Audience(maps.append, lambda: True, lambda m: "", stream, sketch))  # pyright: ignore
    build.start()
    until(lambda: build.state().done >= 8)
    assert maps == [] and WAITING in text_html(build.state())
    build.stop(show=show)
    held.let_go()
    assert build.wait(60.0) and build.state().status == "stopped" and 8 <= build.state().done < 40
    if not show:
        assert maps == [] and stream.shown == [] and build.state().shown == 0
        return
    (simap,) = maps
    assert len(simap.frame_names) == build.state().shown == build.state().done and simap.instances
    assert stream.shown == [(build.state().done - 1, simap)] and sketched[-1] == build.state().done - 1


def test_a_map_of_a_stopped_build_that_cannot_be_shown_stops_it_all_the_same(tmp_path):
    held = held_sequence(tmp_path / "tiny", 40, held_from=20)

    def run(observers, cancel, resume):
        with stage_progress(quiet=True) as progress:
            request = BuildRequest("evidence", BuildConfig(), tmp_path / "m.npz")
            return build_to_file(held, request, progress, observers=tuple(observers), cancel=cancel)

    def broken(simap):
        raise ZeroDivisionError("a fault of the page")

    build = LiveBuild(run, 40, Audience(show=broken, watches=lambda: True, done=lambda m: ""))
    build.start()
    until(lambda: build.state().done >= 8)
    build.stop()
    held.let_go()
    assert build.wait(60.0) and build.state().status == "stopped" and build.state().shown == 0


def test_the_waiting_map_shows_the_floor_around_the_cameras(tmp_path):
    held = held_sequence(tmp_path / "tiny", 5, held_from=99)
    simap = waiting_map(held.whole, BuildConfig(method="evidence"))
    at = (held.whole.T_map_world @ held.whole.poses)[:, :2, 3]
    assert np.all(at.min(axis=0) > simap.spec.extent_m[:2]) and np.all(at.max(axis=0) < simap.spec.extent_m[2:])
    assert simap.instances == () and simap.frame_names == ()


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (LiveState(total=7), ("Waiting for the first frame", "0 of 7 frames")),
        (LiveState("building", 3, 7, 12.4, 65.0), ("Building the map", "12 frames/s", "1 min 05 s left", WAITING)),
        (LiveState("building", 3, 7, shown=2), ("The map shows the first 2 frames.",)),
        (LiveState("building", 3, 7, 0.25, 4.0, skipped=1), ("0.2 frames/s", "4 s left", "1 could not be read")),
        (LiveState("stopped", 3, 7, notice="go on"), ("Stopped", "go on")),
        (LiveState("failed", 3, 7, error="a <b>"), ("The build failed", "a &lt;b&gt;")),
    ],
)
def test_the_numbers_are_said_in_words(state, words):
    html = head_html(HEADS[state.status]) + text_html(state)
    assert all(one in html for one in words)


def test_durations():
    assert [duration(s) for s in (0.2, 59.4, 60, 3661)] == ["1 s", "59 s", "1 min 00 s", "1 h 01 min"]


def test_the_page_of_a_stream_reaches_its_own_server_and_nothing_else():
    connect = next(part for part in CONTENT_SECURITY_POLICY.split("; ") if part.startswith("connect-src"))
    assert connect == "connect-src 'self' data: blob:"
