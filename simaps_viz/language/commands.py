"""Spoken English to a robot program, offline: by a grammar, without a network."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

from simaps_viz.errors import CommandError
from simaps_viz.language.grammar import Chart
from simaps_viz.language.nouns import quoted
from simaps_viz.language.orders import GRAMMAR
from simaps_viz.language.program import ProgramError, parse_program
from simaps_viz.language.tokenizer import Sentence, read_words
from simaps_viz.language.words import Vocabulary
from simaps_viz.language.writer import Writer

MAX_LENGTH: Final = 500
"""Characters of a command."""
_MAX_ALTERNATIVES: Final = 4
_MAX_QUOTED: Final = 60
"""Length to which an error message shortens the command that it quotes, characters."""
_MAX_NAME: Final = 40
"""Characters of a class that a refusal takes for an example."""
_MARGIN: Final = 0.28
"""How much less likely than the program another reading may be."""
_ENDS: Final = ("COMMA", "AND", "THEN", "STOP")
_MEANT: Final = frozenset({
    "NOUN", "NOUNS", "ROOMKIND", "ROOM", "ROOMS", "PLACE", "SPOT", "NUM", "IF", "IFSEE", "UNLESS", "NEVER",
    "NOT", "WITHOUT", "EXCEPT", "OTHERWISE", "UNTIL", "NOWAIT", "BEFORE", "AFTER", "HANDS", "NOTHING",
    "BUTFIRST", "BUTNO", "NOTBEFORE", "VIA", "WHENEVER", "AVOID", "GO", "APPROACH", "TURN", "FACE", "LOOK",
    "CIRCLE", "PASS", "SPIN", "STAND", "HALT", "RETURN", "BACKUP", "LEAVE", "STRAFE", "MAKE", "KEEP", "TAKE",
    "STEPS", "UTURN", "HOWMANY", "WHERE", "WHICH", "WHAT", "HOWFAR", "HOWBIG",
})  # fmt: skip
"""Tokens of what is done, with what, and on what condition: a clause that has one of them is never only talk."""
_OPENS: Final = frozenset(["AT", "IN", "ON", "BY", "FOR", "FROM", "AND", "THEN"])


@dataclass(frozen=True)
class Reading:
    """The interpretation of a command."""

    program: str
    notes: tuple[str, ...] = ()
    """Notes on the interpretation, such as synonyms used and words added."""
    alternatives: tuple[str, ...] = ()
    """Programs of the other readings, the likeliest first."""


def read_command(text: str, labels: Sequence[str] | Mapping[str, int]) -> Reading:
    """Read an English command or question.

    A thing that the map lacks is searched for by the words used, so that running the program finds or reports it.

    Args:
        text: one or more sentences.
        labels: class names of the map, best with the number of instances of each: a word like "table" then takes in
            coffee tables where there are too few of the class "table" itself.

    Raises:
        CommandError: naming the word that was not understood, with examples that work.
    """
    if len(text) > MAX_LENGTH:
        raise CommandError(too_long(text))
    vocabulary = Vocabulary(labels)
    sentence = read_words(text, vocabulary)
    if not sentence.words:
        raise CommandError(f"nothing to do was said. {examples(labels)}")
    # Where words are unknown, spelling is corrected, if the command can be read then.
    if sentence.unknown:
        try:
            better = read_words(text, vocabulary, correcting=True)
            if better.words != sentence.words:
                return _read(better, vocabulary)
        except CommandError:
            pass
    try:
        return _read(sentence, vocabulary)
    except CommandError:
        shorter = _without_talk(sentence)
        if shorter is None:
            raise
        with suppress(CommandError):
            return _read(shorter, vocabulary)
        raise


def _without_talk(sentence: Sentence) -> Sentence | None:
    """Return a sentence without the clauses around it that are only talk, with a note on each; None if it has none.

    "Netflix and chill: go to the sofa": a clause is talk if it holds a word that is not known, and nothing that is
    done, where, with what, or on what condition.
    """
    words, edges = sentence.words, sentence.edges
    ends = [at for at in range(len(words)) if any(edge.kind in ("COMMA", "STOP") for edge in edges[at])]
    clauses = [range(a + 1, b) for a, b in pairwise([-1, *ends, len(words)])]
    unknown = set(sentence.unknown)
    talk = [
        any(words[at] in unknown for at in clause)
        and not any(edge.kind in _MEANT for at in clause for edge in edges[at])
        and not any(edge.kind in _OPENS for edge in edges[clause.start])
        for clause in clauses
    ]
    kept = [at for at, (clause, is_talk) in enumerate(zip(clauses, talk, strict=True)) if clause and not is_talk]
    if not kept or not any(talk[: kept[0]] + talk[kept[-1] + 1 :]):
        return None
    start, end = clauses[kept[0]].start, clauses[kept[-1]].stop
    end += end < len(words)  # a question mark says what is wanted
    left_out = [
        " ".join(words[clause.start : clause.stop])
        for at, clause in enumerate(clauses)
        if talk[at] and not kept[0] < at < kept[-1]
    ]
    notes = tuple(f'"{_in_brief(said)}" is left out: it names nothing to do' for said in left_out)
    within = [tuple(replace(e, end=e.end - start) for e in here if e.end <= end) for here in edges[start:end]]
    return Sentence(words[start:end], (*within, ()), (*sentence.notes, *notes))


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


def _read(sentence: Sentence, vocabulary: Vocabulary) -> Reading:
    chart = Chart(GRAMMAR, sentence.edges)
    readings = [found for found in chart.parse("start") if found.end == len(sentence.words)]
    if not readings:
        raise CommandError(_refusal(sentence, chart, vocabulary))
    # The likeliest reading that makes sense is the program; the others and the other meanings of words come after it.
    programs: dict[str, Writer] = {}
    refusal: CommandError | None = None
    for reading in sorted(readings, key=lambda r: r.cost):
        if programs and reading.cost > readings[0].cost + _MARGIN:
            break
        writer = Writer()
        try:
            program = writer.write(reading.value)
            parse_program(program)
            programs.setdefault(program, writer)
        except ProgramError:
            refusal = refusal or CommandError(
                f'Not understood: "{_in_brief(" ".join(sentence.words))}". Say it in other words, or in several steps.'
            )
        except CommandError as error:
            refusal = refusal or error
    if not programs:
        raise refusal or CommandError("nothing to do was said")
    program, writer = next(iter(programs.items()))
    others = list(programs)[1:]
    others += [program.replace(quoted(one), quoted(other)) for one, other in writer.others]
    kept = tuple(dict.fromkeys(other for other in others if other != program))
    return Reading(program, (*sentence.notes, *writer.notes), kept[:_MAX_ALTERNATIVES])


def _refusal(sentence: Sentence, chart: Chart, vocabulary: Vocabulary) -> str:
    """Name the one word that was not understood, or what the order lacks."""
    words, edges, at = sentence.words, sentence.edges, min(chart.furthest, len(sentence.words))
    try_this = examples(vocabulary.labels)
    if chart.refusal is not None and chart.refusal[0] >= at:
        return f"Not understood: {chart.refusal[1]}. {try_this}"
    starts = [i for i in range(len(words)) if i == 0 or any(e.kind in _ENDS for e in edges[i - 1])]
    begins = max((i for i in starts if i <= at), default=0)
    kinds = {edge.kind for edge in edges[begins]}
    clause = _in_brief(" ".join(words[begins:]))
    if any(edge.kind in ("AVOID", "NEVER") for here in edges[begins : at + 1] for edge in here):
        return f'Not understood: "{clause}". A command says what to do, not what to leave out. {try_this}'
    if kinds & {"HANDS", "TAKE"}:
        can = "The robot has no hands and carries nothing: it can drive, turn, look, and answer questions."
        return f'Not understood: "{clause}". {can} {try_this}'
    if sentence.unknown:
        unknown = next((word for word in (words[begins], *words[at:]) if word in sentence.unknown), sentence.unknown[0])
        near = vocabulary.suggest(unknown)
        hint = f" Did you mean {near}?" if near else ""
        return f'Not understood: "{_in_brief(unknown)}".{hint} {try_this}'
    if at >= len(words):
        return f'Not understood: "{clause}" seems to be cut short. {try_this}'
    return f'Not understood: "{_in_brief(words[at])}" in "{clause}". {try_this}'


def _in_brief(said: str) -> str:
    return said if len(said) <= _MAX_QUOTED else f"{said[: _MAX_QUOTED - 1].rstrip()}…"
