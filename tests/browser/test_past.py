"""A page that shows the past, in Debian's Chromium: it says so, its camera moves along, and it finds back."""

from dataclasses import replace

import numpy as np
import pytest
from browser import (
    field_of,
    free_port,
    mine,
    open_workbench,
    toy_services,
    until,
    watched_page,
)
from built_maps import FRAMES, built, fill
from playwright.sync_api import expect
from sequences import write_tiny_sequence
from toy_maps import _views, toy_map

from simaps_viz import open_sequence
from simaps_viz.app import workbench as app
from simaps_viz.viewer.page.shared import TimeStep
from simaps_viz.viewer.panels.build import BuildPanel, StepsPanel
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.workbench import Workbench

POSE = """() => {
  const node = window.__viserMutable.nodeRefFromName['/camera'];
  return node && node.visible ? node.position.toArray() : null;
}"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A map with its history, and its file."""
    folder = tmp_path_factory.mktemp("past")
    simap = built(open_sequence(write_tiny_sequence(folder / "tiny", frames=FRAMES)), folder / "m.npz")
    return simap, folder / "m.npz"


@pytest.fixture(scope="module")
def opened(browser, made):
    simap, path = made
    with (
        app.open_workbench(simap, recording=None, port=free_port(), map_path=path) as bench,
        watched_page(browser) as page,
    ):
        open_workbench(page, bench)
        yield bench, page


@pytest.fixture
def page(page):
    page.get_by_role("tab", name="Build", exact=True).click()
    return page


def at_end(session) -> bool:
    """The page shows the finished map, and nothing of any other time."""
    return session.time == TimeStep(FRAMES - 1) and not session.snapshot().badge


def test_the_camera_moves_while_the_build_plays_and_goes_at_the_end(bench, page):
    session = mine(bench)
    poses = session.simap.T_map_camera[:, :3, 3]
    assert page.evaluate(POSE) is None
    fill(page, "Frame", "2")
    until(page, lambda: (pose := page.evaluate(POSE)) is not None and np.allclose(pose, poses[2], atol=1e-4))
    session.panels[BuildPanel]._rate.value = 1  # slow enough to be seen whatever else the machine does
    page.get_by_role("button", name="Play", exact=True).click()
    seen = set()
    there = {tuple(pose) for pose in np.round(poses, 3).tolist()}
    until(page, lambda: seen.add(tuple(np.round(page.evaluate(POSE) or poses[2], 3).tolist())) or seen >= there)
    assert len(there) == 3 and session.frame < FRAMES - 1, "it still plays"
    session.panels[BuildPanel]._rate.value = 30
    until(page, lambda: session.frame == FRAMES - 1 and page.evaluate(POSE) is None)


def test_the_past_is_marked_and_one_button_ends_it(bench, page):
    session = mine(bench)
    fill(page, "Frame", "5")
    page.get_by_role("tab", name="Map", exact=True).click()
    expect(page.get_by_text(f"as of frame 5, the last is {FRAMES - 1}").first).to_be_visible()
    until(page, lambda: session.scene._scene.get_handle_by_name("/badge") is not None)
    page.get_by_role("button", name="Show the finished map").click()
    until(page, lambda: at_end(session))
    expect(page.get_by_role("button", name="Show the finished map")).to_have_count(0)
    until(page, lambda: page.evaluate(POSE) is None)


def test_steps_and_frames_never_mix(bench, page):
    session = mine(bench)
    fill(page, "Frame", "5")
    until(page, lambda: not session.panels[StepsPanel]._slider.disabled)
    first = str(-bench.shared.timeline(session.simap).levels)
    fill(page, "Merges done", first)
    until(page, lambda: session.time.step == 0 and session.frame == FRAMES - 1)
    until(page, lambda: page.evaluate(POSE) is None)
    page.get_by_role("tab", name="Map", exact=True).click()
    expect(page.get_by_text("classes only", exact=True).first).to_be_visible()
    page.get_by_role("tab", name="Build", exact=True).click()
    page.get_by_role("button", name="Back to the map").click()
    until(page, lambda: at_end(session))
    expect(field_of(page, "Merges done")).not_to_have_value(first)  # else there is nothing to choose
    fill(page, "Merges done", first)
    until(page, lambda: session.time.step == 0)
    fill(page, "Frame", "7")
    until(page, lambda: session.time.step is None and session.frame == 7)


def test_a_command_is_given_on_the_finished_map(bench, page):
    session = mine(bench)
    fill(page, "Frame", "5")
    until(page, lambda: session.frame == 5)
    session.panels[CommandPanel]._drive.speed = 8.0
    session.panels[CommandPanel].ask("go to the chair")
    until(page, lambda: at_end(session))
    until(page, lambda: "Done" in session.panels[CommandPanel]._result.content)


def test_a_map_without_frames_says_how_to_get_them(browser):
    whole = toy_map()
    bare = replace(whole, frame_names=(), T_map_camera=np.zeros((0, 4, 4)), views=_views(np.zeros((2, 2), np.int32), 0))
    with Workbench(bare, services=toy_services(), port=free_port()) as bench, watched_page(browser) as page:
        open_workbench(page, bench)
        page.get_by_role("tab", name="Build", exact=True).click()
        expect(page.get_by_text("This map keeps no frames. Build it again with --history")).to_be_visible()
        expect(page.get_by_text("Map as it was then")).to_have_count(0)
        expect(page.get_by_role("button", name="Play", exact=True)).to_have_count(0)
