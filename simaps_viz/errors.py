"""The errors a user can meet; every message names the file or value, what was expected, and what was found."""

from collections.abc import Iterator
from contextlib import contextmanager

MAX_MESSAGE = 1000
"""Characters of a message; names and values found in files can be of any length."""


class SIMapsError(Exception):
    """Base of all errors this package raises on purpose; the command line prints it as one line.

    Messages show what was found in files, so whatever could not be printed, or would end the line, is written as its
    escape, and what is too long is cut in the middle.
    """

    def __init__(self, message: object = "", *more: object) -> None:
        super().__init__(_printable(str(message)), *more)


class InputError(SIMapsError):
    """A file, folder, option or argument is not as expected."""


class CommandError(SIMapsError):
    """A spoken command or a program cannot be carried out on this map: a refusal, in words.

    Args:
        message: why not.
        suggestions: commands that can be read instead, the likeliest first.
    """

    def __init__(self, message: object = "", *more: object, suggestions: tuple[str, ...] = ()) -> None:
        super().__init__(message, *more)
        self.suggestions = suggestions


class PlanningError(SIMapsError):
    """There is no free path from the robot to its goal."""


def one_line(error: BaseException) -> str:
    """Return what a library's error says on one line, at most 200 characters; its kind where it says nothing."""
    return " ".join(str(error).split())[:200] or type(error).__name__


def _printable(text: str) -> str:
    if not text.isprintable():
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    half = MAX_MESSAGE // 2
    return text if len(text) <= MAX_MESSAGE else f"{text[:half]} ... {text[-half:]}"


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Import a library of an extra inside this block.

    Args:
        extra: its name in pyproject.toml.
        what: the feature that needs it, as users call it.

    Raises:
        InputError: the library is not installed, or cannot be loaded.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"{what}: expected the package {error.name}, found it not installed; pip install 'simaps-viz[{extra}]'"
        ) from None
    except ImportError as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{what}: expected the packages of the extra [{extra}], found {reason}") from error
