"""The documentation's pages: their fenced blocks, and the commands in them."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = (
    *("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"),
    *sorted(f"docs/{path.name}" for path in (ROOT / "docs").glob("*.md")),
)
SHELL = ("", "sh", "bash", "console")
"""Languages of fenced blocks that hold commands."""
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)
_INDENTED = re.compile(r"^ {4}(?:[A-Z_]+=\S+ )?((?:simaps |python apps/).*)$", re.M)
_INLINE = re.compile(r"(?<!`)`((?:simaps |python apps/)[^`]+)`")


@dataclass(frozen=True)
class Line:
    page: str
    number: int
    """Line number, from 1."""
    text: str
    """Without the comment behind it."""

    @property
    def words(self) -> list[str]:
        return shlex.split(self.text)

    def __str__(self) -> str:
        return f"{self.page}:{self.number}: {self.text}"


def blocks(page: str, languages: tuple[str, ...]) -> Iterator[tuple[int, str]]:
    """Return the line number and the text of each fenced block in one of these languages."""
    text = (ROOT / page).read_text()
    for found in _BLOCK.finditer(text):
        if found[1] in languages:
            yield text.count("\n", 0, found.start(2)) + 1, found[2]


def shell_lines(page: str) -> list[Line]:
    """Return every command line of a page's shell blocks, those broken with a backslash joined."""
    found = []
    for start, block in blocks(page, SHELL):
        begun = ""
        for offset, line in enumerate(block.splitlines()):
            begun += line
            if begun.endswith("\\"):
                begun = begun[:-1]
                continue
            text = shlex.join(shlex.split(begun, comments=True))
            if text:
                found.append(Line(page, start + offset, text))
            begun = ""
    return found


def inline_commands(page: str) -> list[Line]:
    """Return the commands that stand in the text, those with a placeholder such as MAP left out."""
    outside = _outside(page)
    found = []
    for span in _INLINE.finditer(outside):
        text = re.sub(r"\s+", " ", span[1])
        if not re.search(r"\b[A-Z]{2,}\b|…|\.\.\.|\|", re.sub(r'"[^"]*"', "", text)):
            found.append(Line(page, outside.count("\n", 0, span.start()) + 1, text))
    return found


def indented_commands(page: str) -> list[Line]:
    """Return the command lines that are set off by four spaces: shown, not to be run as they stand."""
    outside = _outside(page)
    return [
        Line(page, outside.count("\n", 0, line.start()) + 1, shlex.join(shlex.split(line[1], comments=True)))
        for line in _INDENTED.finditer(outside)
    ]


def links(page: str) -> list[str]:
    """Return what a page links to, other sites left out."""
    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", (ROOT / page).read_text())
    return [target for target in targets if not target.startswith("http")]


def _outside(page: str) -> str:
    """Return a page with its fenced blocks blanked."""
    return _BLOCK.sub(lambda block: "\n" * block[0].count("\n"), (ROOT / page).read_text())
