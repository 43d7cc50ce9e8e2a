"""Spoken English to a robot program, offline: by a grammar, without a network."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

from simaps_viz.errors import CommandError
from simaps_viz.language.asides import clauses, is_reason, is_statement, plainly
from simaps_viz.language.grammar import Chart
from simaps_viz.language.nouns import ONE, Phrase, quoted
from simaps_viz.language.orders import EVERYTHING, GRAMMAR
from simaps_viz.language.program import ProgramError, parse_program
from simaps_viz.language.tokenizer import Sentence, read_words
from simaps_viz.language.words import Vocabulary, plain, plural, singular
from simaps_viz.language.writer import Writer

MAX_LENGTH: Final = 500
"""Characters of a command."""
_MAX_ALTERNATIVES: Final = 4
_MAX_QUOTED: Final = 60
"""Length to which an error message shortens the command that it quotes, characters."""
_MAX_NAME: Final = 40
"""Characters of a class that a refusal takes for an example."""
MAX_SUGGESTIONS: Final = 3
"""Commands that are offered instead of one that was refused."""
_MARGIN: Final = 0.28
"""How much less likely than the program another reading may be."""
_END: Final = re.compile(r"(?:\W|\b(?:and|then|but|next)\b)+$")
_ENDS: Final = ("COMMA", "AND", "THEN", "STOP")
_MEANT: Final = frozenset({
    "NOUN", "NOUNS", "ROOMKIND", "ROOM", "ROOMS", "PLACE", "SPOT", "NUM", "IF", "IFSEE", "IFKNOWN", "UNLESS", "NEVER",
    "NOT", "WITHOUT", "EXCEPT", "OTHERWISE", "UNTIL", "NOWAIT", "BEFORE", "AFTER", "HANDS", "NOTHING",
    "BUTFIRST", "BUTNO", "NOTBEFORE", "VIA", "WHENEVER", "AVOID", "GO", "APPROACH", "TURN", "FACE", "LOOK",
    "CIRCLE", "PASS", "SPIN", "STAND", "HALT", "RETURN", "BACKUP", "LEAVE", "STRAFE", "MAKE", "KEEP", "TAKE",
    "STEPS", "UTURN", "HOWMANY", "EXIST", "SEEQ", "COUNT", "WHATCOLOR", "HOWTOGET", "WHERE", "WHICH",
    "WHAT", "HOWFAR", "HOWBIG",
})  # fmt: skip
"""Tokens of what is done, with what, and on what condition: a clause that has one of them is never only talk."""
_DONE: Final = frozenset(
    {"GO", "APPROACH", "TURN", "FACE", "LOOK", "CIRCLE", "PASS", "RETURN", "HANDS", "NEVER", "NOT", "TO"}
)
"""Tokens of what is done: a clause that has one of them is no heading."""
_OPENS: Final = frozenset(["TO", "TOWARD", "NEAR", "AT", "IN", "ON", "BY", "FOR", "FROM", "AND", "THEN"])
_DETERMINERS: Final = frozenset(["DET", "INDEF", "EVERY"])
_LOST: Final = frozenset(["left", "lost", "put", "forgot", "forgotten", "dropped", "misplaced"])
_FOUND: Final = frozenset(["somebody", "someone"])
"""Who left a thing where it still is: "somebody left a cup on the table"."""
_NAMES: Final = frozenset(["NOUN", "NOUNS", "ROOMKIND", "ROOM", "ROOMS", "PLACE", "SPOT"])


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
    try:
        return _understood(text, vocabulary)
    except CommandError as error:
        for shorter, notes, named in _without_asides(text, vocabulary):
            with suppress(CommandError):
                reading = _understood(shorter, vocabulary, named)
                return replace(reading, notes=(*notes, *reading.notes))
        suggested = instead(text, labels) or examples(labels)
        said = str(error) if str(error).endswith(("?", ".")) else f"{error}."
        raise CommandError(f"{said} Try: {', '.join(map(quoted, suggested))}.", suggestions=suggested) from None


def instead(text: str, labels: Sequence[str] | Mapping[str, int]) -> tuple[str, ...]:
    """Return up to three commands that can be read, like one that was refused; none where every word is known.

    A word that is not known, or a thing that the map lacks, gives way to what is spelled like it or of its kind, or is
    left out; or only what comes before it is kept; or the most frequent things take its place.
    """
    vocabulary = Vocabulary(labels)
    try:
        sentence = read_words(text[:MAX_LENGTH], vocabulary)
    except CommandError:
        return ()
    words, (at, end) = sentence.words, _strange(sentence)
    if end - at in (0, len(words)):
        return ()

    def readable(commands: Iterable[Sequence[str]]) -> Iterator[str]:
        for said in (_END.sub("", " ".join(command)) for command in commands):
            with suppress(CommandError):
                if "search(" not in _understood(said, vocabulary).program:
                    yield said

    name = " ".join(words[at:end])
    near = [vocabulary.suggest(name) or "", ""] if name in sentence.unknown else []
    frequent = sorted(vocabulary.labels, key=lambda label: -(vocabulary.count(label) or 0))[:MAX_SUGGESTIONS]
    number = str if singular(name) == name else plural
    # Another thing is offered only where a thing was named: "sing me a song" is not "chair me a song".
    is_thing = name not in sentence.unknown or (
        at and not _DETERMINERS.isdisjoint(edge.kind for edge in sentence.edges[at - 1])
    )
    likely, often = (
        [(*words[:at], *(number(plain(other)).split() if other else ()), *words[end:]) for other in others]
        for others in ([*near, *vocabulary.kin(name)], frequent)
    )
    before = readable(words[:n] for n in range(at, 1, -1))
    found = [*readable(likely)] or [*islice(before, 1)] or [*readable(often if is_thing else ())]
    return tuple(dict.fromkeys(found))[:MAX_SUGGESTIONS]


def _strange(sentence: Sentence) -> tuple[int, int]:
    """Return where the first words are that are unknown or name what the map lacks, and where they end, else (0, 0)."""
    for at, edges in enumerate(sentence.edges[:-1]):
        named = [edge for edge in edges if edge.kind in ("NOUN", "NOUNS")]
        if sentence.words[at] in sentence.unknown or (named and not any(edge.value.known for edge in named)):
            return at, max([at + 1, *(edge.end for edge in named)])
    return 0, 0


def _understood(text: str, vocabulary: Vocabulary, named: Phrase | None = None) -> Reading:
    """Read a command to the last word; ``named`` is what was spoken of before it."""
    sentence = read_words(text, vocabulary)
    if not sentence.words:
        raise CommandError("nothing to do was said")
    # Where words are unknown, spelling is corrected, if the command can be read then.
    if sentence.unknown:
        with suppress(CommandError):
            better = read_words(text, vocabulary, correcting=True)
            if better.words != sentence.words:
                return _read(better, vocabulary, named)
    return _read(sentence, vocabulary, named)


def _without_asides(text: str, vocabulary: Vocabulary) -> Iterator[tuple[str, list[str], Phrase | None]]:
    """Return a text without clauses that say nothing about what is to be done, notes on them, and what they name.

    "Netflix and chill: go to the sofa", "my feet hurt, so take me to the sofa", "I lost my handbag. Where is it?"
    First without reasons and talk in which no word counts, then also without what is only said to be so, and at last
    without what a person wants to do there.
    """
    plain = plainly(text)
    for purposes in (False, re.search(r"\b(?:i|me|we|us)\b", plain) is not None):
        said = list(clauses(plain, purposes=purposes))
        sentences = [read_words(clause, vocabulary) for clause in said]
        talk, stated = [], []
        for clause, sentence in zip(said, sentences, strict=True):
            names_things = any(edge.kind in _NAMES for here in sentence.edges for edge in here)
            talk.append(is_reason(clause) or _is_talk(sentence) or (purposes and _is_purpose(sentence)))
            stated.append(talk[-1] or is_statement(clause, names_things=names_things))
        for dropped in (talk, stated):
            kept = [clause for clause, out in zip(said, dropped, strict=True) if not out]
            if any(dropped) and any(clause.strip() for clause in kept):
                left_out = [at for at, out in enumerate(dropped) if out and sentences[at].words]
                brief = [_in_brief(said[at].strip(" ,.;:!")) for at in left_out]
                notes = [f'"{one}" is left out: it names nothing to do' for one in brief]
                named = next((found for at in left_out if (found := _first_named(sentences[at]))), None)
                yield "".join(kept), notes, named


def _is_talk(sentence: Sentence) -> bool:
    """Whether a clause has a word that is not known, and nothing to do, no thing, no place and no condition."""
    kinds = {edge.kind for here in sentence.edges for edge in here}
    opens = {edge.kind for edge in sentence.edges[0]} if sentence.words else set()
    listed = not opens.isdisjoint(_DETERMINERS) and "IS" not in kinds  # "the sofa, the zorgon"
    heads = sentence.words[-1:] in (("!",), (":",)) and len(sentence.words) <= 4 and kinds.isdisjoint(_DONE)
    if heads and sentence.unknown:  # "plant party!"
        return True
    return bool(sentence.unknown) and kinds.isdisjoint(_MEANT) and opens.isdisjoint(_OPENS) and not listed


def _is_purpose(sentence: Sentence) -> bool:
    """Whether a clause says what a person will do there, as "to get rid of this cup", "where I can wash my hands"."""
    if sentence.words[:1] == ("where",):
        return not any(edge.kind in _NAMES for here in sentence.edges for edge in here)
    return len(sentence.words) > 2 and sentence.words[0] == "to" and any(e.kind == "HANDS" for e in sentence.edges[1])


def _first_named(sentence: Sentence) -> Phrase | None:
    """Return the first thing that a clause names, with all that is said of it unless it is no longer there."""
    chart = Chart(GRAMMAR, sentence.edges)
    lost = not _LOST.isdisjoint(sentence.words) and _FOUND.isdisjoint(sentence.words)
    for at in range(len(sentence.words)):
        found = [one.value for one in chart.parse("thing", at) if ONE not in one.value.text]
        found = [one for one in found if "search(" not in one.text and one.base != EVERYTHING.base]
        if found:
            return found[-1 if lost else 0]
    return None


def too_long(text: str) -> str:
    """Return the error for a command that is too long, with a way to shorten it."""
    return (
        f"This command has {len(text)} characters, and at most {MAX_LENGTH} can be read. "
        "Say it in fewer words, or give one command after the other."
    )


def examples(labels: Iterable[str]) -> tuple[str, ...]:
    """Return commands that work on a map with these classes."""
    names = [plain(label) for label in labels if len(label) <= _MAX_NAME] or ["chair"]
    first, other = names[0], names[min(1, len(names) - 1)]
    return f"go to the {first}", f"go to the {first} nearest the {other}", "turn right, then go forward 1 m"


def _read(sentence: Sentence, vocabulary: Vocabulary, named: Phrase | None) -> Reading:
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
        writer = Writer(named)
        try:
            program = writer.write(reading.value)
            parse_program(program)
            programs.setdefault(program, writer)
        except ProgramError:
            said = _in_brief(" ".join(sentence.words))
            refusal = refusal or CommandError(f'Not understood: "{said}". Say it in other words, or in several steps')
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
    if chart.refusal is not None and chart.refusal[0] >= at:
        return f"Not understood: {chart.refusal[1]}."
    starts = [i for i in range(len(words)) if i == 0 or any(e.kind in _ENDS for e in edges[i - 1])]
    begins = max((i for i in starts if i <= at), default=0)
    kinds = {edge.kind for edge in edges[begins]}
    clause = _in_brief(" ".join(words[begins:]))
    if any(edge.kind in ("AVOID", "NEVER") for here in edges[begins : at + 1] for edge in here):
        return f'Not understood: "{clause}". A command says what to do, not what to leave out.'
    if kinds & {"HANDS", "TAKE"}:
        can = "The robot has no hands and carries nothing: it can drive, turn, look, and answer questions."
        return f'Not understood: "{clause}". {can}'
    if sentence.unknown:
        unknown = next((word for word in (words[begins], *words[at:]) if word in sentence.unknown), sentence.unknown[0])
        near = vocabulary.suggest(unknown)
        hint = f" Did you mean {near}?" if near else ""
        return f'Not understood: "{_in_brief(unknown)}".{hint}'
    if at >= len(words):
        return f'Not understood: "{clause}" seems to be cut short.'
    return f'Not understood: "{_in_brief(words[at])}" in "{clause}".'


def _in_brief(said: str) -> str:
    return said if len(said) <= _MAX_QUOTED else f"{said[: _MAX_QUOTED - 1].rstrip()}…"
