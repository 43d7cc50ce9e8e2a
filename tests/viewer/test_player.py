"""What plays a slider: once it is stopped nothing more of it is shown, and two on one page do not lock one another."""

import contextlib
import threading

import pytest
import viser
from browser import free_port, toy_workbench
from fake_page import fake_page

from simaps_viz.viewer.page.panel import Played, Player
from simaps_viz.viewer.panels.build import BuildPanel

PATIENCE_S = 60.0
LOOKS_S = 0.2
"""So long a thread that may go on is given to do so, where it is not to."""


@pytest.fixture
def gui():
    server = viser.ViserServer(host="127.0.0.1", port=free_port(), verbose=False)
    yield server.gui
    server.stop()


def playing() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "workbench-play"]


def ended() -> bool:
    for thread in playing():
        thread.join(PATIENCE_S)
    return not playing()


def test_it_shows_one_position_after_another_and_can_be_played_again(gui):
    shown: list[int] = []
    player = Player(gui, "Play", Played(lambda: 1, lambda: 3, shown.append, lambda: 1000.0))
    player.toggle()
    assert ended() and shown == [1, 2, 3] and player.button.label == "Play"
    player.toggle()
    assert ended() and shown == [1, 2, 3, 1, 2, 3]


def test_who_stops_it_has_the_last_word(gui):
    happened: list[str] = []
    begun, gate = threading.Event(), threading.Event()

    def show(position: int) -> None:
        begun.set()
        assert gate.wait(PATIENCE_S)
        happened.append(f"shown {position}")

    player = Player(gui, "Play", Played(lambda: 0, lambda: 9, show, lambda: 0.1))

    def stop() -> None:
        player.stop()
        happened.append("stopped")

    player.toggle()
    assert begun.wait(PATIENCE_S)
    stopping = threading.Thread(target=stop)
    stopping.start()
    stopping.join(LOOKS_S)
    gate.set()
    stopping.join(PATIENCE_S)
    assert ended() and happened == ["shown 0", "stopped"] and player.button.label == "Play"


def test_two_that_stop_one_another_both_come_to_an_end(gui):
    both = threading.Barrier(2)
    players: list[Player] = []

    def show(other: int) -> None:
        with contextlib.suppress(threading.BrokenBarrierError):
            both.wait(LOOKS_S)
        players[other].stop()

    for other in (1, 0):
        played = Played(lambda: 0, lambda: 5, lambda _, other=other: show(other), lambda: 1000.0)
        players.append(Player(gui, f"Play {other}", played))
    for player in players:
        player.toggle()
    stopping = threading.Thread(target=lambda: [player.stop() for player in players], daemon=True)
    stopping.start()
    stopping.join(PATIENCE_S)
    assert not stopping.is_alive() and ended()


def test_who_asks_for_the_finished_map_gets_it_though_playing_was_about_to_begin():
    with toy_workbench() as bench, fake_page(bench) as page:
        build = page.session.panels[BuildPanel]
        assert page.session.at_end
        with build._player._lock:  # it has shown nothing yet
            build.toggle()
            page.session.finish()
        assert ended() and page.session.at_end
