"""What the browser tests share: Debian's Chromium, a watched page, a workbench on the toy map, a small recording."""

import itertools
import os
import re
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Browser, Frame, Locator, Page, expect, sync_playwright
from toy_maps import TOY_POSE, toy_map

from simaps_viz.errors import CommandError
from simaps_viz.mapping.simap import recommunity, repartition
from simaps_viz.navigation.agent import Answer
from simaps_viz.navigation.planner import RobotShape
from simaps_viz.navigation.robot import Goal
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.page.shared import Services
from simaps_viz.viewer.panels.command import CommandPanel
from simaps_viz.viewer.panels.map import MapPanel
from simaps_viz.viewer.scene.camera import TOP
from simaps_viz.viewer.session import Session
from simaps_viz.viewer.workbench import Workbench

PATIENCE_S = 60.0
"""How long anything may take to appear: a machine with other work draws pages slowly, and what hangs never appears."""
expect.set_options(timeout=1000 * PATIENCE_S)
CHROMIUM = Path("/usr/bin/chromium")
FEW_PICTURES = Path(__file__).with_name("few_pictures.js")
ARGUMENTS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",  # without a graphics card, putting pages together takes more than drawing the map
    # The lists below the address bar, which nobody sees, are two more pages for each one opened. What stands before
    # them is of Playwright's own list, which this one replaces.
    "--disable-features=HttpsUpgrades,MediaRouter,OptimizationHints,PaintHolding,WebUIOmniboxPopup,WebUIOmniboxAimPopup",
]
FIRST_PORT, PORTS_EACH = 20_000, 2_000
"""Below those the system gives to connections; of up to six processes that run tests at once, each has its own."""
_rows = itertools.islice(itertools.cycle(range(0, PORTS_EACH, 8)), os.getpid() % 250, None)
LOCAL = ("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:")


def toy_answer(**others: Any) -> Answer:
    """Return what a command service gives, as plain as it can be."""
    plain = Answer("ok", None, "", (), np.zeros((0, 2)), TOY_POSE, 0.0)
    return replace(plain, **others)


def toy_ask(simap: SIMap, command: str, pose: Pose2, robot: RobotShape | None = None) -> Answer:
    """Drive to x = 1.5 m, or refuse a piano."""
    if "piano" in command:
        raise CommandError("There is no piano on this map. It has: chair (3), dining table (2).")
    if "crash" in command:
        raise ZeroDivisionError("a fault of the service")
    if "locked" in command:
        return toy_answer(status="failed", reason="No free way to the locked room.", program="robot.move_to((9, 9))\n")
    return toy_answer(
        program='chair = robot.instances("chair")[0]\nrobot.move_to_object("chair", chair)\n',
        goals=(Goal("move_to_object", "chair", 1, (1.5, pose.y_m)),),
        path_m=np.array([[pose.x_m, pose.y_m], [1.5, pose.y_m]]),
        final_pose=Pose2(1.5, pose.y_m, np.pi / 2),
        path_length_m=abs(1.5 - pose.x_m),
    )


def toy_view(frame: int) -> tuple[NDArray, NDArray]:
    """A grey picture with one bright ellipse for each segment 11 .. 19."""
    rgb = np.full((480, 640, 3), 90 + 10 * frame, np.uint8)
    ids = np.zeros((480, 640), np.int32)
    for segment in range(11, 20):
        centre = (60 * (segment - 10), 240 + 10 * frame)
        cv2.ellipse(ids, centre, (25, 60), 0, 0, 360, segment, -1)
        cv2.ellipse(rgb, centre, (25, 60), 0, 0, 360, (200, 20 * (segment - 10), 120), -1)
    return rgb, ids


def free_port() -> int:
    """Return the first of six free ports in a row: a workbench takes three, and the next one three more."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 6
    for row in itertools.islice(_rows, PORTS_EACH // 8):
        first = FIRST_PORT + PORTS_EACH * worker + row
        with ExitStack() as probes:
            try:
                for port in range(first, first + 6):
                    probes.enter_context(socket.socket()).bind(("127.0.0.1", port))
            except OSError:
                continue
            return first
    pytest.fail("no six ports in a row are free")


def toy_services(**others: Any) -> Services:
    return Services(
        repartition=lambda simap, k: repartition(simap, k_percent=k),
        recommunity=lambda simap, resolution, k: recommunity(simap, resolution=resolution, k_percent=k),
        ask=toy_ask,
        view=toy_view,
        **others,
    )


@contextmanager
def toy_workbench(services: Services | None = None) -> Iterator[Workbench]:
    with Workbench(toy_map(), services=services or toy_services(), port=free_port(), start=TOY_POSE) as workbench:
        workbench.tabs._leave_s = 60.0  # a page that is loaded again may be far faster than its leaving
        assert workbench.wait_idle()
        yield workbench


def mine(bench: Workbench) -> Session:
    """The page that was opened last."""
    return bench.sessions[-1]


@contextmanager
def chromium() -> Iterator[Browser]:
    """Debian's Chromium, without a window. Its absence is a failure unless the caller asked for no browser."""
    if os.environ.get("SIMAPS_NO_BROWSER") == "1":
        pytest.skip("SIMAPS_NO_BROWSER=1")
    if not CHROMIUM.is_file():
        pytest.fail(f"{CHROMIUM} is missing: install chromium, or set SIMAPS_NO_BROWSER=1 to leave these tests out")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=str(CHROMIUM), headless=True, args=ARGUMENTS)
        yield browser
        browser.close()


@contextmanager
def watched_page(browser: Browser, width: int = 1280, height: int = 800, **context: Any) -> Iterator[Page]:
    """A fresh page; fails at the end when it, or a frame in it, asked for anything outside this machine."""
    opened = browser.new_context(viewport={"width": width, "height": height}, **context)
    asked = []
    try:
        opened.set_default_timeout(1000 * PATIENCE_S)
        opened.add_init_script(path=FEW_PICTURES)
        page = opened.new_page()
        page.on("request", lambda request: asked.append(request.url))
        yield page
    finally:  # a workbench counts its pages: those of a test that failed are none of the next one
        opened.close()
    assert [url for url in asked if not url.startswith(LOCAL)] == []


def until(page: Page, predicate: Callable[[], object], timeout_s: float = PATIENCE_S) -> None:
    """Wait, letting the browser work, until a predicate holds."""
    end = time.monotonic() + timeout_s
    while not predicate():
        assert time.monotonic() < end, "timed out"
        page.wait_for_timeout(40)


def open_workbench(page: Page, workbench: Any) -> None:
    """Load the page and wait for the map and a settled camera."""
    page.goto(f"{workbench.url}/?fixedDpr=1")
    page.wait_for_function(
        "() => window.__viserMutable?.nodeRefFromName && window.__viserMutable.nodeRefFromName['/map'] != null",
        timeout=1000 * PATIENCE_S,
    )
    last: list[tuple[float, ...]] = []

    def settled() -> bool:
        if not workbench.sessions or mine(workbench).client.camera.update_timestamp == 0.0:
            return False
        camera = mine(workbench).client.camera
        width = page.locator("canvas").first.bounding_box() or {"width": 0, "height": 1}
        last.append((*camera.position, camera.aspect))
        same = len(last) > 8 and np.allclose(last[-1], last[-8], rtol=1e-6)
        fits = same and abs(camera.aspect - width["width"] / width["height"]) < 0.001
        return fits and page_is_there(workbench, page, mine(workbench).simap)

    until(page, settled)


STILL = """() => new Promise((done) => {
  const numbers = () => JSON.stringify(window.__viserMutable.camera.matrixWorldInverse.elements);
  let last = numbers(), left = 12;
  const draw = () => {
    const now = numbers();
    left = now === last ? left - 1 : 12;
    last = now;
    if (left) requestAnimationFrame(draw); else done();
  };
  draw();
})"""


def at_rest(page: Page) -> None:
    """Wait until the page has drawn a dozen pictures in a row from the same place, however long each may take."""
    page.evaluate(STILL)


CLOSE_ALL = "() => document.querySelectorAll('.mantine-Notification-closeButton').forEach((one) => one.click())"


@contextmanager
def borrowed(bench: Any, page: Page) -> Iterator[Page]:
    """A page that the tests of a file share, for opening one takes longer than they do; left as it was opened."""
    with all_borrowed(bench, page):
        yield page


@contextmanager
def all_borrowed(bench: Any, *pages: Page) -> Iterator[None]:
    """All pages of a workbench, in the order in which they were opened, as `borrowed`."""
    until(pages[0], lambda: len(bench.sessions) == len(pages))  # others were closed, which it may not know yet
    kept = [(one.panels[CommandPanel].state(), one.panels[MapPanel].state()) for one in bench.sessions]
    yield
    until(pages[0], lambda: len(bench.sessions) == len(pages))
    for page, session, (robot, look) in zip(pages, bench.sessions, kept, strict=True):
        page.evaluate("() => document.activeElement.blur()")
        page.keyboard.press("Escape")
        if session.theme.dark:
            page.keyboard.press("l")
            until(page, lambda session=session: not session.theme.dark)
        session.panels[CommandPanel].reset()
        session.panels[CommandPanel].restore(robot)
        session.panels[MapPanel].reset()
        session.panels[MapPanel].restore(look)
        session.select(None)
        session.finish()
        session.look(TOP)
        page.evaluate(CLOSE_ALL)
        page.mouse.move(1, 1)
        page.get_by_role("tab", name="Map", exact=True).click()
        assert session.wait_idle(PATIENCE_S)
        until(page, lambda page=page, session=session: page_is_there(bench, page, session.simap, session))


def on_canvas(
    workbench: Any, page: Page, x_m: float, y_m: float, session: Any = None, z_m: float = 0.0
) -> tuple[float, float]:
    """Where a point of the floor, or above it, appears, in pixels of the page; of several pages, say whose session."""
    camera = (session or mine(workbench)).client.camera
    forward = np.asarray(camera.look_at) - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, camera.up_direction)
    right = right / np.linalg.norm(right)
    ray = np.array([x_m, y_m, z_m]) - camera.position
    depth, half = ray @ forward, np.tan(camera.fov / 2.0)
    u = (ray @ right / depth / half / camera.aspect + 1.0) / 2.0
    v = (1.0 - ray @ np.cross(right, forward) / depth / half) / 2.0
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    return box["x"] + u * box["width"], box["y"] + v * box["height"]


CAMERA = """() => {
  const { camera, nodeRefFromName } = window.__viserMutable, map = nodeRefFromName['/map'];
  return map && [...camera.matrixWorldInverse.elements, ...camera.projectionMatrix.elements,
    ...map.matrixWorld.elements];
}"""


def place_on(page: Page, simap: Any, x_m: float, y_m: float) -> tuple[float, float]:
    """Where a point of the floor appears: by the camera's own matrices; the map's node lies at the map's middle."""
    numbers: list[float] = []
    until(page, lambda: numbers.extend(page.evaluate(CAMERA) or ()) or numbers)  # a map that is drawn anew is away
    view, projection, node = np.array(numbers).reshape(3, 4, 4).transpose(0, 2, 1)
    xmin, ymin, xmax, ymax = simap.spec.extent_m
    local = np.array([x_m - (xmin + xmax) / 2.0, y_m - (ymin + ymax) / 2.0, 0.0, 1.0])
    clip = projection @ view @ node @ local
    u, v = (clip[:2] / clip[3] * (1, -1) + 1.0) / 2.0
    box = page.locator("canvas").first.bounding_box()
    assert box is not None
    return box["x"] + u * box["width"], box["y"] + v * box["height"]


def page_is_there(workbench: Any, page: Page, simap: Any, session: Any = None) -> bool:
    """Whether the page draws from where its camera was set: what is set here is drawn from a while later."""
    xmin, ymin, xmax, ymax = simap.spec.extent_m
    return all(
        np.allclose(place_on(page, simap, *corner), on_canvas(workbench, page, *corner, session), atol=1.5, rtol=0.0)
        for corner in ((xmin, ymin), (xmax, ymax))
    )


PIXELS = """(places) => {
  const canvas = [...document.querySelectorAll('canvas')].sort((a, b) => b.width * b.height - a.width * a.height)[0];
  const box = canvas.getBoundingClientRect();
  const copy = document.createElement('canvas'); copy.width = canvas.width; copy.height = canvas.height;
  const context = copy.getContext('2d', { willReadFrequently: true });
  context.drawImage(canvas, 0, 0);
  return places.map(([x, y]) => {
    const u = (x - box.x) / box.width * canvas.width, v = (y - box.y) / box.height * canvas.height;
    return Array.from(context.getImageData(Math.floor(u), Math.floor(v), 1, 1).data.slice(0, 3));
  });
}"""
"""The colours that the canvas shows at places of the page: one copy of it for all of them."""


def pixel(workbench: Any, page: Page, x_m: float, y_m: float, session: Any = None) -> tuple[int, ...]:
    """The colour the canvas shows at a point of the floor."""
    return tuple(page.evaluate(PIXELS, [on_canvas(workbench, page, x_m, y_m, session)])[0])


def pixels_around(
    workbench: Any, page: Page, place: tuple[float, float], reach_m: float, count: int, session: Any = None
) -> list[list[int]]:
    """The colours along a short line through a point of the floor, west to east."""
    west, east = (on_canvas(workbench, page, place[0] + d, place[1], session) for d in (-reach_m, reach_m))
    return page.evaluate(PIXELS, np.linspace(west, east, count).tolist())


def wait_for_color(
    workbench: Any,
    page: Page,
    place: tuple[float, float],
    rgb: Sequence[int] | NDArray,
    tolerance: int = 3,
    session: Any = None,
) -> None:
    until(page, lambda: np.abs(np.subtract(pixel(workbench, page, *place, session), rgb)).max() <= tolerance)


def rerun_frame(page: Page) -> Frame:
    """The frame of the recorded build, which has no address until it is loaded."""
    found: list[Frame] = []
    until(page, lambda: found.extend(one for one in page.frames if "/rerun/" in one.url) or found)
    return found[0]


def field_of(page: Page, label: str | re.Pattern[str]) -> Locator:
    """The text or number box beside the label that begins so (viser gives its inputs no accessible name)."""
    begins = label if isinstance(label, re.Pattern) else re.compile(rf"^\s*{re.escape(label)}")
    row = page.locator("label", has_text=begins).locator("xpath=ancestor::div[contains(@class,'Flex-root')][1]")
    return row.locator("input:not([type=hidden]), textarea:not([aria-hidden])").last
