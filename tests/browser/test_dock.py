"""The recorded build docked in the workbench, in Debian's Chromium: its look, its timelines, others in its place."""

import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rerun as rr
from browser import PATIENCE_S, field_of, free_port, mine, rerun_frame, until, watched_page
from forwarded import watched_through
from playwright.sync_api import Browser, Frame, Locator, Page, expect
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.app import workbench
from simaps_viz.build.pipeline import BuildConfig
from simaps_viz.build.to_file import build_complete
from simaps_viz.console.progress import stage_progress
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.structures import SIMap

FRAMES = 6
WIDTH_PX = 2140
MAP_SHOWN = "() => window.__viserMutable?.nodeRefFromName?.['/map'] != null"
OPENED = "() => window.simapsReady && window.simapsEvents.some((one) => one.type === 'recording_open')"
ECHO_MS = 1700
"""Longer than rerun's page takes a time for the echo of one that was set from outside."""

TOOLS = (300, -135)
"""A place without letters in rerun's time panel, from the lower left corner of the dock; px."""
TIMELINE, RULER, RULER_PX = (42, 29), 72, (200, 383)
"""Where the time panel has the name of its timeline and its ruler, from its row of buttons down; px."""
MENU = {"frame": 27, "louvain": 51, "merge": 75}
"""The timelines to choose from, below that name."""


@dataclass(frozen=True, eq=False)
class Dock:
    """A workbench with its recording open."""

    bench: Any
    page: Page

    @property
    def rerun(self) -> Frame:
        """The frame of the recording, which is another one after a reload."""
        return rerun_frame(self.page)

    def at(self, dx: float, dy: float) -> tuple[float, float]:
        """A place in the dock, from its lower left corner."""
        box = self.page.locator("iframe[title='Recorded build']").bounding_box()
        assert box is not None
        return box["x"] + dx, box["y"] + box["height"] + dy

    def buttons(self) -> float:
        """How high over the dock's lower edge the time panel has its buttons."""
        self.page.mouse.move(1, 1)  # a tip that opens where the mouse rests in rerun lies over them until it leaves
        found: list[float] = []

        def one() -> bool:
            found[:] = self.like_buttons()
            return len(found) == 1

        until(self.page, one)
        return found[0]

    def like_buttons(self) -> list[float]:
        """How high all is that has the colour and the size of those buttons."""
        x, y = self.at(22, -230)
        picture = self.page.screenshot(clip={"x": x, "y": y, "width": 1, "height": 230})
        column = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert column is not None
        runs = np.split(np.arange(len(column)), np.flatnonzero(np.diff(np.abs(column[:, 0].astype(int) - 223) < 5)) + 1)
        return [float(run.mean() - 230) for run in runs if abs(int(column[run[0], 0]) - 223) < 5 and 15 < len(run) < 30]

    def choose(self, timeline: str) -> None:
        """Choose a timeline in rerun; its menu may take a while to open."""
        for patience_ms in (1500, 4000, 16000, 60000):
            self.page.keyboard.press("Escape")
            name = (TIMELINE[0], self.buttons() + TIMELINE[1])
            self.page.mouse.click(*self.at(*name))
            self.page.wait_for_timeout(patience_ms)
            self.page.mouse.click(*self.at(name[0] + 15, name[1] + MENU[timeline]))
            end = time.monotonic() + patience_ms / 1000
            while time.monotonic() < end:
                if self.time()[1] == timeline:
                    return
                self.page.wait_for_timeout(40)
        pytest.fail(f"rerun's timeline: expected {timeline}, found {self.time()}")

    def scrub(self, share: float) -> None:
        """Put the time cursor at a share of the time line that is shown; what was set before is no echo any more."""
        self.rerun.evaluate("() => commanded.clear()")
        first, last = RULER_PX
        self.page.mouse.click(*self.at(first + share * (last - first), self.buttons() + RULER))

    def events(self) -> list[dict[str, Any]]:
        """What rerun has reported so far."""
        return self.rerun.evaluate("() => window.simapsEvents")

    def time(self) -> tuple[str, str, int]:
        """Recording, timeline and time that rerun reported last."""
        told = [e for e in self.events() if e["type"] == "time_update"]
        return (told[-1]["recording_id"], told[-1]["timeline"], int(told[-1]["time"])) if told else ("", "", -1)

    def shows(self, timeline: str, at: int, recording: str | None = None) -> None:
        end = time.monotonic() + PATIENCE_S
        while self.time()[1:] != (timeline, at) or recording not in (None, self.time()[0]):
            if time.monotonic() > end:
                told = [[e.get(k) for k in ("type", "recording_id", "timeline", "time")] for e in self.events()[-9:]]
                pytest.fail(f"expected {timeline} {at} of {recording or 'any recording'}, found {told}")
            self.page.wait_for_timeout(40)

    def color(self, dx: float, dy: float) -> tuple[int, ...]:
        x, y = self.at(dx, dy)
        self.page.wait_for_timeout(200)  # pictures are dear where there is no graphics card
        picture = self.page.screenshot(clip={"x": x, "y": y, "width": 2, "height": 2})
        image = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        return tuple(image[0, 0, ::-1].tolist())

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()
        self.page.wait_for_timeout(200)

    @property
    def step(self) -> Locator:
        """The box of the slider over the steps, whatever it is called."""
        folder = self.page.get_by_text("How objects were joined", exact=True)
        return folder.locator("xpath=following::input[not(@type='hidden')][1]")

    def fill(self, box: Locator, value: int) -> None:
        box.fill(str(value))
        box.press("Enter")
        box.blur()


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[SIMap, Path]:
    """A map whose chairs are each joined from two parts, and the recording of its build."""
    folder = tmp_path_factory.mktemp("built")
    sequence = open_sequence(write_tiny_sequence(folder / "tiny", frames=FRAMES))
    with stage_progress(quiet=True) as progress:
        simap = build_complete(sequence, "paper", BuildConfig(), folder / "m.npz", folder / "m.rrd", progress)
    return simap, folder / "m.rrd"


@pytest.fixture(scope="module")
def opened(browser: Browser, built: tuple[SIMap, Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Dock]:
    """One for all tests, through one forwarded port: opening a recording takes longer than they do.

    Another one lies where recordings are kept.
    """
    simap, recording = built
    kept = tmp_path_factory.mktemp("kept")
    record(kept / "other.rrd", "the other")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SIMAPS_RECORDINGS", str(kept))
        with (
            workbench.open_workbench(simap, recording=recording, port=free_port()) as bench,
            watched_through(browser, bench, WIDTH_PX) as page,
        ):
            written: list[str] = []
            page.on("console", lambda one: written.append(one.text))
            page.wait_for_function(MAP_SHOWN)
            rerun_frame(page).wait_for_function("() => window.simapsReady")
            yield Dock(bench, page)
            refused = [one for one in written if "Content Security Policy" in one]
            assert refused == [], "usage data are not even tried"


@pytest.fixture
def dock(opened: Dock) -> Dock:
    """The dock as it opens: at the last frame, nothing selected."""
    session = mine(opened.bench)
    session.select(None)
    session.show_frame(FRAMES - 1)
    opened.shows("frame", FRAMES - 1)
    opened.tab("Map")
    return opened


def test_the_timelines_of_rerun_and_the_steps_of_the_page_move_each_other(dock, built):
    parts = Timeline(built[0])
    communities = parts.levels
    assert (parts.taken, parts.last) == (2, communities + 2)
    page, step = dock.page, dock.step
    canvas = page.locator("canvas").first.bounding_box()
    assert canvas is not None and canvas["width"] >= 0.6 * WIDTH_PX  # the room is for the map
    assert dock.bench.tabs._session_of  # the hidden frame reported which tab it is in
    dock.tab("Build")
    expect(step).to_have_value(str(parts.taken))  # counted as in the words beside it
    # From the page to rerun.
    dock.fill(step, 1)
    dock.shows("merge", 1)
    dock.fill(step, 1 - communities)
    dock.shows("louvain", 1)
    dock.fill(step, -communities)
    dock.shows("louvain", 0)
    expect(page.get_by_text("Classes only: each cell has a class")).to_be_visible()
    # From rerun to the page: a person drags the time cursor, and chooses another timeline.
    dock.scrub(1.0)
    dock.shows("louvain", communities)
    expect(step).to_have_value("0")
    expect(page.get_by_text("before any is joined")).to_be_visible()
    dock.choose("merge")
    for share, merge in ((0.0, 0), (0.5, 1), (1.0, 2)):
        dock.scrub(share)
        dock.shows("merge", merge)
        expect(step).to_have_value(str(merge))
    expect(page.get_by_text(f"This is the map: {parts.taken} steps applied.")).to_be_visible()
    # Back on the frames, it shows the page's.
    dock.choose("frame")
    dock.shows("frame", FRAMES - 1)


def test_a_click_on_nothing_in_the_recording_is_answered_and_one_on_a_name_is_not(dock):
    page = dock.page
    session, said = mine(dock.bench), page.get_by_text("There is no object of the map where you clicked.")

    def tell(item: dict[str, Any]) -> None:
        dock.rerun.evaluate("item => post({ type: 'selection_change', items: [item] })", item)

    (west, south, _), (east, north, _) = session.simap.instances[0].aabb_m
    middle = [(west + east) / 2, -(south + north) / 2, None]
    tell({"type": "view", "view_name": "Objects", "by_name": True})
    tell({"type": "entity", "entity_path": "/map/objects", "position": middle})
    until(page, lambda: session.selected == session.simap.instances[0].id)
    session.say("Later", "what is said after it")
    expect(page.get_by_text("what is said after it")).to_be_visible()
    assert said.count() == 0
    tell({"type": "entity", "entity_path": "/map/ground", "position": [99.0, 99.0, None]})
    expect(said).to_be_visible()
    assert session.selected == session.simap.instances[0].id


def record(path: Path, name: str) -> None:
    """One brightness a frame."""
    stream = rr.RecordingStream("brightness", recording_id=name)
    view = rr.blueprint.Spatial2DView(origin="/picture", background=[0, 0, 0])
    panel = rr.blueprint.TimePanel(timeline="frame", play_state="paused")
    stream.save(path, default_blueprint=rr.blueprint.Blueprint(view, panel, auto_views=False))
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    for frame in range(3):
        stream.set_time("frame", sequence=frame)
        stream.log("/picture", rr.Image(np.full((100, 100, 3), 60 + 40 * frame, np.uint8)))
    stream.flush()
    stream.disconnect()


def test_another_recording_in_the_dock_is_not_tied_to_the_page_and_the_own_one_is_again(dock):
    page, middle = dock.page, (200, -450)
    own = dock.time()[0]
    dock.tab("Build")
    page.get_by_text("Recorded builds", exact=True).click()
    expect(field_of(page, "Recording")).to_have_value(re.compile("^other"))
    page.get_by_role("button", name="Show it beside the map").click()
    expect(page.get_by_text("other is shown beside the map.")).to_be_visible()
    dock.shows("frame", 0, "the other")
    until(page, lambda: np.ptp([*dock.color(*middle), 60]) <= 3)
    back = page.get_by_role("button", name="Back to this map's build")
    expect(back).to_be_visible()
    # Neither moves the other.
    dock.fill(field_of(page, "Frame"), 2)
    until(page, lambda: mine(dock.bench).frame == 2)
    page.wait_for_timeout(ECHO_MS)
    assert dock.time() == ("the other", "frame", 0) and np.ptp([*dock.color(*middle), 60]) <= 3
    dock.scrub(1.0)
    until(page, lambda: np.ptp([*dock.color(*middle), 140]) <= 3)
    page.wait_for_timeout(500)
    assert mine(dock.bench).frame == 2 and field_of(page, "Frame").input_value() == "2"
    # Tied again.
    back.click()
    dock.shows("frame", 2, own)
    expect(back).to_be_hidden()
    dock.fill(field_of(page, "Frame"), 1)
    dock.shows("frame", 1, own)
    dock.scrub(1.0)
    until(page, lambda: mine(dock.bench).frame == FRAMES - 1)
    expect(field_of(page, "Frame")).to_have_value(str(FRAMES - 1))


FOCUSED = """() => {
  const one = document.activeElement;
  return one.matches('iframe') ? 'IFRAME' : one.getAttribute('aria-label') || one.textContent.trim();
}"""


def test_keys_lead_out_of_the_recording_and_reach_the_page_from_it(dock):
    page = dock.page

    def go_through(key: str) -> list[str]:
        page.locator("iframe[title='Recorded build']").focus()
        names = []
        for n in range(40):
            page.keyboard.press(key)
            if n == 0:  # the recording asks the page to take the focus
                until(page, lambda: page.evaluate(FOCUSED) != "IFRAME")
            page.wait_for_timeout(60)
            names.append(page.evaluate(FOCUSED))
            if names[-1] == "IFRAME":
                break
        return names

    for key in ("Tab", "Shift+Tab"):
        names = go_through(key)
        assert names[-1] == "IFRAME" and {"Help", "Map", "Instance", "Find"} <= set(names), (key, names)

    session = mine(dock.bench)
    session.select(session.simap.instances[0].id)
    until(page, lambda: session.selected is not None)
    page.mouse.click(*dock.at(100, -400))  # in the picture of the map
    until(page, lambda: page.evaluate(FOCUSED) == "IFRAME")
    page.wait_for_timeout(500)
    assert session.selected is not None
    page.keyboard.press("Escape")
    until(page, lambda: session.selected is None)
    page.keyboard.press("[")
    until(page, lambda: session.frame == FRAMES - 2)
    page.keyboard.press("?")
    expect(page.get_by_text("How to use this page")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.get_by_text("How to use this page")).to_have_count(0)
    page.get_by_role("button", name="Help", exact=True).click()
    expect(page.get_by_text("How to use this page")).to_be_visible()
    page.mouse.click(5, 300)  # beside it
    expect(page.get_by_text("How to use this page")).to_have_count(0)
    dock.shows("frame", FRAMES - 2)
    page.mouse.click(*dock.at(100, -400))
    pose = session.pose
    page.keyboard.press("ArrowRight")  # is rerun's own: a frame on
    until(page, lambda: session.frame == FRAMES - 1)
    assert session.pose == pose  # frames move the camera, not the robot
    page.keyboard.press(" ")  # likewise: it plays
    until(page, lambda: any(event["type"] == "play" for event in dock.events()))


def test_it_is_dark_when_the_page_is(dock):
    page, tools = dock.page, TOOLS
    until(page, lambda: min(dock.color(*tools)) > 240)
    page.get_by_role("button", name="Light / dark").click()
    until(page, lambda: max(dock.color(*tools)) < 40)
    page.reload()
    page.locator("iframe[title='Recorded build']").wait_for()
    until(page, lambda: max(dock.color(*tools)) < 40)
    rerun_frame(page).wait_for_function(OPENED)
    page.wait_for_timeout(1500)
    assert max(dock.color(*tools)) < 40
    page.get_by_role("button", name="Light / dark").click()
    until(page, lambda: min(dock.color(*tools)) > 240)


def test_on_a_phone_it_opens_in_sight_and_a_finger_still_finds_the_page(opened, browser):
    with watched_page(browser, 420, 860, has_touch=True, is_mobile=True) as page:
        page.goto(opened.bench.url)
        page.wait_for_function(MAP_SHOWN)
        cdp = page.context.new_cdp_session(page)

        def swipe(y: float, by: float) -> None:
            for kind, places in (("Start", [y]), ("Move", np.linspace(y, y + by, 10)), ("End", [None])):
                for place in places:
                    points = [] if place is None else [{"x": 200, "y": float(place)}]
                    cdp.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})

        def box(one: Locator) -> dict[str, float]:
            found: Any = one.bounding_box()
            return found

        page.get_by_role("tab", name="Build", exact=True).tap()
        header = page.get_by_role("button", name="panel Recorded build")
        header.tap()
        frame, top = page.locator("iframe[title='Recorded build']"), page.get_by_role("button", name="Help", exact=True)
        until(page, lambda: frame.bounding_box() and abs(box(frame)["y"] + box(frame)["height"] - 860) < 3)
        assert box(header)["y"] >= 172 + 100 and box(top)["y"] < 172  # it is in sight, the title is not
        assert box(frame)["height"] > 0.55 * 860
        back = "(one) => getComputedStyle(one, '::after').content"
        assert header.evaluate(back) == '"Back to the map"'

        def title_is_back() -> bool:  # a busy browser may take a swipe for less than it is: swipe until it is in sight
            swipe(min(box(header)["y"] - 60, 840), 250)
            return box(top)["y"] > 172

        until(page, title_is_back)
        page.get_by_role("tab", name="Map", exact=True).tap()
        expect(page.get_by_label("Colours").and_(page.locator("input"))).to_be_visible()
        expect(header).to_have_attribute("aria-expanded", "false")  # the map has its place again
        assert header.evaluate(back) == "none"
        mine(opened.bench).unfold_recording()  # as Map at frame does
        expect(header).to_have_attribute("aria-expanded", "true")
        build = page.get_by_role("tab", name="Build", exact=True)
        build.tap()
        expect(header).to_have_attribute("aria-expanded", "false")
        until(page, lambda: 860 - 387 <= box(build)["y"] < 860 - 387 + 30)  # the tabs are at the top of the sheet
    until(opened.page, lambda: len(opened.bench.sessions) == 1)
