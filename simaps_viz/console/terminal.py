"""Output of a command: messages for people on stderr, answers on stdout.

A message that cannot be written (a full disk, a closed window) never ends the work that it reports. An answer that
cannot be written is an error, as it is all that was asked for.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from json import dumps
from typing import IO, Any

from rich.console import Console, RenderableType

from simaps_viz.errors import InputError


class _Messages(Console):
    """A console on stderr that ignores messages it cannot write."""

    @property
    def file(self) -> IO[str]:
        """The current stderr, with write errors ignored; not the proxy that rich puts there while bars are shown."""
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
    """A console on stdout; rich itself would exit with status 1 on a broken pipe, which means that the answer is no."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


console = _Messages(stderr=True, highlight=False, emoji=False)
"""For messages to people."""


def note(*lines: str) -> None:
    """Write messages for people on stderr, unchanged, a line each."""
    for line in lines:
        console.print(line, markup=False, soft_wrap=True)


def report(record: dict[str, Any], *lines: str, json: bool) -> None:
    """Report what was done: as `emit` does, or in lines for people, as `note` does."""
    if json:
        emit(record)
    else:
        note(*lines)


def say(text: str) -> None:
    """Write an answer on stdout, unchanged; raises as `emit` does."""
    with answering():
        sys.stdout.write(text)
        sys.stdout.flush()


def emit(record: dict[str, Any]) -> None:
    """Write an answer on stdout as one line of JSON.

    Raises:
        InputError: stdout cannot be written, e.g. its disk is full.
        BrokenPipeError: the reader of the pipe has gone.
    """
    say(dumps(record) + "\n")


def show(*tables: RenderableType, width: int | None = None) -> None:
    """Print tables on stdout, ``width`` characters wide or as wide as the terminal; raises as `emit` does."""
    with answering():
        for table in tables:
            _Answers(highlight=False, markup=False, emoji=False, width=width).print(table)
        sys.stdout.flush()


def drop_answers() -> None:
    """Discard what is still to be written on stdout, as Python would try to write it again when it exits."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def answering() -> Iterator[None]:
    """Turn errors of writing on stdout inside the block into those of `emit`."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        drop_answers()
        raise InputError(f"stdout: could not write the answer: {error.strerror or error}") from error
