"""Mended by hand in the whole workbench, in Debian's Chromium: why an object is one says who made it, of what."""

import re

import pytest
from browser import field_of, free_port, mine, on_canvas, open_workbench, until, watched_page
from playwright.sync_api import expect
from toy_maps import toy_map

from simaps_viz.app import workbench
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.mending import open_mending
from simaps_viz.viewer.panels.mend import MendPanel

CHAIR_3, CHAIR_4, PLANT_9 = (-0.2, -0.8), (3.8, -0.6), (4.55, -1.45)
TABLE_8, CUT = (3.8, 0.3), ((3.6, -0.3), (3.6, 0.9))
BY_HAND = "One object because people made it so by hand"
MACHINE = re.compile("One object (because all|although only)|never joined from parts")
PAUSE_MS = 200


@pytest.fixture(scope="module")
def opened(browser, tmp_path_factory):
    """The page, its workbench and the edits; the tests mend one object after another."""
    path = tmp_path_factory.mktemp("mended") / "toy.npz"
    save_map(toy_map(), path)
    mending = open_mending(path)
    with (
        workbench.open_workbench(mending.simap(), recording=None, port=free_port(), mending=mending) as bench,
        watched_page(browser, 1280, 1000) as page,
    ):
        open_workbench(page, bench)
        yield page, bench, mending


def click(opened, place):
    page, bench, _ = opened
    page.wait_for_timeout(PAUSE_MS)
    page.mouse.click(*on_canvas(bench, page, *place))
    page.wait_for_timeout(PAUSE_MS)


def press(page, role, name):
    page.get_by_role(role, name=name, exact=True).click()
    page.wait_for_timeout(PAUSE_MS)


def panel_of(opened):
    panel = mine(opened[1]).panels[MendPanel]
    assert isinstance(panel, MendPanel)
    return panel


def sign(opened, name):
    page, panel = opened[0], panel_of(opened)
    press(page, "tab", "Mend")
    field_of(page, "Your name").fill(name)
    until(page, lambda: panel._who.value == name)


def chosen(opened, place, number):
    """Click an object, and wait until the panel speaks of it."""
    click(opened, place)
    until(opened[0], lambda: panel_of(opened)._shown == number)


def waits(opened, what):
    press(opened[0], "button", {"join": "Join", "cut": "Cut in two"}[what])
    until(opened[0], lambda: panel_of(opened).waiting == what)


def mended(opened, edits):
    """Wait until there are so many edits and the next click selects again."""
    until(opened[0], lambda: len(opened[2].log.entries) == edits and panel_of(opened).waiting is None)


def explained(opened, what, who, words):
    """The Instance tab says that people made the selected object, who and when, and of what."""
    page, _, mending = opened
    press(page, "tab", "Instance")
    expect(page.get_by_text(BY_HAND)).to_be_visible()
    expect(page.get_by_text(words)).to_be_visible()
    expect(page.get_by_text(MACHINE)).to_have_count(0)
    when = mending.log.entries[-1].when
    line = f"{what}, by {who}, {when[:10]} {when[11:16]} UTC"
    expect(page.locator("div:has(> b:text-is('Edited by hand'))").get_by_text(line)).to_be_visible()


def test_an_object_nobody_mended_is_explained_by_the_frames(opened):
    page, _, _ = opened
    press(page, "tab", "Instance")
    click(opened, PLANT_9)
    expect(page.get_by_text(MACHINE)).to_be_visible()
    expect(page.get_by_text(BY_HAND)).to_have_count(0)


def test_an_object_joined_by_hand_says_who_joined_what(opened):
    sign(opened, "Ann")
    chosen(opened, CHAIR_3, 3)
    waits(opened, "join")
    click(opened, CHAIR_4)
    mended(opened, 1)
    click(opened, CHAIR_4)
    explained(opened, "joined chair 3 and chair 4", "Ann", "Of the 5 frames that saw it, 2 saw")


def test_an_object_cut_by_hand_says_who_cut_what(opened):
    mending = opened[2]
    sign(opened, "Ann")
    before = len(mending.log.entries)
    chosen(opened, TABLE_8, 8)
    waits(opened, "cut")
    click(opened, CUT[0])
    until(opened[0], lambda: len(panel_of(opened)._points) == 1)
    click(opened, CUT[1])
    mended(opened, before + 1)
    click(opened, TABLE_8)
    explained(opened, "cut dining table 8 in two", "Ann", "Of the 4 frames that saw it, 4 saw")


def test_an_object_renamed_by_hand_says_who_calls_it_so(opened):
    page, bench, mending = opened
    sign(opened, "Bo")
    before = len(mending.log.entries)
    chosen(opened, PLANT_9, 9)
    field_of(page, "Class").click()
    page.get_by_role("option", name="couch").first.click()
    until(page, lambda: panel_of(opened)._class.value == "couch")
    press(page, "button", "Rename")
    mended(opened, before + 1)
    click(opened, PLANT_9)
    explained(opened, "potted plant 9 is called couch", "Bo", "Of the 4 frames that saw it, 4 saw")
    assert mine(bench).selected == 9
