"""The two timelines of a map: the frames of its build, and the steps in which its objects were joined."""

from html import escape

import viser

from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE, note_html
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.structures import SIMap
from simaps_viz.viewer.page.page import Page
from simaps_viz.viewer.page.panel import Panel, Played, Player, button, by_person
from simaps_viz.viewer.page.shared import NO_HISTORY, Snapshot

FRAMES_PER_S = 8
NOTE_RECORDED = "Go back in time here or in the recorded build: both show the same frame."
NOTE = (
    "Go back in time: the map shows what it was after that frame. "
    "To watch what the camera saw as well, build the map with --record MAP.rrd."
)
NO_FRAMES = "This map keeps no frames. Build it again with --history (or --record MAP.rrd) to go back in time."
FRAME_HINT = "Counted from 0. Keys [ and ]: one frame back or forward."
STEP_HINT = (
    "How many parts are joined, those that the map joins first. Before them, at the far left, cells come together to "
    "parts: first there are classes only, then Louvain's levels."
)


class BuildPanel(Panel):
    """A slider over the frames of the build, in step with the recorded build."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page, gui = page, page.gui
        self._names = page.simap.frame_names
        last = max(len(self._names) - 1, 0)
        self._note = gui.add_html("")
        slider = gui.add_slider("Frame", 0, max(last, 1), 1, last, disabled=last == 0, hint=FRAME_HINT)
        self._slider = by_person(slider, self._moved)
        self._name = gui.add_html(self._caption(last))
        self._then = gui.add_html("", visible=False)
        played = Played(
            lambda: page.frame, lambda: len(self._names) - 1, page.show_frame, lambda: float(self._rate.value)
        )
        self._player = page.players["frames"] = Player(gui, "Play", played)
        self._rate = gui.add_slider("Rate (per s)", 1, 30, 1, FRAMES_PER_S, hint="How fast Play goes.")
        self._fill = gui.add_checkbox(
            "Map as it was then", page.as_it_was, hint="After the frame that is shown; otherwise the finished map."
        )
        self._fill.on_update(lambda _: self._filled())
        self._history = True
        """Whether the history of the map is at hand, as far as is known."""
        self._show_controls()
        page.submit("history", lambda: self._look_for_history(page.simap))

    def toggle(self) -> None:
        """Play, or stop playing."""
        if len(self._names) > 1:
            self._player.toggle()

    def map_changed(self, simap: SIMap) -> None:
        """Extend the slider to the frames of a map that has grown, and move it to the frame shown."""
        if simap.frame_names == self._names:
            return
        last = max(len(simap.frame_names) - 1, 0)
        self._names = simap.frame_names
        self._slider.max = max(last, 1)
        self._show_controls()
        self.time_changed(self._page.frame, None)
        self._name.content = self._caption(self._page.frame)
        self._page.submit("history", lambda: self._look_for_history(simap))

    def panels_changed(self) -> None:
        """Look for the history again: the frames of the map, and its file, may be there now."""
        self._page.submit("history", lambda: self._look_for_history(self._page.simap))

    def time_changed(self, frame: int, step: int | None) -> None:
        """Move the slider to the frame."""
        if self._slider.value != frame:
            self._slider.value = frame
        self._name.content = self._caption(frame)

    def painted(self, simap: SIMap, snapshot: Snapshot) -> None:
        """Describe the map at an earlier time step; empty for the finished map."""
        if snapshot.words:
            self._note_history(snapshot.words != NO_HISTORY)
        words = "" if snapshot.words == NO_HISTORY else snapshot.words  # which stands above
        content = f'<div role="status" style="{BOX_STYLE}">{escape(words)}</div>' if words else ""
        if self._then.content != content:
            self._then.content, self._then.visible = content, bool(content)

    def state(self) -> bool:
        """Whether earlier frames show the map as it was then."""
        return self._page.as_it_was

    def restore(self, state: bool) -> None:
        """Show the map as it was then, or the finished map, at earlier frames."""
        self._fill.value = self._page.as_it_was = state

    def _look_for_history(self, simap: SIMap) -> None:
        if len(simap.frame_names) > 1:
            self._note_history(self._page.shared.look_back(simap, 0) is not None)

    def _note_history(self, known: bool) -> None:
        """Describe what an earlier frame shows, before anybody goes there."""
        if known != self._history:
            self._history = known
            self._show_controls()

    def _moved(self) -> None:
        self._player.stop()
        self._page.show_frame(int(self._slider.value))

    def _filled(self) -> None:
        self._page.as_it_was = bool(self._fill.value)
        self._page.show_frame(self._page.frame, also_recording=False)

    def _show_controls(self) -> None:
        """Hide the controls that have no effect, and explain why."""
        some = len(self._names) > 1
        self._slider.disabled = self._player.button.disabled = not some
        known = bool(self._names) or self._page.services.building
        for widget in (self._slider, self._name, self._player.button, self._rate, self._fill):
            widget.visible = known
        recorded = self._page.recording.url is not None
        note = (NOTE_RECORDED if recorded else NOTE) if self._history else NO_HISTORY
        self._note.content = note_html(note if known else NO_FRAMES)

    def _caption(self, frame: int) -> str:
        if not self._names:
            return f'<div style="{BOX_STYLE}">No frame is on the map yet.</div>'
        name = escape(self._names[min(frame, len(self._names) - 1)])
        picture = f'<span style="{DIM_STYLE}">is picture {name} of the sequence</span>'
        return f'<div style="{BOX_STYLE}">Frame <b>{frame}</b> {picture}</div>'


class StepsPanel(Panel):
    """A slider over classes, communities and merges; it starts at the finished map."""

    def __init__(self, page: Page) -> None:
        """Fill the open container."""
        self._page, gui = page, page.gui
        self._timeline: Timeline | None = None
        with gui.add_folder("How objects were joined"):
            self._slider = by_person(
                gui.add_slider("Merges done", 0, 1, 1, 1, marks=(), disabled=True, hint=STEP_HINT), self._moved
            )
            self._words = gui.add_html("")
            played = Played(lambda: self._chosen, lambda: self._finished, self.choose, lambda: float(self._rate.value))
            self._player = page.players["steps"] = Player(gui, "Play the steps", played)
            self._player.button.disabled = True
            self._rate = gui.add_slider("Rate (per s)", 1, 60, 1, 12, hint="How fast Play the steps goes.")
            icon = viser.Icon.ARROW_BACK_UP
            self._back = button(gui, "Back to the map", self._go_back, icon=icon, color="gray", visible=False)

    def map_changed(self, simap: SIMap) -> None:
        """Clear the steps of the map before, and queue computing those of this one."""
        self._player.stop()
        self._timeline = None
        self._slider.disabled = self._player.button.disabled = True
        self._back.visible = False
        self._say("Looking for the steps …")
        self._page.submit("steps", lambda: self._find(simap), later=True)

    def choose(self, position: int) -> None:
        """Show a step."""
        timeline = self._timeline
        if timeline is not None:
            position = min(max(position, 0), timeline.last)
            self._page.show_step(position, timeline)
            self._say(timeline.words(position) + self._page.recording.words(position))

    def time_changed(self, frame: int, step: int | None) -> None:
        """Move the slider to the step, or to the finished map."""
        timeline = self._timeline
        if timeline is None:
            return
        position = timeline.finished if step is None else step
        if step is None and self._chosen == position and not self._back.visible:
            return  # as most often, while the frames are scrubbed
        if self._chosen != position:
            self._slider.value = position - timeline.levels
        self._say(timeline.words(position) + ("" if step is None else self._page.recording.words(position)))
        self._back.visible = step is not None

    def _find(self, simap: SIMap) -> None:
        """Set the slider to the steps of a map, unless another map is shown meanwhile."""
        timeline = self._page.shared.timeline(simap)
        if not timeline.last or simap is not self._page.simap:
            return
        self._player.stop()
        self._timeline = timeline
        some = timeline.last > 1
        self._slider.min, self._slider.max = -timeline.levels, max(timeline.last - timeline.levels, 1)
        self._slider.disabled = self._player.button.disabled = not some
        self._slider.value = timeline.finished - timeline.levels
        self._say(timeline.words(timeline.finished) if some else "This map keeps no steps.")
        self.time_changed(self._page.frame, self._page.time.step)

    @property
    def _chosen(self) -> int:
        """The position of the slider, which counts from the first merge, as the words beside it do."""
        return int(self._slider.value) + (0 if self._timeline is None else self._timeline.levels)

    @property
    def _finished(self) -> int:
        return 0 if self._timeline is None else self._timeline.finished

    def _go_back(self) -> None:
        self._player.stop()
        if self._page.time.step is not None:
            self.choose(self._finished)

    def _moved(self) -> None:
        self._player.stop()
        self.choose(self._chosen)

    def _say(self, words: str) -> None:
        self._words.content = f'<div role="status" style="{BOX_STYLE};{DIM_STYLE}">{escape(words)}</div>'
