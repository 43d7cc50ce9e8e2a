"""What people and programs read of a command: messages on stderr, answers on stdout.

A message that cannot be written (a full disk, a closed window) never ends the work that it tells of. An answer that
cannot be written is an error, as it is all that was asked for.
"""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO, Any

from rich.console import Console, RenderableType

from simaps_viz.errors import InputError


class _Messages(Console):
    """A console on stderr that goes on where nothing can be written."""

    @property
    def file(self) -> IO[str]:
        """Stderr as it is now, forgiving; behind rich's own stand-in for it, which comes while bars are shown."""
        return _Forgiving(getattr(sys.stderr, "rich_proxied_file", sys.stderr))  # pyright: ignore[reportReturnType] - as much of a file as rich uses


class _Forgiving:
    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        with suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            self._stream.flush()


class _Answers(Console):
    """A console on stdout; rich would end the program with status 1, which says that the answer is no."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


console = _Messages(stderr=True, highlight=False, emoji=False)
"""For messages to people."""


def say(text: str) -> None:
    """Write an answer on stdout, as it is; errors as `emit`."""
    with answering():
        sys.stdout.write(text)
        sys.stdout.flush()


def emit(record: dict[str, Any]) -> None:
    """Write an answer on stdout as one line of JSON.

    Raises:
        InputError: stdout cannot be written, e.g. its disk is full.
        BrokenPipeError: nobody reads it any more.
    """
    say(json.dumps(record) + "\n")


def show(*tables: RenderableType, width: int | None = None) -> None:
    """Print tables on stdout, as wide as the terminal or as told, characters; errors as `emit`."""
    with answering():
        for table in tables:
            _Answers(highlight=False, markup=False, emoji=False, width=width).print(table)
        sys.stdout.flush()


def drop_answers() -> None:
    """Let what is still to be written on stdout go nowhere: Python writes it once more when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def answering() -> Iterator[None]:
    """Have a block write on stdout; errors as `emit`."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        drop_answers()
        raise InputError(f"stdout: could not write the answer: {error.strerror or error}") from error
