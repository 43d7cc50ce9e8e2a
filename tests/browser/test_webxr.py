"""The phone's page in Debian's Chromium, whose WebXR is simulated: its own JavaScript sends what becomes the map."""

import base64
import json
import threading
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from browser import PATIENCE_S, until, watched_page
from fake_phone import UNIT_M, color_network, phone_pose
from playwright.sync_api import expect
from sequences import write_tiny_sequence

from simaps_viz import open_sequence
from simaps_viz.app.webxr import WebXRSource
from simaps_viz.build.pipeline import BuildConfig, build_map
from simaps_viz.live import phone as phones
from simaps_viz.live.run import LiveRequest, LiveRun
from simaps_viz.live.source import Traffic
from simaps_viz.viewer.server.access import Access

FRAMES, LARGER = 9, 16
"""Pictures are so many times as large as depth, so that JPEG leaves colours what they are."""
FAKE = (Path(__file__).parents[1] / "helpers" / "fake_xr.js").read_text()


def as_base64(array):
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()


def fake_frame(frame, *, turned):
    """Return a frame as WebXR hands it out; ``turned``: its depth lies on its side, as sensors do in phones."""
    k, depth = frame.intrinsics, np.rint(frame.depth_m / UNIT_M).astype("<u2")
    position, xyzw = phone_pose(frame.T_world_camera)
    # Clip coordinates of a camera with z backward, in columns; the principal point is not in the middle of pixels.
    projection = np.zeros((4, 4))
    projection[0, 0], projection[1, 1] = 2 * k.fx / k.width, 2 * k.fy / k.height
    projection[0, 2], projection[1, 2] = 1 - 2 * (k.cx + 0.5) / k.width, 2 * (k.cy + 0.5) / k.height - 1
    projection[2, 2:], projection[3, 2] = (-1.0, -0.002), -1.0
    depth_from_view = np.eye(4)
    if turned:  # the view's rows run along the buffer's columns, from its right
        depth = np.rot90(depth, -1)
        depth_from_view[:2] = [0, -1, 0, 1], [1, 0, 0, 0]
    rgba = np.dstack([frame.color, np.full(frame.color.shape[:2], 255, np.uint8)])
    picture = cv2.resize(rgba, None, fx=LARGER, fy=LARGER, interpolation=cv2.INTER_NEAREST)
    return {
        "width": picture.shape[1], "height": picture.shape[0], "picture": as_base64(picture), "unit": UNIT_M,
        "depthWidth": depth.shape[1], "depthHeight": depth.shape[0], "depth": as_base64(depth),
        "depthFromView": depth_from_view.T.ravel().tolist(), "projection": projection.T.ravel().tolist(),
        "position": dict(zip("xyz", position, strict=True)), "orientation": dict(zip("xyzw", xyzw, strict=True)),
    }  # fmt: skip


@pytest.fixture
def tiny(tmp_path):
    write_tiny_sequence(tmp_path / "tiny", frames=FRAMES)
    return open_sequence(tmp_path / "tiny")


@contextmanager
def phone_page(browser, source, frames):
    with watched_page(browser, width=400, height=800) as page:
        page.add_init_script(f"window.fakeFrames = {json.dumps(frames)};\n{FAKE}")
        page.goto(source.entrance.replace("localhost", "127.0.0.1"))
        yield page


def test_the_page_sends_what_the_phone_sees(browser, tiny, monkeypatch):
    """Its depth lies on its side; upright depth makes the map of the next test."""
    monkeypatch.setattr(phones, "BEHIND", 1000)
    source = WebXRSource("webxr://0", Access(token=""), network=color_network(), traffic=Traffic())
    frames = [tiny.read(i, color=True) for i in range(FRAMES)]
    with phone_page(browser, source, [fake_frame(one, turned=True) for one in frames]) as page:
        expect(page.get_by_role("status")).to_have_text("Ready.")
        page.get_by_role("button", name="Start").click()
        until(page, lambda: len(source._frames) >= FRAMES)
        assert "frames sent" in page.get_by_role("status").inner_text()
        mode, depth = page.evaluate("fakeXR.asked")
        assert mode == "immersive-ar" and depth["usagePreference"] == ["cpu-optimized"]
        page.get_by_role("button", name="End").click()
        until(page, lambda: page.evaluate("fakeXR.ended") and source._phone is None)
        expect(page.get_by_role("status")).to_have_text("Ended.")
    shots = [shot for _ in range(FRAMES) if (shot := source.take(1.0)) is not None]
    source.close()
    assert source._traffic.dropped == {}
    # Frames come in their order, but some may have been skipped while another was encoded.
    for shot in shots:
        assert shot.frame.color is not None
        x_m = shot.frame.T_world_camera[0, 3]
        true = min(frames, key=lambda one: abs(one.T_world_camera[0, 3] - x_m))
        assert np.allclose(shot.frame.T_world_camera, true.T_world_camera, atol=1e-6)
        k, expected = shot.frame.intrinsics, true.intrinsics
        assert (k.width, k.height) == (expected.width * LARGER, expected.height * LARGER)
        own = [k.fx, k.fy, k.cx + 0.5, k.cy + 0.5]
        assert own == pytest.approx(
            [LARGER * v for v in (expected.fx, expected.fy, expected.cx + 0.5, expected.cy + 0.5)], rel=1e-5
        )
        middle = slice(LARGER // 2, None, LARGER)
        assert np.allclose(shot.frame.depth_m[middle, middle], true.depth_m, atol=UNIT_M)
        assert np.abs(shot.frame.color[middle, middle].astype(int) - true.color).max() < 30
    times = [shot.stamp_ns for shot in shots]
    assert len(times) == FRAMES and times == sorted(set(times))


def test_a_map_grows_from_the_page_and_a_server_that_comes_back_is_found_again(browser, tiny, tmp_path):
    network, traffic = color_network(), Traffic()
    source = WebXRSource("webxr://0", Access(token=""), network=network, traffic=traffic)
    request = LiveRequest(source, BuildConfig(), tmp_path / "m.npz", network=network, every_frame=True, traffic=traffic)
    run, cancel, found = LiveRun(request), threading.Event(), []
    thread = threading.Thread(target=lambda: found.append(run.run((), cancel)))
    thread.start()
    frames = [fake_frame(tiny.read(i, color=True), turned=False) for i in range(FRAMES)]
    with phone_page(browser, source, frames) as page:
        page.get_by_role("button", name="Start").click()
        until(page, lambda: traffic.placed >= FRAMES, 5 * PATIENCE_S)
        # The connection breaks off, and the page connects again by itself.
        broken, before = source._phone, traffic.placed
        assert broken is not None
        broken.close(1011)
        until(page, lambda: source._phone not in (None, broken) and traffic.placed > before)
        # A page that opens on another phone takes over, and this one does not fight for it.
        with phone_page(browser, source, frames) as other:
            other.get_by_role("button", name="Start").click()
            expect(page.get_by_role("status")).to_have_text("Another phone has taken over.")
            assert page.evaluate("fakeXR.ended")
            cancel.set()
            until(page, lambda: not thread.is_alive(), 5 * PATIENCE_S)
    thread.join()
    source.close()
    assert found[0].counts() == build_map(tiny).counts() == {"chair": 2}


def test_a_browser_without_ar_says_so(browser, tiny):
    source = WebXRSource("webxr://0", Access(token=""), network=None, traffic=Traffic())
    with phone_page(browser, source, [fake_frame(tiny.read(0, color=True), turned=False)]) as page:
        page.evaluate("fakeXR.none = true")
        page.get_by_role("button", name="Start").click()
        expect(page.get_by_role("status")).to_contain_text("This browser has no AR")
        assert source._phone is None
    source.close()
