"""A question before what destroys or overwrites; its buttons are the confirmation, made by the server for one page."""

import functools
import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import viser

from simaps_viz.drawing.theme import BOX_STYLE
from simaps_viz.errors import InputError
from simaps_viz.viewer.page.panel import button

if TYPE_CHECKING:
    from simaps_viz.viewer.page.page import Page

ANSWER_S = 60.0
"""How long a question may be answered."""


class Question:
    """A dialog with a button for each answer, on one page.

    The buttons exist, and have ids, only once the question is asked, so that a message that was made up in advance
    presses none of them. One of them counts, once, within `ANSWER_S`, and as long as the file that the question is
    about is as it was.
    """

    def __init__(
        self,
        page: "Page",
        title: str,
        html: str,
        answers: Mapping[str, Callable[[], None]],
        *,
        file: Path | None = None,
        name: str | None = None,
    ) -> None:
        """Ask; the job of the answer that is chosen is then queued on the page's panels' thread.

        Args:
            page: whose person is asked.
            title: of the dialog.
            html: what will happen.
            answers: {label of a button: its job}.
            file: what the question is about, if that is a file.
            name: text to edit in the dialog, which `name` then returns.

        Raises:
            InputError: the person at the page may not edit.
        """
        if not page.may("edit"):
            raise InputError("expected the owner's page, found a visitor's, where nothing can be changed")
        self._page, self._file, self._seen = page, file, _mark(file)
        self._asked, self._lock, self._over = time.monotonic(), threading.Lock(), False
        gui = page.gui
        self._modal = gui.add_modal(title)
        with self._modal:
            gui.add_html(f'<div style="{BOX_STYLE};overflow-wrap:anywhere">{html}</div>')
            self._name: viser.GuiInputHandle[str] | None = None if name is None else gui.add_text("New name", name)
            for label, job in answers.items():
                button(gui, label, functools.partial(self._answer, job))
            button(gui, "Cancel", self.cancel, color="gray")

    @property
    def name(self) -> str:
        """The text of the dialog, without blanks around it."""
        return "" if self._name is None else self._name.value.strip()

    def cancel(self) -> None:
        """Close the dialog; nothing is done."""
        self._end()

    def _end(self) -> bool:
        """Close the dialog; False when that was done already."""
        with self._lock:
            over, self._over = self._over, True
        if not over:
            self._modal.close()
        return not over

    def _answer(self, job: Callable[[], None]) -> None:
        in_time = time.monotonic() - self._asked < ANSWER_S
        if self._end():
            self._page.submit(f"answer {id(self)}", functools.partial(self._do, job, in_time))

    def _do(self, job: Callable[[], None], in_time: bool) -> None:
        if not in_time:
            raise InputError(f"expected an answer within {ANSWER_S:g} s, found a later one; nothing was done")
        if _mark(self._file) != self._seen:
            raise InputError(f"{self._file}: expected the file as it was when you were asked, found it changed")
        job()


def _mark(file: Path | None) -> tuple[int, int, int] | None:
    """Return what tells a file from another one under its name; None where there is none."""
    try:
        status = None if file is None else os.stat(file, follow_symlinks=False)
    except OSError:
        return None
    return None if status is None else (status.st_ino, status.st_size, status.st_mtime_ns)
