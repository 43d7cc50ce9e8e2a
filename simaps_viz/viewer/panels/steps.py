"""The second timeline of a map: how its objects came about, from classes over communities to the last merge."""

from collections.abc import Callable
from html import escape

import viser

from simaps_viz.drawing.theme import BOX_STYLE, DIM_STYLE
from simaps_viz.mapping.timeline import Timeline
from simaps_viz.viewer.page.player import Played, Player

HINT = "0 = classes; then the levels of Louvain; then one step for each merge, those that the map takes first."


class StepsPanel:
    """A slider over the steps; it rests at the finished map until somebody moves it."""

    def __init__(
        self,
        gui: viser.GuiApi,
        on_step: Callable[[int, bool], None],
        more_words: Callable[[int], str] = lambda step: "",
    ) -> None:
        """Fill the open container.

        Args:
            gui: where.
            on_step: gets the step to show, and whether this page chose it.
            more_words: what else to say of a step.
        """
        self._on_step, self._more_words = on_step, more_words
        self._timeline: Timeline | None = None
        self._step: int | None = None
        with gui.add_folder("How objects were joined"):
            self._slider = gui.add_slider("Position", 0, 1, 1, 1, disabled=True, hint=HINT)
            self._slider.on_update(self._moved)
            self._words = gui.add_html("")
            played = Played(
                lambda: int(self._slider.value), lambda: self._finished, self.choose, lambda: float(self._rate.value)
            )
            self._player = Player(gui, "Play the steps", played)
            self._player.button.disabled = True
            self._rate = gui.add_slider("Pace (per s)", 1, 60, 1, 12, hint="Positions a second, while it plays.")
            self._back = gui.add_button("Back to the map", icon=viser.Icon.ARROW_BACK_UP, color="gray", visible=False)
            self._back.on_click(lambda _: self.rest())

    @property
    def step(self) -> int | None:
        """The step shown; None = the finished map."""
        return self._step

    def offer(self, timeline: Timeline) -> None:
        """Another map is shown: these are its steps; the slider rests at the finished map again."""
        self._player.stop()
        self._timeline, self._step = timeline, None
        some = timeline.last > 1
        self._slider.max = max(timeline.last, 1)
        self._slider.value = timeline.finished
        self._slider.disabled = self._player.button.disabled = not some
        self._say(timeline.words(timeline.finished) if some else "This map keeps no steps.")
        self._back.visible = False

    def withdraw(self) -> None:
        """Another map is shown: its steps are being looked for."""
        self._player.stop()
        self._timeline, self._step = None, None
        self._slider.disabled = self._player.button.disabled = True
        self._back.visible = False
        self._say("Looking for the steps …")

    def choose(self, step: int, *, chosen_here: bool = True) -> None:
        """Show a step."""
        timeline = self._timeline
        if timeline is None:
            return
        step = min(max(step, 0), timeline.last)
        self._step = None if step == timeline.finished else step
        if self._slider.value != step:
            self._slider.value = step
        self._say(timeline.words(step) + self._more_words(step))
        self._back.visible = self._step is not None
        self._on_step(step, chosen_here)

    def rest(self) -> None:
        """Show the finished map."""
        self._player.stop()
        if self._timeline is not None and self._step is not None:
            self.choose(self._timeline.finished)

    def forget(self) -> None:
        """Another timeline is used: go back to the finished map without a word to anyone."""
        self._player.stop()
        if self._timeline is not None and self._step is not None:
            self._step = None
            self._slider.value = self._timeline.finished
            self._say(self._timeline.words(self._timeline.finished))
            self._back.visible = False

    def stop(self) -> None:
        """Stop playing."""
        self._player.stop()

    @property
    def _finished(self) -> int:
        return 0 if self._timeline is None else self._timeline.finished

    def _moved(self, event: viser.GuiEvent) -> None:
        if event.client_id is not None:
            self._player.stop()
            self.choose(int(self._slider.value))

    def _say(self, words: str) -> None:
        self._words.content = f'<div role="status" style="{BOX_STYLE};{DIM_STYLE}">{escape(words)}</div>'
