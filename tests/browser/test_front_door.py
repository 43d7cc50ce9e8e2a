"""A build watched from another machine, through one forwarded port: the docked recording follows what is streamed."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from browser import PATIENCE_S, mine, rerun_frame, until
from forwarded import watched_through
from live_sequences import at_once, held_sequence, settings

from simaps_viz.app.live import live_workbench
from simaps_viz.console.progress import stage_progress

FRAMES, HELD = 40, 20
TIMES = "() => window.simapsEvents.filter((one) => one.type === 'time_update').map((one) => Number(one.time))"


def docked(page) -> Callable[[], np.ndarray]:
    """Return what takes pictures of the docked recording."""
    box = page.locator("iframe[title='Recorded build']").bounding_box()

    def picture() -> np.ndarray:
        shot = cv2.imdecode(np.frombuffer(page.screenshot(clip=box), np.uint8), cv2.IMREAD_COLOR)
        return np.asarray(shot).astype(int)

    return picture


def changed(before: np.ndarray, after: np.ndarray) -> float:
    """Share of the pixels that differ clearly."""
    return float((np.abs(after - before).max(axis=2) > 25).mean())


def drawn(picture: np.ndarray) -> float:
    """Share of the pixels that are not of the ground's colour: next to nothing before the recording is drawn."""
    return float((picture != np.median(picture, axis=(0, 1))).any(axis=2).mean())


def test_the_live_stream_comes_through_one_port_and_the_docked_recording_follows_it(browser, tmp_path, monkeypatch):
    at_once(monkeypatch)
    held = held_sequence(tmp_path / "tiny", FRAMES, held_from=HELD)
    with (
        stage_progress(quiet=True) as progress,
        live_workbench(held, settings(tmp_path / "m.npz"), progress) as (bench, build),
        watched_through(browser, bench, 2040) as page,
    ):
        recording = rerun_frame(page)
        recording.wait_for_function("() => window.simapsEvents.some((one) => one.type === 'recording_open')")
        picture = docked(page)
        pictures = [picture()]

        def rests() -> bool:
            page.wait_for_timeout(3500)  # longer than a stream's page rests between two pictures
            pictures.append(picture())
            return drawn(pictures[-1]) > 0.1 and changed(*pictures[-2:]) < 0.001

        until(page, rests)  # what changes from here on comes with the build
        before = pictures[-1]
        seen = len(recording.evaluate(TIMES))
        stream: Any = build._audience.stream
        streamed = stream.frames
        assert streamed == [0]
        build.start()
        until(page, lambda: build.state().done >= 8 and streamed[-1] > 0)
        assert build.state().status == "building" and streamed[-1] < HELD
        until(page, lambda: recording.evaluate(TIMES)[seen:][-1:] == [float(streamed[-1])])
        until(page, lambda: changed(before, picture()) > 0.02)
        held.let_go()
        assert build.wait(PATIENCE_S) and mine(bench).wait_idle(PATIENCE_S)
        assert build.state().status == "done" and streamed[-1] == FRAMES - 1
        until(page, lambda: recording.evaluate(TIMES)[-1:] == [float(FRAMES - 1)])
