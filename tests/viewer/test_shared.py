"""What sessions are made of: results that are computed once, names of tabs, a worker that costs nothing while idle."""

import threading

import pytest
from benchmarks.large_maps import large_map

from simaps_viz.colors.instances import instance_colors
from simaps_viz.viewer.page.page import Worker
from simaps_viz.viewer.page.shared import MAX_SIDE, SharedCache, paint
from simaps_viz.viewer.session import Tabs


def test_tabs_are_few_and_forgotten_after_a_while():
    now = [0.0]
    tabs: Tabs[int] = Tabs(most=2, kept_s=10.0, leave_s=0.0, clock=lambda: now[0])
    names = []
    for n in range(3):
        name, state = tabs.claim(None, f"session {n}")
        assert state is None
        names.append(name)
        tabs.leave(f"session {n}", n)
    assert len(tabs) == 2 and len(set(names)) == 3
    assert tabs.claim(names[0], "a")[1] is None  # pushed out by the two that came after
    assert tabs.claim(names[1], "b") == (names[1], 1)
    now[0] = 11.0
    assert tabs.claim(names[2], "c")[1] is None
    tabs.leave("nobody", 9)
    assert len(tabs) == 0


def test_a_page_faster_than_the_leaving_of_its_former_self_waits_for_it():
    tabs: Tabs[str] = Tabs(leave_s=60.0)
    name, _ = tabs.claim(None, "old")
    threading.Timer(0.2, tabs.leave, args=("old", "what was done")).start()
    assert tabs.claim(name, "new") == (name, "what was done")


def test_once_computes_once_waits_forgets_and_tries_again():
    once: SharedCache[int] = SharedCache(2)
    gate, calls, found = threading.Event(), [], []

    def slow():
        calls.append(1)
        gate.wait(60.0)
        return 7

    threads = [threading.Thread(target=lambda: found.append(once.get("a", slow))) for _ in range(8)]
    for thread in threads:
        thread.start()
    gate.set()
    for thread in threads:
        thread.join()
    assert found == [7] * 8 and calls == [1]
    with pytest.raises(ZeroDivisionError):
        once.get("b", lambda: 1 // 0)
    assert once.get("b", lambda: 2) == 2 and once.get("c", lambda: 3) == 3
    assert once.get("a", lambda: 8) == 8  # pushed out
    once.forget(lambda key: key == "a")
    assert once.get("c", lambda: 4) == 4 and once.get("a", lambda: 9) == 8


def test_once_keeps_to_its_size():
    once: SharedCache[bytes] = SharedCache(9, size=len, max_size=10)
    once.get("a", lambda: b"123456")
    once.get("b", lambda: b"123456")
    assert once.get("a", lambda: b"") == b"" and once.get("b", lambda: b"") == b"123456"
    assert once.get("c", lambda: b"x" * 50) == once.get("c", lambda: b"") == b"x" * 50


def test_a_worker_has_no_thread_when_idle_and_takes_nothing_after_its_stop():
    done = []
    worker = Worker(done.append)
    for n in range(3):
        worker.submit("a", lambda n=n: done.append(n))
        assert worker.wait_idle() and worker._thread is None
    worker.stop()
    worker.submit("b", lambda: done.append("late"))
    assert worker.wait_idle() and done == [0, 1, 2]


def test_a_worker_leaves_what_can_wait_until_nothing_else_has_come_for_a_while(monkeypatch):
    monkeypatch.setattr("simaps_viz.viewer.page.page.LATER_S", 60.0)  # so no machine is too slow
    done, going, painted, again = [], threading.Event(), threading.Event(), threading.Event()
    worker = Worker(done.append)
    worker.submit("cut", going.wait)
    for n in range(2):
        worker.submit("words", lambda n=n: done.append(f"words {n}"), later=True)
    worker.submit("paint", lambda: (done.append("paint"), painted.set()))
    going.set()
    assert painted.wait(60.0) and not worker.wait_idle(0.05)
    worker.submit("paint", lambda: (done.append("paint again"), again.set()))  # while it waits
    assert again.wait(60.0) and not worker.wait_idle(0.05)
    worker.stop()
    assert worker.wait_idle() and done == ["paint", "paint again"]


def test_what_can_wait_is_done_all_at_once(monkeypatch):
    monkeypatch.setattr("simaps_viz.viewer.page.page.LATER_S", 0.01)
    done = []
    worker = Worker(done.append)
    for name in ("words", "names"):
        worker.submit(name, lambda name=name: done.append(name), later=True)
    assert worker.wait_idle() and done == ["words", "names"]


def test_the_picture_of_a_very_large_map_is_one_that_every_browser_takes():
    simap = large_map(100, 10_000, 40, edges=False)
    picture = paint(simap, "instance", None, None)
    assert picture.shape == (41, MAX_SIDE, 3)
    one = max(simap.instances, key=lambda one: one.cells)
    x, y = one.centroid_m[0] + 0.5, one.centroid_m[1]
    row, col = y / 0.05 * 41 / 100, x / 0.05 * MAX_SIDE / 10_000
    assert picture[int(row), int(col)].tolist() == instance_colors(simap)[one.id].tolist()
    assert paint(large_map(100, 1000, 4, edges=False), "instance", None, None).shape == (100, 1000, 3)
