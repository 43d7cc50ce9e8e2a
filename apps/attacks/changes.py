"""Forged changes: everything a page can destroy, asked for by who may not, or without the server's question."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

from attacks.messages import widgets
from attacks.target import Target, Tries, page, say, wait
from websockets.sync.connection import Connection

from simaps_viz.viewer.page import panel
from simaps_viz.viewer.page.panel import PanelSpec
from simaps_viz.viewer.panels.live import LiveState, live_panel
from simaps_viz.viewer.session import Session

OWN = "own"
"""The recording of the library that an attack may delete."""
CHANGES = (
    "Change", "Divide, remove", "Last edit", "Rename …", "Delete …", "Restore …", "Stop …", "Resume",
    "Drive the real robot", "Rehearse and drive", "Stop the robot",
)  # fmt: skip
"""Labels of all widgets of a page with which something that is kept can be changed, or a robot moved."""
ANSWERS = {"Rename …": "Save the name", "Delete …": "Move to the trash", "Stop …": "Stop now"}
"""{button that asks: the button of its question that does it}."""


def build_to_stop(folder: Path) -> PanelSpec:
    """Return the panel of a build that is always running, on a robot; stopped, it leaves a file in the folder."""
    running, robot = LiveState("building", 1, 9), mock.Mock(allowed=True, switched=False)
    return live_panel(lambda: running, (folder / "stopped").touch, lambda: None, robot)


def named(session: Session, label: str) -> dict[str, Any]:
    """Return a page's widgets of a label, by their ids."""
    return {uuid: one for uuid, one in widgets(session).items() if getattr(one._impl.props, "label", None) == label}


def press(connection: Connection, session: Session, label: str, value: Any = True) -> bool:
    """Send what a page sends when its newest widget of a label is used; False when it has none."""
    for uuid in reversed(named(session, label)):
        say(connection, type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
        return True
    return False


def choose_own(connection: Connection, session: Session) -> None:
    """Choose the recording that may be deleted in the list of a page."""
    for handle in named(session, "Recording").values():
        option = next((one for one in handle._impl.props.options if one.startswith(f"{OWN} ")), None)
        if option is not None:
            press(connection, session, "Recording", option)


def settle(connection: Connection, session: Session) -> None:
    """Wait until a page has read what it was sent, the last of it a word of its own, and done what that asked for."""
    find, word = next(reversed(named(session, "Find").values())), f"settled {time.monotonic()}"
    press(connection, session, "Find", word)
    wait(lambda: find.value == word, 60.0)
    wait(lambda: False, 0.2)  # threads have taken up the rest by then
    session.wait_idle()


def changes_by_visitors(target: Target) -> Tries:
    """A visitor sends all that an owner's page sends to mend, rename, delete, restore, stop, drive, to both pages."""
    bench = target.closed
    with page(bench, owner=True) as (_, owner), page(bench) as (mine, visitor):
        for session in (owner, visitor):
            session.wait_idle()
            session.select(session.simap.instances[0].id)
            session.wait_idle()
        shown = bench.simap
        yield None if owner.may("edit") and not visitor.may("edit") else "the two have one role"
        for label in CHANGES:
            yield f"a visitor's page has {label!r}" if named(visitor, label) else None
            yield None if named(owner, label) else f"an owner's page lacks {label!r}: nothing was tried"
        for session in (visitor, owner):
            for uuid, handle in widgets(session).items():
                for value in getattr(handle._impl.props, "options", (True, "forged")):
                    say(mine, type="GuiUpdateMessage", uuid=uuid, updates={"value": value})
            for uuid in session.gui._command_handle_from_uuid:
                say(mine, type="CommandTriggerMessage", uuid=uuid)
            settle(mine, visitor)
            yield None if bench.simap is shown and owner.simap is shown else "the map was mended"


@contextlib.contextmanager
def _asked(connection: Connection, session: Session, label: str) -> Iterator[str | None]:
    """Have a page ask one of its questions; yields the id of the button that would do it, None where it asks none."""
    choose_own(connection, session)
    settle(connection, session)
    press(connection, session, label)
    wait(lambda: named(session, ANSWERS[label]), 5.0)
    yield next(reversed(named(session, ANSWERS[label])), None)
    if named(session, "Cancel"):
        press(connection, session, "Cancel")
        settle(connection, session)


def answers_to_no_question(target: Target) -> Tries:
    """An owner's page presses what asks and stops there; answers of other pages, cancelled and late ones are sent."""
    with page(target.bench) as (mine, session), page(target.bench) as (other, third):
        session.wait_idle()
        for label, done_by in ANSWERS.items():
            yield f"{label!r} is done without a question" if named(session, done_by) else None
            with _asked(mine, session, label) as answer:
                yield None if answer else f"{label!r} asked nothing"
                say(other, type="GuiUpdateMessage", uuid=answer or "", updates={"value": True})
                settle(other, third)
                yield None if answer in widgets(session) else "another page's answer counted"
            say(mine, type="GuiUpdateMessage", uuid=answer or "", updates={"value": True})  # it was cancelled
            settle(mine, session)
            yield f"{label!r} is done though it was cancelled" if named(session, done_by) else None
            with mock.patch.object(panel, "ANSWER_S", 0.0), _asked(mine, session, label) as answer:
                say(mine, type="GuiUpdateMessage", uuid=answer or "", updates={"value": True})
                settle(mine, session)
                yield "a late answer left its question open" if answer in widgets(session) else None
