"""The page of a robot's map, in Debian's Chromium: what comes is said in words, the map grows, and ending saves it."""

import re
import time
from dataclasses import replace

from browser import PATIENCE_S, mine, open_workbench, until, watched_page
from live_sequences import at_once
from playwright.sync_api import expect
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.app.live import source_workbench
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.live.run import LiveRequest
from simaps_viz.live.source import PlayedSequence, Traffic
from simaps_viz.mapping.file import load_map

FIRST, LAST = 8, 20


class Robot(PlayedSequence):
    """A robot that waits to be let go on after its first frames, and has lost three of them."""

    def __init__(self, sequence, traffic):
        super().__init__(sequence, at_pace=False)
        self.most, self._traffic = FIRST, traffic

    def take(self, timeout_s):
        if self._next >= self.most:
            time.sleep(0.02)
            return None
        if self._next < 3:
            self._traffic.drop("no pose in time")
        shot = super().take(timeout_s)
        return None if shot is None else replace(shot, sent_ns=shot.sent_ns - 40_000_000)

    def words(self):
        return "connected"


def test_the_page_says_what_comes_while_the_map_grows_and_ending_it_saves_the_map(browser, tmp_path, monkeypatch):
    at_once(monkeypatch)
    monkeypatch.setattr("simaps_viz.live.run.SHARE", 1.0)
    monkeypatch.setattr("simaps_viz.live.run.FRAMES_A_PLACE", LAST)
    write_tiny_sequence(tmp_path / "tiny", frames=LAST + 1)
    traffic = Traffic()
    robot = Robot(open_sequence(tmp_path / "tiny"), traffic)
    request = LiveRequest(robot, BuildConfig(), tmp_path / "m.npz", traffic=traffic)
    with source_workbench(request) as (bench, build, _), watched_page(browser) as page:
        open_workbench(page, bench)
        expect(page.get_by_text("Waiting for the first frame …")).to_be_visible()
        build.start()
        # Rate, delay, drops and the state of the connection, in words.
        expect(
            page.get_by_text(re.compile(r"connected · .*\d+ ms behind · 3 dropped \(no pose in time\)"))
        ).to_be_visible()
        expect(page.get_by_text(f"{FIRST} frames on the map")).to_be_visible()
        assert robot.most == FIRST and build.state().status == "building"
        # The map grows: more frames are on it than before, and the page shows objects before the end.
        robot.most = LAST
        expect(page.get_by_text(f"{LAST} frames on the map")).to_be_visible()
        until(page, lambda: mine(bench).simap.counts() == {"chair": 2})
        assert build.state().status == "building" and not (tmp_path / "m.npz").exists()
        # Ending asks first, then saves.
        page.get_by_role("button", name="End and save …").click()
        page.get_by_role("button", name="End and save now").click()
        expect(page.get_by_role("tab", name="Mend")).to_be_visible()  # what can be done with a finished map
        assert build.wait(PATIENCE_S) and len(load_map(tmp_path / "m.npz").frame_names) == LAST
