"""The panel that scrubs through the build, in step with the recording."""

import threading
import time
from collections import deque
from collections.abc import Callable
from html import escape

import viser

from simaps_viz.structures import SIMap

ECHO_S = 1.5
"""For how long a frame that was sent to the recording may come back as an echo."""
SETTLE_S = 10.0
"""For how long after a recording opened its going to its first frame is overruled."""
FRAMES_PER_S = 5.0


class FrameLink:
    """Keeps two scrubbers in step without them chasing one another.

    The page's own frame is sent to the recording; what the recording reports is taken over unless it only echoes
    what it was sent.
    """

    def __init__(self, send: Callable[[int], None], clock: Callable[[], float] = time.monotonic) -> None:
        """Take how to send a frame to the recording."""
        self._send, self._clock = send, clock
        self._sent: deque[tuple[int, float]] = deque(maxlen=64)
        self._opened_s = float("-inf")

    def push(self, frame: int) -> None:
        """Show a frame in the recording."""
        self._sent.append((frame, self._clock()))
        self._send(frame)

    def opened(self, frame: int) -> None:
        """A recording was opened: bring it to the page's frame."""
        self._opened_s = self._clock()
        self.push(frame)

    def accept(self, reported: int, current: int) -> bool:
        """Tell whether a frame the recording reports is news."""
        now = self._clock()
        if reported == current or any(frame == reported and now - at < ECHO_S for frame, at in self._sent):
            return False
        if reported == 0 and now - self._opened_s < SETTLE_S:
            self.push(current)
            return False
        self._opened_s = float("-inf")  # somebody scrubs
        return True


class BuildPanel:
    """The widgets; ``set_frame`` moves them."""

    def __init__(
        self,
        gui: viser.GuiApi,
        simap: SIMap,
        *,
        on_frame: Callable[[int, bool], None],
        recorded: bool,
    ) -> None:
        """Fill the current container; ``on_frame`` gets the frame and whether this page chose it."""
        self._on_frame = on_frame
        self._names = simap.frame_names
        last = max(len(self._names) - 1, 0)
        note = (
            "Scrub here or in the recorded build on the left: both show the same frame."
            if recorded
            else "There is no recording of this build at hand; the map still knows its frames."
        )
        gui.add_html(f'<div style="padding:.5em .8em 0;font-size:.82em;opacity:.75">{note}</div>')
        self._slider = gui.add_slider("Frame", 0, last, 1, last, disabled=last == 0)
        self._slider.on_update(self._moved)
        self._name = gui.add_html(self._caption(last))
        self._fill = gui.add_checkbox(
            "Only what was seen by then", True, hint="Hide objects that no frame up to this one had named."
        )
        self._fill.on_update(lambda _: on_frame(self.frame, False))
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, disabled=last == 0)
        self._play.on_click(lambda _: self.toggle())
        self._playing = threading.Event()

    @property
    def frame(self) -> int:
        """The frame shown."""
        return int(self._slider.value)

    @property
    def fill_in_step(self) -> bool:
        """Whether the map shall only show what had been seen by then."""
        return bool(self._fill.value)

    def set_frame(self, frame: int, *, chosen_here: bool = False) -> None:
        """Move the slider, and tell."""
        frame = min(max(frame, 0), max(len(self._names) - 1, 0))
        self._slider.value = frame
        self._tell(frame, chosen_here)

    def toggle(self) -> None:
        """Play, or stop playing."""
        if self._playing.is_set():
            self.stop()
            return
        self._playing.set()
        self._play.label, self._play.icon = "Pause", viser.Icon.PLAYER_PAUSE
        threading.Thread(target=self._run, name="workbench-play", daemon=True).start()

    def stop(self) -> None:
        """Stop playing."""
        self._playing.clear()
        self._play.label, self._play.icon = "Play", viser.Icon.PLAYER_PLAY

    def _run(self) -> None:
        last = len(self._names) - 1
        frame = 0 if self.frame >= last else self.frame
        while self._playing.is_set() and frame <= last:
            self.set_frame(frame, chosen_here=True)
            time.sleep(1.0 / FRAMES_PER_S)
            frame += 1
        if self._playing.is_set():
            self.stop()

    def _moved(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:
            self._playing.clear()
            self._tell(self.frame, True)

    def _tell(self, frame: int, chosen_here: bool) -> None:
        self._name.content = self._caption(frame)
        self._on_frame(frame, chosen_here)

    def _caption(self, frame: int) -> str:
        name = self._names[frame] if self._names else "no frames"
        return (
            f'<div style="padding:.2em .8em;font-size:.85em">Frame <b>{escape(name)}</b> '
            f'<span style="opacity:.6">({frame + 1 if self._names else 0} of {len(self._names)})</span></div>'
        )
