"""The panel one speaks to the robot through: the command, what became of it, and the ride."""

from collections.abc import Callable
from dataclasses import dataclass
from html import escape

import viser

from simaps_viz.structures import Pose2, SIMap

EXAMPLES = 3


@dataclass(frozen=True)
class CommandActions:
    """Whom the panel tells; none of these may take long."""

    ask: Callable[[str], None]
    pause: Callable[[], None]
    """Pause the ride, or go on."""
    stop: Callable[[], None]
    speed: Callable[[float], None]
    reset: Callable[[], None]
    """Put the robot back where it started."""
    place: Callable[[], None]
    """The next two clicks on the map say where the robot stands and where it looks."""


class CommandPanel:
    """The widgets; the ``show`` methods fill them."""

    def __init__(self, gui: viser.GuiApi, simap: SIMap, actions: CommandActions, *, enabled: bool) -> None:
        """Fill the current container."""
        self._actions = actions
        self._form = gui.add_form(None)
        with self._form:
            self._text = gui.add_text("Command", "", hint="In plain English; Enter sends it.", disabled=not enabled)
            go = gui.add_button("Go", icon=viser.Icon.PLAYER_PLAY, disabled=not enabled)
        go.on_click(lambda _: self._form.submit())
        self._form.on_submit(lambda _: self._send())
        self._result = gui.add_html(message_html("", "Try one of these, or type your own.", "plain"))
        self._program = gui.add_html("", visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._ride = gui.add_button_group("Ride", ("Pause", "Stop"), visible=False)
        self._ride.on_click(lambda event: actions.pause() if event.target.value == "Pause" else actions.stop())
        self._speed = gui.add_slider("Speed (×)", 0.25, 8.0, 0.25, 1.0, visible=False)
        self._speed.on_update(lambda _: actions.speed(float(self._speed.value)))
        with gui.add_folder("Examples"):
            buttons = [gui.add_button(text, color="gray", disabled=not enabled) for text in examples(simap)]
        for button in buttons:
            button.on_click(lambda event: self._try(str(event.target.label)))
        self._pose = gui.add_html("")
        place = gui.add_button_group("Start pose", ("Set on map", "Reset"))
        place.on_click(lambda event: actions.place() if event.target.value == "Set on map" else actions.reset())

    def show_thinking(self, command: str) -> None:
        """Say that a command is being worked on."""
        self._result.content = message_html("Working on it …", command, "plain")

    def show_result(self, title: str, text: str, tone: str) -> None:
        """Say what became of a command; tone is one of plain, good, bad."""
        self._result.content = message_html(title, text, tone)

    def show_program(self, program: str, line: int | None = None) -> None:
        """Show the program, the given line (from 1) marked."""
        self._program.content = program_html(program, line)
        self._program.visible = bool(program)

    def show_progress(self, share: float | None) -> None:
        """Show how much of the ride is over, 0 to 1, and what steers it; None hides both."""
        for widget in (self._progress, self._ride, self._speed):
            if widget.visible != (share is not None):
                widget.visible = share is not None
        if share is not None:
            self._progress.value = round(100.0 * share, 1)

    def show_pose(self, pose: Pose2) -> None:
        """Say where the robot stands."""
        self._pose.content = (
            '<div style="padding:.2em .8em;font-size:.82em">Robot at '
            f"<b>x {pose.x_m:.2f} m, y {pose.y_m:.2f} m</b>, heading <b>{pose.heading_deg % 360:.0f}°</b></div>"
        )

    def _try(self, command: str) -> None:
        self._text.value = command
        self._actions.ask(command)

    def _send(self) -> None:
        command = str(self._text.value).strip()
        if command:
            self._actions.ask(command)


def examples(simap: SIMap, most: int = EXAMPLES) -> list[str]:
    """Make commands that this map can answer, from the classes on it."""
    counts = simap.counts()
    names = list(counts)
    if not names:
        return ["move forward 1 meter"]
    several = next((name for name in names if counts[name] >= 3), None)
    texts = [f"go to the third {several} from here"] if several else []
    texts.append(f"go to the {names[0]}")
    if len(names) > 1:
        texts.append(f"go to the {names[0]} nearest the {names[1]}")
        texts.append(f"move in between the {names[0]} and the {names[1]}")
    texts.append(f"face the {names[-1]}")
    return list(dict.fromkeys(texts))[:most]


def message_html(title: str, text: str, tone: str) -> str:
    """Say something: a bold title and a text, tinted by tone (plain, good, bad)."""
    ink, paper = {"good": ("#0b5d2a", "#e7f6ec"), "bad": ("#8a1c1c", "#fdecec")}.get(tone, ("#444", "#f3f4f6"))
    head = f'<div style="font-weight:600">{escape(title)}</div>' if title else ""
    return (
        f'<div style="margin:.2em .8em;padding:.5em .7em;border-radius:4px;font-size:.85em;line-height:1.4;'
        f'color:{ink};background:{paper}">{head}<div>{escape(text)}</div></div>'
    )


def program_html(program: str, line: int | None = None) -> str:
    """Show a program as code, with line numbers; the given line (from 1) is marked."""
    rows = []
    for number, text in enumerate(program.rstrip("\n").splitlines(), start=1):
        mark = "background:#fff1b8;" if number == line else ""
        rows.append(
            f'<div style="{mark}white-space:pre-wrap;padding:0 .5em"><span style="opacity:.4;user-select:none">'
            f"{number:>2} </span>{escape(text)}</div>"
        )
    return (
        '<div style="margin:.3em .8em;padding:.4em 0;border-radius:4px;background:#f3f4f6;color:#222;'
        f'font:12px/1.5 ui-monospace,monospace">{"".join(rows)}</div>'
    )
