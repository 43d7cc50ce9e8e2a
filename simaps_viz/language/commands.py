"""Spoken English to a robot program, offline: a grammar, no network."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedInput, VisitError

from simaps_viz.errors import CommandError
from simaps_viz.language.builder import Builder
from simaps_viz.language.spoken import UnknownWordsLexer, tokens
from simaps_viz.language.words import Vocabulary

MAX_LENGTH: Final = 500
"""Characters of a command."""
_MAX_ALTERNATIVES: Final = 4


@dataclass(frozen=True)
class Reading:
    """What a command was understood to mean."""

    program: str
    notes: tuple[str, ...] = ()
    """How words were read, e.g. synonyms and what was left unsaid."""
    alternatives: tuple[str, ...] = ()
    """Programs of the other readings, the likeliest first."""


def read_command(text: str, labels: Sequence[str]) -> Reading:
    """Read an English command.

    A thing the map does not have is kept as it was said, so that whoever runs the program refuses it by name.

    Args:
        text: one or more sentences.
        labels: class names of the map.

    Raises:
        CommandError: naming the words that were not understood, with examples that work.
    """
    if len(text) > MAX_LENGTH:
        raise CommandError(f"a command has at most {MAX_LENGTH} characters, found {len(text)}")
    vocabulary = Vocabulary(labels)
    spoken = tokens(text, vocabulary)
    if not spoken:
        raise CommandError(f"nothing to do was said. {examples(labels)}")
    try:
        tree = _parser().parse(spoken)  # pyright: ignore[reportArgumentType]
    except UnexpectedInput as error:
        raise CommandError(f"{_what_was_not_understood(text, spoken, error)} {examples(labels)}") from None
    program, builder = _build(tree, vocabulary, {})
    alternatives = [
        _build(tree, vocabulary, {word: label})[0] for word, others in builder.ambiguous.items() for label in others
    ]
    return Reading(program, tuple(builder.notes), tuple(alternatives[:_MAX_ALTERNATIVES]))


def examples(labels: Sequence[str]) -> str:
    """Give commands that work on a map with these classes, in one sentence."""
    first = labels[0] if labels else "chair"
    other = labels[1] if len(labels) > 1 else first
    return (
        f'Try: "go to the second {first}", "go to the {first} nearest the {other}", '
        f'"go to the left of the {other}", "turn right, then go forward 1 m".'
    )


@cache
def _parser() -> Lark:
    grammar = Path(__file__).with_suffix(".lark").read_text(encoding="utf-8")
    return Lark(grammar, parser="earley", lexer=UnknownWordsLexer, maybe_placeholders=False)


def _build(tree: Tree, vocabulary: Vocabulary, choices: dict[str, str]) -> tuple[str, Builder]:
    builder = Builder(vocabulary, choices)
    try:
        return str(builder.transform(tree)), builder
    except VisitError as error:
        if isinstance(error.orig_exc, CommandError):
            raise error.orig_exc from None
        raise


def _what_was_not_understood(text: str, spoken: Sequence[Token], error: UnexpectedInput) -> str:
    unknown = list(dict.fromkeys(str(word) for word in spoken if word.type == "WORD"))
    if unknown:
        return f"Not understood: {', '.join(unknown)}."
    stopped = getattr(error, "token", None)
    at = next((i for i, word in enumerate(spoken) if word is stopped), None)
    if at is None:
        return f'Not understood: "{text.strip()}" seems to be cut short.'
    return f'Not understood, from "{" ".join(spoken[at:])}" on.'
