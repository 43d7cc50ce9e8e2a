"""A button that plays a slider, one position after another."""

import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass

import viser

_LOCKS: "weakref.WeakKeyDictionary[viser.GuiApi, threading.RLock]" = weakref.WeakKeyDictionary()
"""One lock for all players of a page: showing a position stops the other players, which must not deadlock."""


@dataclass(frozen=True)
class Played:
    """The slider that is played, as functions; none of them may take long."""

    position: Callable[[], int]
    last: Callable[[], int]
    show: Callable[[int], None]
    rate: Callable[[], float]
    """Return the positions shown a second."""


class Player:
    """A button that plays and pauses a slider."""

    def __init__(self, gui: viser.GuiApi, label: str, played: Played, *, first: int = 0) -> None:
        """Add the button to the open container; ``first`` is where playing begins after the last position."""
        self._label, self._played, self._first = label, played, first
        self._turn: threading.Event | None = None
        self._lock = _LOCKS.setdefault(gui, threading.RLock())
        self.button = gui.add_button(label, icon=viser.Icon.PLAYER_PLAY)
        self.button.on_click(lambda _: self.toggle())

    def toggle(self) -> None:
        """Play, or pause."""
        with self._lock:
            if self._turn is not None:
                self.stop()
                return
            ended = self._turn = threading.Event()
            self.button.label, self.button.icon = "Pause", viser.Icon.PLAYER_PAUSE
            threading.Thread(target=self._run, args=(ended,), name="workbench-play", daemon=True).start()

    def stop(self) -> None:
        """Stop playing; no further position is shown after this call."""
        with self._lock:
            turn, self._turn = self._turn, None
            if turn is not None:
                turn.set()
                self.button.label, self.button.icon = self._label, viser.Icon.PLAYER_PLAY

    def _run(self, ended: threading.Event) -> None:
        played = self._played
        at = played.position()
        position = self._first if at >= played.last() else at
        while position <= played.last():
            with self._lock:
                if ended.is_set():
                    return
                played.show(position)
            if ended.wait(1.0 / max(played.rate(), 0.1)):
                return
            position += 1
        with self._lock:
            if self._turn is ended:
                self.stop()
