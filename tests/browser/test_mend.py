"""People mend a map on the page: what they see, what is saved, that all pages show it, and how it is explained."""

import json
import re
from contextlib import contextmanager

import numpy as np
import pytest
from browser import field_of, free_port, mine, on_canvas, open_workbench, pixel, until, watched_page
from playwright.sync_api import expect
from toy_maps import toy_map

from simaps_viz.app import workbench
from simaps_viz.colors.classes import instance_color
from simaps_viz.drawing.texture import map_image
from simaps_viz.mapping.file import save_map
from simaps_viz.mapping.mending import edits_path, open_mending
from simaps_viz.viewer.panels.mend import MendPanel

CHAIR_1, CHAIR_3, CHAIR_4 = (1.25, 1.9), (-0.2, -0.8), (3.8, -0.6)
TABLE_8, PLANT_9 = (3.8, 0.3), (4.55, -1.45)
PAUSE_MS = 150
BY_HAND = "One object because people made it so by hand"
MACHINE = re.compile("One object (because all|although only)|never joined from parts")


@contextmanager
def mendable(folder):
    """The workbench of a map that can be mended, and its edits."""
    save_map(toy_map(), folder / "toy.npz")
    mending = open_mending(folder / "toy.npz")
    with workbench.open_workbench(mending.simap(), recording=None, port=free_port(), mending=mending) as bench:
        yield bench, mending


@pytest.fixture
def mended(tmp_path):
    with mendable(tmp_path) as found:
        yield found


@pytest.fixture
def bench(mended):
    return mended[0]


@pytest.fixture
def mending(mended):
    return mended[1]


def opened(page, bench):
    """Open the page at its Mend tab; returns its session and panel."""
    open_workbench(page, bench)
    press(page, "Mend", role="tab")
    session = mine(bench)
    return session, session.panels[MendPanel]


def selected(page, name):
    """Wait until an object's name is on the panel."""
    expect(page.locator(f"b:text-is('{name}'):visible")).to_be_visible()  # the Instance tab may have it, too


def shows(bench, page, place, instance_id, session=None):
    """Wait until the map has an object, or none, at a place, in its colour; nothing is selected, which would dim it."""
    session = session or mine(bench)
    session.select(None)

    def there():
        simap = session.simap
        found, (row, col) = simap.at(*place), simap.spec.cell_of(*place)
        wanted = map_image(simap, "instance", scale=1)[row, col].astype(int)
        as_wanted = np.abs(wanted - pixel(bench, page, *place, session=session)).max() <= 3
        return as_wanted and (None if found is None else found.id) == instance_id

    until(page, there)


def click(bench, page, place, session=None):
    page.wait_for_timeout(PAUSE_MS)
    x, y = on_canvas(bench, page, place[0], place[1], session)
    page.mouse.click(x, y)
    page.wait_for_timeout(PAUSE_MS)


def press(page, name, role="button"):
    page.get_by_role(role, name=name, exact=True).click()
    page.wait_for_timeout(PAUSE_MS)


def choose(panel, page, label, option):
    """Choose, and wait until the panel knows: viser's page sends only the last change of any 50 ms."""
    field_of(page, label).click()
    page.get_by_role("option", name=option).first.click()
    chosen = {"Class": panel._class, "Join with": panel._other, "Cut along": panel._how}[label]
    until(page, lambda: option in str(chosen.value))


def sign(panel, page, name):
    field_of(page, "Your name").fill(name)
    until(page, lambda: panel._who.value == name)


def cut_by_clicks(panel, page):
    press(page, "Cut in two")
    until(page, lambda: panel.waiting == "cut")


def joins(bench, page, mending):
    click(bench, page, CHAIR_3)
    selected(page, "chair 3")
    press(page, "Join")
    expect(page.get_by_text("Click the other object on the map")).to_be_visible()
    click(bench, page, (0.5, 0.3))
    expect(page.get_by_text("There is nothing there.")).to_be_visible()
    click(bench, page, CHAIR_4)
    expect(page.get_by_text("They do not touch: 3.60 m lie between them.")).to_be_visible()
    selected(page, "chair 3")  # what was joined is selected
    expect(page.locator("ol").get_by_text("joined chair 3 and chair 4")).to_be_visible()
    press(page, "Instance", role="tab")
    expect(page.get_by_text(f"{BY_HAND}, see below.")).to_be_visible()
    expect(page.get_by_text(MACHINE)).to_have_count(0)
    when = mending.log.entries[-1].when
    line = f"joined chair 3 and chair 4, by Ann, {when[:10]} {when[11:16]} UTC"
    expect(page.locator("div:has(> b:text-is('Edited by hand'))").get_by_text(line)).to_be_visible()
    press(page, "Mend", role="tab")
    shows(bench, page, CHAIR_4, 3)
    assert pixel(bench, page, *CHAIR_4) == pixel(bench, page, *CHAIR_3)
    expect(page.get_by_text("Saved to")).to_be_visible()


def cuts(bench, page, mending):
    click(bench, page, TABLE_8)
    selected(page, "dining table 8")
    cut_by_clicks(mine(bench).panels[MendPanel], page)
    click(bench, page, (3.6, -0.3))
    expect(page.get_by_text("Now click the second point")).to_be_visible()
    click(bench, page, (3.6, 0.9))
    expect(page.locator("ol").get_by_text("cut dining table 8 in two")).to_be_visible()
    sizes = sorted(one.cells for one in mending.simap().of_class("dining table"))
    assert sizes[2] == 216 and sum(sizes[:2]) == 192 and abs(sizes[0] - 48) <= 12
    for x in (3.5, 3.9):
        shows(bench, page, (x, 0.3), mending.simap().at(x, 0.3).id)
    assert pixel(bench, page, 3.5, 0.3) != pixel(bench, page, 3.9, 0.3)


def renames(bench, page, mending):
    panel = mine(bench).panels[MendPanel]
    click(bench, page, PLANT_9)
    selected(page, "potted plant 9")
    choose(panel, page, "Class", "new class")
    field_of(page, "New class").fill("tree fern")
    until(page, lambda: panel._new.value == "tree fern")
    press(page, "Rename")
    expect(page.locator("ol").get_by_text("potted plant 9 is called tree fern")).to_be_visible()
    assert mending.simap().counts()["tree fern"] == 1


def deletes_and_takes_it_back(bench, page, mending):
    press(page, "Delete")
    expect(page.locator("ol").get_by_text("took away tree fern 9")).to_be_visible()
    shows(bench, page, PLANT_9, None)
    floor = pixel(bench, page, *PLANT_9)
    press(page, "Undo")
    expect(page.get_by_text("1 taken back.")).to_be_visible()
    shows(bench, page, PLANT_9, 9)
    assert pixel(bench, page, *PLANT_9) != floor
    press(page, "Redo")
    shows(bench, page, PLANT_9, None)


def test_a_person_joins_cuts_renames_deletes_and_takes_it_back(browser, bench, mending):
    with watched_page(browser) as page:
        opened(page, bench)
        expect(page.get_by_text("Select an object on the map")).to_be_visible()
        expect(page.get_by_role("button", name="Delete", exact=True)).to_have_count(0)
        page.keyboard.press("Delete")
        expect(page.get_by_text("Select an object first.")).to_be_visible()
        expect(page.get_by_text("No edits yet")).to_be_visible()
        sign(mine(bench).panels[MendPanel], page, "Ann")
        for step in (joins, cuts, renames, deletes_and_takes_it_back):
            step(bench, page, mending)
        until(page, lambda: len(mending.log.entries) == 4)
    record = json.loads(edits_path(mending.path.parent / "toy.npz").read_text())
    assert [(edit["do"], edit["who"]) for edit in record["edits"]] == [
        ("merge", "Ann"), ("split", "Ann"), ("relabel", "Ann"), ("delete", "Ann"),
    ]  # fmt: skip


def refuses_a_line_beside_the_object(bench, page, mending):
    click(bench, page, TABLE_8)
    cut_by_clicks(mine(bench).panels[MendPanel], page)
    click(bench, page, (2.6, -1.0))
    page.wait_for_function("() => '/cut' in window.__viserMutable.nodeRefFromName")
    red = lambda place: np.abs(np.subtract(pixel(bench, page, *place), (214, 39, 40))).max() < 40  # noqa: E731
    until(page, lambda: red((2.6, -1.0)))
    assert not red((2.6, 0.6))
    mine(bench).panels[MendPanel]._draw([(2.6, -1.0), (2.6, 0.5)])
    until(page, lambda: red((2.6, 0.2)) and red((2.6, 1.0)))  # it goes on beyond the points
    click(bench, page, (2.6, 0.5))
    expect(page.get_by_text("The line does not cross dining table 8. Click on both sides of it.")).to_be_visible()
    until(page, lambda: not red((2.6, 0.2)))
    assert mending.log.entries == () and not mending.saved
    press(page, "Cut in two")
    expect(page.get_by_role("button", name="Cancel")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_role("button", name="Cancel")).not_to_be_visible()
    click(bench, page, CHAIR_1)  # selects again, as nothing waits
    selected(page, "chair 1")


def takes_keys(bench, page, mending):
    desk = mine(bench)
    desk.select(8)
    selected(page, "dining table 8")
    choose(desk.panels[MendPanel], page, "Cut along", "north to south")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("x")
    expect(page.locator("ol").get_by_text("cut dining table 8 in two")).to_be_visible()
    assert sorted(i.cells for i in mending.simap().of_class("dining table")) == [96, 96, 216]
    page.wait_for_timeout(PAUSE_MS)
    page.keyboard.press("Control+z")
    expect(page.get_by_text("1 taken back.")).to_be_visible()
    page.wait_for_timeout(PAUSE_MS)
    page.keyboard.press("Control+Shift+z")
    expect(page.locator("ol").get_by_text("cut dining table 8 in two")).to_be_visible()
    desk.select(8)
    selected(page, "dining table 8")
    page.keyboard.press("Delete")
    expect(page.locator("ol").get_by_text("took away dining table 8")).to_be_visible()
    desk.select(3)
    selected(page, "chair 3")
    field_of(page, "Your name").press_sequentially("xj")  # letters in a text are no edits
    until(page, lambda: "xj" in desk.panels[MendPanel]._who.value)
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Delete")  # comes to the workbench after them
    expect(page.locator("ol").get_by_text("took away chair 3")).to_be_visible()
    assert [entry.edit.kind for entry in mending.log.entries] == ["split", "delete", "delete"]


def says_what_cannot_be_saved(bench, page, mending):
    mending.path.write_text("another program was here")
    click(bench, page, PLANT_9)
    selected(page, "potted plant 9")
    press(page, "Delete")
    expect(page.get_by_text("expected the edits as they were read, found others")).to_be_visible()
    assert pixel(bench, page, *PLANT_9) == instance_color(9)
    sign(mine(bench).panels[MendPanel], page, " ")
    press(page, "Delete")
    expect(page.get_by_text("Write your name below")).to_be_visible()


def test_a_line_beside_the_object_is_refused_keys_do_it_and_what_cannot_be_saved_is_said(browser, bench, mending):
    with watched_page(browser) as page:
        opened(page, bench)
        expect(page.get_by_text("Select an object on the map")).to_be_visible()
        for step in (refuses_a_line_beside_the_object, takes_keys, says_what_cannot_be_saved):
            step(bench, page, mending)


def test_two_pages_see_one_anothers_edits(browser, bench, mending):
    with watched_page(browser) as ann:
        hers, her_panel = opened(ann, bench)
        with watched_page(browser) as bo:
            his, his_panel = opened(bo, bench)
            sign(her_panel, ann, "Ann")
            sign(his_panel, bo, "Bo")
            click(bench, ann, PLANT_9, hers)
            selected(ann, "potted plant 9")
            press(ann, "Delete")
            expect(bo.locator("ol").get_by_text("took away potted plant 9")).to_be_visible()
            shows(bench, bo, PLANT_9, None, his)
            his.select(3)
            selected(bo, "chair 3")
            choose(his_panel, bo, "Join with", "chair 4")
            press(bo, "Join")
            expect(ann.locator("ol").get_by_text("joined chair 3 and chair 4")).to_be_visible()
            shows(bench, ann, CHAIR_4, 3, hers)
            expect(ann.get_by_text("Bo, 20")).to_be_visible()
            press(ann, "Undo")
            shows(bench, bo, CHAIR_4, 4, his)
        until(ann, lambda: len(bench.sessions) == 1)
        press(ann, "Undo")
        expect(ann.get_by_text("No edits; ")).to_be_visible()
    assert mending.log.entries == ()
