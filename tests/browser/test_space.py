"""The room in 3-D in the real browser: its colours, and a click on what stands under a table."""

import numpy as np
import pytest
from browser import PIXELS, free_port, mine, on_canvas, open_workbench, toy_services, until, watched_page
from playwright.sync_api import expect
from toy_maps import TOY_POSE
from toy_surfaces import BROWN, PLANT, toy_with_surface

from simaps_viz.viewer.panels.map import MapPanel, hint_text
from simaps_viz.viewer.workbench import Workbench

NODES = "() => Object.keys(window.__viserMutable.nodeRefFromName).filter((name) => name.startsWith('/surface/')).length"


@pytest.fixture
def bench():
    with Workbench(toy_with_surface(), services=toy_services(), port=free_port(), start=TOY_POSE) as workbench:
        assert workbench.wait_idle()
        yield workbench


def test_the_room_is_seen_as_it_looked_and_its_tables_can_be_lifted_off(browser, bench):
    with watched_page(browser) as page:
        open_workbench(page, bench)
        page.get_by_role("button", name="3-D view").click()
        session = mine(bench)
        until(page, lambda: page.evaluate(NODES) > 10)
        table = session.simap.of_class("dining table")[0]
        (x, y, _), z = session.simap.in_space[PLANT].box.center_m, 0.8

        def color(z_m):
            spot = on_canvas(bench, page, x, y, session, z_m)
            return np.array(page.evaluate(PIXELS, [spot])[0])

        until(page, lambda: np.abs(color(z) - BROWN).max() <= 16)
        page.mouse.move(*on_canvas(bench, page, x, y, session, z))  # its name, as from above
        expect(page.locator(".simaps-hint")).to_have_text(hint_text(table, session.simap.spec.cell_size_m))
        page.mouse.move(1, 1)
        expect(page.locator(".simaps-hint")).to_be_hidden()
        page.mouse.click(*on_canvas(bench, page, x, y, session, z))
        until(page, lambda: session.selected == table.id)
        session.select(None)
        # Cut below the table's top, what stands under it is there to be clicked.
        session.panels[MapPanel]._cut_m.value = 0.6
        session.scene.cut_at(0.6, whole_walls=False)
        until(page, lambda: np.abs(color(0.45) - BROWN).max() > 40)
        page.mouse.click(*on_canvas(bench, page, x, y, session, 0.45))
        until(page, lambda: session.selected == PLANT)
