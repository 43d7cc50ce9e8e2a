"""Mended by hand in the whole workbench, in Debian's Chromium: why an object is one says who made it, of what."""

import re

import pytest
from browser import field_of, free_port, mine, on_canvas, open_workbench, until, watched_page
from playwright.sync_api import expect
from toy_maps import toy_map

from simaps_viz import wiring
from simaps_viz.mapping.mapfile import save_map
from simaps_viz.mapping.mending import open_mending

pytestmark = pytest.mark.browser
CHAIR_3, CHAIR_4, PLANT_9 = (-0.2, -0.8), (3.8, -0.6), (4.55, -1.45)
TABLE_8, CUT = (3.8, 0.3), ((3.6, -0.3), (3.6, 0.9))
BY_HAND = "One object because people made it so by hand"
MACHINE = re.compile("One object (because all|although only)|never joined from parts")
PAUSE_MS = 200


def test_why_is_this_one_object_says_who_made_it_by_hand_and_of_what(browser, tmp_path):
    expect.set_options(timeout=15_000)
    save_map(toy_map(), tmp_path / "toy.npz")
    mending = open_mending(tmp_path / "toy.npz")
    with (
        wiring.workbench(mending.simap(), recording=None, port=free_port(), mending=mending) as bench,
        watched_page(browser, 1280, 1000) as page,
    ):
        open_workbench(page, bench)

        def click(place):
            page.wait_for_timeout(PAUSE_MS)
            page.mouse.click(*on_canvas(bench, page, *place))
            page.wait_for_timeout(PAUSE_MS)

        def press(name):
            page.get_by_role("button", name=name, exact=True).click()
            page.wait_for_timeout(PAUSE_MS)

        def tab(name):
            page.get_by_role("tab", name=name, exact=True).click()
            page.wait_for_timeout(PAUSE_MS)

        def explained(what, who, words):
            tab("Instance")
            expect(page.get_by_text(BY_HAND)).to_be_visible()
            expect(page.get_by_text(words)).to_be_visible()
            expect(page.get_by_text(MACHINE)).to_have_count(0)
            when = mending.log.entries[-1].when
            line = f"{what}, by {who}, {when[:10]} {when[11:16]} UTC"
            expect(page.locator("div:has(> b:text-is('Edited by hand'))").get_by_text(line)).to_be_visible()
            tab("Mend")

        click(PLANT_9)
        expect(page.get_by_text(MACHINE)).to_be_visible()
        expect(page.get_by_text(BY_HAND)).to_have_count(0)

        tab("Mend")
        field_of(page, "Your name").fill("Ann")
        click(CHAIR_3)
        press("Join")
        click(CHAIR_4)
        until(page, lambda: len(mending.log.entries) == 1)
        click(CHAIR_4)
        explained("joined chair #3 and chair #4", "Ann", "Of the 5 frames that saw it, 2 saw")

        click(TABLE_8)
        press("Cut in two")
        click(CUT[0])
        click(CUT[1])
        until(page, lambda: len(mending.log.entries) == 2)
        click(TABLE_8)
        explained("cut dining table #8 in two", "Ann", "Of the 4 frames that saw it, 4 saw")

        field_of(page, "Your name").fill("Bo")
        click(PLANT_9)
        field_of(page, "Class").click()
        page.get_by_role("option", name="couch").first.click()
        page.wait_for_timeout(PAUSE_MS)
        press("Rename")
        until(page, lambda: len(mending.log.entries) == 3)
        click(PLANT_9)
        explained("potted plant #9 is called couch", "Bo", "Of the 4 frames that saw it, 4 saw")
        assert mine(bench).selected == 9
