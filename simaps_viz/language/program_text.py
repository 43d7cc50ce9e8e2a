"""What the text of a program may hold, before anything parses it, and the errors that name its lines."""

import re
import unicodedata
from typing import Final

from simaps_viz.errors import CommandError, PlanningError

MAX_SOURCE: Final = 10_000
"""Characters of a program."""
MAX_DEPTH: Final = 24
"""Levels of the syntax tree."""

# Python ends a line at these and at nothing else; str.splitlines knows more, but check_text refuses those
_NEWLINE = re.compile(r"\r\n|\r|\n")
_UNSEEN = {"Cc": "a control character", "Cf": "a formatting character", "Cs": "half a character"}
_SEPARATORS = {"Zl": "a line separator", "Zp": "a paragraph separator"}


def located(line: int, primitive: str | None, message: str) -> str:
    """Give "line 2: move_to: …"."""
    return f"line {line}: {primitive}: {message}" if primitive else f"line {line}: {message}"


class ProgramError(CommandError):
    """A program cannot be carried out; knows the line and, if there is one, the primitive."""

    def __init__(self, line: int, primitive: str | None, message: str) -> None:
        super().__init__(located(line, primitive, message))
        self.line, self.primitive, self.message = line, primitive, message


class ProgramStuckError(PlanningError):
    """The robot cannot get where a line of a program sends it."""

    def __init__(self, line: int, primitive: str | None, message: str) -> None:
        super().__init__(located(line, primitive, message))
        self.line, self.primitive, self.message = line, primitive, message


def lines_of(text: str) -> list[str]:
    """Give the lines of a program as Python counts them."""
    return _NEWLINE.split(text)


def check_text(text: str) -> None:
    """Refuse a text that is too long, or that reads otherwise than it looks.

    Control characters, marks that turn the direction of writing, invisible characters and lone surrogates are refused
    wherever they stand, in strings and comments too.

    Raises:
        CommandError: naming the line.
    """
    if len(text) > MAX_SOURCE:
        raise CommandError(f"program: expected at most {MAX_SOURCE} characters, found {len(text)}")
    for number, line in enumerate(lines_of(text), start=1):
        if line.isprintable():
            continue
        for character in line:
            kind = (_UNSEEN | _SEPARATORS).get(unicodedata.category(character))
            if kind and character != "\t":
                code = f"U+{ord(character):04X}"
                raise ProgramError(number, None, f"{kind} that cannot be seen ({code}) is not allowed in a program")


def too_deep(line: int) -> ProgramError:
    """Give the error for a program nested too deeply."""
    return ProgramError(line, None, f"too deeply nested; at most {MAX_DEPTH} levels are allowed")


def longest_line(text: str) -> int:
    """Give the number of the longest line: where nesting that stopped the parser itself is most likely found."""
    lengths = [len(line) for line in lines_of(text)]
    return lengths.index(max(lengths)) + 1


class Spelling:
    """Tells whether a name stands in the text letter by letter: Python folds a wide "ｒobot" into "robot"."""

    def __init__(self, text: str) -> None:
        self._lines = [line.encode() for line in lines_of(text)]

    def is_plain(self, name: str, line: int, start: int | None = None, end: int | None = None) -> bool:
        """Tell whether a name is plain letters and stands at a byte offset (its start or its end) of a line."""
        first = start if start is not None else (end or 0) - len(name)
        return name.isascii() and self._lines[line - 1][max(first, 0) : first + len(name)] == name.encode()
