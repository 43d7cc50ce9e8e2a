"""The pictures of the documentation: the workbench on the embedded scene, in headless Chromium. Needs playwright."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.page import DOCKED_WIDTH, NO_NOTES, opened

from simaps_viz.structures import Instance, SIMap

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

    from simaps_viz.viewer.session import Session

RECORDING_MS, SETTLED_MS = 75_000, 3_000
"""What the recorded build and the page take to come to rest in software WebGL."""
RIDE_MS = 6_000
PAUSE_MS = 150
"""viser's page sends only the last of all changes within 50 ms."""
COMPARED_MS, SURFACE_MS = 120_000, 8_000

Scene = Callable[["Page", "Session"], None]


@dataclass(frozen=True)
class Picture:
    """One picture of the page."""

    name: str
    """Of its file, without the ending."""
    pose: Scene
    """What is done on the page before."""
    docked: bool = False
    """Taken on a page that is wide enough for the recorded build beside the map."""


def an_object(page: "Page", session: "Session") -> None:
    """Select a table that many frames saw."""
    session.select(_well_seen(session.simap, "dining table").id)


def why(page: "Page", session: "Session") -> None:
    """Ask why a chair is one object, and its neighbours are others."""
    session.select(_well_seen(session.simap, "chair").id)
    page.wait_for_timeout(SETTLED_MS)
    page.get_by_text("Why is this one object?").first.scroll_into_view_if_needed()


def command(page: "Page", session: "Session") -> None:
    """Send the robot, and look while it is on its way."""
    session.select(None)
    _tab(page, "Command")
    box = _box(page, "Command")
    box.fill("go to the third chair from here, then visit every couch")
    box.press("Enter")
    page.wait_for_timeout(RIDE_MS)


def compare(page: "Page", session: "Session") -> None:
    """Lay the paper's map beside this one."""
    _tab(page, "Compare")
    _box(page, "Right").click()
    page.get_by_role("option", name="Method paper").click()
    page.wait_for_timeout(PAUSE_MS)
    page.get_by_role("button", name="Compare", exact=True).click()
    page.get_by_text("Mark all listed").wait_for(timeout=COMPARED_MS)


def masks(page: "Page", session: "Session") -> None:
    """Look at the masks of a frame."""
    _tab(page, "Masks")
    session.show_frame(40)


def time(page: "Page", session: "Session") -> None:
    """Go back to the time when half of the scene had been seen, on a dark page."""
    page.get_by_role("button", name="Light / dark").click()
    _tab(page, "Build")
    session.show_frame(len(session.simap.frame_names) // 3)


def room(page: "Page", session: "Session") -> None:
    """Look at the room in 3-D, as it looked."""
    session.select(None)
    _tab(page, "Map")
    page.get_by_role("button", name="3-D view").click()
    page.wait_for_timeout(SURFACE_MS)


PICTURES = (
    Picture("room", room),
    Picture("workbench", an_object, docked=True),
    Picture("why", why),
    Picture("command", command),
    Picture("compare", compare),
    Picture("masks", masks),
    Picture("time", time, docked=True),
)


def take(
    browser: "Browser", simap: SIMap, recording: Path, folder: Path, *, width: int, height: int, only: str = ""
) -> None:
    """Write the pictures, each of a page of its own, as PNG files named after them.

    Args:
        browser: that shows the page.
        simap: the map.
        recording: of its build; its history lies beside it.
        folder: where the pictures go.
        width: pixels of the page.
        height: pixels of the page.
        only: name of the one to take; empty takes all.
    """
    for picture in PICTURES:
        if only in ("", picture.name):
            wide = max(width, DOCKED_WIDTH) if picture.docked else width
            with opened(browser, simap, recording, width=wide, height=height) as (page, workbench):
                page.wait_for_timeout(RECORDING_MS if picture.docked else SETTLED_MS)
                page.evaluate(NO_NOTES)
                picture.pose(page, workbench.sessions[-1])
                page.mouse.move(1, 1)  # away from what shows a hint
                workbench.wait_idle()
                page.wait_for_timeout(SETTLED_MS)
                page.evaluate(NO_NOTES)
                page.screenshot(path=folder / f"{picture.name}.png")


def _tab(page: "Page", name: str) -> None:
    page.get_by_role("tab", name=name, exact=True).click()


def _box(page: "Page", label: str) -> "Locator":
    row = page.locator("label", has_text=label).locator("xpath=ancestor::div[contains(@class,'Flex-root')][1]")
    return row.locator("input:not([type=hidden]), textarea:not([aria-hidden])").first


def _well_seen(simap: SIMap, label: str) -> Instance:
    return sorted(simap.of_class(label), key=lambda one: one.frames)[-4:][0]
