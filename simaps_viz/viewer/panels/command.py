"""The panel one speaks to the robot through: the command, what became of it, and the ride."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import viser

from simaps_viz.navigation.agent import is_program
from simaps_viz.structures import Pose2, SIMap
from simaps_viz.viewer.drawing.theme import LONGEST_NAME
from simaps_viz.viewer.driving.drive import SPEED_HINT
from simaps_viz.viewer.panels.command_words import exchanges_html, message_html, program_html
from simaps_viz.viewer.services import ExchangeLike

__all__ = ["CommandActions", "CommandPanel", "Past", "examples", "message_html", "program_html"]

PLACE_HINT = "Say by two clicks on the map where the robot stands and looks; or put it back where it started."
EXAMPLES = 3
FEW = 2
"""Members of a class that need not be told apart by more than its name."""
MOST_PAST = 8
"""Commands that the history shows."""
_LONGEST = 34
"""Characters of a command on a button."""
Phase = Literal["idle", "asking", "driving", "held"]
_BUTTONS: dict[Phase, tuple[str, str, str]] = {
    "idle": ("Go", "Step", "Stop"),
    "asking": ("Go", "Step", "Stop"),
    "driving": ("Pause", "Step", "Stop"),
    "held": ("Play", "Step", "Stop"),
}
_ICONS = {"ok": viser.Icon.CHECK, "refused": viser.Icon.X, "failed": viser.Icon.ALERT_TRIANGLE}


@dataclass(frozen=True)
class CommandActions:
    """Whom the panel tells; none of these may take long."""

    ask: Callable[[str, bool], None]
    """A command was given; True: hold before the first line of its program."""
    pause: Callable[[], None]
    """Pause the ride, or go on."""
    step: Callable[[], None]
    """Run one statement and hold."""
    stop: Callable[[], None]
    """End the ride, or the wait for an answer."""
    speed: Callable[[float], None]
    follow: Callable[[bool], None]
    other_reading: Callable[[], None]
    reset: Callable[[], None]
    """Put the robot back where it started."""
    place: Callable[[], None]
    """The next two clicks on the map say where the robot stands and where it looks."""


@dataclass(frozen=True)
class Past:
    """A command that was given before."""

    command: str
    status: str
    """Either ok, refused or failed; empty while that is not known."""


class CommandPanel:
    """The widgets; the ``show`` methods fill them."""

    def __init__(
        self, gui: viser.GuiApi, simap: SIMap, actions: CommandActions, *, enabled: bool, model: str | None = None
    ) -> None:
        """Fill the current container."""
        self._actions = actions
        self._phase: Phase = "idle"
        self._past: list[Past] = []
        self._add_input(gui, enabled, model)
        self._add_outcome(gui)
        self._add_ride(gui)
        with gui.add_folder("Examples"):
            for text in examples(simap, EXAMPLES + 1):
                button = gui.add_button(text, color="gray", disabled=not enabled)
                button.on_click(lambda event: self._try(str(event.target.label)))
        self._add_history(gui)
        with gui.add_folder("Start pose"):
            self._pose = gui.add_html("")
            place = gui.add_button_group("Robot", ("Set on map", "Reset"), hint=PLACE_HINT)
            place.on_click(lambda event: actions.place() if event.target.value == "Set on map" else actions.reset())

    @property
    def uses_model(self) -> bool:
        """Whether the language model shall read commands."""
        return bool(self._model.visible and self._model.value)

    @property
    def said(self) -> tuple[str, str, str]:
        """What is typed, what became of the last command, and its program, the latter two as HTML."""
        return str(self._text.value), str(self._result.content), str(self._program.content)

    @property
    def speed(self) -> float:
        """Factor on the robot's normal speed."""
        return float(self._speed.value)

    def say_again(self, said: tuple[str, str, str], speed: float) -> None:
        """Show again what ``said`` gave."""
        self._text.value, self._result.content, self._program.content = said
        self._program.visible = bool(said[2])
        self._speed.value = speed

    def show_phase(self, phase: Phase) -> None:
        """Offer the buttons that fit what the robot is doing."""
        self._phase = phase
        if tuple(self._run.options) != _BUTTONS[phase]:
            self._run.options = _BUTTONS[phase]

    def show_thinking(self, command: str, reader: str = "") -> None:
        """Say that a command is being worked on, and who reads it."""
        more = (f"Asking {reader}. Stop ends the wait.",) if reader else ()
        self._result.content = message_html("Working on it …", command, "plain", more)

    def show_result(self, title: str, text: str, tone: str, more: Sequence[str] = ()) -> None:
        """Say what became of a command, with further lines; tone is one of plain, good, bad."""
        self._result.content = message_html(title, text, tone, more)

    def show_program(self, program: str, line: int | None = None, *, stuck: bool = False) -> None:
        """Show the program, the given line (from 1) marked as the one that runs, or where it got stuck."""
        self._program.content = program_html(program, line, stuck=stuck)
        self._program.visible = bool(program)

    def show_other_reading(self, program: str | None) -> None:
        """Offer to run what else the command could mean."""
        self._other_program.content = "" if program is None else program_html(program)
        self._other.visible = program is not None

    def show_progress(self, share: float | None) -> None:
        """Show how much of the ride is over, 0 to 1; None hides it."""
        if self._progress.visible != (share is not None):
            self._progress.visible = share is not None
        if share is not None:
            self._progress.value = round(100.0 * share, 1)

    def show_exchanges(self, exchanges: Sequence[ExchangeLike]) -> None:
        """Show what a language model was sent and answered; none hides it."""
        self._exchanges.content = exchanges_html(exchanges)
        self._conversation.visible = bool(exchanges)

    def show_past(self, past: Sequence[Past]) -> None:
        """Show the history, the newest first."""
        self._past = list(past[:MOST_PAST])
        self._history.visible = bool(past)
        for i, button in enumerate(self._buttons):
            one = self._past[i] if i < len(self._past) else None
            if one is not None:
                text = one.command if len(one.command) <= _LONGEST else f"{one.command[: _LONGEST - 1]}…"
                button.label, button.icon = text, _ICONS.get(one.status, viser.Icon.CLOCK)
            button.visible = one is not None

    def show_pose(self, pose: Pose2) -> None:
        """Say where the robot stands."""
        self._pose.content = (
            '<div style="padding:.2em .8em;font-size:.82em">Robot at '
            f"<b>x {pose.x_m:.2f} m, y {pose.y_m:.2f} m</b>, heading <b>{pose.heading_deg % 360:.0f}°</b></div>"
        )

    def _add_input(self, gui: viser.GuiApi, enabled: bool, model: str | None) -> None:
        # Of several lines, and Enter is seen in the text: the page sends only the last change of any 50 ms, so that a
        # form's own message about Enter would take the place of the last letters.
        self._text = gui.add_text(
            "Command", "", multiline=True, hint="In plain English, or a program; Enter sends it.", disabled=not enabled
        )
        self._text.on_update(self._typed)
        self._run = gui.add_button_group(
            "Run",
            _BUTTONS["idle"],
            disabled=not enabled,
            hint="Go, pause or play on; run one line of the program; stop, also the wait for an answer.",
        )
        self._run.on_click(lambda event: self._pressed(str(event.target.value)))
        self._model = gui.add_checkbox(
            "Language model", True, visible=model is not None, hint=f"Commands are read by {model}; off: by grammar."
        )

    def _add_outcome(self, gui: viser.GuiApi) -> None:
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._result = gui.add_html(message_html("", "Try an example, or type what the robot shall do.", "plain"))
        self._program = gui.add_html("", visible=False)
        self._other = gui.add_folder("The command could also mean", visible=False)
        with self._other:
            button = gui.add_button("Run the other reading", icon=viser.Icon.ARROWS_EXCHANGE, color="gray")
            self._other_program = gui.add_html("")
        button.on_click(lambda _: self._actions.other_reading())
        self._conversation = gui.add_folder("Sent to the language model", expand_by_default=False, visible=False)
        with self._conversation:
            self._exchanges = gui.add_html("")

    def _add_ride(self, gui: viser.GuiApi) -> None:
        self._speed = gui.add_slider("Speed (×)", 0.25, 8.0, 0.25, 1.0, hint=SPEED_HINT)
        self._speed.on_update(lambda _: self._actions.speed(float(self._speed.value)))
        self._follow = gui.add_checkbox(
            "Follow robot", False, hint="The camera goes along: from above in the top view, behind it in the 3-D view."
        )
        self._follow.on_update(lambda _: self._actions.follow(bool(self._follow.value)))

    def _add_history(self, gui: viser.GuiApi) -> None:
        self._history = gui.add_folder("History", visible=False)
        with self._history:
            self._buttons = [gui.add_button("", color="gray", visible=False) for _ in range(MOST_PAST)]
        for i, button in enumerate(self._buttons):
            button.on_click(lambda _, i=i: self._try(self._past[i].command) if i < len(self._past) else None)

    def _try(self, command: str) -> None:
        self._text.value = command
        self._actions.ask(command, False)

    def _typed(self, event: viser.GuiEvent) -> None:
        if event.client_id is None:
            return
        command = entered(str(self._text.value))
        if command is not None:
            self._text.value = command
            self._send(held=False)

    def _pressed(self, name: str) -> None:
        if name == "Stop":
            self._actions.stop()
        elif name == "Step" and self._phase in ("driving", "held"):
            self._actions.step()
        elif self._phase in ("driving", "held"):
            self._actions.pause()
        else:
            self._send(held=name == "Step")

    def _send(self, *, held: bool) -> None:
        command = str(self._text.value).strip()
        if command:
            self._actions.ask(command, held)
        else:
            self.show_result("", "Type first what the robot shall do, or try an example.", "plain")


def entered(text: str) -> str | None:
    """Give the command that Enter ended; None while it is still being written.

    A program has lines, so that only a last empty line ends it; any other command is one line.
    """
    if "\n" not in text or (is_program(text) and not text.endswith("\n")):
        return None
    return text.strip() if is_program(text) else " ".join(text.split())


def examples(simap: SIMap, most: int = EXAMPLES) -> list[str]:
    """Make commands that this map can answer, from the classes on it."""
    counts = {name: count for name, count in simap.counts().items() if len(name) <= LONGEST_NAME}
    names = list(counts)
    if not names:
        return ["move forward 1 meter"]
    few = [name for name in names if counts[name] <= FEW] or names  # "the chair" says little where there are 31
    several = next((name for name in names if counts[name] >= 3), None)
    texts = [f"go to the third {several} from here"] if several else []
    texts.append(f"go to the {few[0]}")
    others = [name for name in names if name != few[0]]
    if others:
        texts.append(f"go to the {others[0]} nearest the {few[0]}")
        texts.append(f"move in between the {few[0]} and the {(few[1:] or others)[0]}")
    texts.append(f"face the {few[-1]}")
    return list(dict.fromkeys(texts))[:most]
