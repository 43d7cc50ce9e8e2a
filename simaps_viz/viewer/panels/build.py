"""The panel that scrubs through the build, in step with the recording."""

import time
from collections import deque
from collections.abc import Callable
from html import escape

import viser

from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE, note_html
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.player import Played, Player

ECHO_S = 1.5
"""For how long a frame that was sent to the recording may come back as an echo."""
SETTLE_S = 10.0
"""For how long after a recording opened its going to its first frame is overruled."""
FRAMES_PER_S = 8
NOTE_RECORDED = "Go back in time here or in the recorded build on the left: both show the same frame."
NOTE = (
    "Go back in time: the map shows what it was after that frame. "
    "To watch what the camera saw as well, build the map with --record MAP.rrd."
)
NO_FRAMES = "This map keeps no frames. Build it again with --history (or --record MAP.rrd) to go back in time."
FRAME_HINT = "Counted from 0. Keys [ and ]: one frame back, one on."


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
        """Return whether a frame the recording reports is news."""
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
        building: bool = False,
    ) -> None:
        """Fill the current container.

        Args:
            gui: where.
            simap: the map.
            on_frame: gets the frame, and whether this page chose it.
            recorded: whether the recorded build stands beside the map.
            building: whether the map is being built, and its frames are to come.
        """
        self._on_frame, self._recorded, self._building = on_frame, recorded, building
        self._names = simap.frame_names
        last = max(len(self._names) - 1, 0)
        self._note = gui.add_html("")
        self._slider = gui.add_slider("Frame", 0, max(last, 1), 1, last, disabled=last == 0, hint=FRAME_HINT)
        self._slider.on_update(self._moved)
        self._name = gui.add_html(self._caption(last))
        self._then = gui.add_html("", visible=False)
        played = Played(
            lambda: self.frame,
            lambda: len(self._names) - 1,
            lambda frame: self.set_frame(frame, chosen_here=True),
            lambda: float(self._rate.value),
        )
        self._player = Player(gui, "Play", played)
        self._rate = gui.add_slider("Pace (per s)", 1, 30, 1, FRAMES_PER_S, hint="Frames a second, while it plays.")
        self._fill = gui.add_checkbox(
            "Map as it was then",
            True,
            hint="After the frame that is shown; otherwise the finished map.",
        )
        self._fill.on_update(lambda _: on_frame(self.frame, False))
        self._show_what_there_is()

    @property
    def frame(self) -> int:
        """The frame shown."""
        return int(self._slider.value)

    @property
    def fill_in_step(self) -> bool:
        """Whether the map shall be shown as it was then."""
        return bool(self._fill.value)

    @property
    def behind(self) -> int | None:
        """The frame after which the map shall be shown; None = the finished map."""
        return self.frame if self.fill_in_step and not self.at_end else None

    @property
    def at_end(self) -> bool:
        """Whether the last frame is shown."""
        return self.frame >= len(self._names) - 1

    def set_fill(self, fill_in_step: bool) -> None:
        """Choose whether the map shall be shown as it was then."""
        self._fill.value = fill_in_step

    def tell(self, words: str) -> None:
        """Describe what was known then; nothing for the finished map."""
        content = f'<div role="status" style="{BOX_STYLE}">{escape(words)}</div>' if words else ""
        if self._then.content != content:
            self._then.content, self._then.visible = content, bool(words)

    def map_changed(self, simap: SIMap) -> None:
        """The build may have gone on: who looked at its last frame goes on to the new last one."""
        if simap.frame_names == self._names:
            return
        last, follow = max(len(simap.frame_names) - 1, 0), self.at_end
        self._names = simap.frame_names
        self._slider.max = max(last, 1)
        self._show_what_there_is()
        if follow or self.frame > last:
            self._slider.value = last
        self._name.content = self._caption(self.frame)

    def rest(self) -> None:
        """Go to the last frame without a word to anyone."""
        self._player.stop()
        last = max(len(self._names) - 1, 0)
        if self._slider.value != last:
            self._slider.value = last
            self._name.content = self._caption(last)

    def set_frame(self, frame: int, *, chosen_here: bool = False) -> None:
        """Move the slider, and tell."""
        frame = min(max(frame, 0), max(len(self._names) - 1, 0))
        self._slider.value = frame
        self._tell(frame, chosen_here)

    def toggle(self) -> None:
        """Play, or stop playing."""
        if len(self._names) > 1:
            self._player.toggle()

    def stop(self) -> None:
        """Stop playing."""
        self._player.stop()

    def _moved(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:
            self._player.stop()
            self._tell(self.frame, True)

    def _tell(self, frame: int, chosen_here: bool) -> None:
        self._name.content = self._caption(frame)
        self._on_frame(frame, chosen_here)

    def _show_what_there_is(self) -> None:
        """Have no controls that do nothing."""
        some = len(self._names) > 1
        self._slider.disabled = self._player.button.disabled = not some
        known = bool(self._names) or self._building
        for widget in (self._slider, self._name, self._player.button, self._rate, self._fill):
            widget.visible = known
        words = (NOTE_RECORDED if self._recorded else NOTE) if known else NO_FRAMES
        self._note.content = note_html(words)

    def _caption(self, frame: int) -> str:
        if not self._names:
            return f'<div style="{BOX_STYLE}">No frame is on the map yet.</div>'
        return (
            f'<div style="{BOX_STYLE}">Frame <b>{escape(self._names[frame])}</b> '
            f'<span style="{DIM_STYLE}">({frame + 1} of {len(self._names)})</span></div>'
        )
