"""The page around rerun's web viewer: what it may load, and its messages both ways."""

import base64
import hashlib
import importlib.metadata
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser import until, watched_page
from playwright.sync_api import Page
from recorded_story import record

from simaps_viz.colors.classes import instance_color
from simaps_viz.errors import InputError, SIMapsError
from simaps_viz.recorder import web_viewer
from simaps_viz.recorder.map_log import GROUND, UNPARTED
from simaps_viz.recorder.web_viewer import CONTENT_SECURITY_POLICY, check_version, rerun_page, viewer_assets
from simaps_viz.viewer.server.front_door import FrontDoor
from simaps_viz.viewer.server.host import Host


def test_assets_are_the_viewer() -> None:
    assets = viewer_assets()
    assert {name: kind for name, (_, kind) in assets.items()} == {
        "re_viewer.js": "text/javascript",
        "re_viewer_bg.wasm": "application/wasm",
    }
    assert b"class WebHandle" in assets["re_viewer.js"][0]
    assert assets["re_viewer_bg.wasm"][0].startswith(b"\0asm") and len(assets["re_viewer_bg.wasm"][0]) > 10_000_000


def test_other_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    check_version()
    check_version("0.41.7")
    with pytest.raises(SIMapsError, match=r"expected version 0\.41\.x, found 0\.410\.0"):
        check_version("0.410.0")
    viewer_assets.cache_clear()
    monkeypatch.setattr(importlib.metadata, "version", lambda _: "0.42.0")
    with pytest.raises(SIMapsError, match=r"found 0\.42\.0"):
        viewer_assets()


def test_missing_program_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    viewer_assets.cache_clear()
    monkeypatch.setattr(web_viewer, "_program", lambda: Path(shutil.which("false") or ""))
    with pytest.raises(SIMapsError, match="ended with status 1"):
        viewer_assets()


def test_page_runs_its_own_script_and_no_other() -> None:
    page = rerun_page(["/a.rrd"])
    inline = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    assert len(inline) == 1
    digest = base64.b64encode(hashlib.sha256(inline[0].encode()).digest()).decode()
    scripts = next(d for d in CONTENT_SECURITY_POLICY.split("; ") if d.startswith("script-src"))
    assert f"'sha256-{digest}'" in scripts and "unsafe-inline" not in scripts and "'unsafe-eval'" not in scripts
    assert re.findall(r"https?://[^\s;]+", CONTENT_SECURITY_POLICY) == []


def test_addresses_cannot_break_out_of_the_page() -> None:
    nasty = "/</script><script>alert(1)</script>.rrd"
    page = rerun_page([nasty], theme="dark")
    assert page.count("<script>") == 1
    config = re.search(r'id="config">(.*?)</script>', page)
    assert config is not None and json.loads(config[1]) == {"recordings": [nasty], "theme": "dark"}


def test_unknown_theme() -> None:
    with pytest.raises(InputError, match="light, dark, found 'pink'"):
        rerun_page([], theme="pink")


@pytest.fixture(scope="module")
def shown(browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Page, Host, list[dict[str, Any]]]]:
    """The toy recording open in a page; every event the page tells."""
    path = record(tmp_path_factory.mktemp("page") / "toy.rrd")
    told: list[dict[str, Any]] = []
    viewer_assets.cache_clear()
    host = Host(
        page=rerun_page,
        assets=viewer_assets(),
        csp=CONTENT_SECURITY_POLICY,
        recordings=[path],
        on_event=lambda event, _session: told.append(event),
    )
    door = FrontDoor().start([host])
    try:
        with watched_page(browser, 640, 700) as page:
            errors: list[str] = []
            page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
            page.goto(door.url)
            until(page, lambda: page.evaluate("window.simapsReady"))
            until(page, lambda: any(e["type"] == "timeline_change" for e in told))
            yield page, host, told
            refused = [one for one in errors if "Content Security Policy" in one]
            assert refused == [], "usage data are not even tried"
    finally:
        door.close()


def pixels(page: Page, color: tuple[int, ...]) -> int:
    """How many pixels of the map, the lower half of the page, have a colour."""
    image = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    near = np.abs(image[300:600, :, ::-1].astype(int) - color[:3]).max(axis=2) <= 3
    return int(near.sum())


SAND, CHAIR = GROUND[UNPARTED][2], instance_color(4)


def test_time_set_from_outside_changes_the_map(shown: tuple[Page, Host, list[dict[str, Any]]]) -> None:
    page, host, told = shown
    for time, there, absent in ((3, CHAIR, SAND), (0, SAND, CHAIR), (3, CHAIR, SAND)):
        before = len(told)
        host.push({"set_time": {"timeline": "frame", "time": time}})
        until(page, lambda: pixels(page, there) > 500 and pixels(page, absent) == 0)  # noqa: B023 - used at once
        echoes = [e for e in told[before:] if e["type"] == "time_update" and e["time"] == time]
        assert echoes == [], "a time that was set from outside is not told back"


def test_other_timelines_can_be_chosen(shown: tuple[Page, Host, list[dict[str, Any]]]) -> None:
    page, host, told = shown
    host.push({"set_time": {"timeline": "merge", "time": 0}})
    until(page, lambda: pixels(page, instance_color(9)) > 500 and pixels(page, CHAIR) > 500)
    host.push({"set_time": {"timeline": "merge", "time": 1}})
    until(page, lambda: pixels(page, instance_color(9)) == 0 and pixels(page, CHAIR) > 500)
    until(page, lambda: any(e["type"] == "timeline_change" and e["timeline"] == "merge" for e in told))


def test_scrubbing_is_told_with_its_timeline(shown: tuple[Page, Host, list[dict[str, Any]]]) -> None:
    page, host, told = shown
    host.push({"set_time": {"timeline": "frame", "time": 0}})
    until(page, lambda: pixels(page, SAND) > 500)
    page.evaluate("() => commanded.clear()")  # what was set before is no echo any more
    before = len(told)
    page.mouse.click(533, 686)  # the right end of the time line
    end = {"type": "time_update", "timeline": "frame", "time": 3}
    until(page, lambda: any(end.items() <= event.items() for event in told[before:]))
