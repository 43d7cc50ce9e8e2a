"""How fast the page answers, measured in headless Chromium without a graphics card. Needs playwright (extra "dev")."""

import contextlib
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from checks.film import filmed

from simaps_viz.app.workbench import open_workbench
from simaps_viz.drawing.surface import layers
from simaps_viz.structures import Instance, SIMap

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Frame, Page

    from simaps_viz.viewer.workbench import Workbench

WIDTH, HEIGHT = 1280, 800
DOCKED_WIDTH = 1920
"""A page on which the recorded build is not folded."""
PATIENCE_MS = 60_000
SETTLED_MS = 1500
CHROMIUM = Path("/usr/bin/chromium")
"""Taken where it is installed; else playwright's own."""
ARGUMENTS = ("--no-sandbox", "--disable-quic", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Software WebGL, so that the figures do not depend on a graphics card."""

MAP_SHOWN = "() => window.__viserMutable?.nodeRefFromName?.['/map'] != null"
PIXEL = """([x, y]) => {
  const canvas = [...document.querySelectorAll('canvas')].sort((a, b) => b.width * b.height - a.width * a.height)[0];
  const box = canvas.getBoundingClientRect();
  const one = document.createElement('canvas'); one.width = one.height = 1;
  const context = one.getContext('2d');
  const u = (x - box.x) / box.width * canvas.width, v = (y - box.y) / box.height * canvas.height;
  context.drawImage(canvas, u, v, 1, 1, 0, 0, 1, 1);
  return Array.from(context.getImageData(0, 0, 1, 1).data.slice(0, 3)).join(',');
}"""
NO_NOTES = """() => {
  const style = document.createElement('style');
  style.textContent = '.mantine-Notification-root { display: none !important; }';
  document.head.append(style);
}"""
"""viser's word about software WebGL lies over the map. Hidden, not removed: the page's own code will remove it."""
PIXELS = f"(places) => places.map({PIXEL}).join(';')"
CHANGED = f"([places, before]) => ({PIXELS})(places) !== before"
PANEL_FULL = """(facts) => {
  const text = document.body.innerText;
  return text.includes(facts) && /Its best views|not at hand|No frame named/.test(text) && !text.includes('Fetching');
}"""


@dataclass(frozen=True)
class Timing:
    """One claim, and what was measured."""

    name: str
    target_s: float
    seconds: Sequence[float]

    @property
    def holds(self) -> bool:
        """Whether the median keeps the target."""
        return statistics.median(self.seconds) <= self.target_s

    def __str__(self) -> str:
        """Return the timing as one line."""
        low, middle = min(self.seconds), statistics.median(self.seconds)
        return (
            f"{self.name:<58} min {low:5.2f} s  median {middle:5.2f} s  of {len(self.seconds)}  "
            f"target {self.target_s:.1f} s  {'ok' if self.holds else 'OVER'}"
        )


@contextlib.contextmanager
def browser() -> Iterator["Browser"]:
    """Start Chromium without a window."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - only the bench needs it

    with sync_playwright() as playwright:
        path = str(CHROMIUM) if CHROMIUM.is_file() else None
        started = playwright.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield started
        started.close()


@contextlib.contextmanager
def opened(
    browser: "Browser", simap: SIMap, recording: Path | None = None, *, width: int = WIDTH, height: int = HEIGHT
) -> Iterator[tuple["Page", "Workbench"]]:
    """Serve a map, and open its page, so many pixels wide and high."""
    with open_workbench(simap, recording=recording, port=0) as workbench:
        context = browser.new_context(viewport={"width": width, "height": height})
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(f"{workbench.url}/?fixedDpr=1")
        page.wait_for_function(MAP_SHOWN)
        page.evaluate(NO_NOTES)
        yield page, workbench
        context.close()


def first_page(browser: "Browser", simap: SIMap, recording: Path | None, *, runs: int) -> Timing:
    """From starting the server on a built map to a page that shows it, its counts and its controls."""
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        with opened(browser, simap, recording) as (page, _workbench):
            page.get_by_text("never seen").wait_for()  # the end of the legend, the last that is filled
            seconds.append(time.perf_counter() - start)
    return Timing(f"server start to usable page, {_cells(simap)}", 5.0, seconds)


def slider(browser: "Browser", simap: SIMap, *, runs: int, target_s: float = 0.5) -> Timing:
    """From a new K in its box to the first changed pixel; every K is a new one, so nothing is remembered.

    Args:
        browser: that shows it.
        simap: of `large_map`.
        runs: how often.
        target_s: how long it may take.
    """
    seconds = []
    with opened(browser, simap) as (page, workbench):
        page.wait_for_timeout(SETTLED_MS)
        box = _box(page, "K (%)")
        places = [list(_on_canvas(page, workbench, *middle)) for middle in _parts_that_split(simap)]
        for run in range(runs + 1):  # the first one warms up
            page.wait_for_timeout(SETTLED_MS)
            before = page.evaluate(PIXELS, places)
            start = time.perf_counter()
            box.fill(str(99 - run // 2 if run % 2 == 0 else 1 + run // 2))
            box.press("Enter")
            page.wait_for_function(CHANGED, arg=[places, before], polling="raf")
            seconds.append(time.perf_counter() - start)
    return Timing(f"slider to changed pixel, {_cells(simap)}", target_s, seconds[1:])


def click(browser: "Browser", simap: SIMap, recording: Path | None, *, runs: int) -> Timing:
    """From a click on an object to its name, facts and best views in the panel, the recording docked."""
    from simaps_viz.drawing.legend import facts_text  # noqa: PLC0415 - viser is slow to import

    seconds = []
    chosen, width = _near_the_middle(simap), DOCKED_WIDTH if recording is not None else WIDTH
    with opened(browser, simap, recording, width=width) as (page, workbench):
        if recording is not None:
            _recording_frame(page)
        page.wait_for_timeout(SETTLED_MS)
        for one in chosen[: runs + 1]:
            x, y = _on_canvas(page, workbench, *one.centroid_m[:2])
            start = time.perf_counter()
            page.mouse.click(x, y)
            page.wait_for_function(PANEL_FULL, arg=facts_text(simap, one), polling="raf")
            seconds.append(time.perf_counter() - start)
            page.wait_for_timeout(SETTLED_MS)
    docked = ", recording docked" if recording else ""
    return Timing(f"click to full panel{docked}, {_cells(simap)}", 0.5, seconds[1:])


def frames_in_step(browser: "Browser", simap: SIMap, recording: Path, *, runs: int) -> tuple[Timing, Timing]:
    """From a frame chosen on the page to the recording showing it, and the other way."""
    there, back = [], []
    with opened(browser, simap, recording, width=DOCKED_WIDTH) as (page, _workbench):
        _recording_frame(page)
        page.get_by_role("tab", name="Build", exact=True).click()
        box = _box(page, "Frame")
        dock = page.locator("iframe[title='Recorded build']").bounding_box()
        assert dock is not None
        with filmed(page, dock) as film:
            for run in range(runs + 1):
                page.wait_for_timeout(2 * SETTLED_MS)  # so that nothing is taken for an echo
                film.begin()
                start = time.perf_counter()
                box.fill(str(10 + 7 * run))
                box.press("Enter")
                _until(page, lambda: film.changed_at is not None)
                there.append((film.changed_at or start) - start)
        page.mouse.click(dock["x"] + dock["width"] / 2, dock["y"] + dock["height"] * 0.6)
        for _ in range(runs + 1):
            page.wait_for_timeout(2 * SETTLED_MS)
            before = box.input_value()
            start = time.perf_counter()
            page.keyboard.press("ArrowRight")  # rerun's own key: one frame on
            _until(page, lambda before=before: box.input_value() != before)
            back.append(time.perf_counter() - start)
    return (
        Timing("frame on the page to frame in the recording", 0.6, there[1:]),
        Timing("frame in the recording to frame on the page", 0.6, back[1:]),
    )


RESTED_S = 10.0


def at_rest(browser: "Browser", simap: SIMap) -> str:
    """Measure what a page takes that nobody touches, of all processes of browsers on this machine; Linux only."""
    with opened(browser, simap) as (page, _workbench):
        page.wait_for_timeout(4 * SETTLED_MS)
        before = _browsers_s()
        page.wait_for_timeout(1000 * RESTED_S)
        share = (_browsers_s() - before) / RESTED_S
    return f"page that nobody touches, {_cells(simap)}: {share:.2f} of a processor"


def _browsers_s() -> float:
    """Return the processor time that browsers have taken so far."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            name, _, numbers = stat.read_text(encoding="utf-8").partition("(")[2].rpartition(")")
            ticks += sum(map(int, numbers.split()[11:13])) if name.startswith("chrom") else 0
    return ticks / os.sysconf("SC_CLK_TCK")


TURNED_S = 20.0
ALL_POINTS = """(count) => {
  const nodes = window.__viserMutable.nodeRefFromName;
  return [...Array(count).keys()].every((number) => nodes[`/surface/${number}`]);
}"""
PICTURES = """(ms) => { window.pictures = new Promise((done) => {
  const start = performance.now();
  let count = 0;
  const tick = (now) => {
    count += 1;
    if (now - start < ms) window.requestAnimationFrame(tick); else done(1000 * count / (now - start));
  };
  window.requestAnimationFrame(tick);
}); }"""


def room(browser: "Browser", few: SIMap, many: SIMap) -> Iterator[str]:
    """Turn the rooms of two maps with surfaces in the 3-D view; the graphics are software, so only ratios count."""
    rates = []
    for simap in (few, many):
        with opened(browser, simap) as (page, _workbench):
            page.wait_for_timeout(SETTLED_MS)
            start = time.perf_counter()
            page.get_by_role("button", name="3-D view").click()
            page.wait_for_function(ALL_POINTS, arg=len(layers(simap, simap.points())))
            page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            first_s = time.perf_counter() - start
            page.evaluate(PICTURES, 1000 * TURNED_S)
            page.mouse.move(WIDTH / 4, HEIGHT / 2)
            page.mouse.down()
            start, step = time.perf_counter(), 0
            while time.perf_counter() - start < TURNED_S:
                step += 1
                page.mouse.move(WIDTH / 4 + 20 * (step % 10), HEIGHT / 2)
            page.mouse.up()
            rates.append(page.evaluate("() => window.pictures"))
            heap = page.evaluate("() => performance.memory.usedJSHeapSize")
            points = len(simap.points().positions)
        yield (
            f"room in 3-D, {points / 1e6:.2f} M points: first picture {first_s:.1f} s after the click, "
            f"{rates[-1]:.2f} pictures a second while it is turned ({rates[-1] / rates[0]:.2f} x), "
            f"{heap / 1e6:.0f} MB of scripts beside {points * 15 / 1e6:.0f} MB of points"
        )


def _cells(simap: SIMap) -> str:
    count = simap.spec.rows * simap.spec.cols
    return f"{count / 1e6:.0f} M cells" if count >= 1_000_000 else f"{count / 1e3:.0f} k cells"


def _until(page: "Page", holds: Callable[[], bool]) -> None:
    end = time.perf_counter() + PATIENCE_MS / 1000.0
    while not holds():
        if time.perf_counter() > end:
            raise TimeoutError("the page and its recording do not follow one another")
        page.wait_for_timeout(5)


def _box(page: "Page", label: str) -> Any:
    """Find the number box beside a label."""
    row = page.locator("label", has_text=label).locator("xpath=ancestor::div[contains(@class,'Flex-root')][1]")
    return row.locator("input:not([type=hidden])").last


def _recording_frame(page: "Page") -> "Frame":
    """Wait until rerun has read the recording."""
    _until(page, lambda: any("/rerun/" in frame.url for frame in page.frames))
    frame = next(frame for frame in page.frames if "/rerun/" in frame.url)
    frame.wait_for_function("() => window.simapsReady")
    page.wait_for_timeout(2 * SETTLED_MS)
    return frame


def _near_the_middle(simap: SIMap) -> list[Instance]:
    """Objects that a click on their middle hits, of the larger half, the one nearest to the map's middle first."""
    xmin, ymin, xmax, ymax = simap.spec.extent_m
    usual = statistics.median(one.cells for one in simap.instances)
    hit = [one for one in simap.instances if one.cells >= usual and simap.at(*one.centroid_m[:2]) == one]
    return sorted(
        hit, key=lambda i: np.hypot(i.centroid_m[0] - (xmin + xmax) / 2.0, i.centroid_m[1] - (ymin + ymax) / 2.0)
    )


def _parts_that_split(simap: SIMap) -> list[tuple[float, float]]:
    """Return the middles of two parts that any K up to 5 joins and any above 90 splits, the second as large as can be.

    As they touch, they have two colours apart and one together: one of them changes its own.
    """
    merges, cells = simap.merges, np.bincount(simap.community.reshape(-1))
    may_split = np.flatnonzero((merges.score > 0.05) & (merges.score < 0.9))
    chosen = may_split[cells[merges.source[may_split]].argmax()]
    middles = []
    for part in (merges.target[chosen], merges.source[chosen]):
        row, col = np.nonzero(simap.community == part)
        middles.append(simap.spec.centre_of(float(np.median(row)), float(np.median(col))))
    return middles


def _on_canvas(page: "Page", workbench: "Workbench", x_m: float, y_m: float) -> tuple[float, float]:
    """Return where a point of the floor appears, pixels of the page."""
    camera = next(iter(workbench.server.get_clients().values())).camera
    forward = np.asarray(camera.look_at) - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, camera.up_direction)
    right = right / np.linalg.norm(right)
    ray = np.array([x_m, y_m, 0.0]) - camera.position
    half = float(ray @ forward) * np.tan(camera.fov / 2.0)
    u = (float(ray @ right) / half / camera.aspect + 1.0) / 2.0
    v = (1.0 - float(ray @ np.cross(right, forward)) / half) / 2.0
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    return box["x"] + u * box["width"], box["y"] + v * box["height"]
