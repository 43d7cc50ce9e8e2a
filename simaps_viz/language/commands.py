"""Spoken English to a robot program, offline: by a grammar, without a network."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Final, Literal

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedEOF, UnexpectedInput, VisitError
from lark.lexer import Lexer
from lark.visitors import CollapseAmbiguities

from simaps_viz.errors import CommandError
from simaps_viz.language.builder import Builder
from simaps_viz.language.lexicon import load_text
from simaps_viz.language.selection import PARTS
from simaps_viz.language.tokenizer import clauses, tokens
from simaps_viz.language.words import Vocabulary

MAX_READINGS: Final = 24
_COST: Final = {"compound": 1.0, "group": 0.2, "go_beside": -0.5, "beside_at": -0.5, "go_front": -0.5}
_COST_OF_PART: Final = 0.3
_COST_OF_ONE_OF_MANY: Final = 0.6
_THINGS: Final = ("described", "another_one", "compound", "group")
MAX_LENGTH: Final = 500
"""Characters of a command."""
_MAX_ALTERNATIVES: Final = 4
_MAX_QUOTED: Final = 60
"""Length to which an error message shortens the command that it quotes, characters."""
_MAX_NAME: Final = 40
"""Characters of a class that a refusal takes for an example."""
_MAX_WORDS: Final = 40
_MAX_LINKS: Final = 5
_LINKS: Final = (
    "AT BEHIND BETWEEN BY EAST FARTHEST FROM FRONT LEFT NEAR NEAREST NORTH OF ON RIGHT SEE SEEN SOUTH TO VIEW WEST"
)
_LINKING: Final = frozenset(_LINKS.split())
"""Tokens that may tie a thing to any of those before it."""
_QUESTION: Final = re.compile(r"\s*(?:which|what|where|how|who|whose|why|is|are|does|did)\b(?!\s+about)", re.IGNORECASE)
_STARTS: Final = {
    "start_go": frozenset(
        ["APPROACH", "BACKUP", "CIRCLE", "GO", "HALT", "PASS", "RETURN", "STAND", "STEPS", "STRAFE", "TAKE"]
    ),
    "start_turn": frozenset(["FACE", "KEEP", "LOOK", "SPIN", "TURN", "UTURN", "WITH"]),
}


@dataclass(frozen=True)
class Reading:
    """The interpretation of a command."""

    program: str
    notes: tuple[str, ...] = ()
    """Notes on the interpretation, such as synonyms used and words added."""
    alternatives: tuple[str, ...] = ()
    """Programs of the other readings, the likeliest first."""


def read_command(text: str, labels: Sequence[str] | Mapping[str, int]) -> Reading:
    """Read an English command.

    A thing that the map lacks keeps the name used in the command, so that running the program reports that name.

    Args:
        text: one or more sentences.
        labels: class names of the map, best with the number of instances of each: a word like "table" then takes in
            coffee tables where there are too few of the class "table" itself.

    Raises:
        CommandError: naming the words that were not understood, with examples that work.
    """
    if len(text) > MAX_LENGTH:
        raise CommandError(too_long(text))
    if _QUESTION.match(text):
        raise CommandError(f"Not understood: a question; the robot takes orders only. {examples(labels)}")
    vocabulary = Vocabulary(labels)
    spoken = tokens(text, vocabulary)
    if not spoken:
        raise CommandError(f"nothing to do was said. {examples(labels)}")
    # Where words are unknown, spelling is corrected, if the command can be read then.
    if not any(word.type == "WORD" for word in spoken):
        return _read(text, spoken, vocabulary, ())
    try:
        plainly: Reading | CommandError = _read(text, spoken, vocabulary, ())
    except CommandError as error:
        plainly = error
    corrected: list[str] = []
    try:
        better = tokens(text, vocabulary, corrected=corrected)
        if corrected:
            return _read(text, better, vocabulary, corrected)
    except CommandError:
        corrected.clear()
    if isinstance(plainly, CommandError):
        raise plainly
    return plainly


def too_long(text: str) -> str:
    """Return the error for a command that is too long, with a way to shorten it."""
    return (
        f"This command has {len(text)} characters, and at most {MAX_LENGTH} can be read. "
        "Say it in fewer words, or give one command after the other."
    )


def examples(labels: Iterable[str]) -> str:
    """Return commands that work on a map with these classes, in one sentence."""
    names = [label for label in labels if len(label) <= _MAX_NAME] or ["chair"]
    first, other = names[0], names[min(1, len(names) - 1)]
    return (
        f'Try: "go to the second {first}", "go to the {first} nearest the {other}", '
        f'"go to the left of the {other}", "turn right, then go forward 1 m".'
    )


def _read(text: str, spoken: Sequence[Token], vocabulary: Vocabulary, notes: Sequence[str]) -> Reading:
    _refuse_what_orders_cannot_say(spoken, vocabulary)
    manners = [f'"{word}" is left out: the robot has one way to drive' for word in spoken if word.type == "MANNER"]
    spoken = [word for word in spoken if word.type != "MANNER"]
    # Parse every clause into its readings, the likeliest first.
    parses: list[list[Tree[Any]]] = []
    for clause in clauses(spoken):
        try:
            if len(clause) > _MAX_WORDS:
                raise CommandError(f"one step takes at most {_MAX_WORDS} words, found {len(clause)}; say it in several")
            if clause[0].type == "WORD" or all(word.type in ("WORD", "DET") for word in clause):
                raise UnexpectedEOF([])
            parses.append(_parsed(clause))
        except UnexpectedInput as error:
            what = _what_was_not_understood(text, spoken, clause, error)
            raise CommandError(f"{what} {examples(vocabulary.labels)}") from None
    if not parses:
        raise CommandError(f'Not understood: "{text.strip()}" holds nothing to do. {examples(vocabulary.labels)}')
    # Build the likeliest program; the other trees and the other meanings of words give the alternatives.
    builder, likeliest, others = _likeliest(parses, vocabulary)
    program = builder.program
    alternatives = [_build(trees, vocabulary, {}) for trees in others]
    for word, labels in builder.ambiguous.items():
        alternatives += [_build(likeliest, vocabulary, {word: label}) for label in labels]
    programs = dict.fromkeys(built.program for built in alternatives if built is not None)
    kept = tuple(other for other in programs if other != program)
    return Reading(program, (*notes, *manners, *builder.notes), kept[:_MAX_ALTERNATIVES])


def _likeliest(
    parses: Sequence[Sequence[Tree[Any]]], vocabulary: Vocabulary
) -> tuple[Builder, list[Tree[Any]], list[list[Tree[Any]]]]:
    """Build the likeliest reading of every clause that makes sense; returns its trees and those of the others."""
    builder, chosen, rest = Builder(vocabulary), [], []
    for readings in parses:
        refusal: CommandError | None = None
        for at, tree in enumerate(readings):
            attempt = builder.copy()
            try:
                _add(attempt, tree)
            except CommandError as error:
                refusal = refusal or error
                continue
            rest += [(len(chosen), other) for other in readings[at + 1 :]]
            builder = attempt
            chosen.append(tree)
            break
        else:
            raise refusal or CommandError("nothing to do was said")
    others = [[*chosen[:at], other, *chosen[at + 1 :]] for at, other in rest]
    return builder, chosen, others[:_MAX_ALTERNATIVES]


def _build(trees: Sequence[Tree[Any]], vocabulary: Vocabulary, choices: dict[str, str]) -> Builder | None:
    builder = Builder(vocabulary, choices)
    try:
        for tree in trees:
            _add(builder, tree)
    except CommandError:
        return None
    return builder


def _add(builder: Builder, tree: Tree[Any]) -> None:
    try:
        builder.transform(tree)
    except VisitError as error:
        if isinstance(error.orig_exc, CommandError):
            raise error.orig_exc from None
        raise


def readings_of(tree: Tree[Any]) -> list[Tree[Any]]:
    """Return the single trees of an ambiguous one, the likeliest first; of equally likely ones, the parser's first."""
    trees = CollapseAmbiguities().transform(tree) if any(tree.find_data("_ambig")) else [tree]
    unique = sorted(dict.fromkeys(trees), key=lambda t: round(_cost(t, 0), 6))
    # "second from the left of the table" may also mean: of those to its left, the second
    of_side = [_renamed(t, "from_side_of", "side_of") for t in unique if any(t.find_data("from_side_of"))]
    return [*unique, *of_side][:MAX_READINGS]


def _renamed(tree: Tree[Any], name: str, other: str) -> Tree[Any]:
    children = [_renamed(child, name, other) if isinstance(child, Tree) else child for child in tree.children]
    return Tree(other if tree.data == name else tree.data, children)


def _cost(tree: Tree[Any], depth: int) -> float:
    """Return how unlikely a reading is: a phrase belongs to the nearest thing before it, what is seen to the first."""
    # Sum the costs of the rules, counting how many things enclose each.
    cost = _COST.get(str(tree.data), 0.0)
    deeper = depth + (str(tree.data) in _THINGS)
    for child in tree.children:
        if isinstance(child, Tree):
            cost += _cost(child, deeper)
    if tree.data == "described" and any(_is_plural(child) for child in tree.children):
        cost += _COST_OF_ONE_OF_MANY
    if str(tree.data) in PARTS:
        cost += _COST_OF_PART
    # Of two attachments the one to the nearer, deeper thing is cheaper; what is seen belongs to the outermost.
    if str(tree.data) == "view":
        cost += 0.1 * depth
    elif depth and str(tree.data) not in _THINGS and str(tree.data) not in ("noun", "nouns", "amount", "side", "pair"):
        cost -= 0.1 * depth
    return cost


def _is_plural(noun: object) -> bool:
    return isinstance(noun, Tree) and noun.data == "noun" and getattr(noun.children[0], "type", "") == "NOUNS"


class _Tokens(Lexer):
    """Hands the parser the tokens made by ``tokenizer.tokens``."""

    def __init__(self, lexer_conf: Any) -> None:
        pass

    def lex(self, data: Sequence[Token]) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        yield from data


def _parsed(clause: Sequence[Token]) -> list[Tree[Any]]:
    """Return the readings of a clause, the likeliest first."""
    shapes = _shapes(tuple(word.type for word in clause))
    return [_filled(shape, clause) for shape in shapes]


@lru_cache(512)
def _shapes(kinds: tuple[str, ...]) -> tuple[Tree[Any], ...]:
    """Return the readings of a clause of such tokens, with their positions for words: many clauses share a shape.

    Which part of the grammar is tried follows from the first token.
    """
    start = next((name for name, words in _STARTS.items() if kinds[0] in words), "start_any")
    places = [Token(kind, str(at)) for at, kind in enumerate(kinds)]
    # The number of readings grows with the Catalan numbers: beyond a few attachments only one is made.
    ambiguity = "explicit" if sum(kind in _LINKING for kind in kinds) <= _MAX_LINKS else "resolve"
    return tuple(readings_of(_parser(ambiguity).parse(places, start)))  # pyright: ignore[reportArgumentType]


def _filled(shape: Tree[Any], clause: Sequence[Token]) -> Tree[Any]:
    children = [_filled(c, clause) if isinstance(c, Tree) else clause[int(c)] for c in shape.children]
    return Tree(shape.data, children)


@cache
def _parser(ambiguity: Literal["explicit", "resolve"]) -> Lark:
    return Lark(
        load_text("commands.lark"),
        parser="earley",
        lexer=_Tokens,
        start=["start_any", *_STARTS],
        maybe_placeholders=False,
        ambiguity=ambiguity,
    )


def _refuse_what_orders_cannot_say(spoken: Sequence[Token], vocabulary: Vocabulary) -> None:
    for word in spoken:
        if word.type == "NOT":
            raise CommandError(
                f'Not understood: "{word}". A command says what to do, not what to leave out. '
                f"{examples(vocabulary.labels)}"
            )
        if word.type == "BEFORE":
            raise CommandError(
                f'Not understood: "{word}". Say the steps in the order to do them, with "then" between them. '
                f"{examples(vocabulary.labels)}"
            )


def _what_was_not_understood(
    text: str, spoken: Sequence[Token], clause: Sequence[Token], error: UnexpectedInput
) -> str:
    unknown = list(dict.fromkeys(str(word) for word in spoken if word.type == "WORD"))
    if unknown:
        can = "The robot can drive, turn and face things, and knows them by class and place only."
        return f"Not understood: {_in_brief(', '.join(unknown))}. {can}"
    if clause[0].type == "TAKE":
        said = _in_brief(" ".join(clause))
        return f'Not understood: "{said}". The robot carries nothing, but can lead the way to things.'
    stopped = getattr(error, "token", None)
    at = int(stopped) if isinstance(stopped, Token) and str(stopped).isdigit() else None
    if at is None:
        said = text.strip() if len(clause) == len(spoken) else " ".join(clause)
        return f'Not understood: "{_in_brief(said)}" seems to be cut short.'
    return f'Not understood, from "{_in_brief(" ".join(clause[at:]))}" on.'


def _in_brief(said: str) -> str:
    return said if len(said) <= _MAX_QUOTED else f"{said[: _MAX_QUOTED - 1].rstrip()}…"
