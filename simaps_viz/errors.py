"""The errors a person can meet; every message names the culprit and what was expected."""

from collections.abc import Iterator
from contextlib import contextmanager

LONGEST_MESSAGE = 1000
"""Characters of a message; names and values found in files can be of any length."""


class SIMapsError(Exception):
    """Base of all errors this package raises on purpose; the command line prints it as one line.

    Messages show what was found in files, so whatever could not be printed, or would end the line, is written as its
    escape, and what is too long is cut in the middle.
    """

    def __init__(self, message: object = "", *more: object) -> None:
        super().__init__(_printable(str(message)), *more)


class InputError(SIMapsError):
    """A file, folder, option or argument is not what it has to be."""


class CommandError(SIMapsError):
    """A spoken command or a program cannot be carried out on this map: a refusal, in words."""


class PlanningError(SIMapsError):
    """There is no free path from where the robot stands to where it should go."""


def _printable(text: str) -> str:
    if not text.isprintable():
        text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    half = LONGEST_MESSAGE // 2
    return text if len(text) <= LONGEST_MESSAGE else f"{text[:half]} ... {text[-half:]}"


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Import a library of an extra inside this block.

    Args:
        extra: its name in pyproject.toml.
        what: what needs it, as the user knows it.

    Raises:
        InputError: the library is not there, or cannot be loaded.
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
