"""Time, in Debian's Chromium: a map that grows while it is built, and one that is shown as it was."""

import re
from dataclasses import replace

import cv2
import numpy as np
from browser import PATIENCE_S, free_port, mine, open_workbench, until, wait_for_color, watched_page
from built_maps import FRAMES, built, fill
from live_sequences import at_once, held_sequence, settings
from playwright.sync_api import expect
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.app import workbench
from simaps_viz.app.live import live_workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.drawing.texture import map_image
from simaps_viz.drawing.theme import LIGHT


def inside(simap, mask):
    """The middle of the cell that lies deepest in a mask, and that cell."""
    row, col = np.unravel_index(cv2.distanceTransform(np.pad(mask, 1).astype(np.uint8), cv2.DIST_L2, 3).argmax(),
                                (mask.shape[0] + 2, mask.shape[1] + 2))  # fmt: skip
    return simap.spec.centre_of(float(row - 1), float(col - 1)), (int(row - 1), int(col - 1))


def test_a_map_grows_stops_goes_on_and_becomes_the_workbench(browser, tmp_path, monkeypatch):
    at_once(monkeypatch)
    held = held_sequence(tmp_path / "tiny", FRAMES, held_from=20)
    output = tmp_path / "m.npz"
    with (
        stage_progress(quiet=True) as progress,
        live_workbench(held, settings(output), progress) as (bench, build),
        watched_page(browser) as page,
    ):
        open_workbench(page, bench)
        expect(page.get_by_text("Waiting for the first frame …")).to_be_visible()
        expect(page.get_by_text(f"0 of {FRAMES} frames")).to_be_visible()
        build.start()
        session = mine(bench)
        until(page, lambda: build.state().done >= 8 and len(session.simap.frame_names) > 0)
        expect(page.get_by_text("Building the map")).to_be_visible()
        place, cell = inside(session.simap, session.simap.grid.observations > 0)
        wait_for_color(bench, page, place, map_image(session.simap)[cell], session=session)
        page.get_by_role("button", name="Stop …").click()
        page.get_by_role("button", name="Stop now").click()
        until(page, lambda: build.state().status == "stopping")
        held.let_go()
        expect(page.get_by_text("Nothing is lost")).to_be_visible()
        assert not output.exists()
        page.get_by_role("button", name="Resume").click()
        expect(page.get_by_role("tab", name="Share", exact=True)).to_be_visible()
        page.get_by_role("tab", name="Progress", exact=True).click()
        expect(page.get_by_text("The map is done")).to_be_visible()
        expect(page.get_by_text(f"Saved as {output}")).to_be_visible()
        assert session.wait_idle(PATIENCE_S)
        place, cell = inside(session.simap, session.simap.instance == session.simap.instances[0].id)
        wait_for_color(bench, page, place, map_image(session.simap)[cell], session=session)
    built(held.whole, tmp_path / "plain.npz")
    assert output.read_bytes() == (tmp_path / "plain.npz").read_bytes()


def test_a_map_is_shown_as_it_was_and_as_it_came_about(browser, tmp_path):
    sequence = open_sequence(write_tiny_sequence(tmp_path / "tiny", frames=FRAMES))
    simap = built(sequence, tmp_path / "m.npz")
    simap = replace(simap, provenance={**simap.provenance, "simulated": True})  # its objects' colours are shown first
    with workbench.open_workbench(simap, recording=None, port=free_port(), map_path=tmp_path / "m.npz") as bench:
        first = bench.shared.look_back(simap, 0)
        assert first is not None
        later = np.isnan(first.grid.height_m) & ~np.isnan(simap.grid.height_m)
        place, cell = inside(simap, later)
        end = map_image(simap)[cell]
        with watched_page(browser) as page:
            open_workbench(page, bench)
            wait_for_color(bench, page, place, end)
            page.get_by_role("tab", name="Build", exact=True).click()
            fill(page, "Frame", "0")
            wait_for_color(bench, page, place, LIGHT.unseen)
            expect(page.get_by_text("m² seen")).to_be_visible()
            page.get_by_role("button", name="Play", exact=True).click()
            wait_for_color(bench, page, place, end)
            until(page, lambda: mine(bench).frame == FRAMES - 1)
            thing, at = inside(simap, simap.instance > 0)
            parts = bench.shared.timeline(simap)
            expect(page.locator(".mantine-Slider-markLabel:visible", has_text=re.compile("-"))).to_have_count(0)
            fill(page, "Merges done", str(-parts.levels))
            expect(page.get_by_text("Classes only: each cell has a class")).to_be_visible()
            wait_for_color(bench, page, thing, map_image(parts.map_at(0), "class")[at])
            page.get_by_role("button", name="Back to the map").click()
            wait_for_color(bench, page, thing, map_image(simap)[at])
            expect(page.get_by_text("before any is joined")).to_be_visible()
