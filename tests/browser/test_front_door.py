"""A workbench on a machine that is reached through one forwarded port, as by ``ssh -L``: nothing else is needed."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import cv2
import numpy as np
from browser import PATIENCE_S, free_port, mine, rerun_frame, toy_services, until, watched_page
from live_sequences import at_once, held_sequence, settings
from recorded_story import record
from toy_maps import TOY_POSE, toy_map

from simaps_viz.app.live import live_workbench
from simaps_viz.console.progress import stage_progress
from simaps_viz.viewer.workbench import Workbench


def pass_on(source: socket.socket, sink: socket.socket) -> None:
    with suppress(OSError):
        while part := source.recv(65_536):
            sink.sendall(part)
    for one in (source, sink):
        with suppress(OSError):
            one.shutdown(socket.SHUT_RDWR)


@contextmanager
def forwarded(port: int) -> Iterator[int]:
    """Forward a port of this machine, and no other, to another one."""
    threads: list[threading.Thread] = []

    def start(target: Callable[..., None], *arguments: socket.socket) -> threading.Thread:
        threads.append(threading.Thread(target=target, args=arguments, daemon=True))
        threads[-1].start()
        return threads[-1]

    def forward(near: socket.socket) -> None:
        with near, socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as far:
            back = start(pass_on, far, near)
            pass_on(near, far)
            back.join()

    def accept(listening: socket.socket) -> None:
        with suppress(OSError):
            while True:
                start(forward, listening.accept()[0])

    with socket.create_server(("127.0.0.1", 0)) as listening:
        start(accept, listening)
        yield listening.getsockname()[1]
        listening.shutdown(socket.SHUT_RDWR)
    for thread in threads:
        thread.join(PATIENCE_S)


@contextmanager
def watched_through(browser, bench: Workbench):
    """Open a page through one forwarded port; fails where it asks for any other."""
    with forwarded(bench.port) as near, watched_page(browser, 2040) as page:
        asked: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("websocket", lambda one: asked.append(one.url))
        page.goto(f"http://127.0.0.1:{near}")
        until(page, lambda: bench.sessions)
        assert mine(bench).wait_idle(PATIENCE_S)
        yield page
        elsewhere = [url for url in asked if url.startswith(("http", "ws")) and f"127.0.0.1:{near}/" not in url]
        assert asked and not elsewhere


def test_map_and_recording_come_through_one_port(browser, tmp_path):
    services = toy_services(recordings=(record(tmp_path / "toy.rrd"),))
    with (
        Workbench(toy_map(), services=services, port=free_port(), start=TOY_POSE) as bench,
        watched_through(browser, bench) as page,
    ):
        page.wait_for_function("() => window.__viserMutable?.nodeRefFromName?.['/map'] != null")
        recording = rerun_frame(page)
        recording.wait_for_function("() => window.simapsEvents.some((one) => one.type === 'recording_open')")
        assert bench.tabs._session_of  # the hidden frame told which tab it is in
        bench.recording_host.push({"set_time": {"timeline": "frame", "time": 1}})  # pyright: ignore[reportOptionalMemberAccess]
        recording.wait_for_function("() => window.simapsEvents.some((one) => one.type === 'time_update')")


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
        watched_through(browser, bench) as page,
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
