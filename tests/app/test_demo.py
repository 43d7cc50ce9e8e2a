"""The demo at once: the shipped map is what is built today, and the page is complete when the frames are there."""

import json
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
import viser
from browser import free_port

from simaps_viz import load_map
from simaps_viz.app import demo, workbench
from simaps_viz.app.demo import SHIPPED_MAP, DemoFrames, FramesPanel, FramesState, shipped_demo, state_in_words
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.cli.main import main
from simaps_viz.errors import InputError
from simaps_viz.scenes.demo import DemoSettings, DepthSensor, demo_manifest, ensure_demo

ROOT = Path(__file__).parents[2]
SMALL = DemoSettings(frames=8, width=160, height=120, sensor=DepthSensor())


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMAPS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("SIMAPS_RECORDINGS", str(tmp_path / "recordings"))
    return tmp_path / "cache"


def test_the_shipped_map_is_the_pinned_one(monkeypatch):
    """That this is what the program builds today is checked by apps/checks/pins.py."""
    monkeypatch.syspath_prepend(str(ROOT / "apps" / "checks"))
    import pins  # noqa: PLC0415 # pyright: ignore[reportMissingImports] - a program of its own

    assert pins.map_digest(SHIPPED_MAP) == json.loads(pins.PINS.read_text())["cafe"]["maps"]["evidence"]
    sys.modules.pop("pins")


def test_the_shipped_map_stands_for_the_frames_that_will_be_rendered(cache, monkeypatch, tmp_path):
    simap = shipped_demo("evidence", BuildConfig(), "light")
    manifest = demo_manifest(cache_dir=cache)
    assert simap is not None and simap.provenance["sequence"] == str(manifest) and len(simap.frame_names) == 200
    assert shipped_demo("paper", BuildConfig(), "light") is None
    assert shipped_demo("evidence", BuildConfig(seed=1), "light") is None
    assert shipped_demo("evidence", BuildConfig(), "heavy") is None
    assert not cache.exists(), "asking changes nothing"
    manifest.parent.mkdir(parents=True)
    manifest.write_text("{}")
    assert shipped_demo("evidence", BuildConfig(), "light") is None, "rendered already"
    manifest.unlink()
    monkeypatch.setattr(demo, "SHIPPED_MAP", tmp_path / "absent.npz")
    assert shipped_demo("evidence", BuildConfig(), "light") is None, "not a checkout"


@pytest.mark.parametrize("level", ["none", "light"])
def test_the_manifest_is_where_it_will_be(cache, level):
    expected = demo_manifest(level=level, seed=0, cache_dir=cache, settings=SMALL)
    assert not expected.exists()
    assert ensure_demo(level=level, cache_dir=cache, settings=SMALL) == expected


@pytest.mark.slow
def test_the_page_is_there_at_once_and_complete_when_the_frames_are(monkeypatch):
    monkeypatch.setattr(demo, "ensure_demo", lambda **given: ensure_demo(**given, settings=SMALL))
    seen = []

    def wait(page):
        seen.append(page.services.panels)
        (thread,) = (one for one in threading.enumerate() if one.name == "demo-frames")
        thread.join(300.0)
        seen.append(page.services.panels)
        seen.append(page.services.look_back(page.simap, 3))
        seen.append(page.simap.frame_names)

    monkeypatch.setattr("simaps_viz.viewer.workbench.Workbench.wait", wait)
    assert main(["demo", "--no-browser", "--port", "0"]) == 0
    before, after, past, frames = seen
    assert before[0].title == "Map" and before[0] not in after
    assert {spec.place for spec in before} == {"tab"}, "a page opens on the map"
    needs_frames = {"Masks", "Compare"}
    assert not needs_frames & {spec.title for spec in before} and needs_frames <= {spec.title for spec in after}
    assert past is not None and len(frames) == 8


def test_a_page_that_is_closed_stops_the_rendering(monkeypatch):
    begun = threading.Event()

    def endless(*, progress, **given):
        while True:
            progress("rendering frames", 43, 200)
            begun.set()

    monkeypatch.setattr(demo, "ensure_demo", endless)
    frames = DemoFrames()
    frames.start(SimpleNamespace())  # pyright: ignore[reportArgumentType] - never reached
    assert begun.wait(60.0)
    assert state_in_words(frames.state()) == "Rendering the café's frames: 43 of 200"
    frames.stop()
    assert not [one for one in threading.enumerate() if one.name == "demo-frames"]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (InputError("cache: no room"), "The frames could not be made: cache: no room"),
        (ZeroDivisionError("x"), "The frames could not be made: Unexpected error (ZeroDivisionError): x"),
    ],
)
def test_a_failure_is_reported_on_the_page(monkeypatch, error, words):
    def fail(**given):
        raise error

    monkeypatch.setattr(demo, "ensure_demo", fail)
    frames = DemoFrames()
    frames.start(SimpleNamespace())  # pyright: ignore[reportArgumentType] - never reached
    frames.stop()
    assert state_in_words(frames.state()) == words


def test_the_page_keeps_its_first_panels_when_the_frames_are_there_and_has_the_order_it_has_later():
    maps, simap = workbench.maps_of(), load_map(SHIPPED_MAP)
    first = workbench.panels_without_frames(maps)
    finished = workbench.panels_of(simap, None, maps, first)
    assert finished[: len(first)] == first
    later = workbench.panels_of(simap, None, workbench.maps_of())
    assert [one.title for one in finished] == [one.title for one in later]


def test_how_far_the_frames_are_is_above_all_else_in_its_tab_until_they_are_there():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    try:
        other = server.gui.add_html("")
        panel = FramesPanel(server.gui, DemoFrames())
        shown = panel._head, panel._bar, panel._note
        assert "Preparing the café" in panel._head.content and all(one.order < other.order for one in shown)
        panel.close()
        assert not any(one.visible for one in shown)
    finally:
        server.stop()


def test_stages_without_steps_have_no_numbers():
    assert state_in_words(FramesState()) == "Preparing the café …"
